"""Within one Context, each output follows each input that it depends on: no cache is stale."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialVelocity
from pydrake.systems.framework import BusValue

from drake_pregrasp import (
    ArmPosture,
    BallSolid,
    CarrierPosture,
    CentroidSelector,
    EstimatorConfig,
    FingertipGoalShaper,
    FingertipSensor,
    ForbiddenPoints,
    GraspQualityMonitor,
    GraspSequencer,
    HalfSpace,
    HandModel,
    JointReference,
    MeasurementFaults,
    NoisyPoseSensor,
    PoseEstimator,
    SafeRegionPartitioner,
    box_surface,
    load_hand,
    load_scenario,
)
from drake_pregrasp.config.planner_config import filter_noise
from drake_pregrasp.grasping.grasp_state import GraspPhase, GraspSettings, GraspState
from drake_pregrasp.regions.constraints import FingerReach, Obstacles
from drake_pregrasp.regions.safe_regions import SafeRegions, compute_safe_regions

SURFACE = box_surface([0.1, 0.1, 0.1], spacing=0.01)
P_OC = load_scenario("a_base").initial_p_OC(SURFACE)
HAND = HandModel(load_hand("package://drake_pregrasp/five_finger_hand.yaml"))
FRAMES = HAND.kinematics.tip_frames
V_A, V_B = SpatialVelocity.Zero(), SpatialVelocity(w=[0, 0, 0.5], v=[0.1, 0, 0])
X_A = RigidTransform()
X_B = RigidTransform(RollPitchYaw(0.1, -0.2, 0.3), [0.02, 0.03, 0.01])
OTHER = P_OC * [1, -1, 1]


FRAMES_A = np.concatenate([P_OC, SURFACE.project(P_OC)[1]]).ravel()
TOUCHED = GraspState.first(5, GraspSettings())
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


def hand_pose(x):
    return AbstractValue.Make(RigidTransform([x, 0.0, 0.0]))


def tip_goals(points):
    goals = BusValue()
    for name, point in zip(FRAMES, points, strict=True):
        goals.Set(name, AbstractValue.Make(RigidTransform(point)))
    return AbstractValue.Make(goals)


# For each system: how to make it, two values for each input, and the outputs that follow it.
CASES = {
    "sensor": (
        lambda: NoisyPoseSensor(position_std=0.1, orientation_std=0.1),
        {
            "X_WO": (X_A, X_B, ["X_WO_measured"]),
            "noise": (np.zeros(6), np.ones(6), ["X_WO_measured"]),
        },
    ),
    "sensor with memory": (
        lambda: NoisyPoseSensor(
            position_std=0.1,
            orientation_std=0.1,
            period=0.1,
            faults=MeasurementFaults(dropout_rate=1e-9),
        ),
        {
            "X_WO": (X_A, X_B, ["X_WO_measured"]),
            "noise": (np.zeros(6), np.ones(6), ["X_WO_measured"]),
        },
    ),
    "estimator": (
        lambda: PoseEstimator(period=0.1, noise=filter_noise(EstimatorConfig())),
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
        lambda: SafeRegionPartitioner(
            surface=SURFACE, num_contacts=5, reach=[FingerReach(BallSolid(np.zeros(3), 0.06))] * 5
        ),
        {
            "X_WO_estimated": (X_A, X_B, ["safe_regions"]),
            "p_WC": (P_OC.ravel(), OTHER.ravel(), ["safe_regions"]),
            "contact_weights": (np.zeros(5), np.array([0, 0, 0, 0, 1e-2]), ["safe_regions"]),
            "obstacles": (obstacles(9.0), obstacles(0.06), ["safe_regions"]),
            "X_WH": (hand_pose(0.0), hand_pose(0.04), ["safe_regions"]),
        },
    ),
    "partitioner that looks ahead": (
        lambda: SafeRegionPartitioner(
            surface=SURFACE, num_contacts=5, tip_radii=np.full(5, 0.009), horizon=1.0
        ),
        {
            "X_WO_estimated": (X_A, X_B, ["safe_regions"]),
            "p_WC": (P_OC.ravel(), OTHER.ravel(), ["safe_regions"]),
            "obstacles": (wall(0.06), wall(0.12), ["safe_regions"]),
            "V_WO_estimated": (V_A, V_B, ["safe_regions"]),
        },
    ),
    "selector": (
        lambda: CentroidSelector(surface=SURFACE, p_OC=P_OC, period=0.1),
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
            "hand_state": (np.zeros(38), np.full(38, 0.1), ["p_WT", "f_T_W"]),
            "net_actuation": (np.ones(19), np.full(19, 2.0), ["f_T_W"]),
        },
    ),
    "joint_reference": (
        lambda: JointReference(HAND.kinematics, period=0.02, initial=np.full(19, 0.1)),
        {"f_T_W": (np.zeros(15), np.ones(15), ["desired_state"])},
    ),
    "carrier_posture": (
        lambda: CarrierPosture(
            tip_frames=FRAMES,
            finger_azimuths=np.arange(5.0),
            home=np.zeros(19),
            carrier=[0, 1, 2, 3],
            gain=5.0,
            period=0.02,
        ),
        {
            "tip_goals": (tip_goals(P_OC), tip_goals(OTHER), ["nominal_posture"]),
            "X_WG": (X_A, X_B, ["nominal_posture"]),
            "V_WG": (V_A, V_B, ["nominal_posture"]),
            "X_WO_estimated": (X_A, X_B, ["X_WH", "X_WU"]),
        },
    ),
    "arm_posture": (
        lambda: ArmPosture(
            tip_frames=FRAMES,
            palm_frame="palm",
            finger_azimuths=np.arange(5.0),
            X_GP=RigidTransform([0.0, 0.0, 0.1]),
            home=np.zeros(19),
            p_WG=np.zeros(3),
            yaw=0.0,
            lead=0.03,
            period=0.02,
        ),
        {
            "tip_goals": (tip_goals(P_OC), tip_goals(OTHER), ["goals"]),
            "X_WG": (X_A, X_B, ["goals"]),
            "V_WG": (V_A, V_B, ["goals"]),
            "X_WO_estimated": (X_A, X_B, ["X_WH", "X_WU"]),
        },
    ),
    "shaper": (
        lambda: FingertipGoalShaper(
            tip_frames=FRAMES,
            tip_radius=0.009,
            object_solid=BallSolid(np.zeros(3), 0.05),
            object_top=0.05,
            fixed=[],
            p_GT=P_OC,
            finger_azimuths=np.arange(5.0),
            period=0.02,
            target_period=0.05,
            lead=0.03,
        ),
        {
            "X_WG": (X_A, X_B, ["tip_goals"]),
            "V_WG": (V_A, V_B, ["tip_goals"]),
        },
    ),
    "sequencer": (
        lambda: GraspSequencer(
            num_fingers=5,
            tip_radius=0.009,
            mass=0.4,
            p_OCoM=np.zeros(3),
            friction=0.5,
            settings=GraspSettings(),
            period=0.02,
        ),
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


def plain(value):
    if isinstance(value, RigidTransform):
        return value.GetAsMatrix34()
    if isinstance(value, SpatialVelocity):
        return value.get_coeffs().copy()
    if isinstance(value, BusValue):
        palm = [value.Find("palm")] if value.Find("palm") else []
        poses = [*(value.Find(name) for name in FRAMES), *palm]
        return np.array([pose.GetAsMatrix34() for pose in poses])
    if isinstance(value, SafeRegions):
        return value.labels.copy()
    return np.array(value)


@pytest.mark.parametrize("name", CASES)
def test_outputs_follow_their_inputs(name):
    make, inputs = CASES[name]
    system = make()
    for changed, (_, second, outputs) in inputs.items():
        context = system.CreateDefaultContext()
        if name == "sequencer" and changed == "contact_frames":
            context.SetDiscreteState(0, TOUCHED.to_vector())
        for port, (first, _, _) in inputs.items():
            system.GetInputPort(port).FixValue(context, first)
        before = [plain(system.GetOutputPort(output).Eval(context)) for output in outputs]
        system.GetInputPort(changed).FixValue(context, second)
        for output, value in zip(outputs, before, strict=True):
            after = plain(system.GetOutputPort(output).Eval(context))
            assert not np.array_equal(after, value), f"{output} doesn't follow {changed}"
