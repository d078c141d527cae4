"""Interception of a moving object: when and where a palm meets it."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray, norms
from drake_pregrasp.grasping.catch_limits import CatchLimit
from drake_pregrasp.grasping.palm_paths import (
    Meeting,
    PalmLimits,
    clear_times,
    descent_shares,
    path_shares,
    turning_points,
)

NUM_TIMES = 200
"""Number of meeting times that are compared."""

DESCENTS = np.array([7, 10, 14, 20, 28, 40, 56, 80])
"""Durations for which the palm's axis goes through the object, as numbers of steps between meeting
times."""

RISES = np.array([0.0, 0.015, 0.03, 0.045, 0.06])
"""Heights above the lowest one at which the palm may be over the object, in metres."""

TOLERANCE = 0.01
"""Standard deviation of the object's position that costs 1, in metres."""

MARGIN = 0.1
"""Distance from the limits of the travel from which on it costs nothing, in metres."""

PERSISTENCE = 0.8
"""Share of its cost with which the present meeting is compared with others."""

EXCESS = 1.1
"""Ratio to a limit of speed or acceleration up to which a meeting that was chosen stays: estimates
vary."""

_INSTANT = 1e-6  # Duration below which rounding decides on the rates of a path, in seconds.


@dataclass(frozen=True, eq=False)
class MeetingSettings:
    """Settings of an interception; times in seconds, lengths in metres.

    Attributes:
        limits: Limits of the palm.
        step: Time between meeting times that are compared, which are multiples of it.
        earliest: Least time until a meeting.
        lateness: Cost of a second until the meeting; if it is negative, of a second less than the
            last meeting time.
        follow: Time for which the hand moves with the object after the meeting, until it has
            gripped it.
        stop: Duration of the constant deceleration to rest after that.
        height: Least height of the palm over its place at the object at which fingertips are clear
            of the object.
        sideways: Largest offset sideways at which fingertips may be beside the object.
        grip: Largest acceleration that the fingers can give to the object, in m/s².
        gravity: Acceleration of gravity along the axes of A, shape (3,), in m/s².
        diffusion: Spectral density of the object's random acceleration, in m²/s³.
    """

    limits: PalmLimits
    step: float
    earliest: float
    lateness: float
    follow: float
    stop: float
    height: float
    sideways: float
    grip: float
    gravity: FloatArray
    diffusion: float


class Choice(NamedTuple):
    """Meeting that was chosen.

    Attributes:
        limit: What prevents every meeting; NONE if one was chosen.
        over: Time from which on the palm's axis goes through the object, in seconds; NaN without a
            meeting.
        time: Time of the meeting, in seconds; NaN without one.
        height: Height of the palm over its place at `over`, in metres; 0 for a palm that goes to
            the object without a stop over it.
    """

    limit: CatchLimit
    over: float
    time: float
    height: float


CHECKS = (
    CatchLimit.REACH,
    CatchLimit.SPEED,
    CatchLimit.ACCELERATION,
    CatchLimit.GRIP,
    CatchLimit.TIME,
)
"""Limits of the object's own motion at a meeting, in the order in which they are checked."""


class _Prediction(NamedTuple):
    """Predicted motion of the object at the meeting times, each of shape (times, 3).

    Attributes:
        p_met: Positions at the meeting, in metres.
        v_met: Velocities at the meeting, in m/s.
        p_gripped: Positions when the hand has gripped, in metres.
        v_gripped: Velocities when the hand has gripped, in m/s.
        p_stopped: Positions when the hand has stopped, in metres.
    """

    p_met: FloatArray
    v_met: FloatArray
    p_gripped: FloatArray
    v_gripped: FloatArray
    p_stopped: FloatArray


def _predicted(motion: FloatArray, tau: FloatArray, settings: MeetingSettings) -> _Prediction:
    (x, v, a), t, f = motion, tau[:, None], settings.follow
    p_met, v_met = x + t * v + t**2 / 2 * a, v + t * a
    p_gripped, v_gripped = p_met + f * v_met + f**2 / 2 * a, v_met + f * a
    p_stopped = p_gripped + settings.stop / 2 * v_gripped
    return _Prediction(p_met, v_met, p_gripped, v_gripped, p_stopped)


