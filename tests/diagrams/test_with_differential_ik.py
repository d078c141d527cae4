"""`fingertip_targets` plugs into Drake's own differential inverse kinematics."""

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.inverse_kinematics import DifferentialInverseKinematicsSystem
from pydrake.multibody.math import SpatialVelocity
from pydrake.planning import DofMask, RobotDiagramBuilder, SceneGraphCollisionChecker
from pydrake.systems.framework import DiagramBuilder

from drake_pregrasp import AddPregraspPlanner, PlannerConfig, box_surface

STEP = 0.01
SLIDE = """
  <link name="{child}"><inertial><mass>0.1</mass></inertial></link>
  <joint name="{child}_slide" type="prismatic">
    <parent>{parent}</parent><child>{child}</child>
    <axis><xyz>{axis}</xyz><limit><lower>-1</lower><upper>1</upper></limit></axis>
  </joint>"""


def gantry_hand():
    """A hand of two fingers, each a gantry whose joint positions are its tip's position in W."""
    parts = []
    for finger in range(2):
        parent = "palm"
        for name, axis in (("x", "1 0 0"), ("y", "0 1 0"), ("tip", "0 0 1")):
            child = f"finger_{finger}_{name}"
            parts.append(SLIDE.format(child=child, parent=parent, axis=axis))
            parent = child
    return (
        "<sdf version='1.9'><model name='hand'><link name='palm'/>"
        "<joint name='mount' type='fixed'><parent>world</parent><child>palm</child></joint>"
        f"{''.join(parts)}</model></sdf>"
    )


def differential_ik(frames):
    builder = RobotDiagramBuilder(0.0)
    (hand,) = builder.parser().AddModelsFromString(gantry_hand(), "sdf")
    builder.plant().Finalize()
    checker = SceneGraphCollisionChecker(
        model=builder.Build(),
        robot_model_instances=[hand],
        edge_step_size=0.1,
        configuration_distance_function=lambda a, b: np.linalg.norm(a - b),
    )
    cost = DifferentialInverseKinematicsSystem.LeastSquaresCost.Config()
    cost.cartesian_axis_masks = {frame: np.array([0, 0, 0, 1.0, 1, 1]) for frame in frames}
    recipe = DifferentialInverseKinematicsSystem.Recipe()
    recipe.AddIngredient(DifferentialInverseKinematicsSystem.LeastSquaresCost(cost))
    return DifferentialInverseKinematicsSystem(
        recipe=recipe,
        task_frame="world",
        collision_checker=checker,
        active_dof=DofMask([True] * 6),
        time_step=STEP,
        K_VX=1.0,
        Vd_TG_limit=SpatialVelocity([5.0] * 3, [1.0] * 3),
    )


def test_fingertips_go_to_the_goals():
    frames = [f"hand::finger_{finger}_tip" for finger in range(2)]
    surface = box_surface([0.1, 0.1, 0.1], spacing=0.01)
    p_OC = np.array([[0.05, 0.0, 0.0], [-0.05, 0.0, 0.0]])
    builder = DiagramBuilder()
    planner = AddPregraspPlanner(
        builder, PlannerConfig(static_duration=0.0), surface, p_OC, fingertip_frames=frames
    )
    ik = builder.AddSystem(differential_ik(frames))
    builder.Connect(
        planner.GetOutputPort("fingertip_targets"), ik.GetInputPort("desired_cartesian_poses")
    )
    builder.ExportInput(planner.GetInputPort("X_WO_measured"), "X_WO_measured")
    builder.ExportInput(ik.GetInputPort("position"), "position")
    builder.ExportInput(ik.GetInputPort("nominal_posture"), "nominal_posture")
    builder.ExportOutput(ik.GetOutputPort("commanded_velocity"), "commanded_velocity")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    q = np.zeros(6)
    diagram.GetInputPort("X_WO_measured").FixValue(context, RigidTransform([0.2, 0.1, 0.3]))
    diagram.GetInputPort("nominal_posture").FixValue(context, q)
    for _ in range(60):
        diagram.GetInputPort("position").FixValue(context, q)
        q = q + STEP * diagram.GetOutputPort("commanded_velocity").Eval(context)
    p_WC = planner.GetOutputPort("p_WC").Eval(planner.GetMyContextFromRoot(context))
    np.testing.assert_allclose(q, p_WC, atol=1e-4)
