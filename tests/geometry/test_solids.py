"""Signed distances of convex solids, and nearest points of triangles."""

import functools

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.arrays import norms
from drake_pregrasp.fast import numba_is_installed
from drake_pregrasp.geometry.solids import BallSolid, BoxSolid, HalfSpace, is_hidden
from drake_pregrasp.geometry.surface import ForbiddenPoints, closest_points
from drake_pregrasp.regions.constraints import Obstacles


def rotation(rng):
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return R * np.sign(np.linalg.det(R))


def random_solid(kind, seed):
    rng = np.random.default_rng(seed)
    center = rng.uniform(-1, 1, 3)
    if kind == "ball":
        return BallSolid(center, rng.uniform(0, 1))
    if kind == "box":
        return BoxSolid(center, rotation(rng), rng.uniform(0.2, 2, 3))
    return HalfSpace(center, rng.normal(size=3))


kinds = pytest.mark.parametrize("kind", ["ball", "box", "half-space"])


def test_distances_have_their_closed_forms():
    points = np.random.default_rng(0).uniform(-3, 3, (200, 3))
    ball = BallSolid(np.array([0.5, 0, 0]), 0.7)
    expected = np.linalg.norm(points - [0.5, 0, 0], axis=1) - 0.7
    np.testing.assert_allclose(ball.distance(points), expected)
    space = HalfSpace(np.array([0, 0, 0.3]), np.array([0, 0, 5.0]))
    np.testing.assert_allclose(space.distance(points), points[:, 2] - 0.3)
    solid = random_solid("box", 3)
    mesh = trimesh.creation.box(solid.size)
    mesh.vertices = mesh.vertices @ solid.R_FB.T + solid.center
    _, nearest, _ = trimesh.proximity.closest_point_naive(mesh, points)
    inside = np.all(np.abs((points - solid.center) @ solid.R_FB) < solid.size / 2, axis=1)
    assert np.any(inside)
    signed = np.where(inside, -nearest, nearest)
    np.testing.assert_allclose(solid.distance(points), signed, atol=1e-9)


@kinds
@given(seed=st.integers(0, 10**6))
def test_the_gradient_is_that_of_the_distance(kind, seed):
    solid = random_solid(kind, seed)
    points = np.random.default_rng(seed + 1).uniform(-3, 3, (10, 3))
    distances, gradients = solid.distance_and_gradient(points)
    np.testing.assert_allclose(np.linalg.norm(gradients, axis=1), 1, rtol=1e-9)
    step = 1e-6
    slopes = np.stack(
        [(solid.distance(points + step * e) - solid.distance(points - step * e)) for e in np.eye(3)]
    ).T / (2 * step)
    smooth = np.abs(np.linalg.norm(slopes, axis=1) - 1) < 1e-4  # Off the creases inside a box.
    np.testing.assert_allclose(gradients[smooth], slopes[smooth], atol=1e-4)
    assert np.sum(smooth) >= 8
    # A step along the gradient leads to the surface from outside.
    outside = distances > 0
    feet = points[outside] - distances[outside, None] * gradients[outside]
    np.testing.assert_allclose(solid.distance(feet), 0, atol=1e-9)


@kinds
@given(seed=st.integers(0, 10**6))
def test_distances_change_no_faster_than_points_and_are_convex(kind, seed):
    solid = random_solid(kind, seed)
    a, b = np.random.default_rng(seed + 2).uniform(-3, 3, (2, 20, 3))
    at_a, at_b = solid.distance(a), solid.distance(b)
    assert np.all(np.abs(at_a - at_b) <= np.linalg.norm(a - b, axis=1) + 1e-12)
    assert np.all(solid.distance((a + b) / 2) <= (at_a + at_b) / 2 + 1e-12)


@kinds
@given(seed=st.integers(0, 10**6))
def test_moving_is_rigid(kind, seed):
    solid, rng = random_solid(kind, seed), np.random.default_rng(seed + 3)
    R, p, (points, normals) = rotation(rng), rng.normal(size=3), rng.uniform(-3, 3, (2, 20, 3))
    obstacles = Obstacles((solid,), ForbiddenPoints(points, rng.uniform(size=20), normals))
    moved = obstacles.moved(R, p)
    distances, gradients = solid.distance_and_gradient(points)
    moved_distances, moved_gradients = moved.solids[0].distance_and_gradient(points @ R.T + p)
    np.testing.assert_allclose(moved_distances, distances, atol=1e-12)
    np.testing.assert_allclose(moved_gradients, gradients @ R.T, atol=1e-9)
    np.testing.assert_allclose(moved.points.points, points @ R.T + p)
    np.testing.assert_allclose(moved.points.normals, normals @ R.T)
    np.testing.assert_array_equal(moved.points.radii, obstacles.points.radii)


def test_at_special_points_gradients_are_units():
    ball = BallSolid(np.zeros(3), 1.0)
    np.testing.assert_array_equal(ball.distance_and_gradient(np.zeros((1, 3)))[1], [[0, 0, 1]])
    box = BoxSolid(np.zeros(3), np.eye(3), np.array([1.0, 2, 3]))
    distances, gradients = box.distance_and_gradient(np.array([[0.0, 0, 0], [0.5, 1, 1.5]]))
    np.testing.assert_allclose(distances, [-0.5, 0])
    np.testing.assert_allclose(np.linalg.norm(gradients, axis=1), 1)


