"""When measurements are taken, lost, frozen, and when they arrive.

Each is a function of the seed and the tick. While faults don't act, a measurement is taken at each
tick, and arrives at once.
"""

from drake_pregrasp.planning.fault_bursts import in_burst
from drake_pregrasp.planning.fault_draws import FaultChannel, fault_generator
from drake_pregrasp.planning.fault_settings import MeasurementFaults
from drake_pregrasp.planning.ticks import first_tick


def is_taken(tick: int, faults: MeasurementFaults, period: float) -> bool:
    """Returns whether a measurement is taken at a tick.

    Turn n is at n * sample_period, and its measurement is taken at the first tick that isn't
    earlier.

    Args:
        tick: Its index.
        faults: Of which the sample period counts, at least `period`; with 0 each tick has one.
        period: Seconds between ticks.
    """
    if not faults.sample_period or not faults.act_at(tick, period):
        return True
    turn = first_tick(tick * period, faults.sample_period)
    return tick in (first_tick(n * faults.sample_period, period) for n in (turn - 1, turn))


def arrival_tick(tick: int, faults: MeasurementFaults, period: float, seed: int) -> int:
    """Returns at which tick a measurement arrives: the first one after delay and jitter.

    Args:
        tick: Index of the tick at which it is taken.
        faults: Of which delay and jitter count.
        period: Seconds between ticks.
        seed: Of the random numbers.
    """
    if not faults.act_at(tick, period):
        return tick
    share = fault_generator(seed, tick, FaultChannel.JITTER).random()
    return tick + first_tick(faults.delay + share * faults.jitter, period)


def is_frozen(tick: int, faults: MeasurementFaults, period: float, seed: int) -> bool:
    """Returns whether the value is frozen at a tick.

    Args:
        tick: Its index.
        faults: Of which `freeze_rate` and `freeze_duration` count.
        period: Seconds between ticks.
        seed: Of the random numbers.
    """
    return faults.act_at(tick, period) and in_burst(
        tick,
        rate=faults.freeze_rate,
        duration=faults.freeze_duration,
        period=period,
        seed=seed,
        channel=FaultChannel.FREEZING,
    )


def is_occluded(tick: int, faults: MeasurementFaults, period: float, seed: int) -> bool:
    """Returns whether a measurement of a tick is lost.

    Args:
        tick: Its index.
        faults: Of which `dropout_rate` and `dropout_duration` count.
        period: Seconds between ticks.
        seed: Of the random numbers.
    """
    return faults.act_at(tick, period) and in_burst(
        tick,
        rate=faults.dropout_rate,
        duration=faults.dropout_duration,
        period=period,
        seed=seed,
        channel=FaultChannel.DROPOUTS,
    )
