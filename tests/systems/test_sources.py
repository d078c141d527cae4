"""Sources of a scenario and the pose sensor without faults."""

import numpy as np
import pytest
from driven import Driven
from made_systems import X_WO
from pydrake.common import RandomGenerator
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import AddRandomInputs
from scipy.spatial.transform import Rotation

import drake_pregrasp as dp
from drake_pregrasp.config.sensor_config import SensorConfig
from drake_pregrasp.estimation.recorded_poses import RecordedPoses
from drake_pregrasp.geometry.motion_profiles import VelocityProfile
from drake_pregrasp.systems import sources
from drake_pregrasp.systems.pose_sensor import NoiseSource, NoisyPoseSensor

TILT = RollPitchYaw(0.1, 0.2, 0.3).ToRotationMatrix().matrix()
SOLIDS = (
    dp.BallSolid(np.array([0.1, 0.2, 0.3]), 0.02),
    dp.BoxSolid(np.array([0.0, 0.1, 0.0]), TILT, np.array([0.1, 0.2, 0.3])),
    dp.HalfSpace(np.array([0.0, 0.0, -0.2]), np.array([0.0, 0.0, 1.0])),
)
VELOCITIES = np.array([[0.1, 0.0, 0.0], [0.0, -0.2, 0.05], [0.0, 0.0, 0.03]])
MOVING = [sources.MovingSolid(solid, v) for solid, v in zip(SOLIDS, VELOCITIES, strict=True)]
PROBES = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 3))


def emitted(source, time, seed=None):
    """The output of a source's only port at a time, after an evaluation at another time."""
    driven = Driven(source)
    source.get_output_port().Eval(driven.context)
    driven.at(time)
    if seed is not None:
        driven.context.get_mutable_numeric_parameter(0).SetAtIndex(0, seed)
    return source.get_output_port().Eval(driven.context)


def test_a_constant_motion_commands_position_and_rate():
    motion = sources.ObjectMotion(VelocityProfile([[0.0, 0.1, -0.5]]))
    np.testing.assert_array_equal(emitted(motion, 3.0), [0.1 * 3.0, -0.5 * 3.0, 0.1, -0.5])


def test_a_replay_passes_through_the_recorded_poses_and_stands_still_outside():
    p_WO = np.array([[0.0, 0, 0], [1, 0, 0], [1, 2, 0]])
    R_WO = Rotation.from_rotvec([[0, 0, 0], [0, 0, 1], [0, 0, -1]])
    replay = Driven(sources.PoseReplay(RecordedPoses(np.array([1.0, 2.0, 4.0]), p_WO, R_WO)))
    for time, p, yaw in (
        (0.0, [0, 0, 0], 0.0),
        (1.0, [0, 0, 0], 0.0),
        (1.5, [0.5, 0, 0], 0.5),
        (2.0, [1, 0, 0], 1.0),
        (3.5, [1, 1.5, 0], -0.5),
        (9.0, [1, 2, 0], -1.0),
    ):
        replay.at(time)
        X_WO = replay.eval("X_WO")
        np.testing.assert_allclose(X_WO.translation(), p, atol=1e-12)
        assert RollPitchYaw(X_WO.rotation()).yaw_angle() == pytest.approx(yaw, abs=1e-12)
        poses = replay.eval("geometry_pose")
        (frame_id,) = poses.ids()
        assert poses.value(frame_id).IsExactlyEqualTo(X_WO)


def test_body_pose_picks_its_body():
    poses = [RigidTransform(np.full(3, float(k))) for k in range(3)]
    body = Driven(sources.BodyPose(BodyIndex(2)), body_poses=AbstractValue.Make(poses))
    assert body.eval("X_WB").IsExactlyEqualTo(poses[2])


def test_a_held_body_pose_is_that_of_its_time_step():
    poses = [AbstractValue.Make([RigidTransform([x, 0.0, 0.0])]) for x in (1.0, 2.0)]
    body = Driven(sources.BodyPose(BodyIndex(0), time_step=0.01), body_poses=poses[0])
    body.simulator.AdvanceTo(1e-9)  # The plant has been updated, as seen by a tick after rounding.
    body.fix(body_poses=poses[1])
    assert body.eval("X_WB").translation()[0] == 1.0
    body.context.SetTime(0.01)
    assert body.eval("X_WB").translation()[0] == 2.0


