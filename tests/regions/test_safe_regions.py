import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_pregrasp import ForbiddenPoints, InvalidArgumentError
from drake_pregrasp.regions.safe_regions import NO_REGION, compute_safe_regions, safe_region_labels


def random_case(seed, n, m, d=3):
    rng = np.random.default_rng(seed)
    q, c, z = (rng.uniform(-0.05, 0.05, (count, d)) for count in (60, n, m))
    return q, c, rng.uniform(-5e-4, 5e-4, n), z, rng.uniform(0, 0.01, m)


@settings(max_examples=60)
@given(
    seed=st.integers(0, 10**6),
    n=st.integers(1, 8),
    m=st.integers(0, 12),
    d=st.integers(3, 7),
    lost=st.integers(0, 2),
)
def test_equals_the_printed_equations(seed, n, m, d, lost):
    q, c, h, z, R = random_case(seed, n, m, d)
    h[: min(lost, n)] = -np.inf
    labels = compute_safe_regions(q, c, h, ForbiddenPoints(z, R)).labels
    np.testing.assert_array_equal(labels, safe_region_labels(q, c, h, z, R))


def test_the_oracle_is_a_transcription_point_by_point():
    """A sanity check of the oracle: conditions of each candidate in plain Python."""
    q, c, h, z, R = random_case(3, 4, 6)
    for point, label in zip(q, safe_region_labels(q, c, h, z, R), strict=True):
        holds = []
        for i in range(4):
            own = math.dist(c[i], point) ** 2
            d = [math.dist(c[i], z_j) for z_j in z]
            free = all(
                own <= math.dist(z[j], point) ** 2 - (2 * R[j] * d[j] - d[j] ** 2) for j in range(6)
            )
            nearest = all(own - h[i] <= math.dist(c[k], point) ** 2 - h[k] for k in range(4))
            holds.append(free and nearest)
        assert [label == i for i in range(4)] == holds


def test_boundary_is_the_plane_that_touches_the_obstacle():
    c, z, R = np.array([0.01, 0.0, 0.0]), np.array([0.05, 0.03, 0.0]), 0.007
    u = (z - c) / np.linalg.norm(z - c)
    touching = z - R * u  # The obstacle's nearest point to the contact.
    side = np.array([-u[1], u[0], 0])
    plane = touching + np.outer(np.linspace(-0.1, 0.1, 11), side)
    for offset, expected in ((-1e-9, 0), (1e-9, NO_REGION)):
        regions = compute_safe_regions(
            plane + offset * u, c[None], np.zeros(1), ForbiddenPoints(z[None], np.array([R]))
        )
        assert np.all(regions.labels == expected)


def test_a_contact_on_a_forbidden_point_is_not_fenced_by_it():
    q = np.random.default_rng(0).normal(size=(20, 3))
    c = np.zeros((1, 3))
    regions = compute_safe_regions(q, c, np.zeros(1), ForbiddenPoints(c, np.array([0.01])))
    assert np.all(regions.labels == 0)


def test_of_coincident_contacts_the_first_has_the_region(surface):
    p_OC = np.tile([[0.05, 0.0, 0.0]], (3, 1))
    sizes = compute_safe_regions(surface.p_OQ, p_OC, np.zeros(3), surface.forbidden).sizes()
    assert sizes[0] > 0
    np.testing.assert_array_equal(sizes[1:], 0)


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 6))
def test_a_larger_weight_grows_a_region_and_a_larger_radius_shrinks_all(seed, n):
    q, c, h, z, R = random_case(seed, n, 8)
    more = h + 1e-3 * (np.arange(n) == 0)
    before, heavier, fenced = (
        compute_safe_regions(q, c, weights, ForbiddenPoints(z, radii)).labels
        for weights, radii in ((h, R), (more, R), (h, R + 0.005))
    )
    assert np.all(heavier[before == 0] == 0)
    assert np.all((heavier == 0) | (heavier == before) | (heavier == NO_REGION))
    assert np.all((fenced == before) | (fenced == NO_REGION))


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6), scale=st.sampled_from([1e-3, 7.0, 1e3]))
def test_labels_scale_turn_and_permute_with_the_scene(seed, scale):
    rng = np.random.default_rng(seed)
    q, c, h, z, R = random_case(seed, 5, 8)
    labels = safe_region_labels(q, c, h, z, R)
    turn, shift = np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.normal(size=3)
    order = rng.permutation(5)
    q, c, z = (scale * (points @ turn.T + shift) for points in (q, c, z))
    forbidden = ForbiddenPoints(z, scale * R)
    moved = compute_safe_regions(q, c[order], scale**2 * h[order], forbidden).labels
    # The shift rounds differences of squares, so that a candidate near a tie may change.
    assert np.mean(np.append(order, NO_REGION)[moved] != labels) <= 1 / 60


def test_contacts_that_are_not_finite_are_refused():
    c = np.array([[0.0, np.nan, 0.0]])
    with pytest.raises(InvalidArgumentError, match="contacts must be finite"):
        compute_safe_regions(c, c, np.zeros(1), ForbiddenPoints.none())


def test_no_contact_and_weights_that_are_not_numbers_are_refused():
    q, none = np.eye(3), ForbiddenPoints.none()
    with pytest.raises(InvalidArgumentError, match="one at least"):
        compute_safe_regions(q, np.empty((0, 3)), np.empty(0), none)
    with pytest.raises(InvalidArgumentError, match="weights must not be NaN"):
        compute_safe_regions(q, q, np.array([0.0, np.nan, 0.0]), none)
