"""Noisy and possibly faulty measurements of the object's pose, and the noise that they use."""

import math

import numpy as np
from pydrake.common import RandomDistribution
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
)

from drake_pregrasp.arrays import FloatArray, are_valid, first_tick, pack, tick_index, unpacker
from drake_pregrasp.config.sensor_config import (
    AnySensorConfig,
    Camera,
    SensorConfig,
    check_faults,
)
from drake_pregrasp.config.validation import checked
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.estimation import measurement_faults
from drake_pregrasp.geometry.rotations import rotation_matrix
from drake_pregrasp.systems.ports import POSE, Source, declare_cache, declare_output

MAX_SEED = 2**53
"""Largest seed: a numeric parameter is a float, which holds every integer up to this one."""

_NEAREST = 1e-9  # In place of a distance of zero to the camera, in metres.


def declare_seed(system: LeafSystem, seed: int) -> tuple[NumericParameterIndex, DependencyTicket]:
    """Declares the seed of a system's noise as its numeric parameter 0.

    Args:
        system: System that is being built.
        seed: Default of the seed, an integer from 0 to 2**53.

    Raises:
        InvalidArgumentError: If `seed` is out of its range.
    """
    if not 0 <= seed <= MAX_SEED:
        raise InvalidArgumentError(f"seed must be from 0 to 2**53, not {seed}")
    index = NumericParameterIndex(system.DeclareNumericParameter(BasicVector([float(seed)])))
    return index, system.numeric_parameter_ticket(index)


class NoiseSource(LeafSystem):
    """Emits independent standard normal numbers, new ones at each tick.

    .. pydrake_system::

        name: NoiseSource
        output_ports:
        - noise

    Port `noise` emits a vector of `size` numbers, a pure function of the seed and of the index of
    the last tick. A Context that is set back or copied therefore repeats its noise, and the publish
    and update events of one tick see the same numbers. Drake's `RandomSource` changes between those
    events, so a logger would see another measurement than the one that the planner used.

    The seed is the numeric parameter 0 of the Context; its default is the argument `seed`.

    Args:
        size: Number of elements of the port.
        period: Seconds between ticks, greater than zero.
        seed: Default of the seed, an integer from 0 to 2**53.

    Raises:
        InvalidArgumentError: If `period` or `seed` is out of its range.
    """

    def __init__(self, *, size: int, period: float, seed: int = 0) -> None:
        super().__init__()
        if not period > 0:
            raise InvalidArgumentError(f"period must be greater than 0 s, not {period}")
        self._period = period
        self._seed, seed_ticket = declare_seed(self, seed)
        self._size = size
        declare_output(self, "noise", size, self._calc_noise, self.time_ticket(), seed_ticket)

    def _calc_noise(self, context: Context) -> FloatArray:
        seed = int(context.get_numeric_parameter(self._seed)[0])
        tick = tick_index(context.get_time(), self._period) % 2**63
        return np.random.default_rng((seed, tick)).standard_normal(self._size)


