"""`fingertip_targets` plugs into Drake's own differential inverse kinematics."""

import numpy as np
from five_finger_hand import FRAMES, HAND
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from drake_pregrasp import AddPregraspPlanner, PlannerConfig
from drake_pregrasp.diagrams.hand_controller import fingertip_kinematics
from drake_pregrasp.diagrams.wiring import connect, export_inputs, export_outputs

STEP = 0.01


def test_fingertips_go_to_the_goals(surface, p_OC):
    builder = DiagramBuilder()
    config = PlannerConfig(static_duration=0.0)
    planner = AddPregraspPlanner(builder, config, surface, p_OC, fingertip_frames=FRAMES)
    ik = builder.AddSystem(fingertip_kinematics(HAND, {}, STEP))
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
