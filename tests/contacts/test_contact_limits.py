"""What holds contact goals back from one tick to the next, over many ticks."""

import dataclasses

import numpy as np
import pytest
from thin_cup import CUP, RADIUS, WALL

from drake_pregrasp import ContactStatus, InvalidArgumentError, box_surface
from drake_pregrasp.contacts.centroids import (
    gaussian_log_weights,
    position_tracking,
    select_contacts,
    verify_contacts,
)
from drake_pregrasp.contacts.goal_limits import (
    ContactLimits,
    CoupledPair,
    follow_pairs,
    groups_of,
    hold_contacts,
    hold_where_tips_meet,
    step_toward,
    tip_gaps,
)
from drake_pregrasp.contacts.quality_guard import GUARDS, guard_measure, keep_quality
from drake_pregrasp.contacts.selection_input import ContactGoals, SelectionInput
from drake_pregrasp.errors import ContactError
from drake_pregrasp.geometry.mesh_surface import AxisArea, mesh_surface
from drake_pregrasp.geometry.shapes import ball_shape, box_shape, cylinder_shape
from drake_pregrasp.geometry.solids import BallSolid, BoxSolid, HalfSpace
from drake_pregrasp.regions.constraints import FingerReach, Limit, Obstacles, RegionConstraints
from drake_pregrasp.regions.safe_regions import NO_REGION, SafeRegions, compute_safe_regions
from drake_pregrasp.regions.walls import normals_agree

BALL = mesh_surface(ball_shape(0.04), spacing=0.006)
NO_ENDS = [AxisArea("+z"), AxisArea("-z")]
CAN = mesh_surface(cylinder_shape(0.035, 0.12), spacing=0.008, no_touch=NO_ENDS)
CUBE = box_surface([0.1, 0.1, 0.1], spacing=0.01)
THIN_CUP = mesh_surface(CUP, spacing=0.006)
PLATE = mesh_surface(box_shape([0.1, 0.1, 0.003]), spacing=0.006)


def selection(surface, p_OC, weights=None, **constraints):
    weights = np.zeros(len(p_OC)) if weights is None else np.array(weights)
    limits = RegionConstraints(**constraints)
    regions = compute_safe_regions(surface.p_OQ, p_OC, weights, surface.forbidden, limits)
    return SelectionInput(surface, p_OC, regions, 0.04**2 * np.eye(3))


class Wandering:
    """A strategy that is drawn to another place each time."""

    def __init__(self, seed, size=0.06, spread=0.01):
        self.rng, self.size, self.spread = np.random.default_rng(seed), size, spread

    def __call__(self, chosen, i):
        mean = self.rng.uniform(-self.size, self.size, 3)
        q = chosen.surface.p_OQ[chosen.regions.members(i)]
        return gaussian_log_weights(q, mean, self.spread**2 * np.eye(3))


def run(surface, p_OC, limits, ticks, seed=0, **constraints):
    """Yields the selection, contacts before and goals of each tick."""
    strategy = Wandering(seed)
    for _ in range(ticks):
        chosen = selection(surface, p_OC, **constraints)
        goals = select_contacts(chosen, strategy, limits=limits)
        yield chosen, p_OC, goals
        p_OC = goals.p_OC


def spread_contacts(surface, n, distance, seed=0):
    """Random candidates that are apart."""
    rng, chosen = np.random.default_rng(seed), []
    for q in rng.permutation(len(surface.p_OQ)):
        p = surface.p_OQ[q]
        if all(np.linalg.norm(p - other) > distance for other in chosen):
            chosen.append(p)
    assert len(chosen) >= n
    return np.array(chosen[:n])


# Steps.


@pytest.mark.parametrize("surface", [BALL, CUBE, THIN_CUP], ids=["ball", "cube", "cup"])
def test_no_step_is_longer_than_max_step_and_all_end_on_the_ground(surface):
    limits = ContactLimits(max_step=0.004)
    moved = 0.0
    for _, before, goals in run(surface, spread_contacts(surface, 4, 0.02), limits, 15):
        steps = np.linalg.norm(goals.p_OC - before, axis=1)
        assert np.max(steps) <= 0.004 + 1e-12
        moved += np.sum(steps)
        nearest, _ = surface.project(goals.p_OC)
        np.testing.assert_allclose(goals.p_OC, nearest, atol=1e-9)
    assert moved > 0.05


