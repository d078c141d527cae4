"""Limits on the motion of contact goals from tick to tick, and the way back of contacts."""

import numpy as np
import pytest
from conftest import slow
from selections import (
    BALL,
    CUBE,
    Wandering,
    always_worse,
    given_regions,
    goals_towards,
    lengths,
    nearest_candidate,
    on_face,
    overlaps,
    selection_of,
    spread_contacts,
    tracking_goals,
    wander,
    without_region,
)
from thin_cup import CUP, RADIUS, WALL

from drake_pregrasp import ContactStatus, InvalidArgumentError, box_surface
from drake_pregrasp.contacts.centroids import position_tracking, select_contacts
from drake_pregrasp.contacts.contact_pairs import Pair
from drake_pregrasp.contacts.goal_limits import (
    ContactLimits,
    hold_contacts,
    judged_goals,
    steps_toward,
)
from drake_pregrasp.contacts.quality_guard import guard_measure
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.geometry.mesh_surface import AxisArea, mesh_surface
from drake_pregrasp.geometry.shapes import box_shape, cylinder_shape
from drake_pregrasp.geometry.solids import BallSolid, BoxSolid, HalfSpace
from drake_pregrasp.regions.constraints import Limit, Obstacles
from drake_pregrasp.regions.finger_reach import FingerReach
from drake_pregrasp.regions.walls import normals_agree

CAN = mesh_surface(
    cylinder_shape(0.035, 0.12), spacing=0.008, no_touch=[AxisArea("+z"), AxisArea("-z")]
)
THIN_CUP = mesh_surface(CUP, spacing=0.006)
PLATE = mesh_surface(box_shape([0.1, 0.1, 0.003]), spacing=0.006)


# Steps.


@pytest.mark.parametrize("surface", [BALL, CUBE, THIN_CUP], ids=["ball", "cube", "cup"])
def test_no_step_is_longer_than_max_step_and_all_end_on_the_allowed_surface(surface):
    limits = ContactLimits(max_step=0.004)
    moved = 0.0
    for _, before, goals in wander(surface, spread_contacts(surface, 4, 0.02), limits, 15):
        steps = lengths(goals.p_OC - before)
        assert np.max(steps) <= 0.004 + 1e-12
        moved += np.sum(steps)
        np.testing.assert_allclose(goals.p_OC, surface.project(goals.p_OC)[0], atol=1e-9)
    assert moved > 0.05


@pytest.mark.parametrize("surface", [BALL, CUBE], ids=["ball", "cube"])
def test_small_steps_lead_to_the_goal(surface):
    place, goal = surface.project(np.array([[0.1, 0.01, 0.0], [-0.02, 0.1, 0.01]]))[0]
    for _ in range(100):
        after = steps_toward(surface, place[None], goal[None], 0.004)[0]
        assert np.linalg.norm(after - goal) < np.linalg.norm(place - goal)
        place = after
        if np.linalg.norm(place - goal) <= 1e-12:
            return
    pytest.fail("the goal is not reached")


@pytest.mark.parametrize("max_step", [0.001, 0.004, 0.02])
@pytest.mark.parametrize(
    ("surface", "start", "goal"),
    [
        (PLATE, [0.01, 0.0, 0.0015], [0.02, 0.01, -0.0015]),
        (PLATE, [0.01, 0.0, 0.0015], [0.01, 0.0, -0.0015]),
        (THIN_CUP, [RADIUS, 0, 0.05], [RADIUS - WALL, 0, 0.045]),
        (THIN_CUP, [RADIUS - WALL, 0, 0.05], [RADIUS, 0.0, 0.05]),
    ],
)
def test_no_step_leads_through_a_wall(surface, start, goal, max_step):
    (place, goal), (normal, _) = surface.project(np.array([start, goal]))
    for _ in range(50):
        place = steps_toward(surface, place[None], goal[None], max_step)[0]
        assert surface.project(place[None])[1][0] @ normal > 0
    assert np.linalg.norm(place - goal) < WALL + 2e-4  # Opposite to it, and no farther.


def test_a_contact_off_the_allowed_surface_moves_to_it_in_one_tick():
    inside = np.array([[0.02, 0.0, 0.0]])
    place = steps_toward(BALL, inside, BALL.project(np.array([[-1.0, 0, 0]]))[0], 0.001)
    np.testing.assert_allclose(place, BALL.project(inside)[0])


def test_within_the_deadband_goals_stay_to_the_bit():
    p_OC = spread_contacts(CUBE, 4, 0.03)
    free = tracking_goals(CUBE, p_OC).p_OC
    steps = lengths(free - p_OC)
    deadband = np.sort(steps)[1:3].mean()
    goals = tracking_goals(CUBE, p_OC, ContactLimits(deadband=deadband)).p_OC
    stays = steps < deadband
    assert np.sum(stays) == 2
    np.testing.assert_array_equal(goals[stays], p_OC[stays])
    np.testing.assert_allclose(goals[~stays], free[~stays], atol=1e-12)


