"""Surfaces, contacts and forbidden points for tests of kernels, and weights by decomposition."""

import numpy as np
import pytest

from drake_pregrasp import ForbiddenPoints
from drake_pregrasp.kernels import make_kernel, numba_is_installed
from drake_pregrasp.kernels.sorting import BLOCK
from drake_pregrasp.quality.contact_models import grasp_matrix

IMPLEMENTATIONS = [
    "numpy",
    "numpy tree",
    pytest.param(
        "numba",
        marks=pytest.mark.skipif(
            not numba_is_installed(), reason="numba is not installed (the extra [fast])"
        ),
    ),
]


SHAPES = [(1, 1, 1), (1, 0.5, 0.5), (1, 0.3, 0.3), (1, 1, 0.04), (1, 0.1, 0.1), (1, 0.3, 0.01)]
"""Edges of boxes, in units of the longest."""


def kernel_of(implementation, *arrays):
    """Makes a kernel; "numpy tree" is what numpy does on large surfaces, on any."""
    kernel = make_kernel(*arrays, implementation=implementation.split()[0])
    if implementation == "numpy tree":
        kernel.few, kernel.chunk = 0, 2 * BLOCK
    return kernel


class Case:
    """Candidates scattered over a box's faces, contacts near them, forbidden points."""

    def __init__(self, seed, n, m, *, size=0.1, N=700, lost=0, coincident=False, shape=SHAPES[0]):
        rng = np.random.default_rng(seed)
        self.size, edges = size, size * np.array(shape)
        self.p_OQ, self.nhat = on_box(rng, N, edges)
        self.areas = rng.uniform(0.5, 2, N)
        self.p_OCoM = edges * rng.uniform(-0.1, 0.1, 3)
        self.p_OC = on_box(rng, n, edges)[0]
        if coincident:
            self.p_OC[n // 2 :] = self.p_OC[0]
        self.h = size**2 * rng.uniform(-0.05, 0.05, n)
        self.h[rng.permutation(n)[:lost]] = -np.inf
        self.forbidden = ForbiddenPoints(
            on_box(rng, m, edges)[0], min(edges) * np.abs(rng.normal(0, 0.03, m))
        )

    def kernel(self, implementation):
        return kernel_of(implementation, self.p_OQ, self.nhat, self.areas, self.p_OCoM)

    def partition(self, kernel):
        return kernel.partition(self.p_OC, self.h, self.forbidden.points, self.forbidden.radii)

    def covariance(self, spread):
        A = np.random.default_rng(1).normal(size=(3, 3))
        return spread**2 * (np.eye(3) + A @ A.T)


def on_box(rng, count, edges):
    normals = np.eye(3)[rng.integers(0, 3, count)] * rng.choice([-1.0, 1.0], count)[:, None]
    points = edges * rng.uniform(-0.5, 0.5, (count, 3))
    return np.where(normals != 0, edges * normals / 2, points), normals


def slow_weights(case, kind, contact, points, active):
    """b_n up to a factor, by decomposing the hand's matrix at each point."""
    weights = []
    for q in points:
        moved = case.p_OC.copy()
        moved[contact] = q
        G = grasp_matrix(moved[active] - case.p_OCoM, None, "complete")
        sigma = np.linalg.svd(G, compute_uv=False)
        weights.append({"msv": sigma[-1], "gii": sigma[-1] / sigma[0], "vew": np.prod(sigma)}[kind])
    return np.array(weights)
