"""Assignment of fingers to contacts at the start, and anew in a run."""

from dataclasses import astuple, replace
from itertools import permutations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation
from selections import BALL, regions_of
from thin_cup import CUP, RADIUS, WALL

from drake_pregrasp import BallReach, InvalidArgumentError, SectorReach, box_surface
from drake_pregrasp.contacts.assignment import (
    FREE_TURN,
    assign_fingers,
    assign_fingers_round,
    make_room,
    palm_turn,
    ring_contacts,
    turned_within,
    wrapped,
)
from drake_pregrasp.contacts.goal_limits import hold_contacts
from drake_pregrasp.contacts.reassignment import (
    ReassignmentRule,
    reassigned_goals,
    surface_symmetries,
)
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.geometry.box_surface import BOX_FACES
from drake_pregrasp.geometry.mesh_surface import AxisArea, mesh_surface
from drake_pregrasp.geometry.shapes import ball_shape, cylinder_shape
from drake_pregrasp.quality.grasp_quality import grasp_quality
from drake_pregrasp.regions.constraints import Limit, RegionConstraints


@given(seed=st.integers(0, 10**6), n=st.integers(1, 5))
def test_all_fingers_together_travel_least(seed, n):
    tips, contacts = np.random.default_rng(seed).uniform(size=(2, n, 3))

    def travel(order):
        return np.sum(np.linalg.norm(tips - contacts[list(order)], axis=1))

    least = min(map(travel, permutations(range(n))))
    order = assign_fingers(tips, contacts)
    assert sorted(order) == list(range(n))
    assert travel(order) == pytest.approx(least, rel=1e-12)


CAN = mesh_surface(
    cylinder_shape(0.03, 0.1), spacing=0.006, no_touch=[AxisArea("+z"), AxisArea("-z")]
)
BOX = box_surface([0.1, 0.06, 0.12], spacing=0.008)


@pytest.mark.parametrize("surface", [CAN, BOX], ids=["can", "box"])
@pytest.mark.parametrize("count", [1, 2, 5, 9])
def test_a_ring_is_of_distinct_allowed_places_level_with_the_centre(surface, count):
    p_OC = ring_contacts(surface, count)
    assert len(np.unique(p_OC, axis=0)) == count
    nearest, _ = surface.project(p_OC)
    np.testing.assert_allclose(nearest, p_OC, atol=1e-9)
    np.testing.assert_allclose(p_OC[:, 2], surface.p_OCoM[2], atol=0.008)


def test_a_ring_round_a_ball_is_even():
    surface = mesh_surface(ball_shape(0.04), spacing=0.004)
    p_OC = ring_contacts(surface, 5)
    angles = np.arctan2(p_OC[:, 1], p_OC[:, 0])
    expected = 2 * np.pi * np.arange(5) / 5
    assert np.max(np.abs(np.angle(np.exp(1j * (angles - expected))))) < 0.004 / 0.04
    np.testing.assert_allclose(p_OC[:, 2], 0, atol=0.004)


def test_a_ring_stands_on_the_outside_of_a_cup():
    p_OC = ring_contacts(mesh_surface(CUP, spacing=0.006), 5)
    assert np.min(np.hypot(p_OC[:, 0], p_OC[:, 1])) > RADIUS - WALL / 2


def test_a_ring_has_at_most_as_many_contacts_as_the_allowed_surface_has_candidates():
    surface = box_surface([0.03, 0.03, 0.03], spacing=0.02)
    count = len(surface.p_OQ)
    assert len(np.unique(ring_contacts(surface, count), axis=0)) == count
    for bad in (0, count + 1):
        with pytest.raises(InvalidArgumentError, match=f"candidates for 1 to {count} contacts"):
            ring_contacts(surface, bad)


azimuths = arrays(float, 5, elements=st.floats(-3.1, 3.1), unique=True)


@given(azimuths, st.floats(-3, 3))
def test_a_turned_hand_finds_its_own_fingers(fingers, turn):
    order, yaw = assign_fingers_round(fingers, fingers + turn)
    np.testing.assert_allclose(wrapped((fingers + turn)[order] - fingers - yaw), 0, atol=1e-9)


