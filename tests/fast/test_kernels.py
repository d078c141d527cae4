"""Both kernels against Eq. 1 as printed, and against weights by decomposition."""

import copy

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_cases import IMPLEMENTATIONS, SHAPES, Case, kernel_of, slow_weights
from slow_safe_regions import breaks_eq_1

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.contacts.centroids import gaussian_log_weights, weighted_centroid
from drake_pregrasp.kernels import KINDS, Weighting, make_kernel
from drake_pregrasp.kernels.blocks import make_blocks
from drake_pregrasp.kernels.sorting import BLOCK
from drake_pregrasp.regions.safe_regions import NO_REGION, compute_safe_regions

TIE = 1e-12  # Of the square of the object's size: closer sides of Eq. 1 may go either way.
SAME = 1e-9  # Of the object's size.


def slow_centroid(case, kind, stretch, covariance, contact, members, active):
    q, areas = case.p_OQ[members], case.areas[members]
    if kind == "position":
        return weighted_centroid(q, gaussian_log_weights(q, case.p_OCoM, covariance), areas)
    b = slow_weights(case, kind, contact, q, active)
    b = b - np.min(b) if stretch else b
    with np.errstate(divide="ignore"):
        return weighted_centroid(q, np.log(b), areas)


def check_centroids(case, implementation, kind, *, stretch=True, spread=0.04, few=3):
    kernel = case.kernel(implementation)
    partition = case.partition(kernel)
    labels = partition.labels_of_candidates()
    active = partition.sizes > 0
    movers = np.flatnonzero(active)[:few]
    covariance = case.covariance(spread * case.size)
    found = kernel.centroids(partition, case.p_OC, movers, Weighting(kind, stretch, covariance))
    assert found.shape == (len(movers), 3)
    for contact, centroid in zip(movers, found, strict=True):
        members = np.flatnonzero(labels == contact)
        expected = slow_centroid(case, kind, stretch, covariance, contact, members, active)
        np.testing.assert_allclose(centroid, expected, rtol=0, atol=SAME * case.size)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
@settings(max_examples=40)
@given(
    seed=st.integers(0, 10**6),
    n=st.integers(1, 32),
    m=st.integers(0, 40),
    size=st.sampled_from([0.01, 0.1, 2.0]),
    lost=st.integers(0, 2),
)
def test_labels_are_those_of_the_printed_equations_but_for_ties(
    implementation, seed, n, m, size, lost
):
    case = Case(seed, n, m, size=size, N=150, lost=min(lost, n))
    kernel = case.kernel(implementation)
    partition = case.partition(kernel)
    labels = partition.labels_of_candidates()
    np.testing.assert_array_equal(partition.sizes, np.bincount(labels + 1, minlength=n + 1)[1:])
    kept = np.flatnonzero(np.isfinite(case.h))
    eq_1 = (case.p_OC[kept], case.h[kept], case.forbidden.points, case.forbidden.radii)
    tie = TIE * size**2
    for q, label in zip(case.p_OQ[::5], labels[::5], strict=True):
        if label == NO_REGION:
            assert all(breaks_eq_1(q, i, *eq_1, slack=-tie) for i in range(len(kept)))
        else:
            assert not breaks_eq_1(q, int(np.flatnonzero(kept == label)[0]), *eq_1, slack=tie)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
