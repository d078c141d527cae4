"""Laws of the offset that touches tell."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from drake_pregrasp.estimation.camera_offset import CameraOffset
from drake_pregrasp.estimation.surface_alignment import SurfacePoints
from drake_pregrasp.geometry.mesh_solid import MeshSolid

BOX = MeshSolid.of(trimesh.creation.box([0.1, 0.08, 0.06]))
RADIUS, STD, SURE = 0.009, 1e-3, 1e-8 * np.eye(3)
BIAS = np.array([0.006, -0.006, 0.005])
TURN, PLACE = Rotation.from_rotvec([0.0, 0.0, 0.4]).as_matrix(), np.array([0.2, -0.1, 0.03])
SIDES = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])


def tips(directions, gap=0.0, is_bound=False):
    """Fingertips that touch sides of the true box, or are a gap away from it."""
    p_OT = directions * (np.array([0.05, 0.04, 0.03]) + RADIUS + gap)
    n = len(directions)
    return SurfacePoints(
        p_OT @ TURN.T + PLACE, np.full(n, RADIUS), np.full(n, STD), np.full(n, is_bound)
    )


def after(touches, times=1, std=0.006, P_WO=SURE):
    offset = CameraOffset.unknown(std).predicted(0.0, std, 30.0)
    for _ in range(times):
        offset = offset.corrected(BOX, touches, TURN, PLACE + BIAS, P_WO)
    return offset


def test_touches_tell_the_offset_along_their_normals_only():
    """Sides do not tell the height, which stays as uncertain as before."""
    offset = after(tips(SIDES[:3]), times=20)
    np.testing.assert_allclose(offset.b_W[:2], BIAS[:2], atol=3e-4)
    np.testing.assert_allclose(offset.b_W[2], 0, atol=1e-9)
    np.testing.assert_allclose(offset.P[2], [0, 0, 0.006**2], atol=1e-12)
    assert np.sqrt(offset.P.diagonal()[:2]).max() < 4e-4
    rested = offset.rested(BIAS[2], 1e-6)
    assert rested.b_W[2] == pytest.approx(BIAS[2], abs=2e-4)
    np.testing.assert_allclose(rested.b_W[:2], offset.b_W[:2], atol=1e-9)


def test_more_touches_never_make_it_less_certain():
    variances = [np.full(3, 0.006**2)]
    for count in (1, 2, 3, 6):
        variances.append(np.linalg.eigvalsh(after(tips(SIDES[:count])).P))
        assert np.all(variances[-1] <= variances[-2] * (1 + 1e-9))


def test_fingertips_that_do_not_touch_are_outside():
    """They tell nothing while they are, and something if they were inside."""
    far = after(tips(SIDES[:4], gap=0.02, is_bound=True), times=5)
    np.testing.assert_array_equal(far.b_W, np.zeros(3))
    np.testing.assert_array_equal(far.P, 0.006**2 * np.eye(3))
    near = after(tips(SIDES[:4], gap=1e-4, is_bound=True), times=20)
    assert np.linalg.norm((near.b_W - BIAS)[:2]) < 1.5e-3


def test_something_far_away_that_presses_is_left_out():
    for touches in (tips(SIDES[:2], gap=0.06), SurfacePoints.seen(np.zeros((0, 3)), STD)):
        np.testing.assert_array_equal(after(touches).b_W, np.zeros(3))
    unknown = CameraOffset.unknown(0.006)
    np.testing.assert_array_equal(unknown.rested(0.05, 1e-6).b_W, np.zeros(3))


def test_the_offset_of_a_turned_world_is_turned():
    turn = Rotation.from_rotvec([0.5, -0.2, 1.0]).as_matrix()
    touches = tips(SIDES[[0, 2, 4]])
    here = after(touches)
    moved = SurfacePoints(touches.p_WQ @ turn.T, *list(vars(touches).values())[1:])
    there = CameraOffset.unknown(0.006).corrected(
        BOX, moved, turn @ TURN, turn @ (PLACE + BIAS), SURE
    )
    np.testing.assert_allclose(there.b_W, turn @ here.b_W, atol=1e-8)
    np.testing.assert_allclose(there.P, turn @ here.P @ turn.T, atol=1e-12)


def test_an_offset_is_forgotten_in_its_time():
    offset = after(tips(SIDES), times=20).predicted(30.0, 0.006, 30.0)
    np.testing.assert_allclose(offset.b_W, after(tips(SIDES), times=20).b_W / np.e, rtol=1e-9)
    late = offset.predicted(1e4, 0.006, 30.0)
    np.testing.assert_allclose(late.P, 0.006**2 * np.eye(3), atol=1e-12)
    assert np.all(offset.P.diagonal() < late.P.diagonal())


def test_errors_are_as_large_as_the_covariance_says():
    """Mean of bᵀ P⁻¹ b over offsets and noise that are drawn as assumed."""
    rng, squares = np.random.default_rng(4), []
    for _ in range(300):
        bias, touches = rng.normal(scale=0.003, size=3), tips(SIDES[[0, 2, 4]])
        noisy = SurfacePoints(
            touches.p_WQ + rng.normal(scale=STD, size=(3, 3)), *list(vars(touches).values())[1:]
        )
        offset = CameraOffset.unknown(0.003).corrected(BOX, noisy, TURN, PLACE + bias, SURE)
        error = bias - offset.b_W
        squares.append(error @ np.linalg.solve(offset.P, error))
    assert 0.8 * 3 < np.mean(squares) < 1.3 * 3