@given(azimuths, azimuths)
def test_fingers_keep_their_order_round_the_palm(fingers, contacts):
    order, _ = assign_fingers_round(fingers, contacts)
    ranks = np.argsort(np.argsort(contacts))[order][np.argsort(fingers)]
    assert np.all((np.diff(np.append(ranks, ranks[0])) - 1) % 5 == 0)


@given(azimuths, azimuths, arrays(float, 5, elements=st.floats(0.05, 3.1)))
def test_an_assignment_is_refused_only_if_none_is_within_each_fingers_own_bound(
    fingers, contacts, allowed
):
    in_order, in_turn = np.argsort(fingers), np.argsort(contacts)
    least = np.inf
    for shift in range(5):
        turns = contacts[np.roll(in_turn, shift)] - fingers[in_order]
        yaw = np.angle(np.sum(np.exp(1j * turns)))
        least = min(least, np.max(np.abs(wrapped(turns - yaw)) - allowed[in_order]))
    try:
        order, yaw = assign_fingers_round(fingers, contacts, largest_offset=allowed)
    except InvalidArgumentError:
        assert least > -1e-9
    else:
        excess = np.abs(wrapped(contacts[order] - fingers - yaw)) - allowed
        assert np.max(excess) == pytest.approx(least, abs=1e-9)
        assert least < 1e-9


@given(azimuths, azimuths, st.floats(-3, 3), st.floats(0.0, 1.0))
def test_a_wrist_of_limited_range_stays_in_it(fingers, contacts, middle, half):
    yaw_range = (middle - half, middle + half)
    _, yaw = assign_fingers_round(fingers, contacts, yaw_range=yaw_range)
    assert yaw_range[0] <= yaw <= yaw_range[1]


@given(st.floats(-20, 20), st.floats(-20, 20), st.floats(0.0, 3.0))
def test_turning_within_a_range_goes_as_near_as_it_can(yaw, middle, half):
    yaw_range = (middle - half, middle + half)
    turned = turned_within(yaw, yaw_range)
    choices = np.linspace(*yaw_range, 200)
    assert yaw_range[0] <= turned <= yaw_range[1]
    assert abs(wrapped(turned - yaw)) <= np.min(np.abs(wrapped(choices - yaw))) + 1e-9
    assert turned_within(yaw, FREE_TURN) == yaw


def test_contacts_out_of_reach_or_too_few_are_refused():
    fingers = 2 * np.pi * np.arange(5) / 5
    crowded = np.array([0.0, 0.1, 0.2, 0.3, 3.0])
    with pytest.raises(InvalidArgumentError, match=r"no finger reaches contact \d: it is"):
        assign_fingers_round(fingers, crowded, largest_offset=0.5)
    with pytest.raises(InvalidArgumentError, match="5 fingers cannot be assigned to 4 contacts"):
        assign_fingers_round(fingers, crowded[:4])
    with pytest.raises(InvalidArgumentError, match="3 fingertips cannot be assigned to 2 contacts"):
        assign_fingers(np.zeros((3, 3)), np.zeros((2, 3)))


def test_a_goal_near_the_axis_does_not_turn_the_palm():
    azimuths = np.array([0.6, 0.0, -0.6, np.pi])
    ring = np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros(4)], axis=1)
    goals = ring * np.array([0.08, 0.001, 0.08, 0.08])[:, None]
    goals[1] = [-0.001, 0.002, 0.0]  # Of a finger inside a bowl, beyond the axis.
    assert abs(palm_turn(goals, azimuths, 0.0)) < 0.02
    R = Rotation.from_euler("z", 0.7).as_matrix()
    assert palm_turn(goals @ R.T, azimuths, 0.0) == pytest.approx(
        palm_turn(goals, azimuths, 0.0) + 0.7
    )


