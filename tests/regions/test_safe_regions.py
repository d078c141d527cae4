import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from slow_safe_regions import breaks_eq_1

from drake_pregrasp import ForbiddenPoints
from drake_pregrasp.regions.safe_regions import NO_REGION, compute_safe_regions

TIE = 1e-12  # m²: conditions closer than this to equality may go either way.


def random_case(seed, n, m):
    rng = np.random.default_rng(seed)
    z = rng.uniform(-0.05, 0.05, (m, 3))
    return {
        "p_OQ": rng.uniform(-0.05, 0.05, (60, 3)),
        "p_OC": rng.uniform(-0.05, 0.05, (n, 3)),
        "contact_weights": rng.uniform(-5e-4, 5e-4, n),
        "forbidden": ForbiddenPoints(z, rng.uniform(0, 0.01, m)),
    }


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 8), m=st.integers(0, 12))
def test_equals_the_printed_equations_but_for_ties(seed, n, m):
    case = random_case(seed, n, m)
    labels = compute_safe_regions(**case).labels
    eq_1 = (
        case["p_OC"],
        case["contact_weights"],
        case["forbidden"].points,
        case["forbidden"].radii,
    )
    for q, label in zip(case["p_OQ"], labels, strict=True):
        if label == NO_REGION:
            assert all(breaks_eq_1(q, i, *eq_1, slack=-TIE) for i in range(n))
        else:
            assert not breaks_eq_1(q, label, *eq_1, slack=TIE)


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


def test_a_larger_weight_never_shrinks_the_region(surface, p_OC):
    sizes = []
    for h in np.linspace(-2e-3, 2e-3, 9):
        weights = np.array([h, 0, 0, 0, 0])
        regions = compute_safe_regions(surface.p_OQ, p_OC, weights, surface.forbidden)
        sizes.append(regions.sizes()[0])
    assert np.all(np.diff(sizes) >= 0)
    assert sizes[0] < sizes[-1]


def test_more_obstacles_never_enlarge_a_region(surface, p_OC):
    few = compute_safe_regions(surface.p_OQ, p_OC, np.zeros(5), surface.forbidden)
    extra = ForbiddenPoints(np.array([[0.06, 0.0, 0.0]]), np.array([0.02]))
    more = compute_safe_regions(surface.p_OQ, p_OC, np.zeros(5), surface.forbidden.joined(extra))
    changed = few.labels != more.labels
    assert np.any(changed)
    assert np.all(more.labels[changed] == NO_REGION)


def test_regions_turn_with_the_world(surface, p_OC):
    R = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    shift = np.array([0.3, -0.2, 0.1])
    there = compute_safe_regions(surface.p_OQ, p_OC, np.zeros(5), surface.forbidden)
    moved = compute_safe_regions(
        surface.p_OQ @ R.T + shift,
        p_OC @ R.T + shift,
        np.zeros(5),
        ForbiddenPoints(surface.forbidden.points @ R.T + shift, surface.forbidden.radii),
    )
    assert np.mean(there.labels != moved.labels) < 0.01  # Only candidates at a tie may change.


def test_a_lost_contact_is_shared_out_among_the_others(surface, p_OC):
    without = np.array([0, 0, -np.inf, 0, 0])
    lost = compute_safe_regions(surface.p_OQ, p_OC, without, surface.forbidden)
    others = compute_safe_regions(
        surface.p_OQ, np.delete(p_OC, 2, axis=0), np.zeros(4), surface.forbidden
    )
    np.testing.assert_array_equal(lost.sizes(), np.insert(others.sizes(), 2, 0))
    np.testing.assert_array_equal(lost.lost, [False, False, True, False, False])


@pytest.mark.parametrize("n", [1, 3])
def test_with_all_contacts_lost_there_is_no_region(surface, p_OC, n):
    weights = np.full(n, -np.inf)
    regions = compute_safe_regions(surface.p_OQ, p_OC[:n], weights, surface.forbidden)
    assert np.all(regions.labels == NO_REGION)
