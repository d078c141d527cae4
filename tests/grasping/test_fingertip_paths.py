"""Goals of fingertips: free space, paths, and positions of withdrawn fingers."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from thin_cup import CUP, RADIUS

from drake_pregrasp import BallSolid, BoxSolid, HalfSpace
from drake_pregrasp.geometry.mesh_surface import INTRUSION
from drake_pregrasp.grasping.fingertip_paths import (
    MOVING_CLEARANCE,
    OTHER_CLEARANCE,
    Pace,
    TipPlaces,
    TipRoom,
    shape_goals,
)

BOX = BoxSolid(np.zeros(3), np.eye(3), np.array([0.1, 0.08, 0.1]))
TABLE = HalfSpace(np.array([0.0, 0.0, -0.05]), np.array([0.0, 0.0, 1.0]))
CLEARANCE = 0.017
PACE = Pace(speed=0.3, acceleration=2.5, period=0.02)
STEP = PACE.speed * PACE.period
ROOM = TipRoom(
    object=BOX,
    object_clearances=np.full(5, CLEARANCE),
    others=((TABLE, np.full(5, 0.013)),),
    spacing=np.full((5, 5), 0.022),
    intrusions=np.full(5, INTRUSION),
)


def room_alone(solid=BOX, others=(), clearance=CLEARANCE):
    """Room of a single tip."""
    around = tuple((other, np.full(1, 0.013)) for other in others)
    least, intrusions = np.full(1, clearance), np.full(1, INTRUSION)
    return TipRoom(solid, least, around, np.zeros((1, 1)), intrusions)


ALONE = room_alone()


def walk(p, goal, rooms):
    """Positions of tips at each tick on their ways through rooms."""
    v = np.zeros_like(p)
    for room in rooms:
        moved = shape_goals(p, v, goal, PACE, room)
        v = PACE.limited((moved - p) / PACE.period, v)
        p = moved
        yield p


point = st.tuples(*[st.floats(-0.15, 0.15)] * 3)
points = st.lists(point, min_size=5, max_size=5)


@given(points)
def test_permitted_places_are_out_of_the_object_and_stay(p):
    moved = ROOM.permitted(np.array(p))
    assert np.min(BOX.distance(moved)) >= CLEARANCE - 1e-9
    gaps = np.linalg.norm(moved[:, None] - moved, axis=2) + np.eye(5)
    if np.min(TABLE.distance(moved)) >= 0.013 and np.min(gaps) >= 0.022:
        np.testing.assert_array_equal(ROOM.permitted(moved), moved)


def test_tips_that_are_too_near_come_apart_evenly_and_off_the_table():
    near, low = [[0.067, 0, 0], [0.067, 0.004, 0]], [0.067, -0.03, -0.06]
    p = np.array([*near, low, [-0.067, 0, 0], [0, 0.06, 0.02]])
    moved = ROOM.permitted(p)
    gaps = np.linalg.norm(moved[:, None] - moved, axis=2)[np.triu_indices(5, 1)]
    assert np.min(gaps) >= 0.022 - 1e-6
    assert moved[:2, 1].mean() == pytest.approx(0.002)
    assert np.min(TABLE.distance(moved)) >= 0.013 - 1e-6


@pytest.mark.slow
@given(point, point)
@settings(max_examples=40)
def test_a_tip_gets_everywhere_without_touching_or_jumping(start, end):
    p, goal = ALONE.permitted(np.array([start])), ALONE.permitted(np.array([end]))
    assume(min(p[0, 2], goal[0, 2]) > -0.05)  # Nothing goes below what stands on a table.
    for moved in walk(p, goal, 200 * [ALONE]):  # The longest way is half round at 6 mm a step.
        # A step along the surface that bends away at an edge is pushed out as well.
        pushed = np.hypot(CLEARANCE, STEP) - CLEARANCE
        assert np.linalg.norm(moved - p) <= 1.001 * np.hypot(STEP, pushed)
        assert BOX.distance(moved)[0] >= CLEARANCE - 1e-9
        p = moved
    np.testing.assert_allclose(p, goal, atol=1e-9)


def test_a_tip_starts_and_stops_gently():
    p, goal = np.array([[0.07, 0.0, 0.0]]), np.array([[0.12, 0.06, 0.03]])
    path = np.array([p, p, *walk(p, goal, 60 * [ALONE])])
    accelerations = np.linalg.norm(np.diff(path, n=2, axis=0), axis=2) / PACE.period**2
    assert np.max(accelerations) <= PACE.acceleration * (1 + 1e-9)
    np.testing.assert_allclose(path[-1], goal, atol=1e-9)


def test_a_tip_goes_round_on_the_shorter_side():
    p, goal = np.array([[0.07, 0.01, 0.0]]), np.array([[-0.07, 0.01, 0.0]])
    sides = [moved[0, 1] for moved in walk(p, goal, 80 * [ALONE])]
    assert max(sides) > 0.05
    assert min(sides) > 0


@pytest.mark.parametrize(("gap", "goes_over"), [(0.01, True), (0.04, False)])
def test_a_tip_goes_over_the_object_where_a_wall_leaves_no_room_beside_it(gap, goes_over):
    wall = BoxSolid(np.array([0.0, 0.05 + gap, 0.0]), np.eye(3), np.array([0.3, 0.02, 0.1]))
    room = room_alone(others=[wall])
    p, goal = np.array([[0.07, 0.01, 0.0]]), np.array([[-0.07, 0.01, 0.0]])
    path = np.concatenate(list(walk(p, goal, 200 * [room])))
    np.testing.assert_allclose(path[-1], goal[0], atol=1e-6)
    assert np.min(wall.distance(path)) > 0.01
    assert (np.max(path[:, 2]) > 0.05) == goes_over


def test_an_obstacle_that_comes_pushes_tips_away():
    p = np.array([[0.07, 0.0, 0.0]])
    v = np.zeros_like(p)
    for x in np.linspace(0.2, 0.12, 30):
        ball = BallSolid(np.array([x, 0.005, 0.0]), 0.03)
        room = room_alone(others=[ball])
        p = shape_goals(p, v, room.permitted(np.array([[0.07, 0.0, 0.0]])), PACE, room)
        assert ball.distance(p)[0] >= 0.013 - 1e-4
        assert BOX.distance(p)[0] >= CLEARANCE - 1e-9


AZIMUTHS = np.array([0.0, 2.0, 4.0])


@pytest.fixture(scope="module")
def in_cup():
    return room_alone(CUP.solid, clearance=0.011)


@pytest.mark.slow
@pytest.mark.parametrize("start", [[-0.06, 0.06, 0.02], [0.08, 0.0, 0.04], [0.0, 0.0, 0.15]])
@pytest.mark.parametrize("goal", [[-0.019, 0.0, 0.05], [0.01, 0.015, 0.02]])
def test_a_tip_gets_into_a_hollow_and_out_again_and_stays_clear(start, goal, in_cup):
    for ends in ([start, goal], [goal, start]):
        first, last = np.array(ends)[:, None]
        path = np.array(list(walk(first, last, [in_cup] * 200)))[:, 0]
        assert np.min(CUP.solid.distance(path)) > 0.0105
        np.testing.assert_allclose(path[-1], last[0], atol=1e-4)


def test_a_tip_that_is_too_near_leaves_straight(in_cup):
    """As one does that gives up its strain: its clearance grows while it touches."""
    y = RADIUS + np.array([0.010, 0.011])
    start, goal = (np.array([[0.0, distance, 0.06]]) for distance in y)
    path = np.array(list(walk(start, goal, [in_cup] * 20)))[:, 0]
    np.testing.assert_allclose(path[:, [0, 2]], start[:, [0, 2]].repeat(20, 0), atol=1e-6)
    np.testing.assert_allclose(path[-1], goal[0], atol=1e-6)


RADII = np.array([0.008, 0.01, 0.012])
WAYS = np.stack([np.cos(AZIMUTHS), np.sin(AZIMUTHS), np.zeros(3)], axis=1)
PLACES = TipPlaces(RADII, WAYS, np.array([0.07, 0.08, 0.09]))
TOP = 0.05
BALL = BallSolid(np.zeros(3), 0.04)
three_tips = st.lists(point, min_size=3, max_size=3).map(np.array)


def room_of(gaps, goals=WAYS, fixed=(), obstacles=(), holding=(False,) * 3):
    around = {"fixed": fixed, "obstacles": obstacles, "holding": np.array(holding)}
    return PLACES.room(BALL, gaps, **around).with_room_at(goals)


@given(st.floats(-3, 3))
def test_withdrawn_tips_are_over_the_object_and_turn_with_the_palm(yaw):
    turn = Rotation.from_rotvec([0, 0, yaw]).as_matrix()
    still, turned = (PLACES.withdrawn(angle, TOP) for angle in (0.0, yaw))
    np.testing.assert_allclose(turned, still @ turn.T, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(still[:, :2], axis=1), PLACES.withdrawn_radii)
    assert np.all(still[:, 2] - RADII > TOP)


@given(three_tips, st.floats(-0.01, 0.05))
def test_first_contacts_ask_of_tips_to_stay(p_GT, standoff):
    p_GC, nhat = PLACES.first_contacts(p_GT, standoff)
    np.testing.assert_allclose(p_GC + (RADII + standoff)[:, None] * nhat, p_GT, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(nhat, axis=1), 1)
    np.testing.assert_array_equal(nhat[:, 2], 0)


def test_a_tip_without_a_direction_has_that_of_its_finger():
    _, nhat = PLACES.first_contacts(np.zeros((3, 3)), 0.02)
    np.testing.assert_array_equal(nhat, WAYS)


@given(three_tips)
def test_room_keeps_tips_off_solids_and_other_tips_by_radii_and_clearances(p_GT):
    gaps = np.array([0.02, 0.001, -0.003])
    room = room_of(gaps, fixed=[TABLE])
    permitted = room.permitted(p_GT)
    off = BALL.distance(permitted) - RADII
    assert np.all(off >= np.minimum(gaps, MOVING_CLEARANCE) - 1e-9)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        assert abs(room.spacing[i, j] - RADII[i] - RADII[j] - OTHER_CLEARANCE) < 1e-12


def test_tips_may_be_as_near_as_they_are_to_touch_or_press():
    gaps = np.array([0.004, 0.001, -0.003])
    room = room_of(gaps)
    touching = (BALL.radius + RADII + gaps)[:, None] * WAYS
    np.testing.assert_allclose(room.permitted(touching), touching, atol=1e-9)


def test_tips_come_as_near_to_other_parts_of_the_object_as_their_goals():
    """But not much nearer than they should: contacts are not planned there."""
    lacking = np.array([0.0005, 0.001, 0.009])
    goals = (BALL.radius + RADII + MOVING_CLEARANCE - lacking)[:, None] * WAYS
    permitted = room_of(np.full(3, 0.02), goals).permitted(goals)
    np.testing.assert_allclose(permitted[:2], goals[:2], atol=1e-9)
    least = RADII[2] + MOVING_CLEARANCE - INTRUSION
    assert BALL.distance(permitted)[2] == pytest.approx(least)


def test_tips_that_hold_come_as_near_to_the_object_as_their_goals():
    """A pad touches along its jaw, where the object may be nearer than along its normal."""
    goals = (BALL.radius + RADII + [0.006, 0.001, -0.001])[:, None] * WAYS
    room = room_of(np.full(3, 0.02), goals, holding=(True,) * 3)
    assert room.permitted(goals) is goals
    near = BALL.distance(room.permitted(0.9 * goals)) - RADII
    np.testing.assert_allclose(near, [0.006, 0.001, -0.001], atol=1e-9)


def test_tips_that_hold_avoid_the_table_but_no_obstacle():
    wall = HalfSpace(np.array([0.1, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]))
    holding = np.array([True, False, True])
    room = room_of(np.full(3, 0.02), fixed=[TABLE], obstacles=[wall], holding=holding)
    beyond = np.array([[0.12, y, 0.0] for y in (-0.05, 0.0, 0.05)])
    moved = np.any(room.permitted(beyond) != beyond, axis=1)
    np.testing.assert_array_equal(moved, ~holding)
    below = np.array([[0.08, y, -0.06] for y in (-0.05, 0.0, 0.05)])
    assert np.all(TABLE.distance(room.permitted(below)) >= RADII + OTHER_CLEARANCE - 1e-9)