@given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.floats(0.0, 1.0), st.floats(0.1, 2.0))
@example(before=0.9, goal=1.4, slack=0.2, high=1.0)  # The range leaves less than the slack.
def test_a_palm_with_slack_turns_no_farther_than_it_must(before, goal, slack, high):
    azimuths = np.array([0.6, 0.0, -0.6, np.pi])
    turned = azimuths + goal
    goals = 0.08 * np.stack([np.cos(turned), np.sin(turned), np.zeros(4)], axis=1)
    before, target = np.clip([before, goal], -high, high)
    expected = np.clip(before, target - slack, target + slack)
    found = palm_turn(goals, azimuths, before, (-high, high), slack)
    assert found == pytest.approx(expected, abs=1e-9)


ENDS = ["+z", "-z"]
PRISM = box_surface([0.1, 0.1, 0.08], spacing=0.01, forbidden_faces=ENDS)
OPEN_BOX = box_surface([0.1, 0.06, 0.12], spacing=0.01, forbidden_faces=[])
WHOLE_CUBE = box_surface([0.1, 0.1, 0.1], spacing=0.01, forbidden_faces=[])
OPEN_CAN = mesh_surface(
    cylinder_shape(0.03, 0.1), spacing=0.006, no_touch=[AxisArea(end) for end in ENDS]
)
CUP_SURFACE = mesh_surface(CUP, spacing=0.008)
SURFACES = {"prism": PRISM, "box": OPEN_BOX}
SYMMETRIES = {name: surface_symmetries(surface) for name, surface in SURFACES.items()}


def turned(surface, R):
    """The same surface in another frame."""
    fields = {name: getattr(surface, name) @ R.T for name in ("p_OQ", "nhat_OQ", "patches")}
    return replace(surface, p_OCoM=R @ surface.p_OCoM, **fields)


@pytest.mark.parametrize(
    ("surface", "count"),
    [
        (WHOLE_CUBE, 24),
        (box_surface([0.1, 0.1, 0.1], spacing=0.01, forbidden_faces=["-z"]), 4),
        (PRISM, 8),
        (OPEN_BOX, 4),
        (turned(OPEN_BOX, Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()), 4),
        (box_surface([0.1, 0.06, 0.12], spacing=0.01, forbidden_faces=["+x"]), 2),
        (box_surface([0.1, 0.06, 0.12], spacing=0.01, forbidden_faces=["+x", "-z"]), 1),
    ],
)
def test_symmetries_of_boxes_are_counted(surface, count):
    symmetries = surface_symmetries(surface)
    assert len(symmetries) == count
    np.testing.assert_array_equal(symmetries[0], np.eye(3))


@pytest.mark.slow
def test_round_objects_turn_about_their_axes():
    of_can, of_cup, of_ball = map(surface_symmetries, (OPEN_CAN, CUP_SURFACE, BALL))
    for symmetries, flips in ((of_can, {-1, 1}), (of_cup, {1})):
        assert set(symmetries[:, 2, 2].round(3)) == flips
        turns = symmetries[symmetries[:, 2, 2] > 0.999]
        angles = np.degrees(np.arctan2(turns[:, 1, 0], turns[:, 0, 0])).round()
        assert set(range(-150, 180, 30)) <= set(angles)
    assert len(of_ball) > 100


def made_change(seed, name, rule, n=4, lost=0, half_angle=3.14, X=None):
    """The selection, goals, and goals after re-assignment of random contacts; X turns them all."""
    surface, rng, T = SURFACES[name], np.random.default_rng(seed), np.eye(3) if X is None else X
    p_OC = surface.p_OQ[rng.choice(len(surface.p_OQ), n, replace=False)]
    azimuths = np.sort(rng.uniform(-np.pi, np.pi, n))
    reach = [SectorReach(a, half_angle, 3.14).make_reach() for a in azimuths]
    if seed % 3 == 0:
        centers = 0.06 * np.stack([np.cos(azimuths), np.sin(azimuths), 0 * azimuths], axis=1)
        reach = [BallReach(center=list(c), radius=0.05 * half_angle).make_reach() for c in centers]
    R_OH = Rotation.from_rotvec([*rng.normal(0, 0.1, 2), rng.uniform(-3, 3)]).as_matrix()
    h = np.zeros(n)
    h[rng.permutation(n)[:lost]] = -np.inf
    pose = T @ R_OH, T @ rng.normal(0, 0.005, 3)
    regions = regions_of(surface, p_OC @ T.T, h, reach=reach, reach_pose=pose)
    selection = SelectionInput(surface, p_OC @ T.T, regions, np.eye(3))
    goals = hold_contacts(selection)
    after = reassigned_goals(selection, goals, rule, SYMMETRIES[name])
    return selection, goals, after