def choose_meeting(
    offset: FloatArray,
    motion: FloatArray,
    variance: float,
    now: float,
    kept: Meeting,
    settings: MeetingSettings,
) -> Choice:
    """Chooses the meeting of lowest cost among all times and descents within the limits.

    A meeting costs its lateness, the squares of the largest shares of the limits of speed and
    acceleration, the standard deviation of the object's position then, and a small margin of reach.

    Args:
        offset: Offset of the palm from the object, its velocity and acceleration, shape (3, 3).
        motion: Position, velocity and acceleration of the object, shape (3, 3).
        variance: Variance of the object's estimated position, the sum over axes, in m².
        now: Present time, in seconds.
        kept: Present plan, which is kept unless another one is clearly better.
        settings: Settings of the interception.
    """
    first, tau = meeting_times(now, settings.step)
    prediction = _predicted(motion, tau, settings)
    limit, possible = _possible_times(motion, tau, prediction, settings)
    if limit != CatchLimit.NONE:
        return no_meeting(limit)
    speed, acceleration, is_out = _paths(offset, motion, tau, prediction, settings)
    worst = np.where(is_out | ~possible[:, None], np.inf, np.maximum(speed, acceleration))
    row, column = np.unravel_index(int(np.argmin(worst)), worst.shape)
    if (least := float(worst[row, column])) > 1:
        return no_meeting(limit_of_paths(least, speed[row, column] >= acceleration[row, column]))
    cost = _cost_of_times(variance, tau, prediction, settings)[:, None] + speed**2 + acceleration**2
    cost[worst > 1] = np.inf
    if (place := place_of(kept, now, first, settings)) is not None:
        cost[place] *= PERSISTENCE
    row, column = np.unravel_index(int(np.argmin(cost)), cost.shape)
    return meeting_at(int(row), int(column), first, settings)


def rest_limit(
    offset: FloatArray, motion: FloatArray, now: float, plan: Meeting, settings: MeetingSettings
) -> CatchLimit:
    """Returns what prevents the rest of a chosen meeting, and what follows it; NONE if nothing.

    Speeds and accelerations may exceed their limits by the factor `EXCESS`.

    Args:
        offset: Offset of the palm from the object, its velocity and acceleration, shape (3, 3).
        motion: Position, velocity and acceleration of the object, shape (3, 3).
        now: Present time, in seconds. If it is that of the meeting, no path is left.
        plan: Plan of the meeting.
        settings: Settings of the interception.
    """
    limits = settings.limits
    speed, acceleration = EXCESS * limits.speed, EXCESS * limits.acceleration
    limits = replace(limits, speed=speed, acceleration=acceleration)
    settings = replace(settings, limits=limits, earliest=0.0)
    tau = np.array([max(0.0, plan.time - now)])
    prediction = _predicted(motion, tau, settings)
    limit, _ = _possible_times(motion, tau, prediction, settings)
    if limit != CatchLimit.NONE or tau[0] < _INSTANT:
        return limit
    is_before = plan.over - now > _INSTANT
    begun, height = (np.array([plan.over - now]), plan.height) if is_before else (tau, 0.0)
    up = height * np.eye(3)[0]
    shares = [path_shares(offset[:, i], motion[:, i], begun, i, limits) for i in range(2)]
    end = begun if height else tau
    shares.append(path_shares(offset[:, 2] - up, motion[:, 2] + up, end, 2, limits))
    if height:
        rates = np.abs(motion[1, 2] + np.append(begun, tau) * motion[2, 2])
        shares.append(descent_shares(np.max(rates), height, tau - begun, motion[2, 2], limits))
    slow, weak, out = np.max(shares, axis=0)[:, 0]
    if out or _turn_outside(motion, begun, tau, limits, height)[0]:
        return CatchLimit.REACH
    return limit_of_paths(max(slow, weak), slow >= weak) if max(slow, weak) > 1 else limit


