from dataclasses import dataclass, field

import pytest
from pydrake.common.yaml import yaml_load_data

from drake_pregrasp import ScenarioError
from drake_pregrasp.simulation.schema_check import check_mapping


@dataclass
class Round:
    radius: float = field(default=1.0, metadata={"above": 0})


@dataclass
class Square:
    edge: float = field(default=1.0, metadata={"above": 0})


@dataclass
class Schema:
    shape: Round | Square = field(default_factory=Round)
    shapes: list[Round | Square] = field(default_factory=list)


def check(text: str) -> None:
    check_mapping("file", "", yaml_load_data(text), Schema)


def test_a_tag_says_which_of_a_unions_classes_is_meant():
    for text in ("{radius: 2}", "!Square {edge: 2}"):
        check(f"shape: {text}")
    check("shapes: [{radius: 1}, !Square {}]")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("shape: {edge: 2}", "file: shape.edge: unknown key"),
        ("shape: !Square {radius: 2}", "file: shape.radius: unknown key"),
        ("shape: !Square {edge: 0}", "file: shape.edge: 0 must be a number above 0"),
        ("shape: !Sqare {edge: 2}", "file: shape: no such tag !Sqare; there are: !Round, !Square"),
        ("shape: 3", "file: shape: 3 must be a mapping with a tag out of: !Round, !Square"),
        ("shapes: [!Square {x: 1}]", "file: shapes[0].x: unknown key"),
    ],
)
def test_what_fits_none_of_them_is_refused(text, message):
    with pytest.raises(ScenarioError) as error:
        check(text)
    assert message in str(error.value)


def test_a_tag_where_nothing_is_to_choose_is_refused():
    with pytest.raises(ScenarioError, match="the tag !Schema is not allowed here"):
        check_mapping("file", "key", yaml_load_data("key: !Schema {}")["key"], Schema)
