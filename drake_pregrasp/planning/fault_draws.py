"""Random numbers for faults, as a function of the seed and the tick."""

from enum import IntEnum

import numpy as np


class FaultChannel(IntEnum):
    """What a fault's random numbers are for.

    They start at 1: numpy takes the entropy (seed, tick, 0) for (seed, tick), which is that of the
    measurement noise.
    """

    TAILS = 1
    OUTLIERS = 2
    DROPOUTS = 3
    JITTER = 4
    FREEZING = 5
    SIGN_FLIPS = 6
    NAN = 7


def fault_generator(seed: int, tick: int, channel: FaultChannel) -> np.random.Generator:
    """Returns a generator that starts anew: the same arguments give the same numbers.

    Args:
        seed: At least 0.
        tick: Index of the planning tick, of either sign.
        channel: Different ones have independent numbers.
    """
    return np.random.default_rng((seed, tick % 2**63, int(channel)))