def test_the_deadband_holds_no_contact_where_it_may_not_be():
    """An obstacle has come a millimetre too near: the way out is shorter than the deadband."""
    p_OC = spread_contacts(CUBE, 4, 0.05, first=[[0.05, 0.001, 0.002]])
    wall = Obstacles((HalfSpace(np.array([0.0, -0.001, 0.0]), np.array([0.0, 1.0, 0.0])),))
    limits = ContactLimits(deadband=0.05, recover=True)
    for _ in range(3):
        goals = tracking_goals(CUBE, p_OC, limits, obstacles=wall, clearance=0.003)
        p_OC = goals.p_OC
    assert goals.active[0]
    assert p_OC[0, 1] >= 0.002


def test_goals_stay_on_permitted_surface_of_their_regions():
    """The centroid of two candidates lies between them, on the surface of neither."""
    p_OC = np.array([[0.05, -0.02, 0.005]])
    both = [nearest_candidate(CUBE, [0.05, y, 0.005]) for y in (-0.015, 0.025)]
    ball = Obstacles((BallSolid(np.array([0.05, 0.005, 0.005]), 0.018),))
    # Cells of 10 mm: regions end at -10 and 20 mm, inside the ball; candidates are outside of it.
    for obstacles, places in ((Obstacles(), (-0.01, 0.02)), (ball, (-0.015, 0.025))):
        regions = given_regions(CUBE, both, obstacles=obstacles)
        chosen = SelectionInput(CUBE, p_OC, regions, np.eye(3))
        goals = select_contacts(chosen, position_tracking)
        assert np.min(np.abs(goals.p_OC[0, 1] - places)) < 1e-9
        assert goals.active[0]


# Pairs.

PAIR = Pair(first=0, second=1, distance=0.03)


def error(pair, surface, p_OC):
    return pair.error(p_OC, surface.project(p_OC)[1])


def paired_contacts(surface, n, distance=0.03, seed=1):
    """Random candidates, the first two at the distance of the pair, the others apart."""
    first = np.random.default_rng(seed).choice(surface.p_OQ)
    second = min(surface.p_OQ, key=lambda q: abs(np.linalg.norm(q - first) - PAIR.distance))
    p_OC = spread_contacts(surface, n, distance, seed, first=[first, second])
    assert error(PAIR, surface, p_OC) < PAIR.tolerance
    return p_OC


@pytest.mark.slow
@pytest.mark.parametrize("surface", [BALL, CAN], ids=["ball", "can"])
@pytest.mark.parametrize("max_step", [np.inf, 0.004])
def test_pairs_keep_their_distance_and_the_second_its_region(surface, max_step):
    limits = ContactLimits(pairs=(PAIR,), max_step=max_step)
    moved = np.zeros(2)
    for chosen, before, goals in wander(surface, paired_contacts(surface, 4), limits, 40):
        assert error(PAIR, surface, goals.p_OC) <= PAIR.tolerance + 1e-12
        steps = lengths(goals.p_OC - before)
        assert np.max(steps) <= max_step + 1e-12
        if steps[1] > 0 and max_step == np.inf:  # A shorter step may end before its region.
            own = surface.project_into(goals.p_OC[1:2], [chosen.regions.members(1)])[0]
            np.testing.assert_allclose(goals.p_OC[1:2], own, atol=1e-9)
        moved += steps[:2]
    assert np.all(moved > 0.01)


JAWS = Pair(first=0, second=1)
Z_JAWS = [FingerReach(None, sign * np.eye(3)[0], axis=np.eye(3)[2]) for sign in (1, -1)]


@pytest.mark.slow
@pytest.mark.parametrize("reach", [[], [*Z_JAWS, None, None]], ids=["free", "jaws"])
@pytest.mark.parametrize("surface", [BALL, CAN, CUBE], ids=["ball", "can", "cube"])
def test_opposite_contacts_stay_opposite_while_they_move(surface, reach):
    first = surface.project(np.array([[0.1, 0.03, 0.0]]))
    across = np.array([1.0, 1.0, 0.0 if reach else 1.0])
    second = surface.project(first[0] - 0.2 * across * first[1])[0]
    p_OC = spread_contacts(surface, 4, 0.03, first=[first[0][0], second[0]])
    moved, limits, axis = 0.0, ContactLimits(pairs=(JAWS,)), (1 - across) * np.eye(3)[2]
    allowed = max(JAWS.tolerance, JAWS.error(p_OC, surface.project(p_OC)[1], axis))
    for _, before, goals in wander(surface, p_OC, limits, 20, reach=reach):
        (a, b), normals = goals.p_OC[:2], surface.project(goals.p_OC)[1]
        line = (b - a) / np.linalg.norm(b - a)
        assert max(normals[0] @ line, -normals[1] @ line) < -np.cos(np.radians(31))
        mean = across * (normals[1] - normals[0])
        off = np.linalg.norm(np.cross(b - a, mean / np.linalg.norm(mean)))
        assert off <= allowed + 1e-12
        moved, allowed = moved + np.linalg.norm(b - before[1]), max(JAWS.tolerance, off)
    assert off <= JAWS.tolerance
    assert moved > 0.005


