"""Shifts of the palm along its axis: which are tried, how low they may bring it, what they gain."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from five_finger_hand import HAND, X_WO
from hypothesis import given
from hypothesis import strategies as st
from pydrake.geometry import Box
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.systems.framework import DiagramBuilder

import drake_pregrasp as dp
from drake_pregrasp.diagrams.approaches import approaching_hands, best_approach
from drake_pregrasp.errors import Lack, NoGraspError
from drake_pregrasp.geometry.solids import HalfSpace
from drake_pregrasp.grasping.clearances import LINK_CLEARANCE

BASE = HAND.description.base
GROUND = HalfSpace([0, 0, 0], [0, 0, 1])
PLANNING = dp.PlannerConfig(static_duration=0.0)
lengths = st.floats(0.0, 0.4)


@given(top=lengths, shift=st.floats(-0.2, 0.2), least=lengths)
def test_a_shift_moves_the_palm_but_never_lowers_it_below_its_least_height(top, shift, least):
    unshifted = HAND.description.over_object(top).palm_height
    assert unshifted == pytest.approx(max(BASE.palm_height, top + BASE.top_clearance))
    hand = HAND.description.over_object(top, shift, least)
    assert hand.palm_height >= unshifted + shift - 1e-12
    assert hand.palm_height >= min(unshifted, top + least) - 1e-12
    if top + least <= unshifted + shift:
        assert hand.palm_height == pytest.approx(unshifted + shift)
    elif shift < 0:
        assert hand.palm_height == pytest.approx(min(unshifted, top + least))


def make_groups(count, asked):
    """Yields groups of two approaches each, and notes which were asked for."""
    for number in range(count):
        asked.append(number)
        yield [f"{number} above", f"{number} side"]


def test_shifts_are_tried_in_order_until_there_is_a_grasp():
    def start_of(hand):
        if hand < "2":
            raise NoGraspError(Lack.REACH, hand)
        return SimpleNamespace(score=float(hand == "2 side"))

    asked = []
    assert best_approach(make_groups(4, asked), start_of).hand == "2 side"
    assert asked == [0, 1, 2]
    with pytest.raises(NoGraspError, match="0 above"):
        best_approach(make_groups(2, []), start_of)


def test_shifts_are_not_tried_if_something_else_than_a_grasp_is_missing():
    def start_of(hand):
        raise dp.InvalidArgumentError(hand)

    asked = []
    with pytest.raises(dp.InvalidArgumentError, match="0 above"):
        best_approach(make_groups(4, asked), start_of)
    assert asked == [0]


@pytest.mark.slow
def test_a_palm_that_shifts_far_down_ends_over_the_top_of_a_tall_object():
    size = [0.1, 0.1, 0.3]
    tall = dp.box_surface(size, spacing=0.03)
    config = dp.GraspConfig(palm_shifts=[-1.0])
    ((hand,),) = approaching_hands(HAND, config, tall, RigidTransform(), fixed=[GROUND])
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    robot = dp.add_hand_model(plant, hand.description)
    plant.RegisterCollisionGeometry(
        plant.world_body(), RigidTransform(), Box(*size), "object", CoulombFriction(1.0, 1.0)
    )
    plant.Finalize()
    diagram = builder.Build()
    root = diagram.CreateDefaultContext()
    context = plant.GetMyContextFromRoot(root)
    plant.SetPositions(context, *robot, hand.base.at_home(hand.fingers_home))
    query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(root))
    (item,) = plant.GetCollisionGeometriesForBody(plant.world_body())
    palm = plant.GetBodyByName("palm")
    gaps = [
        query.ComputeSignedDistancePairClosestPoints(item, link).distance
        for link in plant.GetCollisionGeometriesForBody(palm)
    ]
    assert min(gaps) == pytest.approx(2 * LINK_CLEARANCE, abs=1e-6)


@pytest.mark.slow
def test_an_object_out_of_reach_is_grasped_with_a_lower_palm():
    high = replace(HAND.description, base=replace(BASE, palm_height=0.26))
    box = dp.box_surface([0.1, 0.1, 0.1], spacing=0.02, forbidden_faces=["+z", "-z"])
    there = {"mass": 0.4, "X_WO": X_WO}
    with pytest.raises(dp.NoGraspError, match="no grasp for lack of reach"):
        dp.choose_approach(high, box, PLANNING, **there, config=dp.GraspConfig(palm_shifts=[0.0]))
    config = dp.GraspConfig(palm_shifts=[0.0, -0.05, -0.08])
    hand, start = dp.choose_approach(high, box, PLANNING, **there, config=config)
    assert hand.description.palm_height == pytest.approx(0.21)
    assert np.sum(start.has_contact) >= 3