def test_fingers_are_lost_from_their_time_on():
    weights = sources.ContactWeights(np.array([1.0, 2.0, 3.0]), [(2.0, [1]), (3.0, [0])])
    rounded = 2.0 - 4e-16  # As a tick's time may be.
    for time, expected in (
        (0.0, [1, 2, 3]),
        (rounded, [1, -np.inf, 3]),
        (2.0, [1, -np.inf, 3]),
        (9.0, [-np.inf, -np.inf, 3]),
    ):
        np.testing.assert_array_equal(emitted(weights, time), expected)


def test_lost_fingers_come_back_unless_another_loss_goes_on():
    lost, back = [(2.0, [0, 1]), (0.0, [2])], [(5.0, [0]), (6.0, [2])]
    lost.append((1.0, [2]))
    weights = sources.ContactWeights(np.array([1.0, 2.0, 3.0]), lost, back)
    for time, away in ((1.9, [2]), (2.0, [0, 1, 2]), (5.0 - 4e-16, [1, 2]), (6.0, [1, 2])):
        expected = np.where(np.isin(np.arange(3), away), -np.inf, [1.0, 2, 3])
        np.testing.assert_array_equal(emitted(weights, time), expected)


def test_capability_counts_at_the_smallest_distance_of_fingers_that_are_left():
    p_WC = np.array([[0.0, 0, 0], [0.3, 0, 0], [0.05, 0, 0], [0, 0.4, 0]])
    source = sources.ContactWeights(
        np.array([0.01, 0, 0, 0]), [(1.0, [2])], capability=lambda t: np.array([0.8, 0.5, 1, 1 - t])
    )
    driven = Driven(source, p_WC=p_WC.ravel())
    for time, length in ((0.0, 0.05), (1.0, 0.3)):
        driven.at(time)
        expected = dp.capability_weights(np.array([0.8, 0.5, 1 - time, 1 - time]), length)
        expected += [0.01, 0, 0, 0]
        np.testing.assert_allclose(driven.eval("contact_weights"), expected)
    driven.fix(p_WC=0.5 * p_WC.ravel())
    np.testing.assert_allclose(driven.eval("contact_weights")[1], -(0.15**2) * 0.3 / 1.3)


def test_capability_counts_at_a_given_length_wherever_the_fingers_are():
    source = sources.ContactWeights(
        np.zeros(3), capability=lambda t: np.array([1.0, 0.5, 0.2 + t]), length=0.1
    )
    expected = dp.capability_weights(np.array([1.0, 0.5, 0.4]), 0.1)
    np.testing.assert_allclose(emitted(source, 0.2), expected)


def test_a_finger_that_is_not_there_cannot_be_lost():
    with pytest.raises(dp.InvalidArgumentError, match="no contact 3; there are 0 to 2"):
        sources.ContactWeights(np.zeros(3), [(1.0, [3])])


def assert_same_solids(solids, others):
    for one, other in zip(solids, others, strict=True):
        np.testing.assert_allclose(one.distance(PROBES), other.distance(PROBES), atol=1e-12)


@pytest.mark.parametrize("time", [0.0, 0.5, 7.0])
def test_obstacles_move_steadily_without_turning_and_tell_where_they_will_be(time):
    ahead = sources.MovingObstacles(MOVING, lookahead=0.1)
    expected = [
        s.moved(np.eye(3), (time + 0.1) * v) for s, v in zip(SOLIDS, VELOCITIES, strict=True)
    ]
    assert_same_solids(emitted(ahead, time).solids, expected)
    rows = [solid.rounded_box() for solid in expected]
    np.testing.assert_allclose(emitted(ahead, time).rows, rows, atol=1e-12)
    assert_same_solids(emitted(ahead, 0.0).after(time).solids, expected)
    R, p = X_WO.rotation().matrix(), X_WO.translation()
    moved = emitted(ahead, 0.0).moved(R, p).after(time)
    assert_same_solids(moved.solids, dp.Obstacles(tuple(expected)).moved(R, p).solids)


