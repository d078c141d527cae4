"""Contacts without a region, and fingertips without room, get other places."""

import numpy as np
import pytest
from selections import (
    BALL,
    CUBE,
    goals_towards,
    lengths,
    on_face,
    overlaps,
    selection_of,
    spread_contacts,
    tracking_goals,
)

from drake_pregrasp import ContactStatus, box_surface
from drake_pregrasp.contacts.assignment import make_room
from drake_pregrasp.contacts.centroids import position_tracking, select_contacts
from drake_pregrasp.contacts.goal_limits import ContactLimits
from drake_pregrasp.geometry.box_surface import BOX_FACES
from drake_pregrasp.geometry.mesh_surface import AxisArea, mesh_surface
from drake_pregrasp.geometry.shapes import box_shape
from drake_pregrasp.geometry.solids import BallSolid, BoxSolid, HalfSpace
from drake_pregrasp.regions.constraints import Limit, Obstacles, RegionConstraints
from drake_pregrasp.regions.finger_reach import FingerReach
from drake_pregrasp.regions.safe_regions import NO_REGION
from drake_pregrasp.regions.walls import normals_agree


@pytest.mark.slow
def test_a_contact_without_a_region_comes_back_to_a_permitted_place_with_room():
    rng = np.random.default_rng(0)
    tips = np.full(5, 0.008)
    reach = [FingerReach(BallSolid(np.array([0.0, 0.0, 0.02]), 0.055))] * 5
    wall = Obstacles((HalfSpace(np.array([0, 0, -0.02]), np.array([0, 0, 1.0])),))
    constraints = {"tip_radii": tips, "reach": reach, "obstacles": wall, "clearance": 0.002}
    for _ in range(6):
        p_OC = spread_contacts(BALL, 5, 0.025, int(rng.integers(1000)))
        p_OC[1] = p_OC[0]  # And some are out of the reach, or behind the wall.
        limits = ContactLimits(recover=True, max_step=0.01)
        for _ in range(25):
            chosen = selection_of(BALL, p_OC, **constraints)
            goals = select_contacts(chosen, position_tracking, limits=limits)
            assert np.max(lengths(goals.p_OC - p_OC)) <= 0.01 + 1e-12
            p_OC = goals.p_OC
        assert np.all(goals.active)
        assert not overlaps(BALL, goals, tips)
        normals = BALL.project(p_OC)[1]
        for i in range(5):
            there = p_OC[i][None], normals[i][None]
            assert chosen.regions.constraints.limits_at(i, *there)[0] == Limit.NONE


def test_the_way_back_leads_to_the_nearest_place_with_room():
    p_OC = on_face((0.005, 0.005), (0.025, 0.005), (0.015, 0.004))
    goals = goals_towards([p_OC[0], p_OC[1], None], p_OC, 0.011, recover=True)
    centres = [CUBE.p_OQ + 0.011 * CUBE.nhat_OQ - p for p in p_OC[:2] + np.array([0.011, 0, 0])]
    room = np.min(np.linalg.norm(centres, axis=2), axis=0) > 0.022
    nearest = np.min(lengths(CUBE.p_OQ[room] - p_OC[2]))
    assert np.linalg.norm(goals[2] - p_OC[2]) == pytest.approx(nearest)
    assert np.min(lengths(goals[2] - p_OC[:2])) > 0.022 - 1e-9


def on_sides(*sides):
    """Constraints of fingertips that may each touch one side only."""
    closed = [[AxisArea(face) for face in BOX_FACES if face != side] for side in sides]
    return RegionConstraints(tip_radii=np.full(len(sides), 0.012), tip_gap=0.004, closed=closed)


@pytest.mark.parametrize(("width", "away"), [(0.05, [1]), (0.062, [1]), (0.064, []), (0.08, [])])
def test_a_fingertip_without_room_between_two_others_keeps_away(width, away):
    surface = box_surface([width] * 3, spacing=0.005)
    p_OC = width / 2 * np.array([[1, 0.888, 0.4], [1, 0, 0.4], [1, -0.888, 0.4], [-1, 0, 0.2]])
    given, has_room = make_room(surface, p_OC, on_sides("+x", "+x", "+x", "-x"))
    assert np.flatnonzero(~has_room).tolist() == away
    np.testing.assert_array_equal(given, p_OC)  # No other has to move.


