"""Weights from capability: shares of the surface, and contacts that stay in their regions."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import pdist

from drake_pregrasp import ForbiddenPoints, box_surface, capability_weights, compute_safe_regions

SURFACE = box_surface([0.1, 0.1, 0.1], spacing=0.008)
CAPABILITIES = st.lists(st.floats(1e-6, 1.0), min_size=2, max_size=8)


def region_of(q, c, h):
    return compute_safe_regions(q, c, h, ForbiddenPoints.none()).labels


def test_the_line_between_two_fingers_is_divided_in_proportion():
    line = np.zeros((10_000, 3))
    line[:, 0] = np.linspace(0, 0.2, 10_000)
    for s, t in ((1.0, 0.25), (0.1, 0.8), (0.6, 0.6)):
        labels = region_of(line, line[[0, -1]], capability_weights(np.array([s, t]), 0.2))
        assert np.mean(labels == 0) == pytest.approx(s / (s + t), abs=2e-4)


@settings(max_examples=50)
@given(s=CAPABILITIES, factor=st.floats(0.1, 1.0), seed=st.integers(0, 1000))
def test_contacts_stay_in_their_regions_and_only_proportions_count(s, factor, seed):
    c = SURFACE.p_OQ[np.random.default_rng(seed).choice(len(SURFACE.p_OQ), len(s), replace=False)]
    h = capability_weights(np.array(s), pdist(c).min())
    np.testing.assert_array_equal(region_of(c, c, h), np.arange(len(s)))
    again = capability_weights(factor * np.array(s), pdist(c).min())
    np.testing.assert_allclose(again, h, atol=1e-12)


@settings(max_examples=50)
@given(s=CAPABILITIES, more=st.floats(1.0, 100.0), seed=st.integers(0, 1000))
def test_a_stronger_finger_has_at_least_the_surface_that_it_had(s, more, seed):
    c = SURFACE.p_OQ[np.random.default_rng(seed).choice(len(SURFACE.p_OQ), len(s), replace=False)]
    before = region_of(SURFACE.p_OQ, c, capability_weights(np.array(s), pdist(c).min()))
    s[0] = min(1.0, more * s[0])
    after = region_of(SURFACE.p_OQ, c, capability_weights(np.array(s), pdist(c).min() + 1e-12))
    assert np.all(after[before == 0] == 0)


@pytest.mark.parametrize("nothing", [0.0, -1.0, np.nan])
def test_a_finger_without_capability_is_lost_and_equal_fingers_have_equal_weights(nothing):
    h = capability_weights(np.array([0.4, nothing, 0.4, np.inf]), 0.1)
    np.testing.assert_allclose(h, [-0.01 * 0.6 / 1.4, -np.inf, -0.01 * 0.6 / 1.4, 0.0])
    assert np.all(capability_weights(np.full(3, nothing), 0.1) == -np.inf)
