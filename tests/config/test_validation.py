"""Configurations are validated by the ranges of their fields; keywords of 0.1 still work."""

from dataclasses import dataclass, field

import numpy as np
import pytest

import drake_pregrasp as dp
from drake_pregrasp.config.deprecated_keywords import config_with
from drake_pregrasp.config.planner_config import MeasuresConfig, filter_noise
from drake_pregrasp.config.sensor_config import SensorConfig
from drake_pregrasp.config.validation import MAX_LENGTH, MAX_TEXT, check_fields
from drake_pregrasp.geometry.mesh_surface import AxisArea
from drake_pregrasp.regions.finger_reach import FingerReach


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
        ({"point": 3.0}, "point must be a list, not 3.0"),
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


def test_keywords_change_fields_and_fields_of_fields():
    keywords = {"period": 0.1, "clearance": 0.02}
    with pytest.warns(DeprecationWarning, match="give period, clearance in a PlannerConfig"):
        config = config_with(
            None, dp.PlannerConfig(), keywords, object(), {"clearance": "limits.clearance"}
        )
    assert config == dp.PlannerConfig(period=0.1, limits=dp.LimitsConfig(clearance=0.02))


def test_without_keywords_the_configuration_is_the_callers_or_the_default():
    own, default = dp.PlannerConfig(period=0.1), dp.PlannerConfig()
    assert config_with(own, default, {}, object()) is own
    assert config_with(None, default, {}, object()) is default


@pytest.mark.parametrize(
    ("config", "keywords", "message"),
    [
        (None, {"colour": 1}, "no argument colour"),
        (
            dp.PlannerConfig(),
            {"period": 0.1},
            "accepts period in its config, not as keywords too",
        ),
    ],
)
def test_unknown_keywords_and_keywords_beside_a_configuration_are_refused(
    config, keywords, message
):
    with pytest.raises(TypeError, match=message):
        config_with(config, dp.PlannerConfig(), keywords, object())


SURFACE = dp.box_surface([0.1, 0.1, 0.1], spacing=0.01)
P_OC = dp.load_scenario("a_base").initial_p_OC(SURFACE)
BALL = dp.BallSolid(np.zeros(3), 0.05)
FIVE = {"surface": SURFACE, "num_contacts": 5}
ESTIMATOR = dp.EstimatorConfig(
    position_std=0.01, gravity=9.81, gate=5.0, lost_after=1e6, reacquire_after=4
)
NOISE = {"noise": dp.PoseFilterNoise(**vars(filter_noise(ESTIMATOR))), "gate": 5.0}
NOISE |= {"lost_after": np.inf, "reacquire_after": 4}
STDS = {"position_std": 0.1, "orientation_std": 0.2}
BLEND = {"period": 0.1, "strategy": "blend", "blend": {"vew": 1.0}}
REACHES = {"reach": [FingerReach(dp.BallSolid(np.zeros(3), 0.1)), None, None, None, None]}
REACHES["tip_radii"] = [0.01] * 5
TIPS = {"tip_frames": ["a"], "tip_radius": 0.01, "object_solid": BALL, "target_period": 0.05}
TIPS |= {"fixed": [], "p_GT": np.ones((1, 3)), "finger_azimuths": [0.0]}
FINGERS = {"num_fingers": 3, "tip_radius": 0.01, "mass": 0.4, "p_OCoM": np.zeros(3)}
CASES = [
    (dp.PoseEstimator, {"period": 0.05, **NOISE}, ESTIMATOR),
    (
        dp.NoisyPoseSensor,
        {**STDS, "faults": dp.MeasurementFaults(), "period": 0.1},
        SensorConfig(0.1, 0.2),
    ),
    (dp.NoisyPoseSensor, {**STDS, "faults": None}, SensorConfig(0.1, 0.2)),
    (
        dp.CentroidSelector,
        {"surface": SURFACE, "p_OC": P_OC, **BLEND},
        dp.PlannerConfig(
            period=0.1, static_duration=0.0, strategy="blend", blend=dp.BlendConfig(vew=1.0)
        ),
    ),
    (
        dp.SafeRegionPartitioner,
        {**FIVE, **REACHES, "closed": [[AxisArea("+x")], [], [], [], []], "wall_test": "normals"},
        dp.PlannerConfig(
            limits=dp.LimitsConfig(
                clearance=0.0, forbidden_faces=[["+x"], [], [], [], []], **REACHES
            ),
            wall_test="normals",
        ),
    ),
    (
        dp.FingertipGoalShaper,
        {**TIPS, "period": 0.01, "speed": 0.1, "standoff": 0.03},
        dp.GraspConfig(period=0.01, goal_speed=0.1, standoff=0.03),
    ),
    (
        dp.GraspSequencer,
        {**FINGERS, "friction": 0.4, "period": 0.01},
        dp.GraspConfig(planned_friction=0.4, period=0.01),
    ),
    (
        dp.GraspQualityMonitor,
        {**FIVE, "contact_model": "hard_finger"},
        MeasuresConfig(contact_model="hard_finger"),
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize(("system", "keywords", "expected"), CASES)
def test_systems_understand_the_keywords_that_they_had(monkeypatch, system, keywords, expected):
    configs = []

    def recorded(*arguments):
        configs.append(config_with(*arguments))
        return configs[-1]

    monkeypatch.setattr(f"{system.__module__}.config_with", recorded)
    with pytest.warns(DeprecationWarning, match="as keywords they are deprecated"):
        system(**keywords)
    assert configs == [expected]


def test_former_names_of_statuses_warn():
    for name in ("NO_ALLOWED", "LITTLE_ALLOWED"):
        with pytest.warns(DeprecationWarning, match=f"now {name}_SURFACE"):
            assert (
                getattr(dp.ContactStatus, f"{name}_GROUND") == dp.ContactStatus[f"{name}_SURFACE"]
            )
    with pytest.raises(AttributeError, match="no member GROUND"):
        dp.ContactStatus.GROUND  # noqa: B018


def test_there_is_no_chatter_of_solvers_to_suppress():
    with (
        pytest.warns(DeprecationWarning, match="does nothing") as warned,
        dp.without_solver_chatter(),
    ):
        pass
    assert warned[0].filename == __file__
