from dataclasses import replace

import numpy as np
import pytest
from driven import Driven
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from drake_pregrasp import InvalidArgumentError, MeasurementFaults, NoisyPoseSensor
from drake_pregrasp.config.sensor_config import Camera, SensorConfig
from drake_pregrasp.geometry.rotations import rotation_matrix

T = 0.05
STDS = 0.01, 0.02
NOISE = np.random.default_rng(0).standard_normal((200, 6))
ALL = MeasurementFaults(
    noise_factor=2.0,
    position_bias=(0.01, 0.0, 0.0),
    orientation_bias=(0.0, 0.1, 0.0),
    degrees_of_freedom=3.0,
    outlier_probability=0.2,
    dropout_rate=0.5,
    delay=0.05,
    jitter=0.2,
    out_of_order=True,
    freeze_rate=0.5,
    nan_probability=0.1,
    sample_period=0.1,
)
WITHOUT_MEMORY = MeasurementFaults(
    degrees_of_freedom=3.0, outlier_probability=0.5, nan_probability=0.1
)


KINDS = pytest.mark.parametrize("faults", [WITHOUT_MEMORY, ALL], ids=["without memory", "all"])
MEMORIES = pytest.mark.parametrize("freeze_rate", [0.0, 1e-9], ids=["no memory", "memory"])


def true_pose(tick):
    return RigidTransform(RollPitchYaw(0.1, 0.2, 0.03 * tick), [0.01 * tick, 0.2, 0.3])


class Sensor(Driven):
    """A sensor of an object that moves from tick to tick."""

    def __init__(self, faults, seed=3):
        super().__init__(NoisyPoseSensor(SensorConfig(*STDS, faults), period=T, seed=seed))

    def at_tick(self, tick, X_WO=None):
        self.at(tick * T, X_WO=X_WO or true_pose(tick), noise=NOISE[int(tick)])

    def set_seed(self, seed):
        self.context.get_mutable_numeric_parameter(0).SetAtIndex(0, seed)

    def emitted(self, ticks=range(100)):
        """Returns what is emitted at the ticks, one row each: the pose and the time."""
        rows = []
        for tick in ticks:
            self.at_tick(tick)
            rows.append(self.numbers())
            self.update()
        return np.array(rows)


NO_FAULTS = MeasurementFaults()


def test_without_faults_it_is_the_same_to_the_bit_and_there_is_neither_state_nor_parameter():
    for faults in (NO_FAULTS, MeasurementFaults(start=1.0)):
        sensor = Sensor(faults)
        context = sensor.context
        assert context.num_total_states() == context.num_numeric_parameter_groups() == 0
        for tick, row in enumerate(sensor.emitted()):
            X_WO, (position_std, orientation_std) = true_pose(tick), STDS
            turn = RotationMatrix(rotation_matrix(orientation_std * NOISE[tick, 3:]))
            p_WM = X_WO.translation() + position_std * NOISE[tick, :3]
            X_WM = RigidTransform(turn @ X_WO.rotation(), p_WM)
            np.testing.assert_array_equal(row, [*X_WM.GetAsMatrix34().ravel(), tick * T])


TIMING = {"dropout_rate", "delay", "jitter", "freeze_rate", "sample_period"}
CHANGED = {name for name, value in vars(ALL).items() if value != getattr(NO_FAULTS, name)}


@pytest.mark.parametrize("name", sorted(CHANGED - {"out_of_order"}))
def test_each_fault_alone_is_one_and_only_what_concerns_time_has_state(name):
    context = Sensor(MeasurementFaults(**{name: vars(ALL)[name]})).context
    assert context.num_numeric_parameter_groups() == 1
    assert context.num_discrete_state_groups() == (name in TIMING)


@KINDS
def test_outside_of_their_time_faults_change_no_bit(faults):
    window = replace(faults, start=1.0, end=2.0)
    found, expected = Sensor(window).emitted(), Sensor(NO_FAULTS).emitted()
    inside = np.arange(100) // 20 == 1
    late = np.arange(100) // 5 == 8  # What was measured at the end of the window still arrives.
    settled = ~inside & ~late
    np.testing.assert_array_equal(found[settled], expected[settled])
    assert np.mean(np.any(found[inside] != expected[inside], axis=1)) > 0.4


def test_at_a_tick_outputs_are_the_same_before_and_after_its_update():
    """Even though the plant's own update of that time may have moved the object on."""
    sensor = Sensor(ALL)
    for tick in range(60):
        sensor.at_tick(tick)
        before = sensor.numbers()
        sensor.update()
        np.testing.assert_array_equal(sensor.numbers(), before)
        sensor.at_tick(tick, true_pose(tick + 9))
        np.testing.assert_array_equal(sensor.numbers(), before)
        sensor.at((tick + 0.7) * T)
        np.testing.assert_array_equal(sensor.numbers(), before)


def test_a_context_that_is_copied_or_set_back_repeats():
    sensor, other = Sensor(ALL), Sensor(ALL)
    first = sensor.emitted(range(30))
    other.context.SetTimeStateAndParametersFrom(sensor.context)
    rest = sensor.emitted(range(30, 60))
    np.testing.assert_array_equal(other.emitted(range(30, 60)), rest)
    # Set back in time alone, it forgets what it cannot have measured yet.
    np.testing.assert_array_equal(sensor.emitted(range(30)), first)


