import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from drake_pregrasp import InvalidArgumentError, MeasurementFaults, NoisyPoseSensor
from drake_pregrasp.config.sensor_config import SensorConfig
from drake_pregrasp.geometry.rotations import rotation_matrix

T = 0.05
STD = SensorConfig(0.01, 0.02)
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
    sign_flip_probability=0.5,
    nan_probability=0.1,
    sample_period=0.1,
)
WITHOUT_MEMORY = MeasurementFaults(
    degrees_of_freedom=3.0, outlier_probability=0.5, nan_probability=0.1
)


def faulty(faults, seed=3):
    return NoisyPoseSensor(SensorConfig(0.01, 0.02, faults), period=T, seed=seed)


def true_pose(tick):
    return RigidTransform(RollPitchYaw(0.1, 0.2, 0.03 * tick), [0.01 * tick, 0.2, 0.3])


def set_inputs(sensor, context, tick, X_WO=None):
    sensor.GetInputPort("X_WO").FixValue(context, X_WO or true_pose(tick))
    sensor.GetInputPort("noise").FixValue(context, NOISE[tick])


def outputs(sensor, context):
    X_WM = sensor.GetOutputPort("X_WO_measured").Eval(context)
    (stamp,) = sensor.GetOutputPort("measurement_time").Eval(context)
    return np.array([stamp, *X_WM.GetAsMatrix34().ravel()])


def update(sensor, context):
    if context.num_discrete_state_groups():
        context.SetDiscreteState(sensor.EvalUniquePeriodicDiscreteUpdate(context))


def emitted(sensor, ticks=range(100), context=None):
    """Returns what is emitted at the ticks, one row each: the stamp and the pose."""
    context = context or sensor.CreateDefaultContext()
    rows = []
    for tick in ticks:
        context.SetTime(tick * T)
        set_inputs(sensor, context, tick)
        rows.append(outputs(sensor, context))
        update(sensor, context)
    return np.array(rows)


def test_without_faults_it_is_the_same_to_the_bit_and_there_is_neither_state_nor_parameter():
    for sensor in (NoisyPoseSensor(STD), faulty(MeasurementFaults(start=1.0))):
        context = sensor.CreateDefaultContext()
        assert context.num_total_states() == context.num_numeric_parameter_groups() == 0
        for row, tick in zip(emitted(sensor), range(100), strict=True):
            X_WO = true_pose(tick)
            turn = RotationMatrix(rotation_matrix(0.02 * NOISE[tick, 3:]))
            X_WM = RigidTransform(
                turn @ X_WO.rotation(), X_WO.translation() + 0.01 * NOISE[tick, :3]
            )
            np.testing.assert_array_equal(row[1:], X_WM.GetAsMatrix34().ravel())
            assert row[0] == tick * T


TIMING = {"dropout_rate", "delay", "jitter", "freeze_rate", "sample_period"}
ALONE = TIMING | {
    "noise_factor",
    "position_bias",
    "orientation_bias",
    "degrees_of_freedom",
    "outlier_probability",
    "sign_flip_probability",
    "nan_probability",
}


@pytest.mark.parametrize("name", sorted(ALONE))
def test_each_fault_alone_is_one_and_only_what_concerns_time_has_state(name):
    context = faulty(MeasurementFaults(**{name: vars(ALL)[name]})).CreateDefaultContext()
    assert context.num_numeric_parameter_groups() == 1
    assert context.num_discrete_state_groups() == (name in TIMING)


@pytest.mark.parametrize("faults", [WITHOUT_MEMORY, ALL], ids=["without memory", "all"])
def test_outside_of_their_time_faults_change_no_bit(faults):
    window = {**vars(faults), "start": 1.0, "end": 2.0}
    found, expected = emitted(faulty(MeasurementFaults(**window))), emitted(NoisyPoseSensor(STD))
    inside = np.arange(100) // 20 == 1
    late = np.arange(100) // 5 == 8  # What was measured at the end of the window still arrives.
    settled = ~inside & ~late
    np.testing.assert_array_equal(found[settled], expected[settled])
    assert np.mean(np.any(found[inside] != expected[inside], axis=1)) > 0.4


def test_at_a_tick_outputs_are_the_same_before_and_after_its_update():
    """Even though the plant's own update of that time may have moved the object on."""
    sensor = faulty(ALL)
    context = sensor.CreateDefaultContext()
    for tick in range(60):
        context.SetTime(tick * T)
        set_inputs(sensor, context, tick)
        before = outputs(sensor, context)
        update(sensor, context)
        np.testing.assert_array_equal(outputs(sensor, context), before)
        set_inputs(sensor, context, tick, true_pose(tick + 9))
        np.testing.assert_array_equal(outputs(sensor, context), before)
        context.SetTime((tick + 0.7) * T)
        np.testing.assert_array_equal(outputs(sensor, context), before)