@pytest.mark.parametrize(("side", "up"), [(1, 2), (2, 1)])
def test_fingertips_that_overlap_get_the_nearest_place_side_by_side(side, up):
    """Also over an object that lies on another face."""
    surface = box_surface([0.08] * 3, spacing=0.005)
    p_OC = np.full((2, 3), 0.04)
    p_OC[:, side], p_OC[:, up] = [0.0, 0.005], [0.01, -0.03]  # One under the other.
    given, has_room = make_room(surface, p_OC, on_sides("+x", "+x"), up=np.eye(3)[up])
    assert has_room.all()
    np.testing.assert_array_equal(given[0], p_OC[0])
    assert 0.028 <= given[1, side] <= 0.028 + 0.005
    np.testing.assert_allclose(given[1, up], p_OC[1, up], atol=0.0025)


def test_the_way_back_leads_into_no_ball_round_forbidden_points():
    surface = box_surface([0.1, 0.1, 0.1], spacing=0.01, forbidden_radius=0.012)
    p_OC = np.array([[-0.05, 0.005, 0.005], [0.05, 0.01, 0.049]])
    goals = goals_towards([p_OC[0], None], p_OC, surface=surface, recover=True)
    assert 0.012 < np.min(lengths(surface.forbidden.points - goals[1])) < 0.03


def test_the_way_back_leads_through_no_wall():
    """The nearest permitted place is right below, 3 mm away, but no step leads there."""
    rims = [AxisArea(face) for face in ("+x", "-x", "+y", "-y")]
    plate = mesh_surface(box_shape([0.1, 0.1, 0.003]), spacing=0.006, no_touch=rims)
    p_OC = np.array([[0.0, 0.0, 0.0015]])
    above = BoxSolid(np.array([0.0, 0.0, 0.0114]), np.eye(3), np.array([0.04, 0.04, 0.02]))
    constraints = {"obstacles": Obstacles((above,)), "clearance": 5e-4}
    limits = ContactLimits(recover=True, max_step=0.004)
    for _ in range(10):
        same_side = normals_agree(plate.project(p_OC)[1], plate.nhat_OQ)
        goals = tracking_goals(plate, p_OC, limits, same_side=same_side, **constraints)
        p_OC = goals.p_OC
    assert goals.active[0]
    assert p_OC[0, 2] == pytest.approx(0.0015)


def test_without_recovery_it_stays():
    p_OC = spread_contacts(BALL, 4, 0.03)
    start = p_OC[1].copy()
    reach = [None, FingerReach(BallSolid(-start, 0.02)), None, None]
    for recover in (False, True):
        for _ in range(4):  # Around the ball: no step leads to surface that faces the other way.
            chosen = selection_of(BALL, p_OC, reach=reach)
            chosen.regions.labels[chosen.regions.labels == 1] = NO_REGION
            limits = ContactLimits(recover=recover)
            goals = select_contacts(chosen, position_tracking, limits=limits)
            assert not goals.active[1]
            p_OC[1] = goals.p_OC[1]
            assert recover or np.all(p_OC[1] == start)
    assert np.linalg.norm(p_OC[1] + start) <= 0.02


def test_a_lost_contact_does_not_recover():
    p_OC = spread_contacts(BALL, 4, 0.03)
    p_OC[1] = BALL.project(p_OC[1:2] + 0.002)[0][0]  # Not where a candidate is.
    chosen = selection_of(BALL, p_OC, weights=[0, -np.inf, 0, 0])
    goals = select_contacts(chosen, position_tracking, limits=ContactLimits(recover=True))
    np.testing.assert_array_equal(goals.p_OC[1], p_OC[1])
    assert goals.status[1] == ContactStatus.LOST