def in_hand(selection, p_OC):
    R_OH, p_OH = selection.regions.constraints.reach_pose
    return (p_OC - p_OH) @ R_OH


def cost(selection, goals, p_OC):
    """The squared distances from the fingers' places, which the present contacts define."""
    total = 0.0
    for finger in np.flatnonzero(~selection.regions.lost):
        here, there = in_hand(selection, np.array([goals.p_OC[finger], p_OC[finger]]))
        reach = selection.regions.constraints.reach[finger]
        if reach.solid is not None:
            place = reach.solid.center
        else:
            place = np.append(np.hypot(*here[:2]) * reach.direction[:2], here[2])
        total += np.sum((there - place) ** 2)
    return total


def crosses(selection, before, after):
    """Whether fingers that go the shorter ways around the hand's axis change their order."""
    remain = ~selection.regions.lost
    start, end = (in_hand(selection, p[remain]) for p in (before, after))
    start, end = np.arctan2(start[:, 1], start[:, 0]), np.arctan2(end[:, 1], end[:, 0])
    turns = np.angle(np.exp(1j * (end - start)))

    def in_cycle(angles):
        order = np.argsort(np.angle(np.exp(1j * angles)))
        return list(np.roll(order, -int(np.argmin(order))))

    way = np.linspace(0, 1, 50)[1:-1, None]
    return any(in_cycle(angles) != in_cycle(start) for angles in start + way * turns)


def places_of(p_OC):
    return set(map(tuple, p_OC.round(6) + 0.0))


seeds = st.integers(0, 10**6)
names = st.sampled_from(list(SURFACES))


@given(seeds, names, st.integers(1, 6), st.integers(0, 2), st.floats(0.01, 1), st.floats(0, 0.06))
@example(3, "prism", 5, 0, 0.01, 1e-6)  # The cheapest change leaves fewer contacts in reach.
@example(1, "prism", 3, 0, 0.01, 1e-6)  # Two fingers go half around the hand, the one each way.
def test_changes_are_worthwhile_equivalent_and_in_order(seed, name, n, lost, gain, beyond):
    rule = ReassignmentRule(beyond=beyond, gain=gain)
    selection, goals, after = made_change(seed, name, rule, n, min(lost, n - 1), half_angle=1.5)
    if not after.reassigned:
        assert after is goals
        return
    remain, p_OCoM = ~selection.regions.lost, SURFACES[name].p_OCoM
    before = cost(selection, goals, goals.p_OC)
    assert before > np.sum(remain) * beyond**2
    assert cost(selection, goals, after.p_OC) <= (1 - gain) * before * (1 + 1e-9)
    assert not np.any(after.active & ~remain)
    assert not crosses(selection, goals.p_OC, after.p_OC)
    equivalent = p_OCoM + (goals.p_OC - p_OCoM) @ SYMMETRIES[name].swapaxes(1, 2)
    assert any(
        places_of(after.p_OC[remain]) == places_of(p[remain])
        and np.allclose(after.p_OC[~remain], p[~remain])
        for p in equivalent
    )
    measures = [astuple(grasp_quality(g.p_OC[remain] - p_OCoM)) for g in (goals, after)]
    np.testing.assert_allclose(*np.array(measures, dtype=float), rtol=1e-6, atol=1e-9)
    fingers = np.flatnonzero(remain)
    permitted = [
        np.sum(selection.limits_of(fingers, g.p_OC[fingers])[0] == Limit.NONE)
        for g in (goals, after)
    ]
    assert permitted[1] >= max(permitted[0], 1)


