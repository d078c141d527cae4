"""Configurations are validated by the ranges of their fields; keywords of 0.1 still work."""

from dataclasses import dataclass, field

import numpy as np
import pytest

import drake_pregrasp as dp
from drake_pregrasp.config.sensor_config import SensorConfig
from drake_pregrasp.config.validation import MAX_LENGTH, MAX_TEXT, check_fields


@dataclass
class Inner:
    rate: float = field(default=1.0, metadata={"above": 0, "at_most": 2})


@dataclass
class Outer:
    count: int = field(default=1, metadata={"at_least": 1})
    point: list[float] = field(default_factory=lambda: [0.0] * 3, metadata={"length": 3})
    rows: list[list[float]] = field(
        default_factory=list, metadata={"elements": {"length": 2, "at_least": 0}}
    )
    kinds: list[str] = field(default_factory=list, metadata={"one_of": ("a", "b")})
    flag: bool = False
    name: str = ""
    inner: Inner = field(default_factory=Inner)
    several: list[Inner] = field(default_factory=list)


@pytest.mark.parametrize(
    "config",
    [dp.PlannerConfig(), dp.EstimatorConfig(), SensorConfig(), dp.GraspConfig(), dp.Scenario()],
)
def test_defaults_are_in_range(config):
    check_fields(config)


@pytest.mark.parametrize(
    "changes",
    [
        {"count": np.int64(3), "point": np.zeros(3), "inner": Inner(np.float32(2.0))},
        {"rows": ((0, 1), (2, 3)), "kinds": ["b", "a"], "flag": True},
    ],
)
def test_values_of_other_types_that_mean_the_same_are_accepted(changes):
    check_fields(Outer(**changes))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"count": 0}, "count must be a whole number at least 1, not 0"),
        ({"count": 1.0}, "count must be a whole number at least 1, not 1.0"),
        ({"count": True}, "count must be a whole number at least 1, not True"),
        ({"point": [0.0, 0.0]}, r"point must be a list of exactly 3 elements, not \[0.0, 0.0\]"),
        ({"point": [0.0, np.nan, 0.0]}, r"point\[1\] must be a number, not nan"),
        ({"point": 3.0}, "point must be a list of exactly 3 elements, not 3.0"),
        ({"kinds": 3.0}, "kinds must be a list, not 3.0"),
        ({"rows": [[0, 1], [0, -1]]}, r"rows\[1\]\[1\] must be a number at least 0, not -1"),
        ({"kinds": ["a"] * (MAX_LENGTH + 1)}, "kinds must be a list of at most 64 elements"),
        ({"kinds": ["c"]}, r"kinds\[0\] must be one of: a, b, not 'c'"),
        ({"flag": 1}, "flag must be true or false, not 1"),
        ({"name": "a" * (MAX_TEXT + 1)}, "name must be a text of at most 2000 characters"),
        ({"name": 3}, "name must be a text, not 3"),
        ({"inner": Inner(2.5)}, "inner.rate must be a number above 0 and at most 2, not 2.5"),
        ({"several": [Inner(), Inner(10**400)]}, r"several\[1\].rate must be a number above 0"),
    ],
)
def test_a_value_out_of_range_is_named_with_its_path(changes, message):
    with pytest.raises(dp.InvalidArgumentError, match=message):
        check_fields(Outer(**changes))


def test_contradictions_of_a_planner_are_found_through_its_fields():
    with pytest.raises(
        dp.InvalidArgumentError, match=r"limits\.max_speed must be a number at least"
    ):
        check_fields(dp.PlannerConfig(limits=dp.LimitsConfig(max_speed=-1.0)))
