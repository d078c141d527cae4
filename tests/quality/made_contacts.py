"""Contacts that tests of measures share."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from drake_pregrasp import box_surface

SURFACE = box_surface([0.1, 0.08, 0.12], spacing=0.01)


def seeds(least, most):
    """Runs a test with seeds and numbers of contacts."""
    return given(seed=st.integers(0, 10**6), n=st.integers(least, most))


def on_box(seed, n):
    """Places of contacts on a box, and the outward normals there."""
    q = np.random.default_rng(seed).choice(len(SURFACE.p_OQ), n, replace=False)
    return SURFACE.p_OQ[q], SURFACE.nhat_OQ[q]


def anywhere(seed, n):
    """Random lever arms and unit normals."""
    rng = np.random.default_rng(seed)
    nhat = rng.normal(size=(n, 3))
    return rng.normal(scale=0.05, size=(n, 3)), nhat / np.linalg.norm(nhat, axis=1, keepdims=True)