@pytest.mark.parametrize("surface", [BALL, CUBE], ids=["ball", "cube"])
def test_small_steps_lead_to_the_goal(surface):
    start, goal = surface.project(np.array([[0.1, 0.01, 0.0], [-0.02, 0.1, 0.01]]))[0]
    place, steps = start, 0
    while np.linalg.norm(place - goal) > 1e-12 and steps < 100:
        after = step_toward(surface, place, goal, 0.004)
        assert np.linalg.norm(after - goal) < np.linalg.norm(place - goal)
        place, steps = after, steps + 1
    assert steps < 100


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
    place, goal = surface.project(np.array([start, goal]))[0]
    normal = surface.project(place[None])[1][0]
    for _ in range(50):
        place = step_toward(surface, place, goal, max_step)
        _, normals = surface.project(place[None])
        assert normals[0] @ normal > 0
    assert np.linalg.norm(place - goal) < WALL + 2e-4  # Opposite to it, and no farther.


def test_a_contact_off_the_ground_goes_there_at_once():
    inside = np.array([0.02, 0.0, 0.0])
    place = step_toward(BALL, inside, BALL.project(np.array([[-1.0, 0, 0]]))[0][0], 0.001)
    np.testing.assert_allclose(place, BALL.project(inside[None])[0][0])


def test_within_the_deadband_goals_stay_to_the_bit():
    p_OC = spread_contacts(CUBE, 4, 0.03)
    free = select_contacts(selection(CUBE, p_OC), position_tracking).p_OC
    ways = np.linalg.norm(free - p_OC, axis=1)
    deadband = np.sort(ways)[1:3].mean()
    limits = ContactLimits(deadband=deadband)
    goals = select_contacts(selection(CUBE, p_OC), position_tracking, limits=limits).p_OC
    stays = ways < deadband
    assert np.sum(stays) == 2
    np.testing.assert_array_equal(goals[stays], p_OC[stays])
    np.testing.assert_allclose(goals[~stays], free[~stays], atol=1e-12)


def test_the_deadband_holds_no_contact_where_it_may_not_be():
    """An obstacle has come a millimetre too near: the way out is shorter than the deadband."""
    p_OC = spread_contacts(CUBE, 4, 0.05)
    p_OC[0] = [0.05, 0.001, 0.002]
    wall = HalfSpace(np.array([0.0, -0.001, 0.0]), np.array([0.0, 1.0, 0.0]))
    constraints = {"obstacles": Obstacles((wall,)), "clearance": 0.003}
    limits = ContactLimits(deadband=0.05, recover=True)
    for _ in range(3):
        goals = select_contacts(
            selection(CUBE, p_OC, **constraints), position_tracking, limits=limits
        )
        p_OC = goals.p_OC
    assert goals.active[0]
    assert p_OC[0, 1] >= 0.002


def test_goals_keep_to_their_regions_ground_and_to_what_is_permitted():
    """The centroid of two candidates lies between them, on ground of neither."""
    p_OC = np.array([[0.05, -0.02, 0.005]])
    both = np.array([[0.05, -0.015, 0.005], [0.05, 0.025, 0.005]])
    labels = np.full(len(CUBE.p_OQ), NO_REGION)
    for place in both:
        labels[np.argmin(np.linalg.norm(CUBE.p_OQ - place, axis=1))] = 0
    regions = SafeRegions.unlimited(labels, 1)
    ball = RegionConstraints(Obstacles((BallSolid(np.array([0.05, 0.005, 0.005]), 0.018),)))
    # Cells are of 10 mm: ground ends at -10 and 20 mm, where the ball is; candidates are out of it.
    for constraints, places in ((RegionConstraints(), (-0.01, 0.02)), (ball, (-0.015, 0.025))):
        limited = dataclasses.replace(regions, constraints=constraints)
        chosen = SelectionInput(CUBE, p_OC, limited, np.eye(3))
        goals = select_contacts(chosen, position_tracking)
        assert np.min(np.abs(goals.p_OC[0, 1] - places)) < 1e-9
        assert goals.active[0]


# Pairs.

PAIR = CoupledPair(first=0, second=1, distance=0.03)


