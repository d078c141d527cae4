"""Constraints of safe regions besides Eq. 1, and what leaves a contact a tiny region."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from selections import regions_of
from thin_cup import CUP

from drake_pregrasp import ForbiddenPoints, box_surface
from drake_pregrasp.geometry.mesh_surface import AxisArea, mesh_surface
from drake_pregrasp.geometry.sampling import lifted
from drake_pregrasp.geometry.shapes import ball_shape
from drake_pregrasp.geometry.solids import BallSolid, BoxSolid, HalfSpace
from drake_pregrasp.regions.constraints import NO_CAUSE, Limit, Obstacles, RegionConstraints
from drake_pregrasp.regions.finger_reach import FingerReach
from drake_pregrasp.regions.safe_regions import NO_REGION, TINY_SHARE, compute_safe_regions
from drake_pregrasp.regions.walls import normals_agree

BALL = mesh_surface(ball_shape(0.04), spacing=0.006)
CUBE = box_surface([0.1, 0.1, 0.1], spacing=0.01, forbidden_faces=[])
CLEARANCE = 0.003


def contacts(surface, n, seed=0):
    return np.random.default_rng(seed).choice(surface.p_OQ, n, replace=False)


# Obstacles.


def near_obstacles(seed):
    """Obstacles around the ball, and all of them as solids."""
    rng = np.random.default_rng(seed)

    def place(distance):
        u = rng.normal(size=3)
        return distance * u / np.linalg.norm(u)

    points = ForbiddenPoints(np.array([place(0.06), place(0.08)]), np.array([0.01, 0.005]))
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    solids = (
        BallSolid(place(0.065), 0.02),
        BoxSolid(place(0.065), R * np.sign(np.linalg.det(R)), np.array([0.03, 0.02, 0.05])),
        HalfSpace(u := place(0.035), -u),
    )
    balls = map(BallSolid, points.points, points.radii)
    return Obstacles(solids, points), [*solids, *balls]


def nearest_point(solid, c):
    """The point of a solid that is nearest to a point out of it, from its definition."""
    if isinstance(solid, BallSolid):
        away = c - solid.center
        return solid.center + solid.radius * away / np.linalg.norm(away)
    if isinstance(solid, BoxSolid):
        p = solid.R_FB.T @ (c - solid.center)
        return solid.center + solid.R_FB @ np.clip(p, -solid.size / 2, solid.size / 2)
    return c - (c - solid.point) @ solid.normal * solid.normal


@pytest.mark.parametrize("seed", range(4))
def test_an_obstacle_removes_only_candidates_too_near_to_it_or_beyond_its_plane(seed):
    p_OC, tips = contacts(BALL, 4, seed), np.array([0.0, 0.002, 0.004, 0.006])
    obstacles, solids = near_obstacles(seed)
    outside = np.all([solid.distance(p_OC) > 0 for solid in solids], axis=0)
    assert np.any(outside)
    free = regions_of(BALL, p_OC, tip_radii=tips)
    limited = regions_of(BALL, p_OC, tip_radii=tips, obstacles=obstacles, clearance=CLEARANCE)
    changed = free.labels != limited.labels
    assert np.any(changed)
    assert np.all(limited.labels[changed] == NO_REGION)
    for contact in np.flatnonzero(outside):
        c, margin = p_OC[contact], tips[contact] + CLEARANCE
        own = free.members(contact)
        keep = np.ones(len(own), dtype=bool)
        for solid in solids:
            z = nearest_point(solid, c)
            u = (z - c) / np.linalg.norm(z - c)
            keep &= (BALL.p_OQ[own] - z) @ u <= -margin + 1e-10
            keep &= solid.distance(BALL.p_OQ[own]) >= margin - 1e-10
        np.testing.assert_array_equal(limited.labels[own] == contact, keep)


@pytest.mark.parametrize("seed", range(3))
def test_straight_paths_inside_a_region_keep_clear_of_obstacles(seed):
    obstacles, solids = near_obstacles(seed)
    p_OC = contacts(BALL, 5, seed + 10)
    limited = regions_of(BALL, p_OC, obstacles=obstacles, clearance=CLEARANCE)
    checked = 0
    for contact, c in enumerate(p_OC):
        members = BALL.p_OQ[limited.members(contact)]
        ways = np.concatenate([c + share * (members - c) for share in (0.2, 0.5, 0.8, 1.0)])
        for solid in solids:
            if solid.distance(c[None])[0] >= CLEARANCE:
                assert np.all(solid.distance(ways) >= CLEARANCE - 1e-12)
                checked += len(ways)
    assert checked > 100


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("standoff", [0.0, 0.03])
def test_a_contact_is_kept_from_a_point_by_what_touches_its_fingertip_from_there_to_its_standoff(
    seed, standoff
):
    (obstacles, solids), tips = near_obstacles(seed), np.array([0.0, 0.006])
    reach = [None, FingerReach(BallSolid(np.zeros(3), 0.07))]
    limits = RegionConstraints(
        2, obstacles, clearance=CLEARANCE, tip_radii=tips, reach=reach, standoff=standoff
    )
    rng = np.random.default_rng(seed)
    points, normals = rng.uniform(-0.09, 0.09, (300, 3)), rng.normal(size=(300, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for contact, radius in enumerate(tips):
        kinds, causes = limits.limits_at(contact, points, normals)
        gaps = [
            [solid.distance(points + (radius + share * standoff) * normals) for solid in solids]
            for share in (0.0, 0.5, 1.0)
        ]
        touched = np.min(gaps, axis=0) < radius + CLEARANCE
        far = (np.linalg.norm(points, axis=1) > 0.07) & (contact == 1)
        blocked = np.any(touched, axis=0) & ~far
        np.testing.assert_array_equal(kinds == Limit.OBSTACLE, blocked)
        assert np.all(touched[causes[blocked], np.flatnonzero(blocked)])
        assert len(set(causes[blocked])) >= 3
        np.testing.assert_array_equal(kinds == Limit.REACH, far)
        np.testing.assert_array_equal(causes[~blocked], NO_CAUSE)


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6))
def test_reach_is_where_a_contact_can_be_and_of_no_others_concern(seed):
    rng, p_OC = np.random.default_rng(seed), contacts(BALL, 4, seed)
    centers, radii = rng.uniform(-0.06, 0.06, (4, 3)), rng.uniform(0.01, 0.1, 4)
    inside = np.linalg.norm(BALL.p_OQ - centers[:, None], axis=2) <= radii[:, None]
    inside[2:] = True
    reach = [
        *(FingerReach(BallSolid(p, r)) for p, r in zip(centers[:2], radii, strict=False)),
        None,
        None,
    ]
    free = regions_of(BALL, p_OC).labels
    permitted = inside[free, np.arange(len(free))]
    limited = regions_of(BALL, p_OC, reach=reach).labels
    np.testing.assert_array_equal(limited, np.where(permitted, free, NO_REGION))


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6))
def test_relabelling_contacts_relabels_the_result(seed):
    rng = np.random.default_rng(seed)
    n = 5
    p_OC = contacts(BALL, n, seed) + rng.normal(size=(n, 3)) * 1e-5  # No candidate at a tie.
    weights = rng.uniform(-2e-4, 2e-4, n)
    weights[rng.integers(n)] = -np.inf if seed % 2 else 0.0
    radii, centers = rng.uniform(0.02, 0.1, n), rng.uniform(-0.04, 0.04, (n, 3))
    tip_radii = rng.uniform(0, 0.02, n)
    same_side = normals_agree(BALL.project(p_OC)[1], BALL.nhat_OQ)

    def regions_in(order):
        return regions_of(
            BALL,
            p_OC[order],
            weights[order],
            tip_radii=tip_radii[order],
            reach=[FingerReach(BallSolid(centers[k], radii[k])) for k in order],
            same_side=same_side[order],
            active_forbidden_points=np.empty((n, 0), dtype=bool),
            obstacles=near_obstacles(seed)[0],
            clearance=CLEARANCE,
        )

    order = rng.permutation(n)  # New contact k is the old contact order[k].
    here, there = regions_in(np.arange(n)), regions_in(order)
    new_of_old = np.append(np.argsort(order), NO_REGION)
    np.testing.assert_array_equal(there.labels, new_of_old[here.labels])
    np.testing.assert_array_equal(there.lost, here.lost[order])
    # Where two causes keep out equally many candidates, either may be named.
    same = there.limits == here.limits[order]
    assert np.mean(same) >= 0.8
    assert np.all(there.causes[same & (there.limits == Limit.CROWDED)] < n)


# Fingertips.


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6))
def test_points_of_two_buffered_cells_are_apart_by_both_radii(seed):
    rng = np.random.default_rng(seed)
    n, p_OC = 4, contacts(CUBE, 4, seed)
    tips, weights = rng.uniform(0.001, 0.012, n), rng.uniform(-2e-4, 2e-4, n)
    limited = regions_of(CUBE, p_OC, weights, tip_radii=tips)
    kept = np.flatnonzero(limited.labels != NO_REGION)
    owner = limited.labels[kept]
    np.testing.assert_array_equal(owner, regions_of(CUBE, p_OC, weights).labels[kept])
    away = np.linalg.norm(CUBE.p_OQ[kept][:, None] - CUBE.p_OQ[kept], axis=2)
    room = tips[owner][:, None] + tips[owner]
    assert np.all((away >= room - 1e-12) | (owner[:, None] == owner))


@pytest.mark.parametrize("gap", [0.0, 0.012])
@pytest.mark.parametrize("h", [0.0, 1.3e-3, -1.3e-3])
def test_cells_are_set_back_by_the_radius_and_half_the_gap(h, gap):
    p_OC = np.array([[0.05, -0.019, 0.0], [0.05, 0.031, 0.0]])
    tips = np.array([0.004, 0.011])
    y, boundary = CUBE.p_OQ[:, 1], 0.006 + h / (2 * 0.05)
    limited = regions_of(CUBE, p_OC, [h, 0.0], tip_radii=tips, tip_gap=gap)
    np.testing.assert_array_equal(limited.labels == 0, y <= boundary - 0.004 - gap / 2)
    np.testing.assert_array_equal(limited.labels == 1, y >= boundary + 0.011 + gap / 2)


@pytest.mark.parametrize("tips", [np.empty(0), np.full(4, 0.01)], ids=["points", "tips"])
def test_a_lost_contact_needs_no_room_and_is_shared_out_among_the_others(tips):
    p_OC = contacts(CUBE, 4)
    lost = regions_of(CUBE, p_OC, [0, 0, -np.inf, 0], tip_radii=tips)
    rest = regions_of(CUBE, np.delete(p_OC, 2, axis=0), tip_radii=tips[:3])
    np.testing.assert_array_equal(lost.sizes(), np.insert(rest.sizes(), 2, 0))
    assert list(lost.lost) == [False, False, True, False]
    assert (lost.limits[2], lost.causes[2]) == (Limit.NONE, NO_CAUSE)


# More coordinates.


def lifted_labels(surface, p_OC, length, limits=None):
    q, c = (
        lifted(surface.p_OQ, surface.nhat_OQ, length),
        lifted(p_OC, surface.project(p_OC)[1], length),
    )
    return compute_safe_regions(q, c, np.zeros(len(c)), surface.forbidden, limits).labels


def test_lifting_by_nothing_changes_nothing():
    surface = mesh_surface(CUP, spacing=0.008, no_touch=[AxisArea("+z")])
    p_OC = contacts(surface, 4)
    limits = RegionConstraints(
        4,
        near_obstacles(1)[0],
        clearance=CLEARANCE,
        reach=[FingerReach(BallSolid(np.zeros(3), 0.08))] * 4,
    )
    plain = compute_safe_regions(surface.p_OQ, p_OC, np.zeros(4), surface.forbidden, limits).labels
    for length, same in ((0.0, True), (0.05, False)):
        labels = lifted_labels(surface, p_OC, length, limits)
        assert np.array_equal(labels, plain) == same


def test_forbidden_points_without_the_further_coordinates_hold_for_all_values():
    rng = np.random.default_rng(7)
    q, c = rng.uniform(-0.05, 0.05, (80, 6)), rng.uniform(-0.05, 0.05, (1, 6))
    z, radii = rng.uniform(-0.05, 0.05, (5, 3)), np.full(5, 0.004)
    result = compute_safe_regions(q, c, np.zeros(1), ForbiddenPoints(z, radii))
    flat = compute_safe_regions(q[:, :3], c[:, :3], np.zeros(1), ForbiddenPoints(z, radii))
    np.testing.assert_array_equal(result.labels, flat.labels)


def test_with_normals_regions_stay_on_surface_that_faces_the_same_way():
    p_OC = np.array([[0.05, 0.0, 0.0], [0.03, 0.05, 0.0]])
    on_plus_x = CUBE.nhat_OQ[:, 0] > 0.9
    for length, strays in ((0.0, True), (0.2, False)):
        assert np.any(lifted_labels(CUBE, p_OC, length)[on_plus_x] != 0) == strays


FOUR = np.array([[0.05, 0.01, 0.0], [-0.05, 0.0, 0.0], [0.0, 0.05, 0.0], [0.0, -0.05, 0.0]])
FAR = BallSolid(np.array([1.0, 0, 0]), 0.1)


def cause(result, contact=0):
    return Limit(result.limits[contact]), int(result.causes[contact]), result.sizes()[contact]


def of_first(center, radius):
    """The first finger reaches a ball, and the others reach everything."""
    return [FingerReach(BallSolid(np.array(center), radius)), None, None, None]


def test_nothing_limits_contacts_with_regions():
    wall = HalfSpace(np.array([0, 0, -1.0]), np.array([0.0, 0.0, 1.0]))
    far = Obstacles((FAR, wall), ForbiddenPoints(np.array([[0, 1.0, 0]]), np.array([0.1])))
    result = regions_of(CUBE, FOUR, obstacles=far, clearance=0.1)
    np.testing.assert_array_equal(result.labels, regions_of(CUBE, FOUR).labels)
    np.testing.assert_array_equal(result.limits, Limit.NONE)
    np.testing.assert_array_equal(result.causes, NO_CAUSE)


@pytest.mark.parametrize("neighbour", [1, 3])
def test_crowded_out_names_the_neighbour(neighbour):
    weights = np.zeros(4)
    weights[neighbour] = 0.1  # As if it were so much nearer everywhere.
    assert cause(regions_of(CUBE, FOUR, weights)) == (Limit.CROWDED, neighbour, 0)


def test_crowded_by_a_fingertip_names_whose_it_is():
    limited = regions_of(CUBE, FOUR[0] + [[0, 0, 0], [0, 1e-3, 0]], tip_radii=np.full(2, 0.08))
    assert cause(limited, 0) == (Limit.CROWDED, 1, 0)
    assert cause(limited, 1) == (Limit.CROWDED, 0, 0)


def test_crowded_to_a_few_candidates_names_a_neighbour():
    around = [[0, 0, 0], [0, 0.009, 0], [0, -0.009, 0], [0, 0, 0.009], [0, 0, -0.008]]
    limit, neighbour, size = cause(regions_of(CUBE, np.array([0.05, 0.005, 0.005]) + around))
    assert limit == Limit.CROWDED
    assert neighbour in {1, 2, 3, 4}
    assert 0 < size < 5


NEAR = BallSolid(np.array([0.07, 0, 0]), 0.06)
POINTS = ForbiddenPoints(np.array([[1.0, 0, 0], [0.07, 0, 0]]), np.array([0.1, 0.06]))
ALL = HalfSpace(np.zeros(3), np.array([-1.0, 0, 0]))
UPPER_HALF = of_first([0.05, 0.01, 0.1], 0.08)


@pytest.mark.parametrize(
    ("constraints", "expected"),
    [
        ({"reach": of_first([0.5, 0, 0], 0.1)}, (Limit.REACH, NO_CAUSE, 0)),
        ({"reach": of_first(FOUR[0], 0.012)}, (Limit.REACH, NO_CAUSE, 4)),
        ({"obstacles": Obstacles((FAR, NEAR))}, (Limit.OBSTACLE, 1, 0)),  # Solids count first.
        ({"obstacles": Obstacles((FAR,), POINTS)}, (Limit.OBSTACLE, 2, 0)),
        # Of several causes the one that keeps out most is named.
        ({"obstacles": Obstacles((ALL,)), "reach": UPPER_HALF}, (Limit.OBSTACLE, 0, 0)),
        ({"same_side": np.arange(4)[:, None] > np.zeros(600)}, (Limit.WALL, NO_CAUSE, 0)),
        ({"same_side": np.zeros((4, 600), dtype=bool)}, (Limit.WALL, NO_CAUSE, 0)),
    ],
)
def test_the_cause_of_a_tiny_region_is_named(constraints, expected):
    result = regions_of(CUBE, FOUR, clearance=0.01, **constraints)
    assert cause(result) == expected
    others_too = not np.any(constraints.get("same_side", True))
    np.testing.assert_array_equal(result.limits[1:], Limit.WALL if others_too else Limit.NONE)
    assert np.all(result.labels == NO_REGION) == others_too


def test_the_cause_forbidden_surface_is_named():
    z = FOUR[0] + [[0, 0.004, 0], [0, -0.004, 0], [0, 0, 0.004], [0, 0, -0.004]]
    fence = ForbiddenPoints(z, np.full(4, 0.002))
    limit, index, size = cause(compute_safe_regions(CUBE.p_OQ, FOUR, np.zeros(4), fence))
    assert (limit, index) == (Limit.FORBIDDEN, NO_CAUSE)
    assert size < 20


@pytest.mark.parametrize(("weights", "sharing"), [([0, 0, 0, 0], 4), ([0, -np.inf, 0, -np.inf], 2)])
def test_a_region_is_tiny_below_a_share_of_what_each_contact_that_is_left_would_have(
    weights, sharing
):
    p_OC = FOUR + 1e-4 * np.random.default_rng(0).normal(size=(4, 3))
    away = np.sort(np.linalg.norm(CUBE.p_OQ - p_OC[0], axis=1))
    least = math.ceil(TINY_SHARE * 600 / sharing)
    assert least in (8, 15)
    for size, limit in ((least, Limit.NONE), (least - 1, Limit.REACH)):
        reach = of_first(p_OC[0], (away[size - 1] + away[size]) / 2)
        result = regions_of(CUBE, p_OC, weights, reach=reach)
        assert cause(result) == (limit, NO_CAUSE, size)