@pytest.mark.parametrize("N", [1, BLOCK - 1, BLOCK, 9 * BLOCK + 1, 30_000])
def test_labels_with_trees_of_all_depths(implementation, N):
    for seed in range(8):
        case = Case(seed, 1 + seed, 20 * (seed % 4), N=N)
        kernel = case.kernel(implementation)
        partition = case.partition(kernel)
        labels = partition.labels_of_candidates()
        assert np.sum(partition.sizes) == np.sum(labels != NO_REGION)
        expected = compute_safe_regions(case.p_OQ, case.p_OC, case.h, case.forbidden).labels
        np.testing.assert_array_equal(labels, expected)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_of_coincident_contacts_the_first_has_the_region(implementation):
    case = Case(0, 6, 10, coincident=True)
    case.h[:] = 0
    sizes = case.partition(case.kernel(implementation)).sizes
    assert sizes[0] > 0
    np.testing.assert_array_equal(sizes[3:], 0)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_each_tied_candidate_has_one_region(implementation):
    x = np.linspace(-0.05, 0.05, 21)
    p_OQ = np.stack([*np.meshgrid(x, x), np.zeros((21, 21))], axis=-1).reshape(-1, 3)
    normals = np.tile([0, 0, 1.0], (441, 1))
    kernel = kernel_of(implementation, p_OQ, normals, np.ones(441), np.zeros(3))
    p_OC = np.array([[0.03, 0, 0], [-0.03, 0, 0], [0, 0.03, 0]])
    partition = kernel.partition(p_OC, np.zeros(3), np.empty((0, 3)), np.empty(0))
    assert np.sum(partition.sizes) == len(p_OQ)
    labels = partition.labels_of_candidates()
    assert np.all(labels[(p_OQ[:, 0] == 0) & (p_OQ[:, 1] < -1e-9)] == 0)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=12)
@given(
    seed=st.integers(0, 10**6),
    n=st.integers(1, 32),
    size=st.sampled_from([0.05, 0.1, 1.0, 3.0]),
    shape=st.sampled_from(SHAPES),
    stretch=st.booleans(),
)
def test_centroids_are_those_of_decomposed_matrices(
    implementation, kind, seed, n, size, shape, stretch
):
    n = max(n, 3) if kind == "vew" else n  # With one contact the volume is the same everywhere.
    case = Case(seed, n, 15, size=size, N=300, lost=seed % 2, shape=shape)
    check_centroids(case, implementation, kind, stretch=stretch)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
@pytest.mark.parametrize("kind", KINDS)
def test_centroids_over_many_blocks(implementation, kind):
    check_centroids(Case(3, 4, 30, N=12_000), implementation, kind, few=1)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
@pytest.mark.parametrize("kind", KINDS)
def test_of_coincident_contacts(implementation, kind):
    check_centroids(Case(1, 6, 10, coincident=True), implementation, kind)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
@pytest.mark.parametrize("spread", [1e-6, 1e-3, 1e3])
def test_of_a_tiny_and_a_huge_covariance(implementation, spread):
    check_centroids(Case(2, 5, 20, N=2000), implementation, "position", spread=spread)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
@pytest.mark.parametrize("kind", KINDS)
def test_of_double_singular_values(implementation, kind):
    """A regular cross of contacts: t is zero with all of them in their places, and values pair."""
    case = Case(4, 4, 0)
    half = case.size / 2
    case.p_OC = half * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    case.p_OCoM, case.h = np.zeros(3), np.zeros(4)
    case.p_OQ[:4] = case.p_OC
    case.p_OQ[4:8] = case.p_OC + np.array([0, 0, 1e-9])
    check_centroids(case, implementation, kind, few=4)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
@pytest.mark.parametrize("kind", KINDS)
def test_of_a_region_with_one_candidate_it_is_that(implementation, kind):
    case = Case(5, 1, 0, N=1)
    kernel = case.kernel(implementation)
    weighting = Weighting(kind, True, np.eye(3))
    found = kernel.centroids(case.partition(kernel), case.p_OC, np.array([0]), weighting)
    np.testing.assert_allclose(found, case.p_OQ, atol=1e-15)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_nearest_points_on_triangles_are_no_farther_than_any_other(implementation):
    rng = np.random.default_rng(7)
    kernel = Case(7, 1, 0, N=1).kernel(implementation)
    corners = 0.01 * rng.normal(size=(40, 3, 3))
    shares = np.vstack([np.eye(3), rng.dirichlet(np.full(3, 0.4), 400)])
    samples = np.einsum("sj,tjx->tsx", shares, corners)
    points = np.vstack([0.02 * rng.normal(size=(60, 3)), samples[:4, :3].reshape(-1, 3)])
    triangles = [np.sort(rng.choice(40, rng.integers(1, 9), replace=False)) for _ in points]
    nearest, which = kernel.nearest_on_triangles(points, triangles, corners)
    for p, q, triangle, own in zip(points, nearest, which, triangles, strict=True):
        assert triangle in own
        distance = np.linalg.norm(p - q)
        assert distance <= np.min(np.linalg.norm(samples[own] - p, axis=2)) + 1e-12
        # It is on the triangle: some mean of the corners.
        edges = (corners[triangle, 1:] - corners[triangle, 0]).T
        (v, w), residual, *_ = np.linalg.lstsq(edges, q - corners[triangle, 0], rcond=None)
        assert min(v, w, 1 - v - w) >= -1e-9
        assert np.sqrt(np.sum(residual)) < 1e-12


