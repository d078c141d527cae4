"""Fingertip goals keep out of what is there, never jump, and get to where they are to go."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from drake_pregrasp import BallSolid, BoxSolid, HalfSpace
from drake_pregrasp.grasping.fingertip_paths import TipRoom, shape_goals

BOX = BoxSolid(np.zeros(3), np.eye(3), np.array([0.1, 0.08, 0.1]))
TABLE = HalfSpace(np.array([0.0, 0.0, -0.05]), np.array([0.0, 0.0, 1.0]))
CLEARANCE = 0.017
STEP = 0.006
ROOM = TipRoom(
    object=BOX,
    p_GO=np.zeros(3),
    object_clearances=np.full(5, CLEARANCE),
    others=((TABLE, 0.013),),
    spacing=0.022,
)
ALONE = TipRoom(object=BOX, p_GO=np.zeros(3), object_clearances=np.full(1, CLEARANCE))

coordinates = st.floats(-0.15, 0.15)
points = st.lists(st.tuples(coordinates, coordinates, coordinates), min_size=5, max_size=5)


@given(points)
def test_permitted_places_are_out_of_the_object(p):
    moved = ROOM.permitted(np.array(p))
    assert np.min(BOX.distance(moved)) >= CLEARANCE - 1e-9


@given(points)
def test_permitted_places_stay(p):
    apart = ROOM.permitted(np.array(p))
    for solid, clearance in ROOM.others:
        if np.min(solid.distance(apart)) < clearance:
            return
    gaps = np.linalg.norm(apart[:, None] - apart, axis=2) + np.eye(5)
    if np.min(gaps) >= ROOM.spacing:
        np.testing.assert_array_equal(ROOM.permitted(apart), apart)


def test_tips_that_are_too_near_come_apart_evenly_and_off_the_table():
    p = np.array(
        [
            [0.067, 0, 0.0],
            [0.067, 0.004, 0.0],
            [0.067, -0.03, -0.06],
            [-0.067, 0, 0],
            [0, 0.06, 0.02],
        ]
    )
    moved = ROOM.permitted(p)
    gaps = np.linalg.norm(moved[:, None] - moved, axis=2)[np.triu_indices(5, 1)]
    assert np.min(gaps) >= ROOM.spacing - 1e-6
    assert moved[:2, 1].mean() == pytest.approx(0.002)
    assert np.min(TABLE.distance(moved)) >= 0.013 - 1e-6


@pytest.mark.slow
@given(
    st.tuples(coordinates, coordinates, coordinates),
    st.tuples(coordinates, coordinates, coordinates),
)
@settings(max_examples=40)
def test_a_tip_gets_everywhere_without_touching_or_jumping(start, end):
    p, goal = ALONE.permitted(np.array([start])), ALONE.permitted(np.array([end]))
    assume(min(p[0, 2], goal[0, 2]) > -0.05)  # Nothing goes below what stands on a table.
    for _ in range(150):  # The longest way is half round at 6 mm a step.
        moved = shape_goals(p, goal, STEP, ALONE)
        # A step along the surface that bends away at an edge is pushed out as well.
        pushed = np.hypot(CLEARANCE, STEP) - CLEARANCE
        assert np.linalg.norm(moved - p) <= 1.001 * np.hypot(STEP, pushed)
        assert BOX.distance(moved)[0] >= CLEARANCE - 1e-9
        p = moved
    np.testing.assert_allclose(p, goal, atol=1e-9)


def test_a_tip_goes_round_on_the_shorter_side():
    p = np.array([[0.07, 0.01, 0.0]])
    goal = np.array([[-0.07, 0.01, 0.0]])
    sides = []
    for _ in range(60):
        p = shape_goals(p, goal, STEP, ALONE)
        sides.append(p[0, 1])
    assert max(sides) > 0.05
    assert min(sides) > 0


def test_an_obstacle_that_comes_pushes_tips_away():
    p = np.array([[0.07, 0.0, 0.0]])
    for x in np.linspace(0.2, 0.12, 30):
        ball = BallSolid(np.array([x, 0.005, 0.0]), 0.03)
        room = TipRoom(BOX, np.zeros(3), np.full(1, CLEARANCE), ((ball, 0.013),))
        p = shape_goals(p, room.permitted(np.array([[0.07, 0.0, 0.0]])), STEP, room)
        assert ball.distance(p)[0] >= 0.013 - 1e-4
        assert BOX.distance(p)[0] >= CLEARANCE - 1e-9
