"""Keywords of the previous release still configure a system, with a warning."""

import numpy as np
import pytest

from drake_pregrasp import (
    BallReach,
    BallSolid,
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
    without_solver_chatter,
)
from drake_pregrasp.config.deprecated_keywords import config_with
from drake_pregrasp.config.planner_config import MeasuresConfig, filter_noise
from drake_pregrasp.config.sensor_config import SensorConfig
from drake_pregrasp.geometry.mesh_surface import AxisArea
from drake_pregrasp.regions.finger_reach import FingerReach
from drake_pregrasp.systems import (
    centroid_selector,
    fingertip_goal_shaper,
    grasp_quality_monitor,
    grasp_sequencer,
    pose_estimator,
    pose_sensor,
    safe_region_partitioner,
)


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


ESTIMATOR = EstimatorConfig(
    position_std=0.01, gravity=9.81, gate=5.0, lost_after=1e6, reacquire_after=4
)
TIPS = {"tip_frames": ["a"], "tip_radius": 0.01, "object_solid": BallSolid(np.zeros(3), 0.05)}
TIPS |= {"fixed": [], "p_GT": np.ones((1, 3)), "finger_azimuths": [0.0]}
CASES = {
    "estimator": (
        pose_estimator,
        lambda s, c: PoseEstimator(
            period=0.05,
            noise=PoseFilterNoise(**vars(filter_noise(ESTIMATOR))),
            gate=5.0,
            lost_after=np.inf,
            reacquire_after=4,
        ),
        ESTIMATOR,
    ),
    "sensor": (
        pose_sensor,
        lambda s, c: NoisyPoseSensor(
            position_std=0.1, orientation_std=0.2, faults=MeasurementFaults(), period=0.1
        ),
        SensorConfig(0.1, 0.2),
    ),
    "sensor without faults": (
        pose_sensor,
        lambda s, c: NoisyPoseSensor(position_std=0.1, orientation_std=0.2, faults=None),
        SensorConfig(0.1, 0.2),
    ),
    "selector": (
        centroid_selector,
        lambda s, c: CentroidSelector(
            surface=s, p_OC=c, period=0.1, strategy="blend", blend={"vew": 1.0}
        ),
        None,
    ),
    "partitioner": (
        safe_region_partitioner,
        lambda s, c: SafeRegionPartitioner(
            surface=s,
            num_contacts=5,
            tip_radii=np.full(5, 0.01),
            reach=[FingerReach(BallSolid(np.zeros(3), 0.1)), None, None, None, None],
            closed=[[AxisArea("+x")], [], [], [], []],
            wall_test="normals",
        ),
        None,
    ),
    "shaper": (
        fingertip_goal_shaper,
        lambda s, c: FingertipGoalShaper(
            **TIPS, target_period=0.05, period=0.01, speed=0.1, standoff=0.03
        ),
        GraspConfig(period=0.01, goal_speed=0.1, standoff=0.03),
    ),
    "sequencer": (
        grasp_sequencer,
        lambda s, c: GraspSequencer(
            num_fingers=3, tip_radius=0.01, mass=0.4, p_OCoM=np.zeros(3), friction=0.4, period=0.01
        ),
        GraspConfig(planned_friction=0.4, period=0.01),
    ),
    "monitor": (
        grasp_quality_monitor,
        lambda s, c: GraspQualityMonitor(surface=s, num_contacts=5, contact_model="hard_finger"),
        MeasuresConfig(contact_model="hard_finger"),
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_systems_understand_the_keywords_that_they_had(surface, p_OC, monkeypatch, name):
    module, make, expected = CASES[name]
    configs = []

    def recorded(*arguments):
        configs.append(config_with(*arguments))
        return configs[-1]

    monkeypatch.setattr(module, "config_with", recorded)
    with pytest.warns(DeprecationWarning, match="as keywords they are deprecated"):
        make(surface, p_OC)
    (config,) = configs
    if expected is not None:
        assert config == expected
    if name == "selector":
        assert (config.static_duration, config.strategy, config.blend.vew) == (0.0, "blend", 1.0)
    if name == "partitioner":
        assert config.limits.clearance == 0.0
        assert config.limits.forbidden_faces == [["+x"], [], [], [], []]
        new = PlannerConfig(
            limits=LimitsConfig(
                clearance=0.0,
                tip_radii=[0.01] * 5,
                reach=[BallReach(center=[0, 0, 0], radius=0.1), None, None, None, None],
                forbidden_faces=config.limits.forbidden_faces,
            ),
            wall_test="normals",
        )
        assert config.wall_test == new.wall_test
        SafeRegionPartitioner(new, surface=surface, num_contacts=5)


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
