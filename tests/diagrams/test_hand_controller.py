"""The hand's controller: its arguments and outputs. Goals fit Drake's own kinematics too."""

import numpy as np
import pytest
from broken_values import broken_values
from driven import Driven
from five_finger_hand import FRAMES, HAND, RAYS, RING, X_WO, bus, hand_controller
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.inverse_kinematics import DifferentialInverseKinematicsSystem
from pydrake.multibody.math import SpatialVelocity
from pydrake.planning import DofMask, RobotDiagramBuilder, SceneGraphCollisionChecker
from pydrake.systems.framework import DiagramBuilder

from drake_pregrasp import AddPregraspPlanner, GraspConfig, PlannerConfig
from drake_pregrasp.diagrams.hand_parsing import add_hand_model
from drake_pregrasp.diagrams.wiring import connect, export_inputs, export_outputs
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.estimation.pose_track import TrackingStatus

TURNED = RING @ RotationMatrix.MakeZRotation(0.4).matrix().T


def test_it_starts_over_the_object_turned_to_its_contacts():
    for p_OC, yaw in ((RING, 0.0), (TURNED, 0.4)):
        np.testing.assert_allclose(hand_controller(p_OC=p_OC).initial[3], yaw, atol=1e-4)
    np.testing.assert_allclose(hand_controller(p_OC=RING, yaw=-0.3).initial[3], -0.3)


def test_its_wrist_starts_within_its_range():
    config = GraspConfig(wrist_range=[-0.1, 0.2])
    assert hand_controller(config, p_OC=TURNED).initial[3] == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("config", "changes", "problem"),
    [
        (None, {"p_OC": RING[:4]}, r"p_OC must have shape \(5, 3\), not \(4, 3\)"),
        (None, {"p_OCoM": np.zeros(2)}, r"p_OCoM must have shape \(3,\), not \(2,\)"),
        (None, {"mass": 0.0}, "mass must be greater than 0, not 0.0"),
        (None, {"mass": np.nan}, "mass must be greater than 0, not nan"),
        (None, {"plant_time_step": -1.0}, "plant_time_step must be greater than 0"),
        (None, {"yaw_slack": -0.1}, "yaw_slack must be at least 0, not -0.1"),
        (GraspConfig(least_force=0.2), {}, "touch_force must be less than least_force, 0.2"),
    ],
)
def test_what_makes_no_sense_is_refused(config, changes, problem):
    with pytest.raises(InvalidArgumentError, match=problem):
        hand_controller(config, **changes)


def test_contacts_on_faces_that_a_finger_may_not_have_are_refused(monkeypatch):
    tip = HAND.description.fingertips[0]
    monkeypatch.setattr(tip, "forbidden_faces", ["-z", "-x"])
    hand_controller()
    monkeypatch.setattr(tip, "forbidden_faces", ["-z", "+x"])
    with pytest.raises(InvalidArgumentError, match=r"finger_0_tip, to which \+x is forbidden"):
        hand_controller()


def targets(point=0.0):
    """Contact goals on the object, of which one may be anywhere."""
    p_WC = (X_WO @ RING.T).T
    p_WC[0, 0] += point
    return bus(p_WC, RAYS)


SOUND = {
    "fingertip_targets": targets(),
    "contact_status": np.ones(5),
    "X_WO_estimated": X_WO,
    "V_WO_estimated": SpatialVelocity.Zero(),
    "close": [0.0],
    "net_actuation": np.zeros(HAND.kinematics.num_positions),
    "tracking_status": [float(TrackingStatus.TRACKING)],
}


@pytest.mark.slow
@pytest.mark.parametrize("port", [*SOUND, "hand_state"])
def test_joints_get_finite_commands_whatever_comes(port):
    system = hand_controller()
    inputs = SOUND | {"hand_state": np.append(system.initial, 0 * system.initial)}
    driven = Driven(system, **inputs)
    driven.advance(0.1)
    largest, before = 0.0, driven.array("desired_state")
    for value in broken_values(inputs[port]):
        for now in (value, inputs[port]):
            driven.fix(**{port: now})
            driven.advance(0.06)
            for output in ("desired_state", "X_WH", "p_GT"):
                assert np.all(np.isfinite(driven.array(output))), output
            desired = driven.array("desired_state")
            largest = max(largest, np.max(np.abs(desired - before)[: len(system.initial)]))
            before = desired
    assert largest < 0.5  # Radians or metres in three ticks, of which joints do less than a third.


@pytest.mark.parametrize(("yaw_slack", "yaw"), [(0.0, 0.0), (0.3, 0.25)])
def test_the_palm_keeps_a_yaw_within_its_slack(yaw_slack, yaw):
    system = hand_controller(yaw=0.25, yaw_slack=yaw_slack)
    driven = Driven(system, **SOUND, hand_state=np.append(system.initial, 0 * system.initial))
    driven.advance(2.0)
    turned = RotationMatrix.MakeZRotation(yaw).matrix()
    np.testing.assert_allclose(driven.eval("X_WU").rotation().matrix(), turned, atol=1e-3)


STEP = 0.01


def test_fingertips_go_to_the_goals(surface, p_OC):
    builder = DiagramBuilder()
    config = PlannerConfig(static_duration=0.0)
    planner = AddPregraspPlanner(builder, config, surface, p_OC, fingertip_frames=FRAMES)
    ik = builder.AddSystem(_fingertip_kinematics())
    connect(builder, planner, "fingertip_targets:desired_cartesian_poses", ik)
    export_inputs(builder, "X_WO_measured", planner)
    export_inputs(builder, "position nominal_posture", ik)
    export_outputs(builder, planner, "p_WC")
    export_outputs(builder, ik, "commanded_velocity")
    p_WO = np.array([0.2, 0.1, 0.3])
    q = home = HAND.home(p_WO, 0.0)
    inputs = {"X_WO_measured": RigidTransform(p_WO), "nominal_posture": home}
    driven = Driven(builder.Build(), **inputs)
    for _ in range(100):
        driven.fix(position=q)
        q = q + STEP * driven.eval("commanded_velocity")
    p_WC = driven.array("p_WC").reshape(-1, 3)
    np.testing.assert_allclose(HAND.tips_at(q), p_WC, atol=1e-4)


def _fingertip_kinematics() -> DifferentialInverseKinematicsSystem:
    """Returns Drake's system that follows the positions of the fingertips."""
    system = DifferentialInverseKinematicsSystem
    masks = dict.fromkeys(FRAMES, np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]))
    tracking, centering = system.LeastSquaresCost.Config(), system.JointCenteringCost.Config()
    tracking.cartesian_qp_weight, centering.posture_gain = 100.0, 5.0
    tracking.cartesian_axis_masks = centering.cartesian_axis_masks = masks
    recipe = system.Recipe()
    recipe.AddIngredient(system.LeastSquaresCost(tracking))
    recipe.AddIngredient(system.JointCenteringCost(centering))
    robot = RobotDiagramBuilder(time_step=0.0)
    hand = add_hand_model(robot.plant(), HAND.description)
    robot.plant().Finalize()
    checker = SceneGraphCollisionChecker(
        model=robot.Build(),
        robot_model_instances=hand,
        edge_step_size=1.0,
        configuration_distance_function=lambda a, b: float(np.linalg.norm(a - b)),
    )
    return system(
        recipe=recipe,
        task_frame="world",
        collision_checker=checker,
        active_dof=DofMask([True] * HAND.kinematics.num_positions),
        time_step=STEP,
        K_VX=1.0,
        Vd_TG_limit=SpatialVelocity([5.0] * 3, [1.0] * 3),
    )
