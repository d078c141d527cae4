"""Seeded noise that holds still while a tick is worked on."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem, NumericParameterIndex

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.ticks import tick_index

MAX_SEED = 2**53
"""Largest seed: integers beyond it have no floats of their own."""


class NoiseSource(LeafSystem):
    """Emits independent standard normal numbers, new ones at each tick.

    .. pydrake_system::

        name: NoiseSource
        output_ports:
        - noise

    Port `noise` emits a vector of `size` numbers: a pure function of the seed and of the index of
    the last tick. So a Context that is set back, or copied, repeats its noise, and publish and
    update events of one tick see the same numbers. Drake's `RandomSource` moves on between them:
    it changes in an unrestricted update, after the publish events and before the discrete updates
    of that time, so the measurement that is logged there is not the one that is used.

    The seed is the numeric parameter 0 of the Context; its default is the argument `seed`.

    Args:
        size: How many numbers to emit.
        period: Seconds between ticks.
        seed: Default of the seed, an integer from 0 to 2**53: a parameter is a float.

    Raises:
        InvalidArgumentError: If `period` or `seed` is out of its range.
    """

    def __init__(self, *, size: int, period: float, seed: int = 0) -> None:
        super().__init__()
        if not period > 0:
            raise InvalidArgumentError(f"period must be greater than 0 s, not {period}")
        if not 0 <= seed <= MAX_SEED:
            raise InvalidArgumentError(f"seed must be from 0 to 2**53, not {seed}")
        self._period = period
        self._seed_index = NumericParameterIndex(
            self.DeclareNumericParameter(BasicVector([float(seed)]))
        )
        self.DeclareVectorOutputPort(
            "noise",
            size,
            self._calc_noise,
            {self.time_ticket(), self.numeric_parameter_ticket(self._seed_index)},
        )

    def _calc_noise(self, context: Context, output: BasicVector) -> None:
        seed = int(context.get_numeric_parameter(self._seed_index)[0])
        tick = tick_index(context.get_time(), self._period) % 2**63
        generator = np.random.default_rng((seed, tick))
        output.SetFromVector(generator.standard_normal(output.size()))