@pytest.mark.slow
@settings(max_examples=12)
@given(seeds, names, st.integers(3, 4))
def test_the_change_costs_least_of_all_that_keep_the_order(seed, name, n):
    selection, goals, after = made_change(seed, name, ReassignmentRule(1e-9, gain=1e-6), n)
    p_OCoM = SURFACES[name].p_OCoM
    costs = [
        cost(selection, goals, p)
        for S in SYMMETRIES[name]
        for order in permutations(range(n))
        if not crosses(
            selection, goals.p_OC, p := p_OCoM + (goals.p_OC[list(order)] - p_OCoM) @ S.T
        )
    ]
    assert cost(selection, goals, after.p_OC) <= min(costs) * (1 + 1e-6)


@given(seeds, st.integers(2, 5), st.integers(1, 7))
def test_a_turned_hand_and_grasp_change_in_the_same_way(seed, n, index):
    T, rule = SYMMETRIES["prism"][index], ReassignmentRule(1e-3, gain=0.1)
    _, _, expected = made_change(seed, "prism", rule, n)
    _, _, found = made_change(seed, "prism", rule, n, X=T)
    np.testing.assert_allclose(found.p_OC, expected.p_OC @ T.T, atol=1e-9)


def test_without_symmetries_fingers_only_exchange_contacts():
    rule, changed = ReassignmentRule(beyond=1e-3, gain=0.1), 0
    for seed in range(40):
        selection, goals, _ = made_change(seed, "box", ReassignmentRule(), n=5)
        after = reassigned_goals(selection, goals, rule, np.eye(3)[None])
        assert set(map(tuple, after.p_OC)) == set(map(tuple, goals.p_OC))
        changed += after.reassigned
    assert changed > 5


def test_pairs_and_fingers_without_reach_are_refused():
    rule = ReassignmentRule(beyond=0.01)
    with pytest.raises(InvalidArgumentError, match="needs the reach"):
        rule.check([], has_pairs=False)
    with pytest.raises(InvalidArgumentError, match="of pairs"):
        rule.check([SectorReach().make_reach()], has_pairs=True)
    ReassignmentRule().check([], has_pairs=True)


def on_sides(*sides):
    """Constraints of fingertips that may each touch one side only."""
    closed = [[AxisArea(face) for face in BOX_FACES if face != side] for side in sides]
    n = len(sides)
    return RegionConstraints(n, tip_radii=np.full(n, 0.012), tip_gap=0.004, closed=closed)


@pytest.mark.parametrize(("width", "away"), [(0.05, [1]), (0.062, [1]), (0.064, []), (0.08, [])])
def test_a_fingertip_without_room_between_two_others_keeps_away(width, away):
    surface = box_surface([width] * 3, spacing=0.005)
    p_OC = width / 2 * np.array([[1, 0.888, 0.4], [1, 0, 0.4], [1, -0.888, 0.4], [-1, 0, 0.2]])
    placed, has_room = make_room(surface, p_OC, on_sides("+x", "+x", "+x", "-x"))
    assert np.flatnonzero(~has_room).tolist() == away
    np.testing.assert_array_equal(placed, p_OC)  # No other has to move.


@pytest.mark.parametrize(("side", "up"), [(1, 2), (2, 1)])
def test_fingertips_that_overlap_get_the_nearest_place_side_by_side(side, up):
    """Also over an object that lies on another face."""
    surface = box_surface([0.08] * 3, spacing=0.005)
    p_OC = np.full((2, 3), 0.04)
    p_OC[:, side], p_OC[:, up] = [0.0, 0.005], [0.01, -0.03]  # One under the other.
    placed, has_room = make_room(surface, p_OC, on_sides("+x", "+x"), up=np.eye(3)[up])
    assert has_room.all()
    np.testing.assert_array_equal(placed[0], p_OC[0])
    assert 0.028 <= placed[1, side] <= 0.028 + 0.005
    np.testing.assert_allclose(placed[1, up], p_OC[1, up], atol=0.0025)