def test_jaws_that_are_off_each_others_height_go_there():
    """With normals of a ball that are opposite, on a line which is not across the axis."""
    first, up = BALL.project(np.array([[0.08, 0.0, 0.02]]))[0][0], np.eye(3)[2]
    p_OC = spread_contacts(BALL, 2, 0.03, first=[first, -first])
    status = []
    for reach in ([], Z_JAWS):
        chosen = selection_of(BALL, p_OC, reach=reach)
        assert error(JAWS, BALL, p_OC) < JAWS.tolerance
        limits, known = ContactLimits(pairs=(JAWS,)), np.ones(2, dtype=bool)
        status.append(judged_goals(chosen, p_OC, known, limits).status[0])
        for guard in (None, always_worse()):  # It holds those that are opposite each other.
            limits = ContactLimits(pairs=(JAWS,), guard=guard)
            goals = tracking_goals(BALL, p_OC, limits, reach=reach).p_OC
            assert (abs((goals[1] - goals[0]) @ up) <= JAWS.tolerance) == bool(reach)
    assert status == [ContactStatus.ACTIVE, ContactStatus.APART_FROM_PARTNER]


@pytest.mark.slow
def test_pairs_keep_their_distance_when_one_of_them_has_to_leave():
    """Obstacles come and go, and a guard would hold the one that may stay."""
    p_OC = paired_contacts(CAN, 5)
    limits = ContactLimits(pairs=(PAIR,), recover=True, guard=guard_measure(["margin"], 0.7))
    rng, strategy = np.random.default_rng(2), Wandering(3)
    moved = 0.0
    for tick in range(25):
        outward = p_OC[0] / np.linalg.norm(p_OC[0])
        ball = BallSolid(p_OC[0] + 0.02 * outward + rng.normal(size=3) * 0.01, 0.02)
        constraints = {"obstacles": Obstacles((ball,)), "clearance": 0.002} if tick % 3 else {}
        chosen = selection_of(CAN, p_OC, **constraints)
        goals = select_contacts(chosen, strategy, limits=limits)
        assert error(PAIR, CAN, goals.p_OC) <= PAIR.tolerance + 1e-12
        moved += np.linalg.norm(goals.p_OC[0] - p_OC[0])
        p_OC = goals.p_OC
    assert moved > 0.01


def test_a_pair_whose_distance_cannot_be_met_stays():
    p_OC = paired_contacts(BALL, 3)
    chosen = without_region(selection_of(BALL, p_OC), 1)  # The second cannot follow.
    free, goals = (
        select_contacts(chosen, position_tracking, limits=ContactLimits(pairs=pairs)).p_OC
        for pairs in ((), (PAIR,))
    )
    assert error(PAIR, BALL, free) > PAIR.tolerance
    np.testing.assert_array_equal(goals[:2], p_OC[:2])
    np.testing.assert_array_equal(goals[2], free[2])


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ({"max_step": 0.0}, "max_step must be greater than 0 m, not 0"),
        ({"max_step": np.nan}, "max_step"),
        ({"deadband": -1.0}, "deadband must be at least 0 m, not -1"),
        ({"deadband": np.inf}, "deadband"),
        ({"pairs": (PAIR, Pair(1, 2, 0.03))}, r"in two pairs: \[0, 1, 1, 2\]"),
        ({"pairs": (Pair(1, 1, 0.03),)}, "in two pairs"),
    ],
)
def test_limits_that_contradict_themselves_are_refused(arguments, problem):
    with pytest.raises(InvalidArgumentError, match=problem):
        ContactLimits(**arguments)


def test_a_pair_off_its_distance_goes_to_it_whatever_a_guard_says():
    pair = Pair(first=0, second=1, distance=0.06)
    p_OC = CUBE.project(np.array([[0.06, 0.0, 0.0], [0.06, 0.02, 0.0], [-0.06, 0, 0]]))[0]
    for guard in (None, always_worse()):
        goals = tracking_goals(CUBE, p_OC, ContactLimits(pairs=(pair,), guard=guard)).p_OC
        assert error(pair, CUBE, goals) <= pair.tolerance
        assert np.any(goals[2] != p_OC[2]) == (guard is None)


