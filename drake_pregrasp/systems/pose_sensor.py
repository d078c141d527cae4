"""A noisy, and possibly faulty, measurement of the object's pose."""

from pydrake.common import RandomDistribution
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import (
    BasicVector,
    CacheEntry,
    Context,
    DependencyTicket,
    DiscreteValues,
    LeafSystem,
    NumericParameterIndex,
    PortDataType,
    ValueProducer,
)

from drake_pregrasp.arrays import FloatArray, pack, unpack
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.estimation.fault_settings import MeasurementFaults, find_flaw
from drake_pregrasp.estimation.measurement_faults import (
    SensorMemory,
    faulty_disturbance,
    next_memory,
)
from drake_pregrasp.geometry.rotations import rotation_matrix
from drake_pregrasp.systems.noise_source import MAX_SEED
from drake_pregrasp.ticks import tick_index


class NoisyPoseSensor(LeafSystem):
    """Measures a pose with white noise and, optionally, faults.

    .. pydrake_system::

        name: NoisyPoseSensor
        input_ports:
        - X_WO
        - noise
        output_ports:
        - X_WO_measured
        - measurement_time

    Port `X_WO` accepts a `RigidTransform`: the true pose of the object O in the world W.

    Port `noise` accepts a vector of 6 standard normal numbers, three for the position and three
    for the orientation. It is a random input in Drake's sense; `NoiseSource` explains why that
    system is the better source for it.

    Port `X_WO_measured` emits a `RigidTransform` M with p_WM = p_WO + position_std * noise[:3] and
    R_WM = Exp(orientation_std * noise[3:]) R_WO; for the effect of faults see `faulty_disturbance`.
    M is the measurement that arrived last, and NaN while none has.

    Port `measurement_time` emits a vector of 1: the time at which the pose at `X_WO_measured` was
    taken, in seconds, and -inf while none has arrived. At a tick without an arrival it does not
    change; an unchanged time means that there is no new measurement.

    Faults are a function of the seed and the tick, so a Context that is set back, or copied,
    repeats them. The seed is the numeric parameter 0 of the Context. With faults that concern time
    (dropouts, delay, jitter, freezing, a sample period) the sensor has discrete state, measures at
    ticks only, and holds the measurement between them. There is no lag: at a tick the outputs are
    the same before the discrete update and after it. `next_memory` defines which measurement
    arrives when. Other faults need no state; the measured pose then follows the true one, and its
    time is the Context's, as without faults.

    Args:
        position_std: Standard deviation per axis, in metres; with heavy-tailed faults the scale of
            Student's t.
        orientation_std: Standard deviation per axis of the rotation vector, in radians; with
            heavy-tailed faults the scale of Student's t.
        period: Seconds between ticks; needed for faults only.
        seed: Default of the faults' seed, an integer from 0 to 2**53.
        faults: Faults of the sensor; none by default. Without faults there is neither state nor
            parameter.

    Raises:
        InvalidArgumentError: If there are faults, and they, `period` or `seed` are out of range.
    """

    NOISE_SIZE = 6

    def __init__(
        self,
        *,
        position_std: float,
        orientation_std: float,
        period: float | None = None,
        seed: int = 0,
        faults: MeasurementFaults | None = None,
    ) -> None:
        super().__init__()
        self._position_std = position_std
        self._orientation_std = orientation_std
        self._X_WO = self.DeclareAbstractInputPort("X_WO", AbstractValue.Make(RigidTransform()))
        self._noise = self.DeclareInputPort(
            "noise", PortDataType.kVectorValued, self.NOISE_SIZE, RandomDistribution.kGaussian
        )
        self._faults = faults if faults is not None and faults.are_any else None
        self._memory: CacheEntry | None = None
        sources = {self._X_WO.ticket(), self._noise.ticket()}
        times = {self.time_ticket()}
        if self._faults is not None:
            self._period = _checked_period(self._faults, period)
            sources |= {self.time_ticket(), self._declare_seed(seed)}
            if self._faults.need_memory:
                self._memory = self._declare_memory(self._faults, sources)
                sources = times = {self._memory.ticket()}
        self.DeclareAbstractOutputPort(
            "X_WO_measured",
            lambda: AbstractValue.Make(RigidTransform()),
            self._calc_measured_pose,
            sources,
        )
        self.DeclareVectorOutputPort("measurement_time", 1, self._calc_measurement_time, times)

    def _declare_seed(self, seed: int) -> DependencyTicket:
        if not 0 <= seed <= MAX_SEED:
            raise InvalidArgumentError(f"seed must be from 0 to 2**53, not {seed}")
        index = self.DeclareNumericParameter(BasicVector([float(seed)]))
        self._seed_index = NumericParameterIndex(index)
        return self.numeric_parameter_ticket(self._seed_index)

    def _declare_memory(
        self, faults: MeasurementFaults, sources: set[DependencyTicket]
    ) -> CacheEntry:
        self._empty = SensorMemory.empty(faults, self._period)
        self._state_index = self.DeclareDiscreteState(pack(self._empty))
        self.DeclarePeriodicDiscreteUpdateEvent(self._period, 0.0, self._store_memory)
        return self.DeclareCacheEntry(
            "memory at the Context's time",
            ValueProducer(lambda: AbstractValue.Make(self._empty), self._calc_memory),
            sources | {self.discrete_state_ticket(self._state_index)},
        )

    def _calc_measured_pose(self, context: Context, output: AbstractValue) -> None:
        if self._memory is None:
            output.set_value(self._measure(context))
        else:
            memory: SensorMemory = self._memory.Eval(context)
            X_WM = memory.pose.reshape(3, 4)
            # NaN would not pass the check of a rotation matrix.
            R_WM = RotationMatrix.MakeUnchecked(X_WM[:, :3])
            output.set_value(RigidTransform(R_WM, X_WM[:, 3]))

    def _calc_measurement_time(self, context: Context, output: BasicVector) -> None:
        if self._memory is None:
            output.SetFromVector([context.get_time()])
        else:
            memory: SensorMemory = self._memory.Eval(context)
            output.SetFromVector([memory.stamp])

    def _measure(self, context: Context) -> RigidTransform:
        """Returns the pose that is measured now, at whatever time it arrives."""
        X_WO: RigidTransform = self._X_WO.Eval(context)
        noise: FloatArray = self._noise.Eval(context)
        offset = self._position_std * noise[:3]
        turn = rotation_matrix(self._orientation_std * noise[3:])
        if self._faults is not None:
            tick = tick_index(context.get_time(), self._period)
            if self._faults.act_at(tick, self._period):
                offset, turn = faulty_disturbance(
                    noise,
                    self._position_std,
                    self._orientation_std,
                    self._faults,
                    tick=tick,
                    seed=self._seed(context),
                )
        R_WM = RotationMatrix.MakeUnchecked(turn) @ X_WO.rotation()
        return RigidTransform(R_WM, X_WO.translation() + offset)

    def _seed(self, context: Context) -> int:
        return int(context.get_numeric_parameter(self._seed_index)[0])

    def _calc_memory(self, context: Context, output: AbstractValue) -> None:
        assert self._faults is not None
        memory = unpack(self._empty, context.get_discrete_state(self._state_index).value())
        time = context.get_time()
        tick = tick_index(time, self._period)
        if tick != memory.tick:
            memory = next_memory(
                memory,
                self._measure(context).GetAsMatrix34().ravel(),
                time=time,
                tick=tick,
                faults=self._faults,
                period=self._period,
                seed=self._seed(context),
            )
        output.set_value(memory)

    def _store_memory(self, context: Context, discrete_state: DiscreteValues) -> None:
        assert self._memory is not None
        memory: SensorMemory = self._memory.Eval(context)
        discrete_state.set_value(self._state_index, pack(memory))


def _checked_period(faults: MeasurementFaults, period: float | None) -> float:
    if period is None or not period > 0:
        raise InvalidArgumentError(f"faults need a period greater than 0 s, not {period}")
    flaw = find_flaw(faults, period)
    if flaw is not None:
        raise InvalidArgumentError(f"faults.{flaw.name}: {flaw.problem}")
    return period
