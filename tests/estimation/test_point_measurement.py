"""Laws of the part of a pose that points measure, before, after and without a prediction."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from drake_pregrasp.config.planner_config import EstimatorConfig, filter_noise
from drake_pregrasp.estimation.point_measurement import SeenObject
from drake_pregrasp.estimation.pose_belief import PoseMeasurement, first_belief
from drake_pregrasp.estimation.pose_filter import merged
from drake_pregrasp.fast import default_kernels
from drake_pregrasp.geometry.mesh_solid import MeshSolid

BOX = trimesh.creation.box([0.1, 0.08, 0.06])
PLACE = np.array([0.2, -0.1, 0.03])
GRAVITY = 9.81


def seen_object(**changes):
    noise = filter_noise(EstimatorConfig(**changes))
    align = default_kernels().align_pose()
    return SeenObject(MeshSolid.of(BOX), noise, np.zeros(3), 0.001, 20, True, align)


def points(R, p, count=300, seed=0):
    """Points of the sides that face a camera, as that sees them."""
    p_OQ, faces = trimesh.sample.sample_surface(BOX, 4 * count, seed=seed)
    return (p_OQ[BOX.face_normals[faces] @ R.T @ [0.45, -0.45, 0.4] > 0][:count]) @ R.T + p


def known(R, p, noise):
    return merged(first_belief(PoseMeasurement(0.0, p, R), noise))


def yaw(angle):
    return Rotation.from_euler("z", angle).as_matrix()


@pytest.mark.slow
@pytest.mark.parametrize(("share", "is_found"), [(0.6, True), (0.4, False)])
def test_a_first_pose_needs_half_of_the_points(share, is_found):
    """The others are scattered around, as those of a hand."""
    seen, rng = seen_object(), np.random.default_rng(1)
    others = PLACE + rng.uniform(-0.09, 0.09, (300, 3))
    count = round(300 * share)
    p_WQ = np.vstack([points(yaw(0.3), PLACE)[:count], others[: 300 - count]])
    assert np.isfinite(seen.measured(p_WQ, 0.0, None).p_WO).all() == is_found
    belief = known(yaw(0.3), PLACE, seen.noise)  # What is followed needs the fewest points only.
    assert np.isfinite(seen.measured(p_WQ, 0.0, belief).p_WO).all()


@pytest.mark.slow
@pytest.mark.parametrize("turn", [2.2, 2.8, -2.6, 3.1])
def test_after_a_loss_a_pose_that_looks_the_same_does_not_replace_the_prediction(turn):
    """A box looks the same after half a turn, and without a prediction it is the other one."""
    seen = seen_object()
    p_WQ = points(yaw(turn), PLACE) + np.random.default_rng(2).normal(scale=1e-3, size=(300, 3))
    again = seen.measured(p_WQ, 0.0, known(yaw(turn), PLACE, seen.noise), is_followed=False)
    np.testing.assert_allclose(again.R_WO, yaw(turn), atol=0.02)
    first = seen.measured(p_WQ, 0.0, None)
    np.testing.assert_allclose(first.R_WO, yaw(turn + np.pi), atol=0.02)


@pytest.mark.slow
def test_after_a_loss_a_pose_that_fits_better_replaces_the_prediction():
    seen, wrong = seen_object(), yaw(0.3 + 1.3)
    belief, p_WQ = known(wrong, PLACE, seen.noise), points(yaw(0.3), PLACE)
    followed = seen.measured(p_WQ, 0.0, belief)
    assert Rotation.from_matrix(followed.R_WO @ yaw(0.3).T).magnitude() > 0.1
    again = seen.measured(p_WQ, 0.0, belief, is_followed=False)
    np.testing.assert_allclose(again.R_WO, yaw(0.3), atol=0.01)


def test_a_prediction_is_shown_with_the_offset_of_the_camera():
    offset = np.array([0.05, -0.04, 0.0])  # Without it, the alignment would start too far away.
    seen = seen_object(bias_std=0.05)
    belief = replace(known(yaw(0.3), PLACE, seen.noise), b_W=offset[None])
    found = seen.measured(points(yaw(0.3), PLACE + offset), 0.0, belief)
    np.testing.assert_allclose(found.p_WO, PLACE + offset, atol=1e-3)
    np.testing.assert_allclose(found.R_WO, yaw(0.3), atol=0.01)


def test_what_flies_is_expected_where_it_falls():
    seen, dt = replace(seen_object(gravity=GRAVITY), rests_on_table=False), 0.15
    belief, high = known(yaw(0.3), PLACE, seen.noise), PLACE - [0, 0, GRAVITY * dt**2 / 2]
    found = seen.measured(points(yaw(0.3), high), dt, belief)
    np.testing.assert_allclose(found.p_WO, high, atol=1e-3)
    np.testing.assert_allclose(found.R_WO, yaw(0.3), atol=0.01)


def test_the_prediction_of_a_centre_of_mass_that_is_not_the_origin():
    p_OCoM = np.array([0.06, 0.05, 0.0])
    seen = replace(seen_object(), p_OCoM=p_OCoM)
    R, p = yaw(1.2), PLACE
    belief = merged(first_belief(PoseMeasurement(0.0, p, R), seen.noise, p_OCoM))
    found = seen.measured(points(R, p), 0.0, belief)
    np.testing.assert_allclose(found.p_WO, p, atol=1e-3)


def test_too_few_points_measure_nothing():
    seen = seen_object()
    belief, p_WQ = known(yaw(0.3), PLACE, seen.noise), points(yaw(0.3), PLACE)
    assert np.isnan(seen.measured(p_WQ[:19], 0.0, belief).p_WO).all()
    assert np.isfinite(seen.measured(p_WQ[::14][:21], 0.0, belief).p_WO).all()
    far = np.vstack([p_WQ[:15], p_WQ[:15] + 0.2])  # Only half of them fit.
    assert np.isnan(seen.measured(far, 0.0, belief).p_WO).all()