def test_a_context_that_is_copied_or_set_back_repeats():
    sensor = faulty(ALL)
    context = sensor.CreateDefaultContext()
    first = emitted(sensor, range(30), context)
    copy = context.Clone()
    rest = emitted(sensor, range(30, 60), context)
    np.testing.assert_array_equal(emitted(sensor, range(30, 60), copy), rest)
    # Set back in time alone, it forgets what it can't have measured yet.
    np.testing.assert_array_equal(emitted(sensor, range(30), context), first)


def test_an_estimate_at_a_tick_depends_on_no_earlier_question():
    sensor = faulty(ALL)
    asked = sensor.CreateDefaultContext()
    for tick in range(40):
        for context_time in (tick * T, (tick + 0.5) * T):
            asked.SetTime(context_time)
            set_inputs(sensor, asked, tick)
            outputs(sensor, asked)
        asked.SetTime(tick * T)
        update(sensor, asked)
    asked.SetTime(40 * T)
    set_inputs(sensor, asked, 40)
    np.testing.assert_array_equal(outputs(sensor, asked), emitted(sensor, range(41))[-1])


@pytest.mark.parametrize("faults", [WITHOUT_MEMORY, ALL], ids=["without memory", "all"])
def test_faults_are_a_function_of_the_seed_which_a_context_may_set(faults):
    sensor, other = faulty(faults, seed=3), faulty(faults, seed=4)
    found = emitted(sensor)
    np.testing.assert_array_equal(found, emitted(faulty(faults, seed=3)))
    assert not np.array_equal(found, emitted(other), equal_nan=True)
    context = sensor.CreateDefaultContext()
    context.get_mutable_numeric_parameter(0).SetAtIndex(0, 4)
    np.testing.assert_array_equal(emitted(sensor, context=context), emitted(other))


def test_nothing_has_arrived_before_the_delay():
    found = emitted(faulty(MeasurementFaults(delay=0.2)), range(8))
    assert np.all(found[:4, 0] == -np.inf)
    assert np.all(np.isnan(found[:4, 1:]))
    np.testing.assert_array_equal(found[4:, 0], np.arange(4) * T)
    np.testing.assert_array_equal(found[4:, 1:], emitted(NoisyPoseSensor(STD))[:4, 1:])


@pytest.mark.parametrize("freeze_rate", [0.0, 1e-9], ids=["without memory", "with memory"])
def test_what_is_not_a_number_is_emitted_as_it_is_with_its_time(freeze_rate):
    faults = MeasurementFaults(nan_probability=1.0, freeze_rate=freeze_rate)
    found = emitted(faulty(faults), range(5))
    assert np.all(np.isnan(found[:, 1:]))
    np.testing.assert_array_equal(found[:, 0], np.arange(5) * T)


def test_measured_rotations_are_rotations():
    found = emitted(faulty(ALL))
    rotations = [RotationMatrix(X[:, :3]) for X in found[:, 1:].reshape(-1, 3, 4)]
    valid = [R.IsValid() for R in rotations]
    np.testing.assert_array_equal(valid, ~np.isnan(found[:, 1]))
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
def test_unusable_arguments_are_named(arguments, message):
    with pytest.raises(InvalidArgumentError, match=message):
        NoisyPoseSensor(SensorConfig(faults=MeasurementFaults(sample_period=0.08)), **arguments)


@pytest.mark.parametrize("freeze_rate", [0.0, 1e-9], ids=["without memory", "with memory"])
def test_outputs_follow_a_seed_that_is_changed(freeze_rate):
    sensor = faulty(MeasurementFaults(degrees_of_freedom=2.0, freeze_rate=freeze_rate))
    context = sensor.CreateDefaultContext()
    set_inputs(sensor, context, 0)
    before = outputs(sensor, context)
    context.get_mutable_numeric_parameter(0).SetAtIndex(0, 4)
    assert not np.array_equal(outputs(sensor, context), before)


def test_outputs_follow_a_state_that_is_changed():
    sensor = faulty(MeasurementFaults(delay=0.2))
    context = sensor.CreateDefaultContext()
    emitted(sensor, range(10), context)
    assert outputs(sensor, context)[0] == pytest.approx(5 * T)
    empty = sensor.CreateDefaultContext().get_discrete_state(0).value()
    context.SetDiscreteState(0, empty)
    assert outputs(sensor, context)[0] == -np.inf
