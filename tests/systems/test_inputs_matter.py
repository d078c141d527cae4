"""Within one Context, each output follows each input that it depends on: no cache is stale."""

from dataclasses import replace

import numpy as np
import pytest
from made_systems import (
    HAND,
    NQ,
    Driven,
    bus,
    make_arm,
    make_carrier,
    make_estimator,
    make_partitioner,
    make_reference,
    make_selector,
    make_sequencer,
    make_shaper,
)
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialVelocity

from drake_pregrasp import (
    BallReach,
    FingertipSensor,
    ForbiddenPoints,
    GraspConfig,
    GraspQualityMonitor,
    HalfSpace,
    MeasurementFaults,
    NoisyPoseSensor,
    Obstacles,
    box_surface,
    load_scenario,
)
from drake_pregrasp.config.sensor_config import SensorConfig
from drake_pregrasp.grasping.grasp_state import GraspPhase, GraspState
from drake_pregrasp.regions.safe_regions import compute_safe_regions

SURFACE = box_surface([0.1, 0.1, 0.1], spacing=0.01)
P_OC = load_scenario("a_base").initial_p_OC(SURFACE)
V_A, V_B = SpatialVelocity.Zero(), SpatialVelocity(w=[0, 0, 0.5], v=[0.1, 0, 0])
X_A = RigidTransform()
X_B = RigidTransform(RollPitchYaw(0.1, -0.2, 0.3), [0.02, 0.03, 0.01])
OTHER = P_OC * [1, -1, 1]
FRAMES_A = np.concatenate([P_OC, SURFACE.project(P_OC)[1]]).ravel()
TOUCHED = GraspState.first(5, GraspConfig().make_settings())
TOUCHED = replace(TOUCHED, phase=GraspPhase.CLOSE, touched=np.ones(5, dtype=bool))


def regions(p_OC):
    labels = compute_safe_regions(SURFACE.p_OQ, p_OC, np.zeros(5), SURFACE.forbidden)
    return AbstractValue.Make(labels)


def obstacles(x):
    points = ForbiddenPoints(np.array([[x, 0.0, 0.0]]), np.array([0.03]))
    return AbstractValue.Make(Obstacles(points=points))


def wall(x):
    half_space = HalfSpace(np.array([x, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]))
    return AbstractValue.Make(Obstacles((half_space,)))


POSED = {"X_WO": (X_A, X_B, ["X_WO_measured"]), "noise": ([0] * 6, [1] * 6, ["X_WO_measured"])}
PALM = {"X_WO_estimated": (X_A, X_B, ["X_WH", "X_WU"])}
SENSOR = SensorConfig(0.1, 0.1)
MEMORY = SensorConfig(0.1, 0.1, MeasurementFaults(dropout_rate=1e-9))
REACH = {"reach": [BallReach(center=[0, 0, 0], radius=0.06)] * 5}
TIPS = {"tip_radii": [0.009] * 5, "horizon": 1.0}


def followed_by(output):
    return {
        "tip_goals": (bus(P_OC), bus(OTHER), [output]),
        "X_WG": (X_A, X_B, [output]),
        "V_WG": (V_A, V_B, [output]),
    }


# For each system: how to make it, two values for each input, and the outputs that follow it.
CASES = {
    "sensor": (lambda: NoisyPoseSensor(SENSOR), POSED),
    "sensor with memory": (lambda: NoisyPoseSensor(MEMORY, period=0.1), POSED),
    "estimator": (
        make_estimator,
        {
            "X_WO_measured": (X_A, X_B, ["X_WO_estimated"]),
            "measurement_time": (
                [0.0],
                [-np.inf],
                ["p_WO_covariance", "tracking_status", "measurement_verdict"],
            ),
        },
    ),
    "partitioner": (
        lambda: make_partitioner(SURFACE, limits=REACH),
        {
            "X_WO_estimated": (X_A, X_B, ["safe_regions"]),
            "p_WC": (P_OC.ravel(), OTHER.ravel(), ["safe_regions"]),
            "contact_weights": (np.zeros(5), np.array([0, 0, 0, 0, 1e-2]), ["safe_regions"]),
            "obstacles": (obstacles(9.0), obstacles(0.06), ["safe_regions"]),
            "X_WH": (X_A, X_B, ["safe_regions"]),
        },
    ),
    "partitioner that looks ahead": (
        lambda: make_partitioner(SURFACE, limits=TIPS),
        {
            "X_WO_estimated": (X_A, X_B, ["safe_regions"]),
            "p_WC": (P_OC.ravel(), OTHER.ravel(), ["safe_regions"]),
            "obstacles": (wall(0.06), wall(0.12), ["safe_regions"]),
            "V_WO_estimated": (V_A, V_B, ["safe_regions"]),
        },
    ),
    "selector": (
        lambda: make_selector(SURFACE, P_OC),
        {
            "X_WO_estimated": (X_A, X_B, ["p_WC", "p_WC_previous"]),
            "p_WO_covariance": (1e-6 * np.eye(3).ravel(), 1e-2 * np.eye(3).ravel(), ["p_WC"]),
            "safe_regions": (regions(P_OC), regions(OTHER), ["p_WC"]),
            "hold_contacts": ([0.0], [1.0], ["p_WC", "contact_status"]),
        },
    ),
    "fingertip_sensor": (
        lambda: FingertipSensor(HAND.kinematics),
        {
            "hand_state": ([0] * 2 * NQ, [0.1] * 2 * NQ, ["p_WT", "f_T_W"]),
            "net_actuation": ([1] * NQ, [2] * NQ, ["f_T_W"]),
        },
    ),
    "joint_reference": (make_reference, {"f_T_W": (np.zeros(15), np.ones(15), ["desired_state"])}),
    "carrier_posture": (make_carrier, followed_by("nominal_posture") | PALM),
    "arm_posture": (make_arm, followed_by("goals") | PALM),
    "shaper": (
        lambda: make_shaper(lead=0.03),
        {"X_WG": (X_A, X_B, ["tip_goals"]), "V_WG": (V_A, V_B, ["tip_goals"])},
    ),
    "sequencer": (
        make_sequencer,
        {
            "X_WO_estimated": (X_A, X_B, ["X_WG"]),
            "V_WO_estimated": (V_A, V_B, ["V_WG"]),
            "contact_frames": (FRAMES_A, -FRAMES_A, ["squeeze_forces"]),
        },
    ),
    "monitor": (
        lambda: GraspQualityMonitor(surface=SURFACE, num_contacts=5),
        {
            "p_WC": (P_OC.ravel(), 0.5 * P_OC.ravel(), ["grasp_quality"]),
            "X_WO": (X_A, X_B, ["grasp_quality"]),
            "contact_status": (np.ones(5), np.array([1.0, 1, 1, 1, 0]), ["grasp_quality"]),
        },
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_outputs_follow_their_inputs(name):
    make, inputs = CASES[name]
    system = make()
    for changed, (_, second, outputs) in inputs.items():
        driven = Driven(system, **{port: first for port, (first, _, _) in inputs.items()})
        if name == "sequencer" and changed == "contact_frames":
            driven.context.SetDiscreteState(0, TOUCHED.to_vector())
        before = [driven.array(output) for output in outputs]
        driven.fix(**{changed: second})
        for output, value in zip(outputs, before, strict=True):
            after = driven.array(output)
            assert not np.array_equal(after, value), f"{output} doesn't follow {changed}"
