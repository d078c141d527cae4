"""`fingertip_targets` plugs into Drake's own differential inverse kinematics."""

import numpy as np
from five_finger_hand import FRAMES, HAND
from pydrake.math import RigidTransform
from pydrake.multibody.inverse_kinematics import DifferentialInverseKinematicsSystem
from pydrake.multibody.math import SpatialVelocity
from pydrake.planning import DofMask, RobotDiagramBuilder, SceneGraphCollisionChecker
from pydrake.systems.framework import DiagramBuilder

from drake_pregrasp import AddPregraspPlanner, PlannerConfig
from drake_pregrasp.diagrams.hand_parsing import add_hand_model
from drake_pregrasp.diagrams.wiring import connect, export_inputs, export_outputs

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
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    p_WO = np.array([0.2, 0.1, 0.3])
    q = home = HAND.home(p_WO, 0.0)
    diagram.GetInputPort("X_WO_measured").FixValue(context, RigidTransform(p_WO))
    diagram.GetInputPort("nominal_posture").FixValue(context, home)
    for _ in range(100):
        diagram.GetInputPort("position").FixValue(context, q)
        q = q + STEP * diagram.GetOutputPort("commanded_velocity").Eval(context)
    p_WC = diagram.GetOutputPort("p_WC").Eval(context).reshape(-1, 3)
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
        robot_model_instances=[hand],
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