def test_obstacles_have_no_velocities_or_one_a_solid():
    assert dp.Obstacles(SOLIDS).after(1.0).solids == SOLIDS
    with pytest.raises(dp.InvalidArgumentError, match=r"shape \(3, 3\), one a solid, not \(2, 3\)"):
        dp.Obstacles(SOLIDS, velocities=np.ones((2, 3)))


@pytest.mark.parametrize("follow", [False, True])
def test_a_hand_keeps_its_orientation_and_its_place_by_the_object_or_in_the_world(follow):
    X = RigidTransform(RollPitchYaw(0.3, 0.1, -2.0), [0.1, 0.0, 0.2])
    X_WH = Driven(sources.HandFramePose(X, follow=follow), X_WO_estimated=X_WO).eval("X_WH")
    np.testing.assert_allclose(X_WH.translation(), X.translation() + follow * X_WO.translation())
    np.testing.assert_array_equal(X_WH.rotation().matrix(), X.rotation().matrix())


def test_noise_holds_for_a_period_and_then_changes():
    source = NoiseSource(size=4, period=0.05, seed=3)
    np.testing.assert_array_equal(emitted(source, 0.15), emitted(source, 3 * 0.05))
    np.testing.assert_array_equal(emitted(source, 0.15), emitted(source, 0.1999))
    assert np.all(emitted(source, 0.15) != emitted(source, 0.2))
    for tick in (0, 7, 8, 1000):  # Each tick has a generator of its own.
        expected = np.random.default_rng((3, tick)).standard_normal(4)
        np.testing.assert_array_equal(emitted(source, 0.05 * tick), expected)


def test_noise_is_a_function_of_the_seed_which_a_context_may_set():
    source, other = (NoiseSource(size=4, period=0.05, seed=seed) for seed in (3, 4))
    assert np.all(emitted(source, 0.1) != emitted(other, 0.1))
    np.testing.assert_array_equal(emitted(source, 0.1, seed=4), emitted(other, 0.1))


def test_noise_is_standard_normal_and_independent():
    source = NoiseSource(size=6, period=0.1)
    x = np.array([emitted(source, 0.1 * k) for k in range(2000)])
    np.testing.assert_allclose(np.cov(x.T), np.eye(6), atol=0.12)
    np.testing.assert_allclose(x.mean(axis=0), 0, atol=0.1)
    assert abs(np.mean(x[1:] * x[:-1])) < 0.05


def test_a_sensor_adds_noise_in_the_world_frame():
    sensor = Driven(NoisyPoseSensor(SensorConfig(0.1, 0.2)), X_WO=X_WO, noise=np.zeros(6))
    assert sensor.eval("X_WO_measured").IsNearlyEqualTo(X_WO, 1e-15)
    sensor.fix(noise=[1.0, 0, -1, 0, 0, 0.5])
    X_WM = sensor.eval("X_WO_measured")
    np.testing.assert_allclose(X_WM.translation() - X_WO.translation(), [0.1, 0, -0.1], atol=1e-15)
    expected = RotationMatrix.MakeZRotation(0.1) @ X_WO.rotation()
    assert (X_WM.rotation().inverse() @ expected).IsNearlyIdentity(1e-12)


def test_a_sensor_takes_drakes_random_inputs():
    builder = DiagramBuilder()
    sensor = builder.AddSystem(NoisyPoseSensor(SensorConfig(0.1, 0.2)))
    builder.ExportInput(sensor.GetInputPort("X_WO"), "X_WO")
    builder.ExportOutput(sensor.GetOutputPort("X_WO_measured"), "X_WM")
    assert AddRandomInputs(0.1, builder) == 1
    measured = Driven(builder.Build(), X_WO=X_WO)
    measured.system.SetRandomContext(measured.context, RandomGenerator(5))
    away = measured.eval("X_WM").translation() - X_WO.translation()
    assert np.linalg.norm(away) == pytest.approx(0.2, abs=0.19)
