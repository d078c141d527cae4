"""What the filter may be told to assume."""

from dataclasses import replace

import numpy as np
import pytest

from drake_pregrasp import InvalidArgumentError, PoseFilterNoise

NOISE = PoseFilterNoise(
    position=1e-3,
    orientation=5e-3,
    acceleration=1e-2,
    angular_acceleration=5e-2,
    initial_velocity=0.1,
    initial_angular_velocity=0.5,
)
MEASURED = ("position", "orientation")
MOVED = (
    "acceleration",
    "angular_acceleration",
    "initial_velocity",
    "initial_angular_velocity",
)


@pytest.mark.parametrize("name", vars(NOISE))
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, "abc", None, 1j, 10**400])
def test_what_is_no_finite_number_is_refused_by_name(name, value):
    with pytest.raises(InvalidArgumentError, match=f"^{name} must be finite.*not {value}"):
        replace(NOISE, **{name: value})


@pytest.mark.parametrize("name", vars(NOISE))
def test_zero_and_less_are_refused_where_they_mean_nothing(name):
    for value in (-1.0, -0.1, 0.0):
        if name in MEASURED or (name in MOVED and value < 0):
            wanted = "finite and above 0" if name in MEASURED else "finite and at least 0"
            with pytest.raises(InvalidArgumentError, match=f"^{name} must be {wanted}, not"):
                replace(NOISE, **{name: value})
        else:
            assert getattr(replace(NOISE, **{name: value}), name) == value


def test_equal_assumptions_are_one_key():
    same = replace(NOISE)
    assert same is not NOISE
    assert {NOISE: 1}[same] == 1
    assert same != replace(NOISE, gravity=9.81)
