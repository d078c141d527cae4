"""Laws of poses and offsets of cameras that contacts measure."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from drake_pregrasp.config.planner_config import EstimatorConfig, filter_noise, tracker_settings
from drake_pregrasp.estimation.contact_measurement import Contacts, felt, touch_noise
from drake_pregrasp.estimation.point_measurement import SeenObject
from drake_pregrasp.estimation.pose_belief import PoseMeasurement, first_belief
from drake_pregrasp.estimation.pose_filter import filter_step, merged, predict
from drake_pregrasp.estimation.pose_track import PoseTrack
from drake_pregrasp.estimation.pose_tracker import update_track
from drake_pregrasp.estimation.surface_alignment import SurfacePoints, align_pose, measured_part
from drake_pregrasp.fast import default_kernels
from drake_pregrasp.geometry.mesh_solid import MeshSolid
from drake_pregrasp.geometry.resting import FlatSide, flat_sides
from drake_pregrasp.grasping.touch_correction import (
    corrected_pose,
    limited_offset,
    touch_correction,
)

SIZE = np.array([0.1, 0.08, 0.06])
MESH = trimesh.creation.box(SIZE)
BOX = MeshSolid.of(MESH)
RADIUS, BIAS, BIAS_STD = 0.009, np.array([0.006, -0.006, 0.005]), 0.006
CONFIG = EstimatorConfig(bias_std=BIAS_STD)
NOISE = filter_noise(CONFIG)
PUSHED = touch_noise(CONFIG.touch_std, 0.05)[1]
TURN, PLACE = Rotation.from_rotvec([0.0, 0.0, 0.4]).as_matrix(), np.array([0.2, -0.1, 0.03])
SIDES = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
WORLD = Rotation.from_rotvec([0.5, -0.2, 1.0]).as_matrix()


def tips(directions, gap=0.0, is_bound=False, R=TURN, p=PLACE, radius=RADIUS):
    """Fingertips that touch sides of the true box, or are a gap away from it."""
    p_OT, n = directions * (SIZE / 2 + radius + gap), len(directions)
    spread = np.full(n, radius), np.full(n, CONFIG.touch_std), np.full(n, is_bound)
    return SurfacePoints(p_OT @ R.T + p, *spread)


def contacts(touches, rests=False):
    return Contacts(BOX, np.zeros(3), touches, rests, CONFIG.touch_std, PUSHED)


def standing(solid=BOX):
    return replace(contacts(tips(SIDES[:0]), rests=True), solid=solid, sides=sides_of(solid))


def sides_of(solid):
    return flat_sides(solid.corners, np.zeros(3))


def shown(R=TURN, p=PLACE, bias=BIAS, noise=NOISE):
    """Belief after many pictures of the box at rest by a camera with a wrong place."""
    belief = first_belief(PoseMeasurement(0.0, p + bias, R), noise)
    for tick in range(1, 40):
        belief = filter_step(belief, PoseMeasurement(0.05 * tick, p + bias, R), noise)[1].belief
    return belief


def after(touches, times=1, rests=False, belief=None):
    belief = belief or shown()
    for _ in range(times):
        belief, _ = felt(belief, 0.0, contacts(touches, rests), NOISE)
    return merged(belief)


def offset_of(belief):
    return belief.b_W[0], belief.P[0, 12:, 12:]


def test_touches_tell_pose_and_offset_along_their_normals_only():
    """Sides do not tell the height, which stays as uncertain as before. The table tells it."""
    for radius in (RADIUS, 0.02):  # The centre of a large fingertip is outside the grid.
        belief = after(tips(SIDES[:3], radius=radius), times=20)
        b_W, P = offset_of(belief)
        np.testing.assert_allclose(b_W[:2], BIAS[:2], atol=6e-4)
        np.testing.assert_allclose(belief.p_WCoM[0, :2], PLACE[:2], atol=6e-4)
        assert b_W[2] == pytest.approx(0, abs=2e-4)
        assert np.sqrt(P[2, 2]) > 0.98 * BIAS_STD
        assert np.sqrt(P.diagonal()[:2]).max() < 7e-4
    rested = after(tips(SIDES[:3]), times=20, rests=True)
    assert rested.b_W[0, 2] == pytest.approx(BIAS[2], abs=4e-4)
    assert rested.p_WCoM[0, 2] == pytest.approx(PLACE[2], abs=4e-4)


def test_an_error_of_a_contact_that_lasts_stays_within_the_covariance():
    error = CONFIG.touch_std  # As of a wrong radius.
    belief = after(tips(SIDES[:1], gap=error), times=200)
    n = TURN[:, 0]
    std = np.sqrt(n @ belief.P[0, 3:6, 3:6] @ n)
    assert 0.3 * error < std < error
    assert abs(n @ (belief.p_WCoM[0] - PLACE)) < 3 * std


def test_more_touches_never_make_the_offset_less_certain():
    variances = [np.full(3, BIAS_STD**2)]
    for count in (1, 2, 3, 6):
        variances.append(np.linalg.eigvalsh(offset_of(after(tips(SIDES[:count])))[1]))
        assert np.all(variances[-1] <= variances[-2] * (1 + 1e-6))


def test_fingertips_that_do_not_touch_are_outside():
    """They tell nothing while they are, and something if they were inside."""
    before = merged(shown())
    far = after(tips(SIDES[:4], gap=0.02, is_bound=True), times=5)
    np.testing.assert_array_equal(far.b_W, before.b_W)
    np.testing.assert_array_equal(far.P, before.P)
    near = after(tips(SIDES[:4], gap=1e-4, is_bound=True), times=20)
    assert np.linalg.norm((near.b_W[0] - BIAS)[:2]) < 2e-3


def test_contacts_far_away_are_left_out():
    before = merged(shown())
    for touches in (tips(SIDES[:2], gap=0.06), SurfacePoints.seen(np.zeros((0, 3)), 0.0)):
        np.testing.assert_array_equal(after(touches).b_W, before.b_W)
    high = shown(p=PLACE + np.array([0, 0, 0.05]))
    rested = after(tips(SIDES[:0]), rests=True, belief=high)
    np.testing.assert_allclose(rested.b_W, 0.0, atol=1e-12)


@pytest.mark.parametrize("axis", [[1.0, 0, 0], [0, 1, 0], [0.6, -0.8, 0]])
def test_a_box_whose_top_is_hidden_stands_on_its_side(axis):
    """Its lowest corner alone would leave height and tilt, and tilt it further at each tick."""
    tilt = Rotation.from_rotvec(np.radians(2.0) * np.array(axis)).as_matrix()
    lifted = np.add(PLACE, [0, 0, 0.002])
    vague = replace(NOISE, orientation=0.05, position=0.003)
    belief = shown(R=tilt @ TURN, p=lifted, bias=np.zeros(3), noise=vague)
    for _ in range(20):
        belief, _ = felt(belief, 0.0, standing(), NOISE)
    mean = merged(belief)
    assert np.degrees(np.arccos(mean.R_WO[0][2, 2])) < 0.3
    assert mean.p_WCoM[0, 2] == pytest.approx(PLACE[2], abs=3e-4)
    turn = Rotation.from_matrix(mean.R_WO[0] @ TURN.T).as_rotvec()
    assert np.degrees(turn[2]) == pytest.approx(0.0, abs=0.1)


def test_points_of_a_side_tell_the_height_as_well_as_one_point_does():
    def variance(of):
        return merged(felt(shown(), 0.0, of, NOISE)[0]).P[0, 5, 5]

    one = contacts(tips(SIDES[:0]), rests=True)
    assert variance(standing()) == pytest.approx(variance(one), rel=0.02)


@pytest.mark.slow
def test_what_lies_on_no_flat_side_may_roll():
    """A can that lies between two facets: standing on the nearer one, it would roll there."""
    solid = MeshSolid.of(trimesh.creation.cylinder(0.03, 0.11, sections=32))
    roll, vague = np.radians(2.0), replace(NOISE, orientation=0.5)
    R = Rotation.from_euler("x", 90, degrees=True) * Rotation.from_euler("z", roll)
    facets = [
        FlatSide(np.array([np.cos(a), np.sin(a), 0.0]), facet)
        for a in np.pi * np.arange(1, 64, 2) / 32
        if len(facet := solid.corners[solid.corners @ [np.cos(a), np.sin(a), 0] > 0.0298])
    ]
    rolled = []
    for sides in (sides_of(solid), facets):
        belief = shown(R=R.as_matrix(), bias=np.zeros(3), noise=vague)
        for _ in range(20):
            belief, _ = felt(belief, 0.0, replace(standing(solid), sides=sides), NOISE)
        turn = Rotation.from_matrix(merged(belief).R_WO[0]) * R.inv()
        rolled.append(np.degrees(np.linalg.norm(turn.as_rotvec())))
    assert rolled[0] < 0.5 < 1.5 < rolled[1], rolled


def test_only_fingertips_that_touch_where_it_is_expected_confirm_a_belief():
    belief, none = shown(bias=np.zeros(3)), tips(SIDES[:0])
    for confirms, touches in (
        (True, tips(SIDES[:1])),
        (True, tips(SIDES[:3], gap=[[0.0], [0.06], [0.06]])),
        (False, tips(SIDES[:3], gap=0.06)),
        (False, tips(SIDES[:3], gap=-1e-3, is_bound=True)),
        (False, none),
    ):
        for rests in (True, False):
            assert felt(belief, 0.0, contacts(touches, rests), NOISE)[1] == confirms


def test_a_turned_world_turns_all():
    here = after(tips(SIDES[[0, 2, 4]]))
    there = after(
        tips(SIDES[[0, 2, 4]], R=WORLD @ TURN, p=WORLD @ PLACE),
        belief=shown(WORLD @ TURN, WORLD @ PLACE, WORLD @ BIAS),
    )
    T = np.kron(np.eye(5), WORLD)
    np.testing.assert_allclose(there.b_W[0], WORLD @ here.b_W[0], atol=1e-6)
    np.testing.assert_allclose(there.p_WCoM[0], WORLD @ here.p_WCoM[0], atol=1e-6)
    np.testing.assert_allclose(there.P[0], T @ here.P[0] @ T.T, atol=1e-6)


def test_an_offset_is_forgotten_in_its_time():
    """Its errors are then those of the position, too: what is shown stays as it is."""
    quiet = replace(NOISE, manoeuvre_rate=0.0)
    belief, _ = felt(shown(noise=quiet), 0.0, contacts(tips(SIDES)), quiet)
    late = predict(belief, 30.0, quiet)
    np.testing.assert_allclose(late.b_W, belief.b_W / np.e)
    forgotten = predict(belief, 1e3, quiet).P[0, 12:, 12:]
    np.testing.assert_allclose(forgotten, BIAS_STD**2 * np.eye(3), rtol=1e-6, atol=1e-12)


def test_the_offset_outlasts_a_loss_of_the_object():
    """A belief that starts anew knows the offset, and takes it off what the camera shows."""
    known = after(tips(SIDES), times=20)
    again = first_belief(PoseMeasurement(2.0, 1.0 + BIAS, TURN), NOISE, None, known)
    np.testing.assert_allclose(again.p_WCoM, np.ones((4, 3)), atol=1e-3)
    position = again.P[0, 3:6, 3:6]
    assert np.sqrt(position.diagonal()).max() < 1.2e-3
    fresh = first_belief(PoseMeasurement(2.0, np.ones(3), TURN), NOISE)
    assert np.sqrt(fresh.P[0, 3, 3]) > BIAS_STD


def squared_errors(seed, rests, ticks=30):
    """Squares of the errors of pose and offset in units of the covariance, over their number.

    A box moves as the filter assumes. A camera with a random offset, which changes as assumed, sees
    three sides of it, and three fingers touch it in the second half; all noise is drawn as assumed.
    """
    rng, config = np.random.default_rng(seed), replace(CONFIG, rests_on_table=rests)
    kernels, noise = default_kernels(), filter_noise(config)
    settings = replace(tracker_settings(config), step=kernels.filter_step)
    spread = config.point_std, config.fewest_points, rests
    seen = SeenObject(BOX, noise, np.zeros(3), *spread, kernels.align_pose())
    track, bias = PoseTrack.empty(21, len(noise.densities), 3), rng.normal(scale=BIAS_STD, size=3)
    p, v, yaw, rate = PLACE, np.array([0.05, 0.02, 0.0]), rng.uniform(-0.7, 0.7), 0.2
    dt, squares, std = 0.05, [], np.sqrt(np.repeat(noise.variances, 3))
    for tick in range(ticks):
        R = Rotation.from_euler("z", yaw).as_matrix()
        p_OQ, faces = trimesh.sample.sample_surface(MESH, 500, seed=int(rng.integers(2**31)))
        n = MESH.face_normals[faces]
        p_OQ = p_OQ + n * rng.normal(scale=config.point_std, size=(500, 1))
        p_OQ = p_OQ[n @ R.T @ [0.5, -0.5, 0.7] > 0]
        turn = Rotation.from_rotvec(rng.normal(scale=config.orientation_std, size=3)).as_matrix()
        p_WQ = p_OQ @ (turn @ R).T + p + bias + rng.normal(scale=config.position_std, size=3)
        if tick:
            measurement = seen.measured(p_WQ, dt * tick, kernels.merged(track.newest))
        else:  # Registration has its own tests.
            points = SurfacePoints.seen(p_WQ, config.point_std)
            found = align_pose(BOX.surface, points, R, p + bias, std)
            measurement = measured_part(0.0, found, std)
        track = update_track(track, measurement, dt * tick, settings)
        touches = tips(SIDES[:3] if tick >= ticks // 2 else SIDES[:0], R=R, p=p)
        errors = rng.normal(scale=config.touch_std, size=(len(touches.radius), 1))
        touches = replace(touches, p_WQ=touches.p_WQ + errors * (SIDES[: len(errors)] @ R.T))
        belief, _ = felt(track.newest, 0.0, contacts(touches, rests), noise)
        track = track.with_newest(belief, track.confirmed_at)
        belief = merged(track.newest)
        theta, P = Rotation.from_matrix(R @ belief.R_WO[0].T).as_rotvec(), belief.P[0]
        e = np.concatenate([theta, p - belief.p_WCoM[0]]), bias - belief.b_W[0]
        parts = zip(e, (P[:6, :6], P[12:, 12:]), strict=True)
        squares.append([x @ np.linalg.solve(C, x) / len(x) for x, C in parts])
        v = v + np.append(rng.normal(scale=config.acceleration * dt**0.5, size=2), 0)
        rate += rng.normal(scale=config.angular_acceleration * dt**0.5)
        p, yaw = p + v * dt, yaw + rate * dt
        for normal in SIDES[: len(errors)] @ R.T:
            p = p + rng.normal(scale=PUSHED**0.5) * normal
        kept, added = noise.bias_step(dt)
        bias = kept * bias + rng.normal(scale=added**0.5, size=3)
    return squares


@pytest.mark.slow
def test_errors_are_as_large_as_the_covariance_says():
    """Over 60 runs: those of the pose and of the offset, before touches, then, and after them."""
    mean = np.mean([squared_errors(seed, rests=False) for seed in range(60)], axis=0)
    for ticks in (slice(5, 15), slice(15, 20), slice(20, 30)):
        found = mean[ticks].mean(axis=0)
        assert np.all((found > 0.8) & (found < 1.3)), (ticks, found)


@pytest.mark.slow
def test_with_a_table_errors_are_not_larger_than_the_covariance_says():
    """The table is exact here, but assumed to be as inexact as a touch."""
    mean = np.mean([squared_errors(seed, rests=True) for seed in range(25)], axis=0)
    assert np.all(mean[5:] < 1.3)


@pytest.mark.parametrize("estimated_from", [0, 60, 1000])
def test_the_hand_and_the_filter_do_not_correct_the_same_error_twice(estimated_from):
    """The frame of the hand ends at the object, whether the filter or the hand corrects first."""
    directions = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0]])
    touches, belief = tips(directions), shown(bias=np.array([0.006, -0.008, 0.0]))
    offset, touching = np.zeros(3), np.ones(3, dtype=bool)
    for tick in range(120):
        if tick % 5 == 0 and tick >= estimated_from:
            belief, _ = felt(belief, 0.0, contacts(touches), NOISE)
        mean = merged(belief)
        R_WG, p_WG = corrected_pose(mean.R_WO[0], mean.p_WCoM[0], np.zeros(3), offset)
        a = touches.p_WQ - p_WG
        distances, gradients = BOX.distance_and_gradient(a @ R_WG)
        n = gradients @ R_WG.T
        rows = np.column_stack([n[:, :2], np.cross(a, n)[:, 2]])
        change = touch_correction(distances - touches.radius, rows, touching, offset)
        offset = limited_offset(offset, change, 2e-4)
    error = (p_WG - PLACE)[:2]
    assert np.linalg.norm(error) < 2e-3  # Smaller gaps are left out.
    was_felt = estimated_from < 120
    assert (np.linalg.norm(offset[:2]) < 2e-3) == was_felt


@pytest.mark.slow
def test_contacts_do_not_turn_what_no_picture_has_shown_to_turn():
    """The facets of a can would turn it about its axis, and the touch would not tell the offset."""
    mesh = trimesh.creation.cylinder(0.04, 0.11, sections=32)
    part = np.diag([1.0, 1, 0, 1, 1, 1])  # All but the turn about the axis.
    upright = PoseMeasurement(0.0, PLACE + BIAS, np.eye(3), part)
    belief = first_belief(upright, NOISE)
    for azimuth in (0.13, 1.4):  # Near the edges of facets.
        n = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        touch = replace(tips(SIDES[:1]), p_WQ=(PLACE + (0.04 + RADIUS) * n)[None])
        can = Contacts(MeshSolid.of(mesh), np.zeros(3), touch, False, CONFIG.touch_std)
        after = merged(felt(belief, 0.0, can, NOISE)[0])
        np.testing.assert_allclose(after.R_WO[0], np.eye(3), atol=1e-4)
        assert after.b_W[0] @ n == pytest.approx(BIAS @ n, abs=1e-3)
