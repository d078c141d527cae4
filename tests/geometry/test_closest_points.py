"""Nearest point of a triangle, by its optimality conditions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import nnls

from drake_pregrasp.fast import numba_is_installed
from drake_pregrasp.geometry.surface import closest_points

without_numba = pytest.mark.skipif(not numba_is_installed(), reason="numba is not installed")
implementations = pytest.mark.parametrize(
    "implementation", ["reference", pytest.param("numba", marks=without_numba)]
)


def nearest(implementation, corners, points):
    if implementation == "reference":
        return closest_points(corners, points)
    from drake_pregrasp.fast.projection import closest_point

    nearest, scratch = np.empty((len(points), 3)), np.empty((6, 3))
    for k, (p, c) in enumerate(zip(points, corners, strict=True)):
        closest_point(p, c, nearest[k], scratch)
    return nearest


def triangle(rng, kind):
    corners = rng.normal(size=(3, 3))
    if kind == "needle":
        corners[2] = corners[0] + 1e-6 * rng.normal(size=3)
    if kind == "line":
        corners[2] = corners[0] + rng.uniform(-1, 2) * (corners[1] - corners[0])
    if kind == "point":
        corners[:] = corners[0]
    return corners


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


@implementations
@pytest.mark.parametrize("corner", range(3))
def test_corners_are_nearest_to_themselves(implementation, corner):
    corners = np.random.default_rng(0).normal(size=(50, 3, 3))
    x = nearest(implementation, corners, corners[:, corner])
    np.testing.assert_allclose(x, corners[:, corner], atol=1e-15)