def meeting_times(now: float, step: float) -> tuple[int, FloatArray]:
    """Returns the first meeting time as a number of steps, and the seconds until all of them."""
    first = math.floor(now / step + 1e-9) + 1
    tau: FloatArray = step * np.arange(first, first + NUM_TIMES, dtype=float) - now
    return first, tau


def no_meeting(limit: CatchLimit) -> Choice:
    """Returns the choice if something prevents every meeting."""
    return Choice(limit, np.nan, np.nan, 0.0)


def limit_of_paths(least: float, is_slow: bool) -> CatchLimit:
    """Returns what prevents every path to possible meetings.

    Args:
        least: Share of a limit on the path that exceeds limits least; infinite if all paths leave
            the travel.
        is_slow: Whether that limit is the speed.
    """
    if least == np.inf:
        return CatchLimit.REACH
    return CatchLimit.SPEED if is_slow else CatchLimit.ACCELERATION


def meeting_at(row: int, column: int, first: int, settings: MeetingSettings) -> Choice:
    """Returns the meeting in a row and a column of `_paths`."""
    time = settings.step * (first + row)
    if column == 0:
        return Choice(CatchLimit.NONE, time, time, 0.0)
    descent, rise = divmod(column - 1, 1 + len(RISES))
    over = settings.step * (first + row - int(DESCENTS[descent]))
    height = float(settings.height + RISES[rise - 1]) if rise else 0.0
    return Choice(CatchLimit.NONE, over, time, height)


def place_of(
    kept: Meeting, now: float, first: int, settings: MeetingSettings
) -> tuple[int, int] | None:
    """Returns the row and the column of a plan in `_paths`; None if it is not among them."""
    if not kept.meets:
        return None
    row, column = round(kept.time / settings.step) - first, 0
    before = round((kept.time - kept.over) / settings.step)
    if before in DESCENTS and kept.over > now:
        rise = int(np.argmin(np.abs(settings.height + RISES - kept.height)))
        rise = 1 + rise if kept.height > 0 else 0
        column = 1 + (1 + len(RISES)) * int(np.argmax(before == DESCENTS)) + rise
    return (row, column) if 0 <= row < NUM_TIMES else None


def _turn_outside(
    motion: FloatArray, begin: FloatArray, end: FloatArray, limits: PalmLimits, height: float = 0.0
) -> BoolArray:
    """Returns whether the object's coordinates have an extreme outside the travel, shape (...).

    Args:
        motion: Position, velocity and acceleration of the object, shape (3, 3).
        begin: Times from which on the palm moves with it, shape (...), in seconds.
        end: Times until which it does, shape (...), in seconds.
        limits: Limits of the palm.
        height: Largest height of the palm over the object in that time, in metres.
    """
    time, place = turning_points(motion)
    highest = place + np.array([0.0, 0.0, height])
    is_outside = (place < limits.lower) | (highest > limits.upper)
    turns = (begin[..., None] < time) & (time < end[..., None])
    return np.asarray(np.any(turns & is_outside, axis=-1))


def _inside(points: FloatArray, limits: PalmLimits) -> BoolArray:
    inside: BoolArray = np.all((limits.lower <= points) & (points <= limits.upper), axis=1)
    return inside


def _possible_times(
    motion: FloatArray, tau: FloatArray, prediction: _Prediction, settings: MeetingSettings
) -> tuple[CatchLimit, BoolArray]:
    """Returns at which times the object itself can be met, or what prevents it at all times."""
    limits = settings.limits
    reached = (tau >= settings.earliest) & _inside(prediction.p_met, limits)
    possible = np.ones(len(tau), dtype=bool)
    # The palm moves with the object until it has gripped it, and then comes to rest.
    gripped = np.abs(prediction.v_gripped)
    speeds = np.maximum(np.abs(prediction.v_met), gripped)
    accelerations = np.maximum(np.abs(motion[2]), gripped / settings.stop)
    checks = (
        reached,
        np.all(speeds <= limits.speed, axis=1),
        np.all(accelerations <= limits.acceleration, axis=1),
        norms(prediction.v_gripped) <= settings.stop * settings.grip,
        _inside(prediction.p_gripped, limits)
        & _inside(prediction.p_stopped, limits)
        & ~_turn_outside(motion, tau, tau + settings.follow, limits),
    )
    for limit, holds in zip(CHECKS, checks, strict=True):
        possible &= holds
        if not possible.any():
            return limit, possible
    return CatchLimit.NONE, possible


