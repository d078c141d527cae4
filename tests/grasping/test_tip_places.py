"""Where fingertips wait and what room they have, as laws."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from drake_pregrasp.geometry.solids import BallSolid, HalfSpace
from drake_pregrasp.grasping.fingertip_paths import MOVING_CLEARANCE, OTHER_CLEARANCE, TipPlaces

AZIMUTHS = np.array([0.0, 2.0, 4.0])
RADII = np.array([0.008, 0.01, 0.012])
WAYS = np.stack([np.cos(AZIMUTHS), np.sin(AZIMUTHS), np.zeros(3)], axis=1)
PLACES = TipPlaces(RADII, WAYS, np.array([0.07, 0.08, 0.09]), 0.05)
BALL = BallSolid(np.zeros(3), 0.04)
TABLE = HalfSpace(np.array([0.0, 0.0, -0.05]), np.array([0.0, 0.0, 1.0]))
NONE = np.zeros(3, dtype=bool)
angles = st.floats(-3, 3)


def tips(seed):
    return np.random.default_rng(seed).uniform(-0.15, 0.15, (3, 3))


@given(angle=angles, seed=st.integers(0, 10**6))
def test_withdrawn_tips_are_over_the_object_and_turn_with_the_palm(angle, seed):
    turn = Rotation.from_rotvec([0, 0, angle]).as_matrix()
    still, turned = (PLACES.withdrawn(tips(seed), R) for R in (np.eye(3), turn))
    np.testing.assert_allclose(turned, still @ turn.T, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(still[:, :2], axis=1), PLACES.withdrawn_radii)
    assert np.all(still[:, 2] - RADII > PLACES.object_top)


@given(seed=st.integers(0, 10**6))
def test_without_a_palm_they_wait_at_the_azimuths_where_they_are(seed):
    p_GT = tips(seed)
    withdrawn = PLACES.withdrawn(p_GT, None)
    cross = p_GT[:, 0] * withdrawn[:, 1] - p_GT[:, 1] * withdrawn[:, 0]
    np.testing.assert_allclose(cross, 0, atol=1e-12)
    assert np.all(np.sum(p_GT[:, :2] * withdrawn[:, :2], axis=1) >= 0)


@given(seed=st.integers(0, 10**6), standoff=st.floats(-0.01, 0.05))
def test_first_contacts_ask_of_tips_to_stay(seed, standoff):
    p_GT = tips(seed)
    p_GC, nhat = PLACES.first_contacts(p_GT, standoff)
    np.testing.assert_allclose(p_GC + (RADII + standoff)[:, None] * nhat, p_GT, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(nhat, axis=1), 1)
    np.testing.assert_array_equal(nhat[:, 2], 0)


def test_a_tip_without_a_direction_has_that_of_its_finger():
    _, nhat = PLACES.first_contacts(np.zeros((3, 3)), 0.02)
    np.testing.assert_array_equal(nhat, WAYS)


@given(seed=st.integers(0, 10**6))
def test_room_keeps_tips_off_what_there_is_by_their_radii_and_a_clearance(seed):
    gaps = np.array([0.02, 0.001, -0.003])
    room = PLACES.room(BALL, gaps, fixed=[TABLE], obstacles=[], holding=NONE)
    permitted = room.permitted(tips(seed))
    off = BALL.distance(permitted) - RADII
    assert np.all(off >= np.minimum(gaps, MOVING_CLEARANCE) - 1e-9)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        assert abs(room.spacing[i, j] - RADII[i] - RADII[j] - OTHER_CLEARANCE) < 1e-12


def test_tips_may_be_as_near_as_they_are_to_touch_or_press():
    gaps = np.array([0.004, 0.001, -0.003])
    room = PLACES.room(BALL, gaps, fixed=[], obstacles=[], holding=NONE)
    touching = (BALL.radius + RADII + gaps)[:, None] * WAYS
    np.testing.assert_allclose(room.permitted(touching), touching, atol=1e-9)


def test_those_that_hold_heed_the_table_but_no_obstacle():
    wall = HalfSpace(np.array([0.1, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]))
    holding = np.array([True, False, True])
    room = PLACES.room(BALL, np.full(3, 0.02), fixed=[TABLE], obstacles=[wall], holding=holding)
    beyond = np.array([[0.12, y, 0.0] for y in (-0.05, 0.0, 0.05)])
    moved = np.any(room.permitted(beyond) != beyond, axis=1)
    np.testing.assert_array_equal(moved, ~holding)
    below = np.array([[0.08, y, -0.06] for y in (-0.05, 0.0, 0.05)])
    assert np.all(TABLE.distance(room.permitted(below)) >= RADII + OTHER_CLEARANCE - 1e-9)
