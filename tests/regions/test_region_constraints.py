"""What limits safe regions beside Eq. 1, against slow transcriptions and as laws."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from thin_cup import CUP, RADIUS, WALL

from drake_pregrasp import ForbiddenPoints, box_surface
from drake_pregrasp.geometry.mesh_surface import AxisArea, mesh_surface
from drake_pregrasp.geometry.sampling import lifted
from drake_pregrasp.geometry.shapes import ball_shape, box_shape
from drake_pregrasp.geometry.solids import BallSolid, BoxSolid, HalfSpace
from drake_pregrasp.regions.constraints import (
    NO_CAUSE,
    FingerReach,
    Limit,
    Obstacles,
    RegionConstraints,
)
from drake_pregrasp.regions.safe_regions import NO_REGION, compute_safe_regions, safe_region_labels
from drake_pregrasp.regions.walls import SurfaceGraph, normals_agree

BALL = mesh_surface(ball_shape(0.04), spacing=0.006)
CUBE = box_surface([0.1, 0.1, 0.1], spacing=0.01, forbidden_faces=[])
CLEARANCE = 0.003


def regions(surface, p_OC, weights=None, **constraints):
    weights = np.zeros(len(p_OC)) if weights is None else np.array(weights)
    limits = RegionConstraints(**constraints)
    return compute_safe_regions(surface.p_OQ, p_OC, weights, surface.forbidden, limits)


def contacts(surface, n, seed=0):
    rng = np.random.default_rng(seed)
    return surface.p_OQ[rng.choice(len(surface.p_OQ), n, replace=False)]


def rotation(rng):
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return R * np.sign(np.linalg.det(R))


# Obstacles.


def near_obstacles(seed):
    rng = np.random.default_rng(seed)

    def place(distance):
        u = rng.normal(size=3)
        return distance * u / np.linalg.norm(u)

    points = ForbiddenPoints(np.array([place(0.06), place(0.08)]), np.array([0.01, 0.005]))
    solids = (
        BallSolid(place(0.065), 0.02),
        BoxSolid(place(0.065), rotation(rng), np.array([0.03, 0.02, 0.05])),
        HalfSpace(u := place(0.035), -u),
    )
    return Obstacles(solids, points)


def nearest_point(solid, c):
    """The point of a solid that is nearest to a point out of it, from its definition."""
    if isinstance(solid, BallSolid):
        away = c - solid.center
        return solid.center + solid.radius * away / np.linalg.norm(away)
    if isinstance(solid, BoxSolid):
        p = solid.R_FB.T @ (c - solid.center)
        return solid.center + solid.R_FB @ np.clip(p, -solid.size / 2, solid.size / 2)
    return c - (c - solid.point) @ solid.normal * solid.normal


def test_an_obstacle_out_of_range_changes_nothing():
    p_OC = contacts(BALL, 4)
    far = Obstacles(
        (BallSolid(np.array([1.0, 0, 0]), 0.1), HalfSpace(np.array([0, 0, -1.0]), np.eye(3)[2])),
        ForbiddenPoints(np.array([[0, 1.0, 0]]), np.array([0.1])),
    )
    with_it = regions(BALL, p_OC, obstacles=far, clearance=0.1, tip_radii=np.zeros(4))
    np.testing.assert_array_equal(with_it.labels, regions(BALL, p_OC).labels)
    np.testing.assert_array_equal(with_it.limits, Limit.NONE)


@pytest.mark.parametrize("seed", range(4))
def test_an_obstacle_removes_what_is_too_near_or_beyond_its_plane_and_nothing_else(seed):
    p_OC, tips = contacts(BALL, 4, seed), np.array([0.0, 0.002, 0.004, 0.006])
    obstacles = near_obstacles(seed)
    outside = [
        c for c in range(4) if all(s.distance(p_OC[c][None])[0] > 0 for s in obstacles.solids)
    ]
    assert outside
    free = regions(BALL, p_OC, tip_radii=tips)
    limited = regions(BALL, p_OC, tip_radii=tips, obstacles=obstacles, clearance=CLEARANCE)
    changed = np.flatnonzero(free.labels != limited.labels)
    assert len(changed)
    assert np.all(limited.labels[changed] == NO_REGION)
    for contact in outside:
        c, margin = p_OC[contact], tips[contact] + CLEARANCE
        for index in free.members(contact):
            q, slack, keep = BALL.p_OQ[index], 1e-10, True
            near = [nearest_point(solid, c) for solid in obstacles.solids]
            near += [
                z + R * (c - z) / np.linalg.norm(c - z)
                for z, R in zip(obstacles.points.points, obstacles.points.radii, strict=True)
            ]
            for z in near:
                u = (z - c) / np.linalg.norm(z - c)
                keep &= u @ (q - z) <= -margin + slack
            for solid in obstacles.solids:
                keep &= np.linalg.norm(q - nearest_point(solid, q)) >= margin - slack
                keep &= solid.distance(q[None])[0] > 0
            for z, R in zip(obstacles.points.points, obstacles.points.radii, strict=True):
                keep &= np.linalg.norm(q - z) - R >= margin - slack
            assert keep == (limited.labels[index] == contact)


@pytest.mark.parametrize("seed", range(3))
def test_straight_ways_inside_a_region_keep_clear_of_obstacles(seed):
    obstacles = near_obstacles(seed)
    p_OC = contacts(BALL, 5, seed + 10)
    limited = regions(BALL, p_OC, obstacles=obstacles, clearance=CLEARANCE)
    checked = 0
    for contact in range(5):
        members = BALL.p_OQ[limited.members(contact)]
        for share in (0.2, 0.5, 0.8, 1.0):
            way = p_OC[contact] + share * (members - p_OC[contact])
            for solid in obstacles.solids:
                if solid.distance(p_OC[contact][None])[0] >= CLEARANCE:
                    assert np.all(solid.distance(way) >= CLEARANCE - 1e-12)
                    checked += len(way)
    assert checked > 100


@pytest.mark.parametrize("seed", range(3))
def test_what_keeps_a_contact_from_a_point_is_what_touches_its_fingertip_there(seed):
    obstacles, tips = near_obstacles(seed), np.array([0.0, 0.006])
    reach = [None, FingerReach(BallSolid(np.zeros(3), 0.07))]
    limits = RegionConstraints(obstacles, clearance=CLEARANCE, tip_radii=tips, reach=reach)
    rng = np.random.default_rng(seed)
    points, normals = rng.uniform(-0.09, 0.09, (300, 3)), rng.normal(size=(300, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for contact in range(2):
        kinds, causes = limits.limits_at(contact, points, normals)
        centres = points + tips[contact] * normals
        spheres = zip(obstacles.points.points, obstacles.points.radii, strict=True)
        gaps = [solid.distance(centres) for solid in obstacles.solids]
        gaps = np.array(gaps + [np.linalg.norm(centres - z, axis=1) - R for z, R in spheres])
        touched = gaps < tips[contact] + CLEARANCE
        far = (np.linalg.norm(points, axis=1) > 0.07) & (contact == 1)
        blocked = np.any(touched, axis=0) & ~far
        np.testing.assert_array_equal(kinds == Limit.OBSTACLE, blocked)
        assert np.all(touched[causes[blocked], np.flatnonzero(blocked)])
        assert len(set(causes[blocked])) >= 3
        np.testing.assert_array_equal(kinds == Limit.REACH, far)
        np.testing.assert_array_equal(causes[~blocked], NO_CAUSE)


@pytest.mark.parametrize("seed", range(3))
def test_tips_stay_clear_of_obstacles_on_the_way_from_their_standoff(seed):
    obstacles, radius, standoff = near_obstacles(seed), 0.004, 0.03
    points, normals = BALL.p_OQ, BALL.nhat_OQ
    shared = {"clearance": CLEARANCE, "tip_radii": np.array([radius])}
    at_places = [
        RegionConstraints(obstacles, **shared).limits_at(0, points + share * standoff * normals, n)
        for share, n in ((share, normals) for share in (0.0, 0.5, 1.0))
    ]
    limits = RegionConstraints(obstacles, standoff=standoff, **shared)
    blocked = limits.limits_at(0, points, normals)[0] != Limit.NONE
    expected = [found != Limit.NONE for found, _ in at_places]
    np.testing.assert_array_equal(blocked, np.any(expected, axis=0))
    assert np.sum(blocked) > np.sum(expected[0])


# Reach.


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6))
def test_more_reach_never_takes_a_candidate_from_anyone(seed):
    p_OC = contacts(BALL, 4, seed)
    center = np.random.default_rng(seed).uniform(-0.06, 0.06, 3)
    before = None
    for radius in (0.01, 0.03, 0.05, 0.2):
        reach = [BallSolid(center, radius), None, BallSolid(center, 0.05), None]
        reach = [None if solid is None else FingerReach(solid) for solid in reach]
        now = regions(BALL, p_OC, reach=reach).labels
        if before is not None:
            had = before != NO_REGION
            np.testing.assert_array_equal(now[had], before[had])
            assert np.all(now[~had & (now != NO_REGION)] == 0)
        before = now


def test_reach_is_where_a_contact_can_be_and_of_no_others_concern():
    p_OC = contacts(BALL, 3)
    solid = BallSolid(p_OC[1], 0.02)
    free = regions(BALL, p_OC).labels
    limited = regions(BALL, p_OC, reach=[None, FingerReach(solid), None]).labels
    inside = np.linalg.norm(BALL.p_OQ - p_OC[1], axis=1) <= 0.02
    np.testing.assert_array_equal(limited, np.where((free == 1) & ~inside, NO_REGION, free))


# Relabelling.


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6))
def test_relabelling_contacts_relabels_the_result(seed):
    rng = np.random.default_rng(seed)
    n = 5
    p_OC = contacts(BALL, n, seed) + rng.normal(size=(n, 3)) * 1e-5  # No candidate at a tie.
    nhat_OC = BALL.project(p_OC)[1]
    weights = rng.uniform(-2e-4, 2e-4, n)
    weights[rng.integers(n)] = -np.inf if seed % 2 else 0.0
    given_to_each = {
        "tip_radii": rng.uniform(0, 0.02, n),
        "reach": [
            FingerReach(BallSolid(rng.uniform(-0.04, 0.04, 3), rng.uniform(0.02, 0.1)))
            for _ in range(n)
        ],
        "same_side": normals_agree(nhat_OC, BALL.nhat_OQ),
        "fencing": rng.uniform(size=(n, 0)) > 0,
    }
    shared = {"obstacles": near_obstacles(seed), "clearance": CLEARANCE}
    here = regions(BALL, p_OC, weights, **given_to_each, **shared)
    order = rng.permutation(n)  # New contact k is the old contact order[k].
    there = regions(
        BALL,
        p_OC[order],
        weights[order],
        **{
            key: [v[k] for k in order] if key == "reach" else v[order]
            for key, v in given_to_each.items()
        },
        **shared,
    )
    new_of_old = np.argsort(order)
    relabelled = np.where(here.labels == NO_REGION, NO_REGION, new_of_old[here.labels])
    np.testing.assert_array_equal(there.labels, relabelled)
    np.testing.assert_array_equal(there.lost, here.lost[order])
    np.testing.assert_array_equal(there.sizes(), here.sizes()[order])
    # Where two causes keep out equally many candidates, either may be named.
    same = there.limits == here.limits[order]
    assert np.mean(same) >= 0.8
    crowded = same & (there.limits == Limit.CROWDED)
    assert np.all(there.causes[crowded] < n)


# Fingertips.


def gap(a, b):
    return np.min(np.linalg.norm(a[:, None] - b, axis=2))


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6))
def test_points_of_two_buffered_cells_are_apart_by_both_radii(seed):
    rng = np.random.default_rng(seed)
    n, p_OC = 4, contacts(CUBE, 4, seed)
    tips, weights = rng.uniform(0.001, 0.012, n), rng.uniform(-2e-4, 2e-4, n)
    limited = regions(CUBE, p_OC, weights, tip_radii=tips)
    plain = regions(CUBE, p_OC, weights)
    kept = limited.labels != NO_REGION
    np.testing.assert_array_equal(limited.labels[kept], plain.labels[kept])
    for i in range(n):
        for k in range(i):
            a, b = (CUBE.p_OQ[limited.members(m)] for m in (i, k))
            if len(a) and len(b):
                assert gap(a, b) >= tips[i] + tips[k] - 1e-12


@pytest.mark.parametrize("gap", [0.0, 0.012])
@pytest.mark.parametrize("h", [0.0, 1.3e-3, -1.3e-3])
def test_cells_are_set_back_by_the_radius_and_half_the_gap(h, gap):
    p_OC = np.array([[0.05, -0.019, 0.0], [0.05, 0.031, 0.0]])
    tips = np.array([0.004, 0.011])
    y, boundary = CUBE.p_OQ[:, 1], 0.006 + h / (2 * 0.05)
    limited = regions(CUBE, p_OC, [h, 0.0], tip_radii=tips, tip_gap=gap)
    np.testing.assert_array_equal(limited.labels == 0, y <= boundary - 0.004 - gap / 2)
    np.testing.assert_array_equal(limited.labels == 1, y >= boundary + 0.011 + gap / 2)


def test_equal_weights_alone_keep_nothing_apart():
    p_OC = np.array([[0.05, -0.02, 0.0], [0.05, 0.03, 0.0]])
    r = 0.012
    weighted = regions(CUBE, p_OC, np.full(2, r**2))
    a, b = (CUBE.p_OQ[weighted.members(m)] for m in (0, 1))
    assert gap(a, b) < r < 2 * r


def test_a_lost_contact_needs_no_room():
    p_OC = contacts(CUBE, 4)
    tips = np.full(4, 0.01)
    lost = regions(CUBE, p_OC, [0, 0, -np.inf, 0], tip_radii=tips)
    rest = regions(CUBE, np.delete(p_OC, 2, axis=0), tip_radii=tips[:3])
    np.testing.assert_array_equal(lost.sizes(), np.insert(rest.sizes(), 2, 0))
    assert list(lost.lost) == [False, False, True, False]
    assert (lost.limits[2], lost.causes[2]) == (Limit.NONE, NO_CAUSE)


# Causes.


def cause(result, contact=0):
    return Limit(result.limits[contact]), int(result.causes[contact]), result.sizes()[contact]


FOUR = np.array([[0.05, 0.01, 0.0], [-0.05, 0.0, 0.0], [0.0, 0.05, 0.0], [0.0, -0.05, 0.0]])


def test_nothing_limits_contacts_with_regions():
    result = regions(CUBE, FOUR)
    np.testing.assert_array_equal(result.limits, Limit.NONE)
    np.testing.assert_array_equal(result.causes, NO_CAUSE)


@pytest.mark.parametrize("neighbour", [1, 3])
def test_crowded_out_names_the_neighbour(neighbour):
    weights = np.zeros(4)
    weights[neighbour] = 0.1  # As if it were so much nearer everywhere.
    assert cause(regions(CUBE, FOUR, weights)) == (Limit.CROWDED, neighbour, 0)


def test_crowded_by_a_fingertip_names_whose_it_is():
    p_OC = FOUR[0] + np.array([[0, 0, 0], [0, 1e-3, 0]])
    for order in ([0, 1], [1, 0]):
        limited = regions(CUBE, p_OC[order], tip_radii=np.full(2, 0.08))
        assert cause(limited, 0) == (Limit.CROWDED, 1, 0)
        assert cause(limited, 1) == (Limit.CROWDED, 0, 0)


def test_crowded_to_a_few_candidates_names_a_neighbour():
    around = [[0, 0, 0], [0, 0.009, 0], [0, -0.009, 0], [0, 0, 0.009], [0, 0, -0.008]]
    p_OC = np.array([0.05, 0.005, 0.005]) + around
    limit, neighbour, size = cause(regions(CUBE, p_OC))
    assert limit == Limit.CROWDED
    assert neighbour in {1, 2, 3, 4}
    assert 0 < size < 5


def test_out_of_reach_is_said():
    reach = [FingerReach(BallSolid(np.array([0.5, 0, 0]), 0.1)), None, None, None]
    assert cause(regions(CUBE, FOUR, reach=reach)) == (Limit.REACH, NO_CAUSE, 0)
    hardly = [FingerReach(BallSolid(FOUR[0], 0.012)), None, None, None]
    limit, _, size = cause(regions(CUBE, FOUR, reach=hardly))
    assert limit == Limit.REACH
    assert size > 0


def test_an_obstacle_is_named_by_its_index_solids_first():
    far = BallSolid(np.array([1.0, 0, 0]), 0.1)
    near = BallSolid(np.array([0.07, 0, 0]), 0.06)
    result = regions(CUBE, FOUR, obstacles=Obstacles((far, near)), clearance=0.01)
    assert cause(result) == (Limit.OBSTACLE, 1, 0)
    points = ForbiddenPoints(np.array([[1.0, 0, 0], [0.07, 0, 0]]), np.array([0.1, 0.06]))
    result = regions(CUBE, FOUR, obstacles=Obstacles((far,), points), clearance=0.01)
    assert cause(result) == (Limit.OBSTACLE, 2, 0)
    assert cause(result, 1)[0] == Limit.NONE


def test_of_several_causes_the_one_that_keeps_out_most_is_named():
    reach = [
        FingerReach(BallSolid(np.array([0.05, 0.01, 0.1]), 0.08)),
        None,
        None,
        None,
    ]  # The upper half.
    wall = Obstacles((HalfSpace(np.zeros(3), np.array([-1.0, 0, 0])),))  # All.
    assert cause(regions(CUBE, FOUR, reach=reach, obstacles=wall))[0] == Limit.OBSTACLE
    assert cause(regions(CUBE, FOUR, reach=reach))[0] == Limit.NONE


def test_forbidden_ground_is_named():
    z = FOUR[0] + [[0, 0.004, 0], [0, -0.004, 0], [0, 0, 0.004], [0, 0, -0.004]]
    fence = ForbiddenPoints(z, np.full(4, 0.002))
    result = compute_safe_regions(CUBE.p_OQ, FOUR, np.zeros(4), fence)
    limit, index, size = cause(result)
    assert (limit, index) == (Limit.FORBIDDEN, NO_CAUSE)
    assert size < 20


def test_a_wall_is_named():
    nobody_sees = np.ones((4, len(CUBE.p_OQ)), dtype=bool)
    nobody_sees[0] = False
    assert cause(regions(CUBE, FOUR, same_side=nobody_sees)) == (Limit.WALL, NO_CAUSE, 0)
    nobody_sees[:] = False
    result = regions(CUBE, FOUR, same_side=nobody_sees)
    assert np.all(result.labels == NO_REGION)
    np.testing.assert_array_equal(result.limits, Limit.WALL)


# Thin walls.

PLATE = mesh_surface(box_shape([0.1, 0.1, 0.003]), spacing=0.006)
THIN_CUP = mesh_surface(CUP, spacing=0.006, no_touch=[AxisArea("+z"), AxisArea("-z")])
ON_PLATE = np.array([[0.02, 0.02, 0.0015], [0.02, -0.02, 0.0015], [-0.02, 0.0, 0.0015]])
AROUND = np.array([[np.cos(a), np.sin(a), 0] for a in (0.3, 2.0, 4.2)])
ON_CUP = RADIUS * AROUND + [0, 0, 0.045]


def same_side(surface, p_OC, test):
    p_OC, nhat_OC = surface.project(p_OC)
    if test == "normals":
        return normals_agree(nhat_OC, surface.nhat_OQ)
    return SurfaceGraph(surface).near_over_the_surface(p_OC, nhat_OC)


def on_far_side(surface, p_OC):
    """For each contact which candidates are across the wall, right behind it."""
    if surface is PLATE:
        behind = surface.nhat_OQ[:, 2] < -0.9
    else:
        behind = np.hypot(surface.p_OQ[:, 0], surface.p_OQ[:, 1]) < RADIUS - WALL / 2
    near = np.linalg.norm(surface.p_OQ[:, None] - p_OC, axis=2).T < 0.012
    return behind & near


@pytest.mark.parametrize(("surface", "p_OC"), [(PLATE, ON_PLATE), (THIN_CUP, ON_CUP)])
def test_without_a_wall_test_regions_reach_through_thin_walls(surface, p_OC):
    labels = regions(surface, p_OC).labels
    far = on_far_side(surface, p_OC)
    assert any(np.any(far[i] & (labels == i)) for i in range(len(p_OC)))


@pytest.mark.parametrize(("surface", "p_OC"), [(PLATE, ON_PLATE), (THIN_CUP, ON_CUP)])
@pytest.mark.parametrize("test", ["normals", "surface"])
def test_with_one_no_region_has_candidates_on_both_sides(surface, p_OC, test):
    result = regions(surface, p_OC, same_side=same_side(surface, p_OC, test))
    far = on_far_side(surface, p_OC)
    assert np.all(result.sizes() > 0)
    for i in range(len(p_OC)):
        assert not np.any(far[i] & (result.labels == i))
        # Its own side is no smaller for it: of two sides, each has its half.
        own = np.linalg.norm(surface.p_OQ - p_OC[i], axis=1) < 0.012
        own &= surface.nhat_OQ @ surface.project(p_OC[i][None])[1][0] > 0.5
        assert np.all(result.labels[own] == i)


@pytest.mark.parametrize("test", ["normals", "surface"])
def test_ground_behind_a_wall_goes_to_the_nearest_contact_on_its_side(test):
    p_OC = np.array([[0.01, 0.0, 0.0015], [-0.01, 0.0, -0.0015]])
    result = regions(PLATE, p_OC, same_side=same_side(PLATE, p_OC, test))
    inner = np.all(np.abs(PLATE.p_OQ[:, :2]) < 0.02, axis=1)
    for sign, contact in ((1, 0), (-1, 1)):
        side = inner & (sign * PLATE.nhat_OQ[:, 2] > 0.9)
        assert np.sum(side) > 20
        assert np.all(result.labels[side] == contact)


def test_by_normals_no_region_has_candidates_on_both_sides_of_a_plate():
    result = regions(PLATE, ON_PLATE, same_side=same_side(PLATE, ON_PLATE, "normals"))
    assert np.all(result.labels[PLATE.nhat_OQ[:, 2] < -0.9] == NO_REGION)
    assert np.all(result.labels[PLATE.nhat_OQ[:, 2] > 0.9] != NO_REGION)


def test_the_way_over_the_surface_leads_round_edges_that_normals_do_not_pass():
    """On a cup's rim both sides are near each other; deep in the cup they aren't."""
    surface = mesh_surface(CUP, spacing=0.004)
    high = surface.project(np.array([[RADIUS, 0, 0.0895]]))
    low = surface.project(np.array([[RADIUS, 0, 0.03]]))
    inside = np.hypot(surface.p_OQ[:, 0], surface.p_OQ[:, 1]) < RADIUS - WALL / 2
    graph = SurfaceGraph(surface)
    for (p_OC, nhat), expected in ((high, True), (low, False)):
        near = graph.near_over_the_surface(p_OC, nhat)[0]
        behind = inside & (np.linalg.norm(surface.p_OQ - p_OC, axis=1) < 0.006)
        assert np.any(behind)
        assert np.any(near[behind]) == expected


@pytest.mark.parametrize("surface", [BALL, CUBE], ids=["ball", "cube"])
def test_convex_bodies_have_no_walls_for_the_way_over_the_surface(surface):
    p_OC = contacts(surface, 3)
    opposite = surface.p_OQ @ p_OC[0] < -0.5 * np.linalg.norm(p_OC[0]) ** 2
    near = SurfaceGraph(surface).near_over_the_surface(p_OC, surface.project(p_OC)[1])
    assert np.all(near[0][~opposite])


def test_a_small_hole_in_the_allowed_surface_is_no_wall():
    """A grid lacks the candidates around a contact: ways lead round the hole, on the same side."""
    x = np.arange(-5.5, 6)
    grid = np.stack([*np.meshgrid(x, x), np.zeros((12, 12))], axis=-1).reshape(-1, 3)
    grid = grid[np.linalg.norm(grid, axis=1) > 1.5]
    up = np.tile([0.0, 0.0, 1.0], (len(grid), 1))
    holed = replace(PLATE, p_OQ=1e-3 * grid, nhat_OQ=up, areas=np.full(len(grid), 1e-6))
    near = SurfaceGraph(holed).near_over_the_surface(np.zeros((1, 3)), up[:1])
    assert np.all(near)


@pytest.mark.parametrize("surface", [PLATE, THIN_CUP], ids=["plate", "cup"])
def test_links_of_the_graph_are_no_longer_than_the_ways_they_shorten(surface):
    """Ways over the surface are never shorter than straight ones: a contact sees its own place."""
    p_OC = contacts(surface, 6)
    near = SurfaceGraph(surface).near_over_the_surface(p_OC, surface.project(p_OC)[1])
    straight = np.linalg.norm(surface.p_OQ - p_OC[:, None], axis=2)
    assert np.all(near[straight < 1e-12])


def test_normals_agree_up_to_120_degrees_and_with_what_is_no_ground():
    angles = np.radians([0, 90, 119, 121, 180])
    normals = np.stack([np.cos(angles), np.sin(angles), np.zeros(5)], axis=1)
    agrees = normals_agree(np.array([[1.0, 0, 0]]), np.vstack([normals, np.zeros(3)]))
    np.testing.assert_array_equal(agrees, [[True, True, True, False, False, True]])


def test_forbidden_ground_behind_a_wall_does_not_fence():
    """The lower side of a plate is forbidden; its upper one is free up to the rims."""
    plate = mesh_surface(box_shape([0.1, 0.1, 0.003]), spacing=0.006, no_touch=[AxisArea("-z")])
    p_OC = np.array([[0.0, 0.0, 0.0015]])
    nhat = plate.project(p_OC)[1]
    top = plate.nhat_OQ[:, 2] > 0.9
    fenced = regions(plate, p_OC)
    assert np.sum(fenced.labels[top] == 0) < 0.5 * np.sum(top)
    fencing = normals_agree(nhat, plate.forbidden.normals)
    free = regions(plate, p_OC, fencing=fencing)
    assert np.all(free.labels[top] == 0)


def test_forbidden_points_that_fence_are_those_of_the_printed_equations():
    rng = np.random.default_rng(4)
    p_OC = contacts(CUBE, 3) + 1e-4 * rng.normal(size=(3, 3))
    z, R = rng.uniform(-0.07, 0.07, (8, 3)), rng.uniform(0, 0.01, 8)
    fencing = rng.uniform(size=(3, 8)) > 0.5
    limits = RegionConstraints(fencing=fencing)
    result = compute_safe_regions(CUBE.p_OQ, p_OC, np.zeros(3), ForbiddenPoints(z, R), limits)
    for i, own in enumerate(fencing):
        printed = safe_region_labels(CUBE.p_OQ, p_OC, np.zeros(3), z[own], R[own])
        np.testing.assert_array_equal(result.labels == i, printed == i)


# More coordinates.


def test_lifting_by_nothing_changes_nothing():
    surface = mesh_surface(CUP, spacing=0.008, no_touch=[AxisArea("+z")])
    p_OC = contacts(surface, 4)
    nhat = surface.project(p_OC)[1]
    limits = RegionConstraints(
        obstacles=near_obstacles(1),
        clearance=CLEARANCE,
        reach=[FingerReach(BallSolid(np.zeros(3), 0.08))] * 4,
    )
    plain = compute_safe_regions(surface.p_OQ, p_OC, np.zeros(4), surface.forbidden, limits)
    for length, same in ((0.0, True), (0.05, False)):
        result = compute_safe_regions(
            lifted(surface.p_OQ, surface.nhat_OQ, length),
            lifted(p_OC, nhat, length),
            np.zeros(4),
            surface.forbidden,
            limits,
        )
        assert np.array_equal(result.labels, plain.labels) == same


def test_forbidden_points_without_the_further_coordinates_hold_for_all_values():
    rng = np.random.default_rng(7)
    q, c = rng.uniform(-0.05, 0.05, (80, 6)), rng.uniform(-0.05, 0.05, (1, 6))
    z, radii = rng.uniform(-0.05, 0.05, (5, 3)), np.full(5, 0.004)
    result = compute_safe_regions(q, c, np.zeros(1), ForbiddenPoints(z, radii))
    flat = compute_safe_regions(q[:, :3], c[:, :3], np.zeros(1), ForbiddenPoints(z, radii))
    np.testing.assert_array_equal(result.labels, flat.labels)


def test_with_normals_regions_keep_to_ground_that_faces_their_way():
    p_OC = np.array([[0.05, 0.0, 0.0], [0.03, 0.05, 0.0]])
    nhat = CUBE.project(p_OC)[1]
    plain = regions(CUBE, p_OC)
    six = compute_safe_regions(
        lifted(CUBE.p_OQ, CUBE.nhat_OQ, 0.2), lifted(p_OC, nhat, 0.2), np.zeros(2), CUBE.forbidden
    )
    for result, strays in ((plain, True), (six, False)):
        on_plus_x = CUBE.nhat_OQ[:, 0] > 0.9
        assert np.any(result.labels[on_plus_x] != 0) == strays
