"""YAML is read as Drake reads it, within bounds."""

import pickle
import sys

import pytest
from pydrake.common.yaml import yaml_load_data

from drake_pregrasp import ScenarioError
from drake_pregrasp.config import yaml_text
from drake_pregrasp.config.yaml_text import MAX_DEPTH, MAX_DIGITS, MAX_VALUES, parse_yaml
from drake_pregrasp.errors import LONGEST_KEY, LONGEST_MESSAGE, printable
from drake_pregrasp.resources import resource_folder

FILES = [*resource_folder("scenarios").glob("*.yaml"), *resource_folder("models").glob("*.yaml")]


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_shipped_files_are_read_as_drake_reads_them(file):
    text = file.read_text(encoding="utf-8")
    assert parse_yaml("file", text) == yaml_load_data(text, private=True)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a: 1\nb: {c: 1, c: 2}", "line 2: the key c occurs twice"),
        ("a: &a {x: 1}\nb: {<<: *a, <<: *a}", "line 2: the key << occurs twice"),
        (
            "a: &a {x: 1}\nb: &b {x: 2, y: 1}\nc: {<<: [*a, *b]}",
            "line 2: the key x occurs twice",
        ),
        ("? [1]\n: 2", "line 1: a list or mapping cannot be a key"),
        ("a: &a [*a]", "line 1: an alias contains itself"),
        ("a: *b", "is not valid YAML: line 1: found undefined alias"),
        ("a: 2001-02-30", "is not valid YAML: day is out of range"),
        ("!!python/object/apply:os.system [x]", "line 1: the tag tag:yaml.org,2002:python"),
        ("a: {_tag: [1]}", "line 1: _tag is not a key; write a tag"),
        (
            f"a: &a {'[' * 20}1{']' * 20}\nb: {'[' * 20}*a{']' * 20}",
            f"line 1: its aliases nest more than {MAX_DEPTH} levels deep",
        ),
        ("[" * (MAX_DEPTH + 1), f"is nested more than {MAX_DEPTH} levels deep"),
        ("1" * (MAX_DIGITS + 1), f"line 1: a whole number has more than {MAX_DIGITS} characters"),
        ("[" + "1," * MAX_VALUES + "]", f"has more than {MAX_VALUES} values"),
        ("x" * (yaml_text.MAX_BYTES + 1), f"has more than {yaml_text.MAX_BYTES} characters"),
    ],
)
def test_errors_are_one_printable_line(text, problem):
    with pytest.raises(ScenarioError) as caught:
        parse_yaml("file", text)
    assert str(caught.value).startswith(f"file: {problem}")
    assert str(caught.value).isprintable()


@pytest.mark.slow
def test_bounds_are_sharp():
    assert len(parse_yaml("file", "[" + "1," * (MAX_VALUES - 1) + "]")) == MAX_VALUES - 1
    parse_yaml("file", "[" * MAX_DEPTH + "]" * MAX_DEPTH)
    assert parse_yaml("file", "1" * MAX_DIGITS) == int("1" * MAX_DIGITS)


def test_a_tag_of_python_is_a_word_like_any_other():
    for module in ("antigravity", "this"):
        data = parse_yaml("file", f"!!python/module:{module} {{}}")
        assert data == {"_tag": f"tag:yaml.org,2002:python/module:{module}"}
        assert module not in sys.modules


def test_merges_may_be_overridden():
    assert parse_yaml("file", "a: &a {x: 1, y: 1}\nb: {<<: *a, x: 2}")["b"] == {"x": 2, "y": 1}
    both = parse_yaml("file", "a: &a {x: 1}\nb: &b {y: 2}\nc: {<<: [*a, *b]}")["c"]
    assert both == {"x": 1, "y": 2}
    nested = (
        "a: &a {x: 1}\nb: &b {<<: *a, y: 2}\nd: &d {z: 3}\nc: &c {<<: *d, w: 4}\ne: {<<: [*b, *c]}"
    )
    assert parse_yaml("file", nested)["e"] == {"x": 1, "y": 2, "z": 3, "w": 4}


def test_an_error_crosses_to_another_process_as_it_is():
    error = ScenarioError("file", "key", "is wrong")
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again)) == (ScenarioError, "file: key: is wrong")
    assert (again.source, again.key, again.problem) == ("file", "key", "is wrong")


def test_what_an_error_says_is_one_printable_line_of_bounded_length():
    said = str(ScenarioError("a\nb", "\x1b[31m" + "k" * 10**6, "\u202e" + "p" * 10**6))
    assert said.isprintable()
    assert len(said) <= LONGEST_KEY + LONGEST_MESSAGE + 100
    assert printable("as it is, é 中") == "as it is, é 中"
