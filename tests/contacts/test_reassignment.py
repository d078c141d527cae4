"""Re-assignment of contacts to fingers: symmetries of objects, and the laws of a change."""

from dataclasses import astuple, replace
from itertools import permutations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from selections import BALL, regions_of
from thin_cup import CUP

from drake_pregrasp import BallReach, InvalidArgumentError, SectorReach, box_surface
from drake_pregrasp.contacts.goal_limits import hold_contacts
from drake_pregrasp.contacts.reassignment import (
    ReassignmentRule,
    reassigned_goals,
    surface_symmetries,
)
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.geometry.mesh_surface import AxisArea, mesh_surface
from drake_pregrasp.geometry.shapes import cylinder_shape
from drake_pregrasp.quality.grasp_quality import grasp_quality
from drake_pregrasp.regions.constraints import Limit

ENDS = ["+z", "-z"]
PRISM = box_surface([0.1, 0.1, 0.08], spacing=0.01, forbidden_faces=ENDS)
BOX = box_surface([0.1, 0.06, 0.12], spacing=0.01, forbidden_faces=[])
WHOLE_CUBE = box_surface([0.1, 0.1, 0.1], spacing=0.01, forbidden_faces=[])
CAN = mesh_surface(
    cylinder_shape(0.03, 0.1), spacing=0.006, no_touch=[AxisArea(end) for end in ENDS]
)
CUP_SURFACE = mesh_surface(CUP, spacing=0.008)
SURFACES = {"prism": PRISM, "box": BOX}
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
        (BOX, 4),
        (turned(BOX, Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()), 4),
        (box_surface([0.1, 0.06, 0.12], spacing=0.01, forbidden_faces=["+x"]), 2),
        (box_surface([0.1, 0.06, 0.12], spacing=0.01, forbidden_faces=["+x", "-z"]), 1),
    ],
)
def test_symmetries_of_boxes_are_counted(surface, count):
    symmetries = surface_symmetries(surface)
    assert len(symmetries) == count
    np.testing.assert_array_equal(symmetries[0], np.eye(3))


def test_round_objects_turn_about_their_axes():
    of_can, of_cup, of_ball = map(surface_symmetries, (CAN, CUP_SURFACE, BALL))
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


@settings(max_examples=30)
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
