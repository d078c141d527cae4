"""Stand-ins for many candidates: exact for polynomials, bounded for weights, same centroids."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_cases import on_box

from drake_pregrasp.kernels import KINDS, Weighting, make_kernel, numba_is_installed
from drake_pregrasp.kernels.blocks import make_blocks
from drake_pregrasp.kernels.search_tree import make_search_tree
from drake_pregrasp.kernels.sorting import BLOCK
from drake_pregrasp.kernels.stand_ins import GRID, NODES, make_stand_ins

needs_numba = pytest.mark.skipif(
    not numba_is_installed(), reason="numba is not installed (the extra [fast])"
)
SAME = 1e-9  # Of the object's size.


def cube_grid(per_edge, size=0.1):
    """Candidates at the centres of cells on the four sides of a cube."""
    x = size * ((np.arange(per_edge) + 0.5) / per_edge - 0.5)
    points, normals = [], []
    for axis in (0, 1):
        for sign in (-1.0, 1.0):
            face = np.zeros((per_edge**2, 3))
            face[:, 1 - axis], face[:, 2] = (c.ravel() for c in np.meshgrid(x, x))
            face[:, axis] = sign * size / 2
            points.append(face)
            normals.append(np.tile(sign * np.eye(3)[axis], (per_edge**2, 1)))
    return np.concatenate(points), np.concatenate(normals)


def test_they_integrate_polynomials_as_their_candidates_do():
    rng = np.random.default_rng(0)
    points, nhat = on_box(rng, 9000, 2.0)
    blocks = make_blocks(points, nhat, rng.uniform(0.5, 2, 9000))
    stand_ins = make_stand_ins(blocks, make_search_tree(blocks))
    assert len(stand_ins.firsts) > 10
    for first, end, grid in zip(stand_ins.firsts, stand_ins.ends, stand_ins.grids, strict=True):
        own = slice(first * BLOCK, end * BLOCK)
        areas, total = blocks.areas[own], np.sum(blocks.areas[own])
        for powers in ((0, 0, 0), (7, 0, 0), (0, 7, 7), (7, 7, 0), (3, 2, 7), (1, 5, 4)):
            exact = np.prod(blocks.points[:, own].T ** powers, axis=1) @ areas
            found = np.prod(grid[:3].T ** powers, axis=1) @ grid[3]
            assert abs(found - exact) < 1e-12 * total


def test_those_of_parts_follow_theirs():
    blocks = make_blocks(*cube_grid(40), np.ones(6400))
    stand_ins = make_stand_ins(blocks, make_search_tree(blocks))
    rows = np.arange(len(stand_ins.firsts))
    assert np.all(stand_ins.skips > rows)
    for row in rows:
        parts = slice(row + 1, stand_ins.skips[row])
        assert np.all(stand_ins.firsts[parts] >= stand_ins.firsts[row])
        assert np.all(stand_ins.ends[parts] <= stand_ins.ends[row])
        following = stand_ins.firsts[stand_ins.skips[row] :]
        assert np.all(following >= stand_ins.ends[row])


def between(values, u, v):
    """The polynomial through values on the grid, evaluated with barycentric weights."""
    sides = np.where((np.arange(NODES) == 0) | (np.arange(NODES) == NODES - 1), 0.5, 1.0)
    weights = sides * (-1.0) ** np.arange(NODES)

    def basis(x):
        shares = weights / (x[:, None] - GRID)
        return shares / np.sum(shares, axis=1, keepdims=True)

    return np.einsum("ki,ij,kj->k", basis(v), values.reshape(NODES, NODES), basis(u))


@needs_numba
@settings(max_examples=60)
@given(seed=st.integers(0, 10**6), size=st.floats(0.01, 1), spread=st.floats(0.3, 30))
def test_the_bound_of_a_gaussian_holds(seed, size, spread):
    from drake_pregrasp.kernels.compiled.stand_ins import gaussian_error

    rng = np.random.default_rng(seed)
    whitener = np.tril(rng.normal(size=(3, 3))) / spread
    frame, middle = np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.normal(size=3)
    half = size * rng.uniform(0.1, 1, 2)

    def exponents(u, v):
        q = middle + np.outer(half[0] * u, frame[0]) + np.outer(half[1] * v, frame[1])
        return q, -0.5 * np.sum((q @ whitener.T) ** 2, axis=1)

    q, on_grid = exponents(np.tile(GRID, NODES), np.repeat(GRID, NODES))
    u, v = rng.uniform(-1, 1, (2, 2000))
    reference = np.max(on_grid)
    exact = np.exp(exponents(u, v)[1] - reference)
    error = np.max(np.abs(between(np.exp(on_grid - reference), u, v) - exact))
    bound = gaussian_error(whitener, np.vstack([q.T, np.ones(BLOCK)]), reference)
    assert error <= bound + 1e-13


@needs_numba
@settings(max_examples=60)
@given(seed=st.integers(0, 10**6), height=st.floats(0, 1), kink=st.booleans())
def test_the_bounds_of_other_weights_hold_also_across_kinks(seed, height, kink):
    """The estimate covers all but what a kink leaves between the places, some times as much."""
    from drake_pregrasp.kernels.compiled.stand_ins import (
        interpolation_error,
        least_between,
    )

    rng = np.random.default_rng(seed)
    slope, bend, (s, t) = rng.normal(size=2), 0.3 * rng.normal(size=3), rng.uniform(-1, 1, 2)
    normal = rng.normal(size=2)

    def weights(u, v):
        smooth = np.sqrt(9 + slope[0] * u + slope[1] * v + bend[0] * u * u + bend[1] * u * v)
        cone = np.hypot(u - s, v - t)
        line = np.abs(normal[0] * (u - s) + normal[1] * (v - t))
        return smooth + height * (line if kink else cone) * (seed % 3 > 0)

    values = weights(np.tile(GRID, NODES), np.repeat(GRID, NODES))
    u, v = rng.uniform(-1, 1, (2, 2000))
    polynomial = between(values, u, v)
    error = np.max(np.abs(polynomial - weights(u, v)))
    assert error <= 4 * interpolation_error(values) + 1e-13
    assert least_between(values) <= np.min(polynomial) + 1e-13


def centroids_of_both(points, nhat, p_OC, weighting, p_OZ, radii):
    found = []
    for implementation in ("numpy", "numba"):
        kernel = make_kernel(
            points, nhat, np.ones(len(points)), np.zeros(3), implementation=implementation
        )
        partition = kernel.partition(p_OC, np.zeros(len(p_OC)), p_OZ, radii)
        movers = np.flatnonzero(partition.sizes)
        found.append(kernel.centroids(partition, p_OC, movers, weighting))
    return found


@needs_numba
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("stretch", [False, True])
@pytest.mark.parametrize("size", [0.1, 1.0])
def test_centroids_are_those_of_all_candidates(kind, stretch, size):
    points, nhat = cube_grid(110, size)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        p_OC = points[rng.choice(len(points), 2 + seed, replace=False)] + 1e-6 * size
        p_OZ, radii = on_box(rng, 12, size)[0], np.full(12, 0.01 * size)
        spread = size * [0.03, 0.3, 1.0, 100.0][seed]
        weighting = Weighting(kind, stretch, spread**2 * np.diag([1.0, 2.0, 0.5]))
        slow, fast = centroids_of_both(points, nhat, p_OC, weighting, p_OZ, radii)
        np.testing.assert_allclose(fast, slow, rtol=0, atol=SAME * size)


@needs_numba
@pytest.mark.parametrize("kind", ["msv", "gii"])
def test_centroids_are_those_of_all_candidates_around_double_singular_values(kind):
    """Regular crosses: the kinks at double values are inside the regions, off and on the grid."""
    points, nhat = cube_grid(110)
    for turn in (0.0, 1e-3, 0.2):
        angle = turn + np.pi / 2 * np.arange(4)
        p_OC = 0.05 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
        weighting = Weighting(kind, True, np.eye(3))
        slow, fast = centroids_of_both(points, nhat, p_OC, weighting, np.empty((0, 3)), np.empty(0))
        np.testing.assert_allclose(fast, slow, rtol=0, atol=SAME * 0.1)


@needs_numba
@pytest.mark.parametrize("kind", ["msv", "gii", "vew"])
def test_the_least_weight_is_found_inside_what_has_a_stand_in(kind):
    """Of two faces each contact has one, and weighs least opposite the other contact."""
    points, nhat = (array[: 2 * 110**2] for array in cube_grid(110))
    for seed in range(4):
        p_OC = np.random.default_rng(seed).uniform(-0.04, 0.04, (2, 3))
        p_OC[:, 0] = -0.05, 0.05
        weighting = Weighting(kind, True, np.eye(3))
        slow, fast = centroids_of_both(points, nhat, p_OC, weighting, np.empty((0, 3)), np.empty(0))
        np.testing.assert_allclose(fast, slow, rtol=0, atol=SAME * 0.1)


@needs_numba
def test_weights_that_are_nearly_the_same_everywhere_have_the_same_centroids():
    """One contact's volume doesn't depend on where it is: what is left is rounding."""
    points, nhat = cube_grid(70)
    weighting = Weighting("vew", False, np.eye(3))
    slow, fast = centroids_of_both(
        points, nhat, points[:1] + 1e-4, weighting, np.empty((0, 3)), np.empty(0)
    )
    np.testing.assert_allclose(fast, slow, rtol=0, atol=SAME * 0.1)
