import numpy as np
import pytest
from pydrake.common import RandomGenerator
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import AddRandomInputs
from scipy.spatial.transform import Rotation

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.config.sensor_config import SensorConfig
from drake_pregrasp.estimation.recorded_poses import RecordedPoses
from drake_pregrasp.geometry.motion_profiles import VelocityProfile
from drake_pregrasp.systems.pose_sensor import NoiseSource, NoisyPoseSensor
from drake_pregrasp.systems.sources import BodyPose, ContactWeights, ObjectMotion, PoseReplay


def noise_at(source, time, seed=None):
    context = source.CreateDefaultContext()
    context.SetTime(time)
    if seed is not None:
        context.get_mutable_numeric_parameter(0).SetAtIndex(0, seed)
    return source.get_output_port().Eval(context)


def commanded(motion, time):
    context = motion.CreateDefaultContext()
    context.SetTime(time)
    return motion.get_output_port().Eval(context)


def test_a_constant_motion_commands_position_and_rate():
    motion = ObjectMotion(VelocityProfile([[0.0, 0.1, -0.5]]))
    np.testing.assert_array_equal(commanded(motion, 3.0), [0.1 * 3.0, -0.5 * 3.0, 0.1, -0.5])


def recorded(times=(1.0, 2.0, 4.0)):
    p = np.array([[0.0, 0, 0], [1, 0, 0], [1, 2, 0]])
    return RecordedPoses(
        np.array(times), p, Rotation.from_rotvec([[0, 0, 0], [0, 0, 1], [0, 0, -1]])
    )


def test_a_replay_passes_through_the_recorded_poses_and_stands_still_outside():
    replay = PoseReplay(recorded())
    context = replay.CreateDefaultContext()
    for time, p_WO, yaw in (
        (0.0, [0, 0, 0], 0.0),
        (1.0, [0, 0, 0], 0.0),
        (1.5, [0.5, 0, 0], 0.5),
        (2.0, [1, 0, 0], 1.0),
        (3.5, [1, 1.5, 0], -0.5),
        (9.0, [1, 2, 0], -1.0),
    ):
        context.SetTime(time)
        X_WO = replay.GetOutputPort("X_WO").Eval(context)
        np.testing.assert_allclose(X_WO.translation(), p_WO, atol=1e-12)
        assert RollPitchYaw(X_WO.rotation()).yaw_angle() == pytest.approx(yaw, abs=1e-12)
        poses = replay.GetOutputPort("geometry_pose").Eval(context)
        (frame_id,) = poses.ids()
        assert poses.value(frame_id).IsExactlyEqualTo(X_WO)


def test_body_pose_picks_its_body():
    poses = [RigidTransform(np.full(3, float(k))) for k in range(3)]
    system = BodyPose(BodyIndex(2))
    context = system.CreateDefaultContext()
    system.get_input_port().FixValue(context, AbstractValue.Make(poses))
    assert system.get_output_port().Eval(context).IsExactlyEqualTo(poses[2])


def test_fingers_are_lost_from_their_time_on():
    weights = ContactWeights(np.array([1.0, 2.0, 3.0]), [(2.0, [1]), (3.0, [0])])
    context = weights.CreateDefaultContext()
    rounded = 2.0 - 4e-16  # As a tick's time may be.
    for time, expected in (
        (0.0, [1, 2, 3]),
        (rounded, [1, -np.inf, 3]),
        (2.0, [1, -np.inf, 3]),
        (9.0, [-np.inf, -np.inf, 3]),
    ):
        context.SetTime(time)
        np.testing.assert_array_equal(weights.get_output_port().Eval(context), expected)


def test_a_finger_that_is_not_there_cannot_be_lost():
    with pytest.raises(InvalidArgumentError, match="no contact 3; there are 0 to 2"):
        ContactWeights(np.zeros(3), [(1.0, [3])])


def test_noise_holds_for_a_period_and_then_changes():
    source = NoiseSource(size=4, period=0.05, seed=3)
    np.testing.assert_array_equal(noise_at(source, 0.15), noise_at(source, 3 * 0.05))
    np.testing.assert_array_equal(noise_at(source, 0.15), noise_at(source, 0.1999))
    assert np.all(noise_at(source, 0.15) != noise_at(source, 0.2))


def test_noise_is_a_function_of_the_seed_which_a_context_may_set():
    source = NoiseSource(size=4, period=0.05, seed=3)
    other = NoiseSource(size=4, period=0.05, seed=4)
    assert np.all(noise_at(source, 0.1) != noise_at(other, 0.1))
    np.testing.assert_array_equal(noise_at(source, 0.1, seed=4), noise_at(other, 0.1))


def test_noise_is_standard_normal_and_independent():
    source = NoiseSource(size=6, period=0.1)
    x = np.array([noise_at(source, 0.1 * k) for k in range(2000)])
    np.testing.assert_allclose(np.cov(x.T), np.eye(6), atol=0.12)
    np.testing.assert_allclose(x.mean(axis=0), 0, atol=0.1)
    assert abs(np.mean(x[1:] * x[:-1])) < 0.05


def measured(sensor, X_WO, noise):
    context = sensor.CreateDefaultContext()
    sensor.GetInputPort("X_WO").FixValue(context, X_WO)
    sensor.GetInputPort("noise").FixValue(context, noise)
    return sensor.GetOutputPort("X_WO_measured").Eval(context)


X_WO = RigidTransform(RollPitchYaw(0.3, -0.2, 2.0), [0.4, 0.5, 0.6])


def test_sensor_without_noise_measures_the_truth():
    sensor = NoisyPoseSensor(SensorConfig(0.1, 0.1))
    assert measured(sensor, X_WO, np.zeros(6)).IsNearlyEqualTo(X_WO, 1e-15)


def test_sensor_adds_noise_in_the_world_frame():
    sensor = NoisyPoseSensor(SensorConfig(0.1, 0.2))
    X_WM = measured(sensor, X_WO, np.array([1.0, 0, -1, 0, 0, 0.5]))
    np.testing.assert_allclose(X_WM.translation() - X_WO.translation(), [0.1, 0, -0.1], atol=1e-15)
    expected = RotationMatrix.MakeZRotation(0.1) @ X_WO.rotation()
    assert (X_WM.rotation().inverse() @ expected).IsNearlyIdentity(1e-12)


def test_sensor_takes_drakes_random_inputs():
    builder = DiagramBuilder()
    sensor = builder.AddSystem(NoisyPoseSensor(SensorConfig(0.1, 0.2)))
    builder.ExportInput(sensor.GetInputPort("X_WO"), "X_WO")
    builder.ExportOutput(sensor.GetOutputPort("X_WO_measured"), "X_WM")
    assert AddRandomInputs(0.1, builder) == 1
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.SetRandomContext(context, RandomGenerator(5))
    diagram.GetInputPort("X_WO").FixValue(context, X_WO)
    X_WM = diagram.GetOutputPort("X_WM").Eval(context)
    assert np.linalg.norm(X_WM.translation() - X_WO.translation()) == pytest.approx(0.2, abs=0.19)