class NoisyPoseSensor(LeafSystem):
    """Measures a pose with white noise, and with faults if the configuration has any.

    .. pydrake_system::

        name: NoisyPoseSensor
        input_ports:
        - X_WO
        - noise
        - visible_share
        output_ports:
        - X_WO_measured
        - measurement_time

    Port `X_WO` accepts a `RigidTransform`: the true pose of the object O in the world W.

    Port `noise` accepts a vector of 6 standard normal numbers, three for the position and three
    for the orientation. It is a random input of Drake; `NoiseSource` is the recommended source. If
    the noise is not finite, the measured pose is NaN.

    Port `visible_share` (optional, only with a `Camera`) accepts a vector of 1, as `VisibleShare`
    emits it. While it is below `least_visible`, and for `registration_gap` after that, nothing is
    measured.

    Port `X_WO_measured` emits a `RigidTransform`: the pose in W of the measured frame M, with
    p_WM = p_WO + position_std * noise[:3] and R_WM = Exp(orientation_std * noise[3:]) R_WO, changed
    by the faults (`faulty_disturbance`). For a `Camera`, the noise along the ray to the object has
    `ray_std` instead. It is the measurement that arrived last, and NaN before
    the first one arrives.

    Port `measurement_time` emits a vector of 1: the time at which the pose at `X_WO_measured` was
    measured, in seconds; -inf before the first measurement arrives. If nothing arrives at a tick,
    the time does not change, and receivers know that there is nothing new.

    Faults are a pure function of the seed and the tick, so a Context that is set back or copied
    repeats them. The seed is the numeric parameter 0 of the Context. A camera, and faults that
    concern time (dropouts, delay, jitter, freezing, a sample period), need discrete state: the
    sensor then measures at ticks only and holds each measurement until the next one. Otherwise the
    sensor has no state, the measured pose follows the true pose continuously, and its time is the
    Context's. In both cases the outputs at a tick are the same before and after the discrete
    update.

    Args:
        config: Noise and faults, or a `Camera`; `SensorConfig()` by default.
        period: Seconds between ticks, greater than zero; only faults and cameras need it.
        seed: Default of the faults' seed, an integer from 0 to 2**53.

    Raises:
        InvalidArgumentError: If the configuration, `period` or `seed` is out of its range.
    """

    NOISE_SIZE = 6

    def __init__(
        self,
        config: AnySensorConfig | None = None,
        *,
        period: float | None = None,
        seed: int = 0,
    ) -> None:
        super().__init__()
        config = checked(config or SensorConfig())
        self._stds: tuple[float | FloatArray, float] = config.position_std, config.orientation_std
        self._camera = config if isinstance(config, Camera) else None
        self._faults = config.faults if config.faults.are_any or self._camera else None
        self._X_WO = self.DeclareAbstractInputPort("X_WO", POSE)
        self._noise = self.DeclareInputPort(
            "noise", PortDataType.kVectorValued, self.NOISE_SIZE, RandomDistribution.kGaussian
        )
        time = self.time_ticket()
        sources: list[Source] = [self._X_WO, self._noise]
        if self._camera is not None:
            self._visible = self.DeclareVectorInputPort("visible_share", 1)
            sources.append(self._visible)
        if self._faults is not None:
            if period is None or not period > 0:
                raise InvalidArgumentError(f"faults need a period greater than 0 s, not {period}")
            check_faults(self._faults, period)
            self._period = period
            self._seed, seed_ticket = declare_seed(self, seed)
            sources += [time, seed_ticket]
        if self._faults is None or not (self._faults.need_memory or self._camera):
            declare_output(self, "X_WO_measured", POSE, self._measure, *sources)
            declare_output(self, "measurement_time", 1, Context.get_time, time)
            return
        empty = measurement_faults.SensorMemory.empty(self._faults, self._period)
        self._unpack = unpacker(empty)
        self._state = self.DeclareDiscreteState(pack(empty))
        stored = self.discrete_state_ticket(self._state)
        self._memory: CacheEntry = declare_cache(
            self, "memory at the Context's time", empty, self._calc_memory, *sources, stored
        )
        memory = self._memory
        declare_output(self, "X_WO_measured", POSE, self._arrived, memory)
        declare_output(self, "measurement_time", 1, lambda c: memory.Eval(c).stamp, memory)
        self.DeclarePeriodicDiscreteUpdateEvent(self._period, 0.0, self._store_memory)

    def _arrived(self, context: Context) -> RigidTransform:
        """Returns the pose that arrived last."""
        X_WM = self._memory.Eval(context).pose.reshape(3, 4)
        # NaN is no rotation matrix, and a checked constructor would raise an error.
        return RigidTransform(RotationMatrix.MakeUnchecked(X_WM[:, :3]), X_WM[:, 3])

    def _measure(self, context: Context) -> RigidTransform:
        """Returns the pose that is measured now, whenever it arrives."""
        X_WO: RigidTransform = self._X_WO.Eval(context)
        noise: FloatArray = self._noise.Eval(context)
        if not are_valid(noise):
            noise = np.full_like(noise, np.nan)
        scale, orientation_std = self._stds
        if self._camera is not None:
            scale = _scale(self._camera, X_WO.translation())
        offset = np.dot(scale, noise[:3])
        turn = rotation_matrix(orientation_std * noise[3:])
        if self._faults is not None:
            tick = tick_index(context.get_time(), self._period)
            if self._faults.act_at(tick, self._period):
                seed = int(context.get_numeric_parameter(self._seed)[0])
                offset, turn = measurement_faults.faulty_disturbance(
                    noise,
                    scale,
                    orientation_std,
                    self._faults,
                    tick=tick,
                    period=self._period,
                    seed=seed,
                )
        R_WM = RotationMatrix.MakeUnchecked(turn @ X_WO.rotation().matrix())
        return RigidTransform(R_WM, X_WO.translation() + offset)

    def _hidden(self, context: Context) -> int:
        """Returns the number of ticks at which a hidden object is not measured, from now on."""
        camera = self._camera
        if camera is None or not self._visible.HasValue(context):
            return 0
        if self._visible.Eval(context)[0] >= camera.least_visible:
            return 0
        return 1 + first_tick(camera.registration_gap, self._period)

    def _calc_memory(self, context: Context) -> measurement_faults.SensorMemory:
        assert self._faults is not None
        memory = self._unpack(context.get_discrete_state(self._state).value())
        time = context.get_time()
        tick = tick_index(time, self._period)
        if tick != memory.tick:
            memory = measurement_faults.next_memory(
                memory,
                self._measure(context).GetAsMatrix34().ravel(),
                time=time,
                tick=tick,
                faults=self._faults,
                period=self._period,
                seed=int(context.get_numeric_parameter(self._seed)[0]),
                hidden=self._hidden(context),
            )
        return memory

    def _store_memory(self, context: Context, discrete_state: DiscreteValues) -> None:
        discrete_state.set_value(self._state, pack(self._memory.Eval(context)))


def _scale(camera: Camera, p_WO: FloatArray) -> FloatArray:
    """Returns the scale of the position's noise for `faulty_disturbance`, shape (3, 3)."""
    ray = p_WO - camera.position
    ray /= max(math.hypot(*ray), _NEAREST)
    across = camera.position_std
    scale: FloatArray = across * np.eye(3) + (camera.ray_std - across) * np.outer(ray, ray)
    return scale