def test_an_estimate_at_a_tick_depends_on_no_earlier_question():
    asked = Sensor(ALL)
    for tick in range(40):
        for time in (tick, tick + 0.5):
            asked.at_tick(time)
            asked.numbers()
        asked.at_tick(tick)
        asked.update()
    asked.at_tick(40)
    np.testing.assert_array_equal(asked.numbers(), Sensor(ALL).emitted(range(41))[-1])


@KINDS
def test_faults_are_a_function_of_the_seed_which_a_context_may_set(faults):
    found, other = Sensor(faults, seed=3).emitted(), Sensor(faults, seed=4).emitted()
    np.testing.assert_array_equal(found, Sensor(faults, seed=3).emitted())
    assert not np.array_equal(found, other, equal_nan=True)
    sensor = Sensor(faults, seed=3)
    sensor.at_tick(0)
    np.testing.assert_array_equal(sensor.numbers(), found[0])
    sensor.set_seed(4)
    np.testing.assert_array_equal(sensor.numbers(), other[0])
    np.testing.assert_array_equal(sensor.emitted(), other)


def test_nothing_has_arrived_before_the_delay():
    found = Sensor(MeasurementFaults(delay=0.2)).emitted(range(8))
    assert np.all(found[:4, -1] == -np.inf)
    assert np.all(np.isnan(found[:4, :-1]))
    np.testing.assert_array_equal(found[4:], Sensor(NO_FAULTS).emitted(range(4)))


@MEMORIES
def test_nan_measurements_are_emitted_unchanged_with_their_times(freeze_rate):
    faults = MeasurementFaults(nan_probability=1.0, freeze_rate=freeze_rate)
    found = Sensor(faults).emitted(range(5))
    assert np.all(np.isnan(found[:, :-1]))
    np.testing.assert_array_equal(found[:, -1], np.arange(5) * T)


def test_measured_rotations_are_rotations():
    found = Sensor(ALL).emitted()
    valid = [RotationMatrix(X[:, :3]).IsValid() for X in found[:, :-1].reshape(-1, 3, 4)]
    np.testing.assert_array_equal(valid, ~np.isnan(found[:, 0]))
    assert 50 < sum(valid) < 100


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "faults need a period greater than 0 s, not None"),
        ({"period": 0.0}, "faults need a period greater than 0 s, not 0.0"),
        ({"period": T, "seed": -1}, r"seed must be from 0 to 2\*\*53, not -1"),
        ({"period": 0.1}, "faults.sample_period: 0.08 must be 0 or at least the planning period"),
    ],
)
def test_invalid_arguments_are_named(arguments, message):
    with pytest.raises(InvalidArgumentError, match=message):
        NoisyPoseSensor(SensorConfig(faults=MeasurementFaults(sample_period=0.08)), **arguments)


def test_outputs_follow_a_state_that_is_changed():
    sensor = Sensor(MeasurementFaults(delay=0.2))
    empty = sensor.context.get_discrete_state(0).CopyToVector()
    sensor.emitted(range(10))
    assert sensor.numbers()[-1] == pytest.approx(5 * T)
    sensor.context.SetDiscreteState(0, empty)
    assert sensor.numbers()[-1] == -np.inf


class SeenSensor(Sensor):
    """A sensor with the errors of a camera."""

    def __init__(self, **settings):
        camera = Camera(*STDS, NO_FAULTS, position=[0.5, -0.5, 0.5], **settings)
        Driven.__init__(self, NoisyPoseSensor(camera, period=T, seed=3))


def test_a_camera_has_its_own_noise_along_the_ray():
    p_WO = true_pose(0).translation()
    ray = (p_WO - [0.5, -0.5, 0.5]) / np.linalg.norm(p_WO - [0.5, -0.5, 0.5])
    for ray_std in (0.0, STDS[0], 0.07):
        sensor = SeenSensor(ray_std=ray_std)
        offsets = []
        for tick in range(20):
            sensor.at_tick(tick, true_pose(0))
            offsets.append(sensor.eval("X_WO_measured").translation() - p_WO)
        along, white = offsets @ ray, STDS[0] * NOISE[:20, :3]
        np.testing.assert_allclose(along, ray_std * NOISE[:20, :3] @ ray, atol=1e-12)
        across = np.array(offsets) - np.outer(along, ray)
        np.testing.assert_allclose(across, white - np.outer(white @ ray, ray), atol=1e-12)


@pytest.mark.parametrize(("gap", "missed"), [(0.0, 0), (0.1, 2), (0.12, 3)])
def test_what_a_camera_does_not_see_it_does_not_measure_nor_for_a_while_after(gap, missed):
    sensor = SeenSensor(least_visible=0.3, registration_gap=gap)
    times = []
    for tick in range(12):
        sensor.fix(visible_share=[0.29 if 3 <= tick < 6 else 0.3])
        sensor.at_tick(tick)
        times.append(sensor.array("measurement_time")[0])
        sensor.update()
    seen = [tick for tick in range(12) if not 3 <= tick < 6 + missed]
    expected = [T * max(s for s in seen if s <= tick) for tick in range(12)]
    np.testing.assert_allclose(times, expected)


def test_what_is_hidden_is_not_measured_although_no_fault_acts():
    camera = Camera(*STDS, MeasurementFaults(start=0.5), least_visible=0.3)
    sensor = Sensor.__new__(SeenSensor)
    Driven.__init__(sensor, NoisyPoseSensor(camera, period=T, seed=3), visible_share=[0.0])
    for tick in range(20):
        sensor.at_tick(tick)
        assert sensor.array("measurement_time")[0] == -np.inf
        sensor.update()
