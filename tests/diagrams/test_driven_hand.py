"""A plant with a hand, and its controller: one loop, which starts at rest over the object."""

import numpy as np
import pytest
from five_finger_hand import HAND
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.framework import DiagramBuilder

from drake_pregrasp import Box, Conveyor, GraspConfig, box_surface, ring_contacts
from drake_pregrasp.diagrams.hand_station import TABLE, add_driven_hand

BOX = Box(size=[0.08, 0.09, 0.1])
SUNK = 1e-4  # Metres by which feet may be in the table.
GRASP = GraspConfig()


@pytest.fixture(scope="module")
def driven():
    surface = box_surface(BOX.size, spacing=0.01, forbidden_faces=["+z", "-z"])
    builder = DiagramBuilder()
    hand = add_driven_hand(
        builder,
        BOX,
        Conveyor(),
        MultibodyPlantConfig(time_step=0.01),
        GRASP,
        HAND,
        p_OCoM=surface.p_OCoM,
        p_OC=ring_contacts(surface, 5),
        target_period=0.05,
    )
    builder.ExportOutput(hand.controller.GetOutputPort("p_WT"), "p_WT")
    diagram = builder.Build()
    return hand, diagram, diagram.CreateDefaultContext()


def test_the_first_desired_state_is_the_present_state(driven):
    hand, _, context = driven
    own = hand.station.GetMyContextFromRoot(context)
    desired = hand.station.GetInputPort("desired_state").Eval(own)
    state = hand.station.GetOutputPort("hand_state").Eval(own)
    np.testing.assert_allclose(desired, state, atol=1e-12)
    n = len(hand.controller.initial)
    np.testing.assert_allclose(state[:n], hand.controller.initial, atol=1e-12)


def test_the_controller_sees_the_plants_fingertips(driven):
    hand, diagram, context = driven
    plant = hand.station.plant
    own = plant.GetMyContextFromRoot(context)
    p_WT = diagram.GetOutputPort("p_WT").Eval(context).reshape(-1, 3)
    for name, point in zip(hand.tip_frames, p_WT, strict=True):
        frame = plant.GetFrameByName(name.split("::")[-1])
        np.testing.assert_allclose(frame.CalcPoseInWorld(own).translation(), point, atol=1e-9)


def test_the_hand_starts_raised_over_the_box_which_stands_on_the_table(driven):
    hand, _, context = driven
    own = hand.station.GetMyContextFromRoot(context)
    p_WO = hand.station.GetOutputPort("X_WO").Eval(own).translation()
    height = TABLE.solid.distance(p_WO[None])
    np.testing.assert_allclose(height, BOX.size[2] / 2, atol=SUNK)
    settings = GRASP.make_settings(HAND.description.fingertips)
    raised = p_WO + np.array([0.0, 0.0, settings.approach_height])
    slides = list(HAND.base.joints[:3])
    over_box = HAND.home(raised, 0.0)[slides]
    np.testing.assert_allclose(hand.controller.initial[slides], over_box, atol=SUNK)