def test_blocks_hold_every_candidate_once_inside_their_boxes():
    case = Case(6, 1, 0, N=5000)
    blocks = make_blocks(case.p_OQ, case.nhat, case.areas)
    np.testing.assert_array_equal(np.sort(blocks.order), np.arange(5000))
    assert np.sum(blocks.areas) == pytest.approx(np.sum(case.areas))
    points = blocks.points.T.reshape(blocks.count, BLOCK, 3)
    own = slice(blocks.starts[-2], blocks.starts[-1])
    away = np.abs(points - blocks.centers[own, None])
    assert np.all(away <= blocks.halves[own, None] + 1e-15)
    for first, second, third in zip(
        blocks.starts[:-2], blocks.starts[1:], blocks.starts[2:], strict=False
    ):
        for k in range(third - second):
            gap = np.abs(blocks.centers[second + k] - blocks.centers[first + k // 8])
            assert np.all(gap + blocks.halves[second + k] <= blocks.halves[first + k // 8] + 1e-15)


def test_says_which_implementations_there_are():
    with pytest.raises(InvalidArgumentError, match="there are: numpy, numba"):
        make_kernel(np.zeros((1, 3)), np.eye(3)[:1], np.ones(1), np.zeros(3), implementation="cuda")


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
@pytest.mark.parametrize("kind", ["msv", "gii", "vew"])
def test_of_weights_that_differ_by_rounding_only_areas_count(implementation, kind):
    """One contact on a ball: all places are alike."""
    rng = np.random.default_rng(0)
    nhat = rng.normal(size=(500, 3))
    nhat /= np.linalg.norm(nhat, axis=1)[:, None]
    areas = rng.uniform(1, 2, 500)
    kernel = kernel_of(implementation, 0.05 * nhat, nhat, areas, np.zeros(3))
    p_OC = 0.05 * nhat[:1]
    partition = kernel.partition(p_OC, np.zeros(1), np.empty((0, 3)), np.empty(0))
    weighting = Weighting(kind, True, np.eye(3))
    found = kernel.centroids(partition, p_OC, np.array([0]), weighting)
    np.testing.assert_allclose(found[0], areas @ (0.05 * nhat) / np.sum(areas), atol=1e-12)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_what_cannot_be_planned_is_refused_in_a_line(implementation):
    case = Case(0, 3, 5)
    kernel, other = case.kernel(implementation), case.kernel(implementation)
    partition = case.partition(kernel)
    weighting = Weighting("position", False, np.eye(3))
    with pytest.raises(InvalidArgumentError, match="of another surface"):
        other.centroids(partition, case.p_OC, np.array([0]), weighting)
    case.h[1] = -np.inf
    lost = case.partition(kernel)
    with pytest.raises(InvalidArgumentError, match=r"regions of contacts \[1\] are empty"):
        kernel.centroids(lost, case.p_OC, np.array([0, 1]), weighting)
    case.p_OC[2, 1] = np.nan
    with pytest.raises(InvalidArgumentError, match="contacts must be finite"):
        case.partition(kernel)


def test_a_copied_partition_is_still_of_its_kernel():
    """Contexts of Drake copy what ports hold."""
    case = Case(0, 3, 5)
    kernel = case.kernel("numpy")
    partition = copy.deepcopy(case.partition(kernel))
    weighting = Weighting("position", False, np.eye(3))
    assert kernel.centroids(partition, case.p_OC, np.arange(3), weighting).shape == (3, 3)