def paired_contacts(surface, n, distance, seed=1):
    p_OC = spread_contacts(surface, n, 0.035, seed)
    others = surface.p_OQ[
        np.argsort(np.abs(np.linalg.norm(surface.p_OQ - p_OC[0], axis=1) - distance))
    ]
    for q in others:
        place = q
        for _ in range(60):
            way = place - p_OC[0]
            place = surface.project((p_OC[0] + distance * way / np.linalg.norm(way))[None])[0][0]
        if np.min(np.linalg.norm(p_OC[2:] - place, axis=1)) > 0.03:
            break
    p_OC[1] = place
    assert PAIR.error(p_OC) < PAIR.tolerance
    return p_OC


@pytest.mark.parametrize("surface", [BALL, CAN], ids=["ball", "can"])
@pytest.mark.parametrize("max_step", [np.inf, 0.004])
def test_pairs_keep_their_distance(surface, max_step):
    limits = ContactLimits(pairs=(PAIR,), max_step=max_step)
    p_OC, moved = paired_contacts(surface, 4, PAIR.distance), 0.0
    for _, before, goals in run(surface, p_OC, limits, 40):
        assert PAIR.error(goals.p_OC) <= PAIR.tolerance + 1e-12
        assert np.max(np.linalg.norm(goals.p_OC - before, axis=1)) <= max_step + 1e-12
        moved += np.linalg.norm(goals.p_OC[0] - before[0])
    assert moved > 0.01


def test_pairs_keep_their_distance_when_one_of_them_has_to_leave():
    """Obstacles come and go, and a guard would hold the one that may stay."""
    p_OC = paired_contacts(CAN, 5, PAIR.distance)
    limits = ContactLimits(pairs=(PAIR,), recover=True, guard=guard_measure(["margin"], 0.7))
    rng, strategy = np.random.default_rng(2), Wandering(3)
    moved = 0.0
    for tick in range(25):
        first = p_OC[0] / np.linalg.norm(p_OC[0])
        ball = BallSolid(p_OC[0] + 0.02 * first + rng.normal(size=3) * 0.01, 0.02)
        constraints = {"obstacles": Obstacles((ball,)), "clearance": 0.002} if tick % 3 else {}
        goals = select_contacts(selection(CAN, p_OC, **constraints), strategy, limits=limits)
        assert PAIR.error(goals.p_OC) <= PAIR.tolerance + 1e-12
        moved += np.linalg.norm(goals.p_OC[0] - p_OC[0])
        p_OC = goals.p_OC
    assert moved > 0.01


def test_a_pair_whose_distance_cannot_be_met_stays():
    p_OC = paired_contacts(BALL, 3, PAIR.distance)
    chosen = selection(BALL, p_OC, weights=[0, -np.inf, 0])  # The second can't follow.
    free = select_contacts(chosen, position_tracking).p_OC
    assert PAIR.error(free) > PAIR.tolerance
    goals = follow_pairs(BALL, chosen.regions, [PAIR], free, p_OC, np.inf)
    np.testing.assert_array_equal(goals[:2], p_OC[:2])
    np.testing.assert_array_equal(goals[2], free[2])


def test_the_second_of_a_pair_keeps_to_its_own_region():
    p_OC = paired_contacts(BALL, 4, PAIR.distance)
    chosen = selection(BALL, p_OC)
    free = select_contacts(chosen, Wandering(5)).p_OC
    goals = follow_pairs(BALL, chosen.regions, [PAIR], free, p_OC, np.inf)
    own = BALL.project_into(goals[1:2], [chosen.regions.members(1)])[0]
    if np.any(goals[1] != p_OC[1]):
        np.testing.assert_allclose(goals[1:2], own, atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ({"max_step": 0.0}, "max_step must be greater than 0 m, not 0"),
        ({"max_step": np.nan}, "max_step"),
        ({"deadband": -1.0}, "deadband must be at least 0 m, not -1"),
        ({"deadband": np.inf}, "deadband"),
        ({"pairs": (PAIR, CoupledPair(1, 2, 0.03))}, r"in two pairs: \[0, 1, 1, 2\]"),
        ({"pairs": (CoupledPair(1, 1, 0.03),)}, "in two pairs"),
    ],
)
def test_limits_that_contradict_themselves_are_refused(arguments, problem):
    with pytest.raises(InvalidArgumentError, match=problem):
        ContactLimits(**arguments)


def test_groups_are_the_pairs_and_each_other_contact():
    assert groups_of([CoupledPair(2, 0, 0.03)], 4) == [[2, 0], [1], [3]]


