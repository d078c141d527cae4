"""Share of the tipping moment: it is 1 where the table's reaction leaves the support polygon."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation

from drake_pregrasp.contacts.tipping import tipping_shares

MG, FORCE = 2.0, 0.5


def shares_of(p_OQ, nhat_OQ, p_OV, p_OCoM, R_WO=None, force=FORCE):
    R_WO = np.eye(3) if R_WO is None else R_WO
    return tipping_shares(
        p_OQ,
        nhat_OQ,
        p_OV=p_OV,
        p_OCoM=p_OCoM,
        weight=R_WO.T @ [0.0, 0.0, -MG],
        force=force,
    )


def random_prism(seed, count):
    """Returns the vertices of a prism on the table, a point over its base, and contacts."""
    rng = np.random.default_rng(seed)
    angles = 2 * np.pi * (np.arange(7) + rng.uniform(0, 0.7, 7)) / 7
    base = 0.05 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    p_WV = np.concatenate([np.c_[base, np.zeros(7)], np.c_[1.5 * base, np.full(7, 0.1)]])
    directions = rng.normal(size=(count, 3))
    normals = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    points = np.c_[rng.uniform(-0.05, 0.05, (count, 2)), rng.uniform(0, 0.3, count)]
    return p_WV, np.array([*rng.uniform(-0.02, 0.02, 2), 0.05]), points, normals


@given(st.integers(0, 10_000))
def test_an_object_tips_where_the_reaction_leaves_the_support_polygon(seed):
    p_WV, p_WCoM, points, normals = random_prism(seed, 50)
    shares = shares_of(points, normals, p_WV, p_WCoM)
    reaction = p_WCoM[:2] - FORCE * normals[:, :2] * points[:, 2:] / MG
    tips = Delaunay(p_WV[:7, :2]).find_simplex(reaction) < 0
    clear = np.abs(shares - 1) > 1e-3
    np.testing.assert_array_equal((shares > 1)[clear], tips[clear])


@given(st.integers(0, 10_000))
def test_the_share_grows_with_height_and_force_and_turns_with_the_object(seed):
    p_WV, p_WCoM, points, normals = random_prism(seed, 20)
    shares = shares_of(points, normals, p_WV, p_WCoM)
    higher = shares_of(points * [1, 1, 2], normals, p_WV, p_WCoM, force=2 * FORCE)
    np.testing.assert_allclose(higher, 4 * shares, rtol=1e-9)
    R_OW = Rotation.random(random_state=seed).as_matrix()
    p_OW = np.array([0.1, -0.2, 0.3])
    p_OV, p_OQ, p_OCoM = (p @ R_OW.T + p_OW for p in (p_WV, points, p_WCoM))
    turned = shares_of(p_OQ, normals @ R_OW.T, p_OV, p_OCoM, R_OW.T)
    np.testing.assert_allclose(turned, shares, rtol=1e-3)


def test_a_box_tips_over_its_edge():
    half = np.array([0.05, 0.015, 0.075])
    p_OV = half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    p_OQ = np.array([[0.05, 0.0, 0.02], [0.0, -0.015, 0.02], [0, 0, 0.075]])
    nhat_OQ = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, 1]])
    shares = shares_of(p_OQ, nhat_OQ, p_OV, np.zeros(3))
    moment = FORCE * (0.075 + 0.02)
    assert shares == pytest.approx([moment / (MG * 0.05), moment / (MG * 0.015), 0.0], rel=1e-3)


@pytest.mark.parametrize("axis", [[0.0, 0, 0], [0.05, 0, 0]])
def test_an_object_on_a_point_or_an_edge_has_finite_shares(axis):
    p_OV = np.array([axis, np.negative(axis), [0.1, 0.1, 0.1], [-0.1, 0.1, 0.1]])
    shares = shares_of(np.array([[0, 0.0, 0.05]]), np.array([[0, -1.0, 0]]), p_OV, np.zeros(3))
    assert 1 < shares[0] < np.inf
