"""Keywords of the previous release still configure a system, with a warning."""

import numpy as np
import pytest

from drake_pregrasp import (
    BallSolid,
    BlendConfig,
    CentroidSelector,
    ContactStatus,
    EstimatorConfig,
    FingertipGoalShaper,
    GraspConfig,
    GraspQualityMonitor,
    GraspSequencer,
    LimitsConfig,
    MeasurementFaults,
    NoisyPoseSensor,
    PlannerConfig,
    PoseEstimator,
    PoseFilterNoise,
    SafeRegionPartitioner,
    box_surface,
    load_scenario,
    without_solver_chatter,
)
from drake_pregrasp.config.deprecated_keywords import config_with
from drake_pregrasp.config.planner_config import MeasuresConfig, filter_noise
from drake_pregrasp.config.sensor_config import SensorConfig
from drake_pregrasp.geometry.mesh_surface import AxisArea
from drake_pregrasp.regions.finger_reach import FingerReach


def test_keywords_change_fields_and_fields_of_fields():
    keywords = {"period": 0.1, "clearance": 0.02}
    with pytest.warns(DeprecationWarning, match="give period, clearance in a PlannerConfig"):
        config = config_with(
            None, PlannerConfig(), keywords, object(), {"clearance": "limits.clearance"}
        )
    assert config == PlannerConfig(period=0.1, limits=LimitsConfig(clearance=0.02))


def test_without_keywords_the_configuration_is_the_callers_or_the_default():
    own, default = PlannerConfig(period=0.1), PlannerConfig()
    assert config_with(own, default, {}, object()) is own
    assert config_with(None, default, {}, object()) is default


@pytest.mark.parametrize(
    ("config", "keywords", "message"),
    [
        (None, {"colour": 1}, "no argument colour"),
        (PlannerConfig(), {"period": 0.1}, "accepts period in its config, not as keywords too"),
    ],
)
def test_unknown_keywords_and_keywords_beside_a_configuration_are_refused(
    config, keywords, message
):
    with pytest.raises(TypeError, match=message):
        config_with(config, PlannerConfig(), keywords, object())


SURFACE = box_surface([0.1, 0.1, 0.1], spacing=0.01)
P_OC = load_scenario("a_base").initial_p_OC(SURFACE)
BALL = BallSolid(np.zeros(3), 0.05)
FIVE = {"surface": SURFACE, "num_contacts": 5}
ESTIMATOR = EstimatorConfig(
    position_std=0.01, gravity=9.81, gate=5.0, lost_after=1e6, reacquire_after=4
)
NOISE = {"noise": PoseFilterNoise(**vars(filter_noise(ESTIMATOR))), "gate": 5.0}
NOISE |= {"lost_after": np.inf, "reacquire_after": 4}
STDS = {"position_std": 0.1, "orientation_std": 0.2}
BLEND = {"period": 0.1, "strategy": "blend", "blend": {"vew": 1.0}}
REACHES = {"reach": [FingerReach(BallSolid(np.zeros(3), 0.1)), None, None, None, None]}
REACHES["tip_radii"] = [0.01] * 5
TIPS = {"tip_frames": ["a"], "tip_radius": 0.01, "object_solid": BALL, "target_period": 0.05}
TIPS |= {"fixed": [], "p_GT": np.ones((1, 3)), "finger_azimuths": [0.0]}
FINGERS = {"num_fingers": 3, "tip_radius": 0.01, "mass": 0.4, "p_OCoM": np.zeros(3)}
CASES = [
    (PoseEstimator, {"period": 0.05, **NOISE}, ESTIMATOR),
    (
        NoisyPoseSensor,
        {**STDS, "faults": MeasurementFaults(), "period": 0.1},
        SensorConfig(0.1, 0.2),
    ),
    (NoisyPoseSensor, {**STDS, "faults": None}, SensorConfig(0.1, 0.2)),
    (
        CentroidSelector,
        {"surface": SURFACE, "p_OC": P_OC, **BLEND},
        PlannerConfig(
            period=0.1, static_duration=0.0, strategy="blend", blend=BlendConfig(vew=1.0)
        ),
    ),
    (
        SafeRegionPartitioner,
        {**FIVE, **REACHES, "closed": [[AxisArea("+x")], [], [], [], []], "wall_test": "normals"},
        PlannerConfig(
            limits=LimitsConfig(clearance=0.0, forbidden_faces=[["+x"], [], [], [], []], **REACHES),
            wall_test="normals",
        ),
    ),
    (
        FingertipGoalShaper,
        {**TIPS, "period": 0.01, "speed": 0.1, "standoff": 0.03},
        GraspConfig(period=0.01, goal_speed=0.1, standoff=0.03),
    ),
    (
        GraspSequencer,
        {**FINGERS, "friction": 0.4, "period": 0.01},
        GraspConfig(planned_friction=0.4, period=0.01),
    ),
    (
        GraspQualityMonitor,
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
            assert getattr(ContactStatus, f"{name}_GROUND") == ContactStatus[f"{name}_SURFACE"]
    with pytest.raises(AttributeError, match="no member GROUND"):
        ContactStatus.GROUND  # noqa: B018


def test_there_is_no_chatter_of_solvers_to_suppress():
    with pytest.warns(DeprecationWarning, match="does nothing") as warned, without_solver_chatter():
        pass
    assert warned[0].filename == __file__