def test_a_pair_off_its_distance_goes_to_it_whatever_a_guard_says():
    pair = CoupledPair(first=0, second=1, distance=0.06)
    p_OC = CUBE.project(np.array([[0.06, 0.0, 0.0], [0.06, 0.02, 0.0], [-0.06, 0, 0]]))[0]
    for guard in (None, always_worse()):
        limits = ContactLimits(pairs=(pair,), guard=guard)
        goals = select_contacts(selection(CUBE, p_OC), position_tracking, limits=limits).p_OC
        assert pair.error(goals) <= pair.tolerance
        assert np.any(goals[2] != p_OC[2]) == (guard is None)


def test_a_pair_that_gets_nearer_to_its_distance_moves():
    """On a ball of 80 mm no two contacts are 200 mm apart."""
    pair = CoupledPair(first=0, second=1, distance=0.2)
    p_OC = spread_contacts(BALL, 3, 0.03)
    chosen = selection(BALL, p_OC)
    free = select_contacts(chosen, position_tracking).p_OC
    farthest = max(BALL.p_OQ[chosen.regions.members(1)], key=lambda q: np.linalg.norm(q - free[0]))
    goals = follow_pairs(BALL, chosen.regions, [pair], free, p_OC, np.inf)
    assert pair.error(goals) < pair.error(p_OC)
    np.testing.assert_array_equal(goals[0], free[0])
    assert np.linalg.norm(goals[1] - farthest) < 0.01


# Fingertips.


def overlaps(surface, goals, tips):
    centres = goals.p_OC + tips[:, None] * surface.project(goals.p_OC)[1]
    away = np.linalg.norm(centres[:, None] - centres, axis=2)
    both = np.outer(goals.active, goals.active) & ~np.eye(len(tips), dtype=bool)
    return np.any(both & (away < tips[:, None] + tips - 1e-8))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("surface", "pairs"),
    [(BALL, ()), (CUBE, ()), (THIN_CUP, ()), (CAN, (PAIR,))],
    ids=["ball", "cube", "cup", "can with a pair"],
)
def test_active_fingertips_never_overlap(surface, pairs, seed):
    tips = np.array([0.009, 0.011, 0.013, 0.008])
    p_OC = paired_contacts(surface, 4, PAIR.distance, seed + 1) if pairs else None
    p_OC = spread_contacts(surface, 4, 0.03, seed) if p_OC is None else p_OC
    limits = ContactLimits(pairs=pairs, max_step=0.03, recover=True)
    moved, active = 0.0, 0
    for _, before, goals in run(surface, p_OC, limits, 25, seed, tip_radii=tips):
        assert not overlaps(surface, goals, tips)
        if pairs:
            assert PAIR.error(goals.p_OC) <= PAIR.tolerance + 1e-12
        moved += np.sum(np.linalg.norm(goals.p_OC - before, axis=1))
        active += np.sum(goals.active)
    assert moved > 0.05
    assert active > 60


def test_of_a_pair_both_are_held_where_one_meets_a_fingertip():
    before = np.array([[0.05, -0.02, 0.0], [0.05, -0.02, 0.03], [0.05, 0.03, 0.0]])
    goals = before + np.array([[0, 0.04, 0], [0, 0.04, 0], [0, 0.001, 0]])
    active, tips = np.ones(3, dtype=bool), np.full(3, 0.01)
    for pairs, stays in (((PAIR,), [True, True]), ((), [True, False])):
        held = hold_where_tips_meet(CUBE.project, goals, before, active, tips, 0.0, pairs)
        np.testing.assert_array_equal(np.all(held == before, axis=1)[:2], stays)


def test_who_is_held_may_hold_those_behind():
    """In a row, each moves to where the one before it was, and the first one can't."""
    y = np.array([0.04, 0.015, -0.01, -0.035])
    before = np.stack([np.full(4, 0.05), y, np.zeros(4)], axis=1)
    goals = before + np.array([0, 0.02, 0]) * (y < 0.04)[:, None]
    active, tips = np.ones(4, dtype=bool), np.full(4, 0.01)
    held = hold_where_tips_meet(CUBE.project, goals, before, active, tips, 0.0, ())
    np.testing.assert_array_equal(held, before)


def test_gaps_of_fingertips_are_between_their_balls():
    p_OC = np.array([[0.05, 0.0, 0.0], [0.0, 0.05, 0.0]])
    gaps = tip_gaps(p_OC, np.eye(3)[:2], np.array([0.01, 0.02]))
    assert gaps[0, 1] == pytest.approx(np.hypot(0.06, 0.07) - 0.03)
    assert gaps[0, 0] == np.inf