@pytest.mark.parametrize(
    ("kind", "numbers"),
    [
        (BallSolid, ([0, 0, 1], 0.5)),
        (BoxSolid, ([0, 0, 1], [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], [1, 2, 3])),
        (HalfSpace, ([0, 0, 1], [0, 0, 2])),
    ],
)
def test_lists_are_as_good_as_arrays(kind, numbers):
    points = np.random.default_rng(0).uniform(-3, 3, (20, 3))
    of_lists, of_arrays = kind(*numbers), kind(*(np.array(n, dtype=float) for n in numbers))
    moved = of_lists.moved(np.eye(3), np.ones(3))
    np.testing.assert_array_equal(of_lists.distance(points), of_arrays.distance(points))
    np.testing.assert_allclose(moved.distance(points + 1), of_lists.distance(points), atol=1e-12)


def test_obstacles_may_be_lists():
    points = ForbiddenPoints([[0, 0, 1], [1, 0, 0]], [0.1, 0.2], [[0, 0, 1], [1, 0, 0]])
    ball = BallSolid([0, 0, 1], 0.5)
    obstacles = Obstacles([ball], points, velocities=[[0, 0, 1]]).moved(np.eye(3), np.ones(3))
    assert (len(obstacles.points), len(obstacles.solids)) == (2, 1)


@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (lambda: BallSolid(np.zeros(3), -1.0), "radius must be at least 0 m, not -1"),
        (lambda: BallSolid(np.full(3, np.nan), 1.0), "a ball's center must be finite"),
        (lambda: BoxSolid(np.zeros(3), np.eye(3), -np.ones(3)), "edges must be at least 0 m"),
        (lambda: HalfSpace(np.zeros(3), np.zeros(3)), "normal must not be zero"),
    ],
)
def test_solids_without_sense_are_refused(make, problem):
    with pytest.raises(InvalidArgumentError, match=problem):
        make()


without_numba = pytest.mark.skipif(not numba_is_installed(), reason="numba is not installed")
implementations = pytest.mark.parametrize(
    "implementation", ["reference", pytest.param("numba", marks=without_numba)]
)


def nearest(implementation, corners, points):
    if implementation == "reference":
        return closest_points(corners, points)
    return compiled_closest_points()(corners, points)


@functools.cache
def compiled_closest_points():
    import numba

    from drake_pregrasp.fast.projection import closest_point

    @numba.njit(error_model="numpy")
    def closest(corners, points):
        nearest, scratch = np.empty((len(points), 3)), np.empty((6, 3))
        for k in range(len(points)):
            closest_point(points[k], corners[k], nearest[k], scratch)
        return nearest

    return closest


def triangle(rng, kind):
    corners = rng.normal(size=(3, 3))
    if kind == "needle":
        corners[2] = corners[0] + 1e-6 * rng.normal(size=3)
    if kind == "line":
        corners[2] = corners[0] + rng.uniform(-1, 2) * (corners[1] - corners[0])
    if kind == "point":
        corners[:] = corners[0]
    return corners


@pytest.mark.slow
@implementations
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(["any", "needle", "line", "point"]),
    st.sampled_from([1e-4, 1.0, 1e3]),
    st.sampled_from([0.01, 1.0, 5.0]),
)
def test_no_corner_lies_on_the_points_side_of_the_nearest(
    implementation, seed, kind, scale, spread
):
    """(p - x)·(y - x) <= 0 for all y of a convex set is what makes x of it the nearest to p."""
    rng = np.random.default_rng(seed)
    corners = np.array([triangle(rng, kind) for _ in range(20)])
    points = corners[:, 1] + spread * rng.normal(size=(20, 3))
    points[:3] = corners[0]
    x = nearest(implementation, scale * corners, scale * points) / scale
    for corner in np.moveaxis(corners, 1, 0):
        assert np.all(np.einsum("ij,ij->i", points - x, corner - x) <= 1e-9)
    for c, point in zip(corners, x, strict=True):  # It is a mean of the corners.
        _, residual = nnls(np.vstack([c.T, np.ones(3)]), np.append(point, 1))
        assert residual < 1e-9


@pytest.mark.slow
@implementations
@pytest.mark.parametrize("corner", range(3))
def test_corners_are_nearest_to_themselves(implementation, corner):
    corners = np.random.default_rng(0).normal(size=(50, 3, 3))
    x = nearest(implementation, corners, corners[:, corner])
    np.testing.assert_allclose(x, corners[:, corner], atol=1e-15)


@pytest.mark.slow
def test_what_a_box_or_a_ball_hides_is_beyond_a_point_of_it_on_the_ray():
    """Against points of each ray that are inside, also for rays along the axes of a box."""
    rng, shares = np.random.default_rng(4), np.linspace(0, 1, 4001)[:, None]
    for case in range(60):
        R = Rotation.random(rng=rng).as_matrix() if case % 2 else np.eye(3)
        half = rng.uniform(0.05, 0.3, 3) if case % 3 else np.full(3, 0.2)
        p_FB, viewpoint = rng.normal(scale=0.1, size=3), rng.normal(size=3)
        points = rng.normal(scale=0.8, size=(30, 3))
        if case % 2 == 0:
            points[:10] = (
                viewpoint + rng.uniform(-2, 2, (10, 1)) * np.eye(3)[rng.integers(3, size=10)]
            )
        is_ball = case % 3 == 0
        for ends in (points, viewpoint + 0.2 * (points - viewpoint)):
            inside = []
            for point in ends:
                p_B = (viewpoint + shares * (point - viewpoint) - p_FB) @ R
                depth = half[0] - norms(p_B) if is_ball else np.min(half - np.abs(p_B), axis=1)
                inside.append(depth.max())
            X_FB = np.column_stack([R, p_FB])[None]
            hidden = is_hidden(viewpoint, ends, X_FB, half[None], np.array([is_ball]))
            clear = np.abs(inside) > 1e-3  # What grazes is left out.
            np.testing.assert_array_equal(hidden[clear], np.array(inside)[clear] > 0)