def test_a_pair_that_gets_nearer_to_its_distance_moves():
    """On a ball of 80 mm no two contacts are 200 mm apart."""
    pair = Pair(first=0, second=1, distance=0.2)
    p_OC = spread_contacts(BALL, 3, 0.03)
    chosen = selection_of(BALL, p_OC)
    goals = tracking_goals(BALL, p_OC, ContactLimits(pairs=(pair,))).p_OC
    np.testing.assert_array_equal(goals[0], tracking_goals(BALL, p_OC).p_OC[0])
    members = BALL.p_OQ[chosen.regions.members(1)]
    farthest = members[np.argmax(lengths(members - goals[0]))]
    assert error(pair, BALL, goals) < error(pair, BALL, p_OC)
    assert np.linalg.norm(goals[1] - farthest) < 0.01


# Fingertips.


@pytest.mark.parametrize("seed", [0, slow(1)])
@pytest.mark.parametrize(
    ("surface", "pairs"),
    [(BALL, ()), (CUBE, ()), (THIN_CUP, ()), (CAN, (PAIR,))],
    ids=["ball", "cube", "cup", "can with a pair"],
)
def test_active_fingertips_never_overlap(surface, pairs, seed):
    tips = np.array([0.009, 0.011, 0.013, 0.008])
    place = paired_contacts if pairs else spread_contacts
    p_OC = place(surface, 4, 0.03, seed)
    limits = ContactLimits(pairs=pairs, max_step=0.03, recover=True)
    moved, active = 0.0, 0
    for _, before, goals in wander(surface, p_OC, limits, 25, seed, tip_radii=tips):
        assert not overlaps(surface, goals, tips)
        if pairs:
            assert error(PAIR, CAN, goals.p_OC) <= PAIR.tolerance + 1e-12
        moved += np.sum(lengths(goals.p_OC - before))
        active += np.sum(goals.active)
    assert moved > 0.05
    assert active > 60


def test_of_a_pair_both_are_held_where_one_meets_a_fingertip():
    before = on_face((-0.015, 0.005), (-0.015, 0.035), (0.035, 0.005))
    places = on_face((0.025, 0.005), (0.025, 0.035), (0.035, 0.005))
    for pairs, stays in (((PAIR,), [True, True]), ((), [True, False])):
        goals = goals_towards(places, before, 0.009, pairs=pairs)
        np.testing.assert_array_equal(np.all(goals == before, axis=1)[:2], stays)


def test_who_is_held_may_hold_those_behind():
    """In a row, each moves to where the one before it was, and the first one cannot."""
    before = on_face((0.045, 0.005), (0.025, 0.005), (0.005, 0.005), (-0.015, 0.005))
    goals = goals_towards(
        on_face((0.045, 0.015), (0.045, 0.005), (0.025, 0.005), (0.005, 0.005)), before, 0.009
    )
    np.testing.assert_array_equal(goals, before)


def test_held_contacts_on_forbidden_surface_or_an_active_fingertip_are_inactive_with_the_cause():
    """The third overlaps only the second, which is inactive; the last is on the cube's top."""
    p_OC = np.vstack([on_face((0, 0), (0.015, 0), (0.03, 0)), [[0, 0, 0.05]]])
    members = np.array_split(np.arange(len(CUBE.p_OQ)), 4)
    regions = given_regions(CUBE, *members, tip_radii=np.full(4, 0.01))
    goals = hold_contacts(SelectionInput(CUBE, p_OC, regions, np.eye(3)))
    active, crowded = ContactStatus.ACTIVE, ContactStatus.CROWDED_OUT
    assert list(goals.status) == [active, crowded, active, ContactStatus.NO_ALLOWED_SURFACE]
    assert goals.causes[1] == 0


@pytest.mark.parametrize(
    "limits",
    [ContactLimits(deadband=0.06), ContactLimits(guard=always_worse())],
    ids=["deadband", "guard"],
)
def test_fingertips_that_overlap_come_apart_whatever_holds_them(limits):
    p_OC = np.array([[0.05, 0.0, 0.0], [0.05, 0.012, 0.0], [-0.05, 0.0, 0.0]])
    for _ in range(3):
        goals = tracking_goals(CUBE, p_OC, limits, tip_radii=np.full(3, 0.01))
        p_OC = goals.p_OC
    assert np.all(goals.active)


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
            chosen = without_region(selection_of(BALL, p_OC, reach=reach), 1)
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