def test_of_two_that_overlap_the_first_is_active_and_named():
    p_OC = np.array([[0.05, 0.0, 0.0], [0.05, 0.015, 0.0], [-0.05, 0.0, 0.0]])
    goals = hold_contacts(selection(CUBE, p_OC, tip_radii=np.full(3, 0.01)))
    assert list(goals.active) == [True, False, True]
    assert (goals.status[1], goals.causes[1]) == (ContactStatus.CROWDED_OUT, 0)


def always_worse():
    """A measure of which each value is below those before it, so that no step is accepted."""
    values = iter(range(0, -1000, -1))
    return lambda p_CoMC, nhat: np.array([next(values)])


@pytest.mark.parametrize(
    "limits",
    [ContactLimits(deadband=0.06), ContactLimits(guard=always_worse())],
    ids=["deadband", "guard"],
)
def test_fingertips_that_overlap_come_apart_whatever_holds_them(limits):
    p_OC = np.array([[0.05, 0.0, 0.0], [0.05, 0.012, 0.0], [-0.05, 0.0, 0.0]])
    tips = np.full(3, 0.01)
    for _ in range(3):
        chosen = selection(CUBE, p_OC, tip_radii=tips)
        goals = select_contacts(chosen, position_tracking, limits=limits)
        p_OC = goals.p_OC
    assert np.all(goals.active)


def test_who_overlaps_an_inactive_one_only_is_active():
    p_OC = np.array([[0.05, 0.0, 0.0], [0.05, 0.015, 0.0], [0.05, 0.03, 0.0]])
    labels = np.arange(len(CUBE.p_OQ)) % 3
    tips = RegionConstraints(tip_radii=np.full(3, 0.01))
    regions = dataclasses.replace(SafeRegions.unlimited(labels, 3), constraints=tips)
    goals = hold_contacts(SelectionInput(CUBE, p_OC, regions, np.eye(3)))
    assert list(goals.active) == [True, False, True]


def test_a_contact_held_on_forbidden_ground_is_inactive_and_says_so():
    p_OC = np.array([[0.05, 0.0, 0.0], [0.0, 0.0, 0.05]])
    regions = SafeRegions.unlimited(np.arange(len(CUBE.p_OQ)) % 2, 2)
    goals = hold_contacts(SelectionInput(CUBE, p_OC, regions, np.eye(3)))
    assert list(goals.status) == [ContactStatus.ACTIVE, ContactStatus.NO_ALLOWED_SURFACE]


# Recovery.


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
            chosen = selection(BALL, p_OC, **constraints)
            goals = select_contacts(chosen, position_tracking, limits=limits)
            assert np.max(np.linalg.norm(goals.p_OC - p_OC, axis=1)) <= 0.01 + 1e-12
            p_OC = goals.p_OC
        assert np.all(goals.active)
        assert not overlaps(BALL, goals, tips)
        normals = BALL.project(p_OC)[1]
        for i in range(5):
            there = p_OC[i][None], normals[i][None]
            assert chosen.regions.constraints.limits_at(i, *there)[0] == Limit.NONE


def first_way_back(surface, p_OC, radius):
    """Where the last contact goes that has no region, while the others stay at candidates."""
    labels = np.full(len(surface.p_OQ), NO_REGION)
    for contact, place in enumerate(p_OC[:-1]):
        labels[np.argmin(np.linalg.norm(surface.p_OQ - place, axis=1))] = contact
    tips = RegionConstraints(tip_radii=np.full(len(p_OC), radius))
    regions = dataclasses.replace(SafeRegions.unlimited(labels, len(p_OC)), constraints=tips)
    chosen = SelectionInput(surface, p_OC, regions, np.eye(3))
    return select_contacts(chosen, position_tracking, limits=ContactLimits(recover=True)).p_OC


def test_the_way_back_leads_to_the_nearest_place_with_room():
    p_OC = np.array([[0.05, 0.005, 0.005], [0.05, 0.025, 0.005], [0.05, 0.015, 0.004]])
    goals = first_way_back(CUBE, p_OC, 0.011)
    away = CUBE.p_OQ - p_OC[2]
    centres = [CUBE.p_OQ + 0.011 * CUBE.nhat_OQ - p for p in p_OC[:2] + np.array([0.011, 0, 0])]
    room = np.min(np.linalg.norm(centres, axis=2), axis=0) > 0.022
    nearest = np.min(np.linalg.norm(away[room], axis=1))
    assert np.linalg.norm(goals[2] - p_OC[2]) == pytest.approx(nearest)
    assert np.min(np.linalg.norm(goals[2] - p_OC[:2], axis=1)) > 0.022 - 1e-9