def _paths(
    offset: FloatArray,
    motion: FloatArray,
    tau: FloatArray,
    prediction: _Prediction,
    settings: MeetingSettings,
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Returns shares of the limits on all paths to the object.

    The rows are meeting times. The first column is the path that ends sideways and along the palm's
    axis together. Then, for each of the `DESCENTS`, come the path that ends sideways so much
    earlier, while the palm is still clear of the object, and those that stop over it at each
    height.

    Returns:
        Shares of the largest speed, of the largest acceleration, and whether a path leaves the
        travel.
    """
    limits, step, heights = settings.limits, settings.step, settings.height + RISES
    level = [path_shares(offset[:, axis], motion[:, axis], tau, axis, limits) for axis in range(2)]
    direct = path_shares(offset[:, 2], motion[:, 2], tau, 2, limits)
    up = [np.array([height, 0.0, 0.0]) for height in heights]
    raised = [path_shares(offset[:, 2] - h, motion[:, 2] + h, tau, 2, limits) for h in up]
    sideways, over = np.max(level, axis=0), np.stack(raised, axis=2)
    earlier = np.arange(NUM_TIMES)[:, None] - DESCENTS
    begun, down = np.maximum(earlier, 0), step * DESCENTS[:, None]
    rates = np.abs(prediction.v_met[:, 2])  # The largest is at one of the ends of the descent.
    rates = np.maximum(rates[begun], rates[:, None])[:, :, None]
    stops = descent_shares(rates, heights, down, motion[2, 2], limits)
    passes = np.broadcast_to(direct[:, :, None, None], (*stops.shape[:3], 1))
    paths = np.concatenate([passes, stops], axis=3)
    paths[..., 1:] = np.maximum(paths[..., 1:], over[:, begun])
    paths = np.maximum(paths, sideways[:, begun][..., None])
    paths[2] = np.maximum(paths[2], (earlier < 0)[..., None])
    with_it = tau[begun], tau[:, None], limits
    paths[2] += np.stack([_turn_outside(motion, *with_it, h) for h in (0.0, *heights)], axis=2)
    # A palm that does not stop over the object is on its axis before it is beside the object.
    clear = clear_times(offset[:, 2], tau, settings.height)
    paths[2, :, :, 0] = np.maximum(paths[2, :, :, 0], tau[begun] > clear[:, None])
    first = np.maximum(sideways, direct)
    aside = np.max(np.abs(offset[0, :2]) + tau[:, None] * np.abs(offset[1, :2]), axis=1)
    first[2] = np.maximum(first[2], aside > settings.sideways)
    speed, acceleration, out = np.concatenate(
        [first[:, :, None], paths.reshape(3, NUM_TIMES, -1)], axis=2
    )
    return speed, acceleration, out > 0


def _cost_of_times(
    variance: float, tau: FloatArray, prediction: _Prediction, settings: MeetingSettings
) -> FloatArray:
    """Returns what meetings cost that depends on their times only, shape (times,)."""
    limits, both = settings.limits, np.stack([prediction.p_met, prediction.p_stopped])
    room = np.min(np.minimum(both - limits.lower, limits.upper - both), axis=(0, 2))
    spread = np.sqrt(variance + settings.diffusion * tau**3)
    late = settings.lateness * tau
    late = late - min(0.0, late[-1])  # No cost is negative, as PERSISTENCE is a share of it.
    cost: FloatArray = late + spread / TOLERANCE + 1 - np.clip(room / MARGIN, 0, 1)
    return cost
