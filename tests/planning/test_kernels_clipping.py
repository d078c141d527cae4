"""Planes that clipping drops are missed nowhere on the patch."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_pregrasp.planning.kernels import numba_is_installed

pytestmark = pytest.mark.skipif(
    not numba_is_installed(), reason="numba is not installed (the extra [fast])"
)

SHARE = 1e-13


def clip(normals, bounds, frame, span, room=200):
    """Returns the indices of the planes that are kept, or None where nothing is left."""
    from drake_pregrasp.planning.kernels.compiled_clipping import EMPTY, relevant_planes

    count = len(bounds)
    chosen = np.arange(count)
    slack = SHARE * (np.abs(bounds) + np.sum(np.abs(normals), axis=1))
    scratch = np.empty((9, count)), np.empty((2, 3, room))
    columns = np.ascontiguousarray(normals.T)
    kept = relevant_planes(chosen, count, columns, bounds, slack, frame, span, *scratch)
    return None if kept == EMPTY else chosen[:kept]


def make(seed, count, thickness):
    """Random planes about a random patch, some twice and some through its corners, and points."""
    rng = np.random.default_rng(seed)
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    span = np.array([rng.uniform(-1, 1, 3), [*rng.uniform(0.1, 1, 2), thickness]])
    inner = span[0] + 0.3 * span[1] * rng.uniform(-1, 1, 3)
    normals = rng.normal(size=(count, 3))
    bounds = normals @ (inner @ frame) + rng.exponential(0.3, count)
    corner = (span[0] + span[1] * [1, 1, 0]) @ frame
    bounds[::7] = normals[::7] @ corner
    normals[1::5], bounds[1::5] = normals[0], bounds[0]
    shares = np.vstack([rng.uniform(-1, 1, (3000, 3)), np.sign(rng.normal(size=(50, 3)))])
    return normals, bounds, frame, span, (span[0] + span[1] * shares) @ frame


@settings(max_examples=60)
@given(
    seed=st.integers(0, 10**6),
    count=st.integers(1, 200),
    thickness=st.sampled_from([0.0, 1e-15, 0.02, 0.5]),
    room=st.sampled_from([12, 200]),
)
def test_what_is_inside_the_kept_planes_is_inside_all(seed, count, thickness, room):
    normals, bounds, frame, span, points = make(seed, count, thickness)
    beyond = normals @ points.T - bounds[:, None]
    inside_all = np.all(beyond <= 0, axis=0)
    kept = clip(normals, bounds, frame, span, room)
    if kept is None:
        assert not np.any(inside_all)
        return
    inside = np.all(beyond[kept] <= 0, axis=0)
    np.testing.assert_array_equal(inside, inside_all)


@pytest.mark.parametrize("sides", [3, 4, 6, 17])
def test_of_many_planes_around_a_polygon_only_its_sides_are_kept(sides):
    angle = 2 * np.pi * np.arange(sides) / sides + 0.1
    normals = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    farther = np.concatenate([np.full(sides, 0.5), np.full(sides, 0.7), np.full(sides, 0.9)])
    span = np.array([[0, 0, 0], [10.0, 10, 0]])
    kept = clip(np.tile(normals, (3, 1)), farther, np.eye(3), span)
    assert sorted(kept) == list(range(sides))
    assert clip(normals, np.full(sides, 100.0), np.eye(3), span).size == 0
    assert clip(normals, np.full(sides, -0.5), np.eye(3), span) is None