def test_the_way_back_leads_into_no_ball_round_forbidden_points():
    surface = box_surface([0.1, 0.1, 0.1], spacing=0.01, forbidden_radius=0.012)
    p_OC = np.array([[-0.05, 0.005, 0.005], [0.05, 0.01, 0.049]])
    goals = first_way_back(surface, p_OC, 0.001)
    away = np.linalg.norm(surface.forbidden.points - goals[1], axis=1)
    assert 0.012 < np.min(away) < 0.03


def test_the_way_back_leads_through_no_wall():
    """The nearest permitted place is right below, 3 mm away, but no step leads there."""
    rims = [AxisArea(face) for face in ("+x", "-x", "+y", "-y")]
    plate = mesh_surface(box_shape([0.1, 0.1, 0.003]), spacing=0.006, no_touch=rims)
    p_OC = np.array([[0.0, 0.0, 0.0015]])
    above = BoxSolid(np.array([0.0, 0.0, 0.0114]), np.eye(3), np.array([0.04, 0.04, 0.02]))
    limits = ContactLimits(recover=True, max_step=0.004)
    for _ in range(10):
        same_side = normals_agree(plate.project(p_OC)[1], plate.nhat_OQ)
        chosen = selection(
            plate, p_OC, obstacles=Obstacles((above,)), clearance=5e-4, same_side=same_side
        )
        goals = select_contacts(chosen, position_tracking, limits=limits)
        p_OC = goals.p_OC
    assert goals.active[0]
    assert p_OC[0, 2] == pytest.approx(0.0015)


def test_without_recovery_it_stays():
    start = spread_contacts(BALL, 4, 0.03)
    reach = [None, FingerReach(BallSolid(-start[1], 0.02)), None, None]
    for recover in (False, True):
        limits, p_OC = ContactLimits(recover=recover), start.copy()
        for _ in range(4):  # Round the ball: no step goes to ground that faces the other way.
            chosen = selection(BALL, p_OC, reach=reach)
            chosen.regions.labels[chosen.regions.labels == 1] = NO_REGION
            goals = select_contacts(chosen, position_tracking, limits=limits)
            assert not goals.active[1]
            p_OC[1] = goals.p_OC[1]
        if recover:
            assert np.linalg.norm(p_OC[1] + start[1]) <= 0.02
        else:
            np.testing.assert_array_equal(p_OC[1], start[1])


def test_a_lost_contact_does_not_recover():
    p_OC = spread_contacts(BALL, 4, 0.03)
    p_OC[1] = BALL.project(p_OC[1:2] + 0.002)[0][0]  # Not where a candidate is.
    chosen = selection(BALL, p_OC, weights=[0, -np.inf, 0, 0])
    goals = select_contacts(chosen, position_tracking, limits=ContactLimits(recover=True))
    np.testing.assert_array_equal(goals.p_OC[1], p_OC[1])
    assert goals.status[1] == ContactStatus.LOST


# The guard.


def qualities(surface, p_OC):
    measured = guard_measure(GUARDS, 0.7)(p_OC - surface.p_OCoM, surface.project(p_OC)[1])
    return np.array(list(measured))


@pytest.mark.parametrize("names", [("q_msv",), ("q_gii", "q_vew"), ("margin",), GUARDS])
@pytest.mark.parametrize("tips", [np.empty(0), np.full(4, 0.008)], ids=["points", "tips"])
def test_guarded_measures_never_fall(names, tips):
    limits = ContactLimits(guard=guard_measure(names, 0.7), max_step=0.01)
    guarded = [GUARDS.index(name) for name in names]
    moved, before = 0.0, None
    p_OC = spread_contacts(CAN, 4, 0.04)
    for _, p_before, goals in run(CAN, p_OC, limits, 15, seed=4, tip_radii=tips):
        assert np.all(goals.active)
        before = qualities(CAN, p_before)[guarded] if before is None else before
        after = qualities(CAN, goals.p_OC)[guarded]
        assert np.all(after >= before - 1e-9)
        moved += np.sum(np.linalg.norm(goals.p_OC - p_before, axis=1))
        before = after
    assert moved > 0.001
    free = ContactLimits(max_step=0.01)
    values = [qualities(CAN, g.p_OC)[guarded] for _, _, g in run(CAN, p_OC, free, 15, seed=4)]
    assert np.min(np.diff(values, axis=0)) < -1e-4


