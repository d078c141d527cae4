"""Laws of the pose that points on a surface measure."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from camera_scene import Scene
from scipy.spatial.transform import Rotation

from drake_pregrasp.arrays import pack
from drake_pregrasp.estimation.pose_belief import PoseFilterNoise, PoseMeasurement, first_belief
from drake_pregrasp.estimation.pose_filter import correct, filter_step, pose_residual
from drake_pregrasp.estimation.registration import register_pose
from drake_pregrasp.estimation.surface_alignment import (
    SurfacePoints,
    align_pose,
    measured_part,
)
from drake_pregrasp.fast import default_kernels
from drake_pregrasp.geometry.distance_grid import distance_grid

NOISE = PoseFilterNoise(5e-4, 3.5e-3, 1e-3, 1e-2, 3.0, 15.0)
STD = np.repeat([NOISE.orientation, NOISE.position], 3)
WEDGE = trimesh.convex.convex_hull(
    np.array([[0, 0, 0], [0.09, 0, 0], [0, 0.07, 0], [0, 0, 0.05], [0.05, 0.05, 0.0]])
)
GRID = distance_grid(WEDGE)


def placed(seed, count=400, std=0.0, mesh=WEDGE):
    """Returns points of a mesh at a random pose, and the pose."""
    rng = np.random.default_rng(seed)
    R, p = Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)
    p_MQ = trimesh.sample.sample_surface(mesh, count, seed=seed)[0]
    return p_MQ @ R.T + p + rng.normal(scale=std, size=p_MQ.shape) if std else p_MQ @ R.T + p, R, p


def moved(R, p, turn=(0.06, -0.05, 0.04), shift=(0.006, -0.005, 0.004)):
    return Rotation.from_rotvec(turn).as_matrix() @ R, p + np.array(shift)


def test_points_give_the_pose_though_others_are_in_the_way():
    for seed in range(5):
        p_WQ, R, p = placed(seed, std=1e-3)
        rng = np.random.default_rng(seed)
        others = p_WQ[:120] + 0.03 + 0.02 * rng.random((120, 3))  # As of a hand beside the object.
        found = align_pose(
            GRID, SurfacePoints.seen(np.vstack([p_WQ, others]), 1e-3), *moved(R, p), STD
        )
        assert np.linalg.norm(found.p_WO - p) < 7e-4
        assert Rotation.from_matrix(found.R_WO @ R.T).magnitude() < np.deg2rad(1.0)
        assert 330 < found.fits < 440


def test_a_rigid_motion_of_the_world_moves_the_pose_and_turns_the_information():
    p_WQ, R, p = placed(1, std=1e-3)
    turn, shift = Rotation.from_rotvec([0.3, -1.0, 0.5]).as_matrix(), np.array([1.0, -2.0, 0.5])
    points = SurfacePoints.seen(p_WQ, 1e-3)
    there = replace(points, p_WQ=p_WQ @ turn.T + shift)
    start = moved(R, p)
    here = align_pose(GRID, points, *start, STD)
    there = align_pose(GRID, there, turn @ start[0], turn @ start[1] + shift, STD)
    T = np.kron(np.eye(2), turn)
    np.testing.assert_allclose(there.p_WO, turn @ here.p_WO + shift, atol=1e-9)
    np.testing.assert_allclose(there.R_WO, turn @ here.R_WO, atol=1e-9)
    largest = np.abs(here.information).max()
    np.testing.assert_allclose(
        there.information / largest, T @ here.information @ T.T / largest, atol=1e-6
    )


def test_more_points_never_tell_less():
    p_WQ, R, p = placed(2)
    information = [np.zeros((6, 6))]
    for count in (3, 10, 60, 400):
        found = align_pose(GRID, SurfacePoints.seen(p_WQ[:count], 1e-3), R, p, STD)
        gain = np.linalg.eigvalsh(found.information - information[-1])
        assert gain.min() > -1e-6 * gain.max()
        information.append(found.information)
        part = measured_part(0.0, found, STD)
        assert part.is_whole == (count > 10)  # Three points leave three directions open.


def test_the_centres_of_touching_spheres_measure_as_points_of_the_surface_do():
    """Spheres that do not touch bound the pose on one side."""
    p_WQ, R, p = placed(3)
    gradients = GRID.at((p_WQ - p) @ R)[1]
    centers = p_WQ + 0.006 * gradients @ R.T
    spheres = replace(SurfacePoints.seen(centers, 1e-3), radius=np.full(400, 0.006))
    found = align_pose(GRID, spheres, *moved(R, p), STD)
    assert np.linalg.norm(found.p_WO - p) < 5e-4
    bounds = replace(spheres, is_bound=np.ones(400, dtype=bool))
    apart = replace(bounds, p_WQ=p_WQ + 0.009 * gradients @ R.T)
    start = moved(R, p, (0, 0, 0), (5e-4, 0, 0))
    assert align_pose(GRID, apart, *start, STD).fits == 0
    np.testing.assert_array_equal(align_pose(GRID, apart, *start, STD).p_WO, start[1])
    deep = replace(bounds, p_WQ=p_WQ + 0.002 * gradients @ R.T)
    assert align_pose(GRID, deep, R, p, STD).fits > 100


def test_what_is_not_observed_stays_as_uncertain_as_before():
    """Points of one face leave three directions open, whose mean and covariance do not change."""
    box = trimesh.creation.box([0.1, 0.08, 0.06])
    rng = np.random.default_rng(4)
    p_WQ = np.column_stack([rng.uniform(-0.03, 0.03, (200, 2)), np.full(200, 0.03)])
    p_WQ[:, 2] += 0.002 + rng.normal(scale=1e-4, size=200)
    points = SurfacePoints.seen(p_WQ, 1e-3)
    found = align_pose(distance_grid(box), points, np.eye(3), np.zeros(3), STD)
    part = measured_part(0.0, found, STD)
    prior = first_belief(PoseMeasurement(0.0, np.zeros(3), np.eye(3)), NOISE)
    after = correct(prior, *pose_residual(prior, part, NOISE)).belief
    variances, before = after.P[0].diagonal(), prior.P[0].diagonal()
    for axis in (2, 3, 4):  # Turn about z, and the ways along x and y.
        np.testing.assert_allclose(variances[axis], before[axis], rtol=1e-6)
    for axis in (0, 1, 5):
        assert variances[axis] < 0.75 * before[axis]
    np.testing.assert_allclose(after.p_WCoM[0, :2], 0, atol=2e-6)
    assert after.p_WCoM[0, 2] == pytest.approx(0.001, abs=1e-4)  # Half way: both know it as well.
    none = replace(part, directions=np.zeros((6, 6)))
    np.testing.assert_array_equal(
        pack(correct(prior, *pose_residual(prior, none, NOISE)).belief), pack(prior)
    )
    unknown = first_belief(part, NOISE).P[0].diagonal()
    assert unknown[2] > 9
    # What is not seen to turn, about z here, is not taken to turn.
    np.testing.assert_allclose(unknown[6:8], NOISE.initial_angular_velocity**2, rtol=1e-6)
    assert unknown[8] < 1e-3
    assert np.all(unknown[3:5] > 0.2)
    assert unknown[5] < 1e-6


def test_points_that_observe_everything_measure_as_a_pose_with_the_assumed_noise():
    p_WQ, R, p = placed(5)
    found = align_pose(GRID, SurfacePoints.seen(p_WQ, 1e-6), *moved(R, p), STD)
    part = measured_part(0.05, found, STD)
    pose = PoseMeasurement(0.05, found.p_WO, found.R_WO)
    prior = first_belief(PoseMeasurement(0.0, p + 1e-3, R), NOISE)
    for p_OCoM in (None, np.array([0.02, 0.01, -0.03])):
        whole, by_points = (filter_step(prior, m, NOISE, p_OCoM)[1] for m in (pose, part))
        np.testing.assert_allclose(by_points.belief.P, whole.belief.P, rtol=1e-3, atol=1e-8)
        np.testing.assert_allclose(by_points.belief.p_WCoM, whole.belief.p_WCoM, atol=1e-6)
        halves = by_points.squares.reshape(2, 3).sum(axis=1)  # Orientation, then position.
        np.testing.assert_allclose(halves, whole.squares.reshape(2, 3).sum(axis=1), rtol=1e-3)


@pytest.mark.slow
def test_the_table_does_not_turn_what_a_camera_shows_at_a_wrong_height():
    """A box whose sides differ by a centimetre is registered by its sides, within the offset."""
    box = trimesh.creation.box([0.1, 0.08, 0.09])
    grid, offset_std, count = distance_grid(box), 0.006, 12
    align = default_kernels().align_pose()
    right = 0
    for seed in range(count):
        rng = np.random.default_rng(seed)
        R = Rotation.from_euler("z", rng.uniform(-0.7, 0.7)).as_matrix()
        p_OQ, faces = trimesh.sample.sample_surface(box, 1200, seed=seed)
        seen = box.face_normals[faces] @ R.T @ [0.45, -0.45, 0.4] > 0
        p_OQ = p_OQ[seen][:400]
        shown = np.array([0.0, 0.0, 0.045]) + rng.normal(scale=offset_std, size=3)
        p_WQ = p_OQ @ R.T + shown + rng.normal(scale=1e-3, size=p_OQ.shape)
        found = register_pose(
            grid, box.vertices, p_WQ, STD, point_std=1e-3, offset_std=offset_std, align=align
        )
        off = grid.at((p_OQ @ R.T + shown - found.p_WO) @ found.R_WO)[0]
        turned = np.abs(R.T @ found.R_WO)  # The identity for each symmetry of the box.
        right += np.abs(off).max() < 3e-3 and np.abs(turned - np.eye(3)).max() < 0.05
    assert right == count


@pytest.mark.slow
def test_of_the_poses_of_a_cube_the_one_turned_least_from_the_axes_of_w_is_chosen():
    cube = trimesh.creation.box([0.065] * 3)
    grid, align = distance_grid(cube), default_kernels().align_pose()
    for seed in range(12):
        rng = np.random.default_rng(seed)
        yaw = rng.uniform(-0.7, 0.7)
        R = Rotation.from_euler("z", yaw).as_matrix()
        p_OQ, faces = trimesh.sample.sample_surface(cube, 1200, seed=seed)
        p_OQ = p_OQ[cube.face_normals[faces] @ R.T @ [0.45, -0.45, 0.4] > 0][:400]
        p_WQ = p_OQ @ R.T + [0.1, 0.0, 0.0325] + rng.normal(scale=1e-3, size=p_OQ.shape)
        found = register_pose(grid, cube.vertices, p_WQ, STD, point_std=1e-3, align=align)
        np.testing.assert_allclose(found.R_WO, R, atol=0.03)


@pytest.mark.slow
def test_points_of_a_thin_wall_are_registered_on_their_side_of_it():
    """Alignments alone end with the wall of a mug on the wrong side of its points."""
    scene, rng = Scene("mug"), np.random.default_rng(91001)
    poses = [scene.resting(rng) for _ in range(23)]
    for index in (6, 17, 22):
        found = scene.seen.measured(scene.points(poses[index], 91001 + index), 0.0, None)
        assert scene.off(poses[index], found.R_WO, found.p_WO) < 3e-3


@pytest.mark.slow
def test_few_points_decide_between_poses_that_differ():
    """Cameras almost in the middle plane of a lying mug hardly see whether its mouth is left."""
    scene, rng = Scene("mug", cameras=2), np.random.default_rng(3)
    poses = [scene.resting(rng) for _ in range(49)]
    for index in (10, 18, 48):
        found = scene.seen.measured(scene.points(poses[index], 3 + index), 0.0, None)
        assert scene.off(poses[index], found.R_WO, found.p_WO) < 3e-3


@pytest.mark.slow
def test_an_object_that_stands_upside_down_is_not_taken_for_one_that_stands_upright():
    """All of the best starts have the mug upright, whose handle they do not find."""
    scene, rng = Scene("mug", cameras=2), np.random.default_rng(60707)
    X_WO = [scene.resting(rng) for _ in range(16)][-1]
    for seed in (15, 1015):
        found = scene.seen.measured(scene.points(X_WO, seed), 0.0, None)
        assert scene.off(X_WO, found.R_WO, found.p_WO) < 3e-3


@pytest.mark.slow
@pytest.mark.parametrize(("cameras", "is_seen"), [(1, False), (2, True)])
def test_the_turn_of_a_mug_is_uncertain_while_its_handle_is_hidden(cameras, is_seen):
    """The mug lies on its handle. Only the second camera sees the handle."""
    scene, rng = Scene("mug", cameras), np.random.default_rng(5)
    X_WO = [scene.resting(rng) for _ in range(13)][-1]
    found = scene.seen.measured(scene.points(X_WO, 17), 0.0, None)
    axis = X_WO.rotation().matrix()[:, 2]
    std = np.sqrt(axis @ first_belief(found, scene.seen.noise).P[0, :3, :3] @ axis)
    assert (std < 0.02) if is_seen else (std > np.pi)
    assert scene.off(X_WO, found.R_WO, found.p_WO) < 3e-3 or not is_seen


@pytest.mark.slow
def test_after_a_loss_the_prediction_counts_if_it_fits_as_well():
    """The first points to be seen again, on one edge, fit many poses; all points only the true."""
    scene, rng = Scene("carton"), np.random.default_rng(4)
    X_WO = scene.resting(rng)
    p_WQ = scene.points(X_WO, 3)
    edge = p_WQ[p_WQ[:, 0] > np.quantile(p_WQ[:, 0], 0.85)]
    known = PoseMeasurement(0.0, X_WO.translation(), X_WO.rotation().matrix())
    turned = replace(known, R_WO=Rotation.from_rotvec([0, 0, 1.3]).as_matrix() @ known.R_WO)

    def off(points, belief):
        found = scene.seen.measured(points, 0.1, belief, is_followed=False)
        return scene.off(X_WO, found.R_WO, found.p_WO)

    beliefs = [first_belief(m, scene.seen.noise, scene.seen.p_OCoM) for m in (known, turned)]
    assert off(edge, None) > 3e-3
    assert off(edge, beliefs[0]) < 3e-3
    assert off(p_WQ, beliefs[1]) < 3e-3