def test_a_step_that_is_taken_back_takes_back_what_paid_only_with_it():
    """The measure is the product of two heights; the first contact meets a fingertip."""
    before = np.array([[0.05, -0.015, 0.005], [0.05, 0.005, -0.035], [0.05, 0.035, 0.005]])
    after = before + np.array([[0, 0.04, 0], [0, 0.04, 0], [0, 0, 0]])
    labels = np.full(len(CUBE.p_OQ), NO_REGION)
    for contact, goal in enumerate(after):
        labels[np.argmin(np.linalg.norm(CUBE.p_OQ - goal, axis=1))] = contact
    regions = SafeRegions.unlimited(labels, 3)
    limits = ContactLimits(guard=lambda p_CoMC, nhat: p_CoMC[:1, 1] * p_CoMC[1, 1])
    for radius, expected in ((1e-3, after), (0.01, before)):
        tips = RegionConstraints(tip_radii=np.full(3, radius))
        chosen = SelectionInput(
            CUBE, before, dataclasses.replace(regions, constraints=tips), np.eye(3)
        )
        goals = select_contacts(chosen, position_tracking, limits=limits)
        np.testing.assert_allclose(goals.p_OC, expected, atol=1e-12)


def test_a_step_that_leaves_the_grasp_as_good_is_taken():
    p_OC = spread_contacts(CAN, 4, 0.03)
    goals, groups = np.roll(p_OC, 1, axis=0), [[0], [1], [2], [3]]
    constant = keep_quality(CAN, goals, p_OC, np.ones(4, bool), lambda p, n: [1.0], groups)
    np.testing.assert_array_equal(constant, goals)


def test_what_takes_no_part_moves_freely_past_the_guard():
    p_OC = spread_contacts(CAN, 4, 0.03)
    goals = np.roll(p_OC, 1, axis=0)
    active = np.array([False, True, False, True])
    groups = [[0], [1], [2], [3]]
    accepted = keep_quality(CAN, goals, p_OC, active, always_worse(), groups)
    np.testing.assert_array_equal(accepted[~active], goals[~active])
    np.testing.assert_array_equal(accepted[active], p_OC[active])


def test_an_unknown_guard_is_refused_and_no_guard_is_none():
    with pytest.raises(InvalidArgumentError, match="no guard 'luck'; there are: q_msv, q_gii"):
        guard_measure(["luck"], 0.7)
    assert guard_measure([], 0.7) is None


# Verification.


def goals_at(p_OC, active=None):
    n = len(p_OC)
    status = np.ones(n) if active is None else np.where(active, 1.0, 0.0)
    return ContactGoals(p_OC, status, np.full(n, -1.0))


def test_goals_on_the_ground_pass():
    verify_contacts(CAN, goals_at(spread_contacts(CAN, 4, 0.03)))
    verify_contacts(CAN, goals_at(np.empty((0, 3))))


@pytest.mark.parametrize(
    ("height", "problem"),
    [
        (2e-4, "contact 2 is 0.2 mm off the object"),
        (-2e-4, "contact 2 is 0.2 mm inside the object"),
    ],
)
def test_a_goal_off_the_object_is_found(height, problem):
    p_OC = spread_contacts(CAN, 4, 0.03)
    normals = CAN.project(p_OC)[1]
    p_OC[2] += height * normals[2]
    with pytest.raises(ContactError, match=problem):
        verify_contacts(CAN, goals_at(p_OC))
    verify_contacts(CAN, goals_at(p_OC, active=np.array([True, True, False, True])))
    p_OC[2] -= 0.75 * height * normals[2]
    verify_contacts(CAN, goals_at(p_OC))


def test_a_goal_on_forbidden_ground_is_found():
    p_OC = np.array([[0.01, 0.0, 0.06]])
    with pytest.raises(ContactError, match="contact 0 is 25 mm off the allowed surface"):
        verify_contacts(CAN, goals_at(p_OC))


def test_a_goal_that_is_no_number_is_found():
    with pytest.raises((ContactError, ValueError)):
        verify_contacts(CAN, goals_at(np.full((1, 3), np.nan)))
