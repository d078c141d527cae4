"""Compiled choice of a meeting of palm and object."""

import math

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.fast.compiling import compiled
from drake_pregrasp.grasping.interception import (
    CHECKS,
    DESCENTS,
    MARGIN,
    NUM_TIMES,
    PERSISTENCE,
    RISES,
    TOLERANCE,
    Choice,
    MeetingSettings,
    limit_of_paths,
    meeting_at,
    meeting_times,
    no_meeting,
    place_of,
)
from drake_pregrasp.grasping.palm_paths import (
    BASIS,
    FINENESS,
    JERK_RANGE,
    PEAK_ACCELERATION,
    PEAK_SPEED,
    SAMPLES,
    SNAP_ENDS,
    Meeting,
    turning_points,
)

_NUM_DESCENTS, _NUM_RISES = len(DESCENTS), len(RISES)
_STEPS = DESCENTS.astype(np.int64)
# Rows of samples, so that loops over samples become vector instructions.
_B0, _B1, _B2 = (np.ascontiguousarray(BASIS[k]) for k in range(3))
_S = np.arange(SAMPLES + 1) / SAMPLES


@compiled()
def path_shares(d0, d1, d2, x, v, a, T, low, high, speed_limit, acceleration_limit):  # type: ignore[no-untyped-def]
    """Returns shares of the limits of speed and acceleration on a path, as `peaks`.

    The second one is infinite if the path leaves the travel.

    Args:
        d0: Offset along one axis at the start, in metres.
        d1: Its rate, in m/s.
        d2: Its acceleration, in m/s².
        x: Position of the object at the start, in metres.
        v: Its velocity, in m/s.
        a: Its acceleration, in m/s².
        T: Duration of the path, in seconds.
        low: Smallest coordinate of the palm, in metres.
        high: Largest coordinate of the palm, in metres.
        speed_limit: Largest speed, in m/s.
        acceleration_limit: Largest acceleration, in m/s².
    """
    c0, c1, c2, per = d0, d1 * T, d2 * T * T, 1 / T
    speed = acceleration = 0.0
    lowest, highest = np.inf, -np.inf
    for i in range(SAMPLES + 1):
        t = T * _S[i]
        place = x + t * (v + t / 2 * a) + c0 * _B0[0, i] + c1 * _B0[1, i] + c2 * _B0[2, i]
        rate = v + t * a + per * (c0 * _B1[0, i] + c1 * _B1[1, i] + c2 * _B1[2, i])
        change = a + per * per * (c0 * _B2[0, i] + c1 * _B2[1, i] + c2 * _B2[2, i])
        lowest, highest = min(lowest, place), max(highest, place)
        speed, acceleration = max(speed, abs(rate)), max(acceleration, abs(change))
    snap = jerk = 0.0
    for i in range(2):
        ends = c0 * SNAP_ENDS[0, i] + c1 * SNAP_ENDS[1, i] + c2 * SNAP_ENDS[2, i]
        snap = max(snap, abs(ends))
    for i in range(3):
        part = c0 * JERK_RANGE[0, i] + c1 * JERK_RANGE[1, i] + c2 * JERK_RANGE[2, i]
        jerk = max(jerk, abs(part))
    acceleration += FINENESS * snap * per * per
    speed += FINENESS * jerk * per
    slack = FINENESS * acceleration * T * T
    if lowest - slack < low or highest + slack > high:
        return speed / speed_limit, np.inf
    return speed / speed_limit, acceleration / acceleration_limit


@compiled()
def clear_time(d0, d1, d2, T, height):  # type: ignore[no-untyped-def]
    """Returns until when a quintic to zero stays above a height, as `clear_times`.

    Args:
        d0: Value at the start, in metres.
        d1: Its rate, in m/s.
        d2: Its acceleration, in m/s².
        T: Duration of the quintic, in seconds.
        height: The height, in metres, above 0.
    """
    c0, c1, c2 = d0, d1 * T, d2 * T * T
    bend = snap = 0.0
    for i in range(SAMPLES + 1):
        bend = max(bend, abs(c0 * _B2[0, i] + c1 * _B2[1, i] + c2 * _B2[2, i]))
    for i in range(2):
        snap = max(snap, abs(c0 * SNAP_ENDS[0, i] + c1 * SNAP_ENDS[1, i] + c2 * SNAP_ENDS[2, i]))
    least = height + FINENESS * (bend + FINENESS * snap)
    before = 0.0
    for i in range(SAMPLES + 1):
        room = c0 * _B0[0, i] + c1 * _B0[1, i] + c2 * _B0[2, i] - least
        if room < 0:
            return T / SAMPLES * (i - 1 + before / (before - room)) if i else -T / SAMPLES
        before = room
    return T


@compiled()
def room_at(x, v, a, t, lower, upper):  # type: ignore[no-untyped-def]
    """Returns the least distance of the object after a time from the limits, in metres.

    Args:
        x: Position of the object, shape (3,), in metres.
        v: Its velocity, shape (3,), in m/s.
        a: Its acceleration, shape (3,), in m/s².
        t: The time, in seconds.
        lower: Smallest coordinates of the palm, shape (3,), in metres.
        upper: Largest coordinates of the palm, shape (3,), in metres.
    """
    room = np.inf
    for axis in range(3):
        place = x[axis] + t * (v[axis] + t / 2 * a[axis])
        room = min(room, min(place - lower[axis], upper[axis] - place))
    return room


@compiled()
def turns_outside(turn, place, begin, end, height, lower, upper):  # type: ignore[no-untyped-def]
    """Returns whether a coordinate of the object has an extreme outside the travel.

    Args:
        turn: Times of the extremes, shape (3,), in seconds.
        place: Coordinates then, shape (3,), in metres.
        begin: Time from which on the palm moves with the object, in seconds.
        end: Time until which it does, in seconds.
        height: Largest height of the palm over the object in that time, in metres.
        lower: Smallest coordinates of the palm, shape (3,), in metres.
        upper: Largest coordinates of the palm, shape (3,), in metres.
    """
    for axis in range(3):
        up = height if axis == 2 else 0.0
        is_outside = place[axis] < lower[axis] or place[axis] + up > upper[axis]
        if is_outside and begin < turn[axis] < end:
            return True
    return False


@compiled(
    "void(f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1],"
    " f8[::1], i8[::1])"
)
def write_possible(  # type: ignore[no-untyped-def]
    motion, turn, place, tau, numbers, lower, upper, speed, acceleration, cost, passed
):
    """Writes what meetings cost by their times, infinite where the object cannot be met.

    Args:
        motion: Position, velocity and acceleration of the object, shape (3, 3).
        turn: Times of the extremes of its coordinates, shape (3,), in seconds.
        place: Coordinates then, shape (3,), in metres.
        tau: Times until the meetings, shape (times,), in seconds.
        numbers: `earliest`, `lateness`, `follow`, `stop`, `grip`, `diffusion` and the variance.
        lower: Smallest coordinates of the palm, shape (3,), in metres.
        upper: Largest coordinates of the palm, shape (3,), in metres.
        speed: Largest speeds, shape (3,), in m/s.
        acceleration: Largest accelerations, shape (3,), in m/s².
        cost: Result, shape (times,).
        passed: Result: number of times that pass each of the checks, in order, shape (5,).
    """
    x, v, a = motion
    earliest, lateness, follow, stop, grip, diffusion, variance = numbers
    least, passed[:] = min(0.0, lateness * tau[-1]), 0
    for k in range(len(tau)):
        t, cost[k] = tau[k], np.inf
        here = room_at(x, v, a, t, lower, upper)
        if not (t >= earliest and here >= 0):
            continue
        passed[0] += 1
        keeps_up, is_within = True, True
        for axis in range(3):
            rate = abs(v[axis] + (t + follow) * a[axis])
            keeps_up &= max(rate, abs(v[axis] + t * a[axis])) <= speed[axis]
            is_within &= max(rate / stop, abs(a[axis])) <= acceleration[axis]
        if not keeps_up:
            continue
        passed[1] += 1
        if not is_within:
            continue
        passed[2] += 1
        squares, left, there = 0.0, np.inf, np.inf
        for axis in range(3):
            rate = v[axis] + (t + follow) * a[axis]
            gripped = x[axis] + t * v[axis] + t * t / 2 * a[axis]
            gripped += follow * (v[axis] + t * a[axis]) + follow * follow / 2 * a[axis]
            end = gripped + stop / 2 * rate
            squares += rate * rate
            left = min(left, min(gripped - lower[axis], upper[axis] - gripped))
            there = min(there, min(end - lower[axis], upper[axis] - end))
        if not math.sqrt(squares) <= stop * grip:
            continue
        passed[3] += 1
        if not (left >= 0 and there >= 0):
            continue
        if turns_outside(turn, place, t, t + follow, 0.0, lower, upper):
            continue
        passed[4] += 1
        spread = math.sqrt(variance + diffusion * t * t * t)
        near = min(1.0, max(0.0, min(here, there) / MARGIN))
        cost[k] = lateness * t - least + spread / TOLERANCE + 1 - near


@compiled(
    "Tuple((i8, i8, i8, f8))(f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8, f8, f8, f8[::1],"
    " f8[::1], f8[::1], f8[::1], f8[::1], i8, i8, f8[:,:,::1])"
)
def cheapest_path(  # type: ignore[no-untyped-def]
    offset,
    motion,
    turn,
    place,
    tau,
    step,
    height,
    sideways,
    lower,
    upper,
    speed,
    acceleration,
    cost,
    row,
    column,
    shares,
):
    """Returns the cheapest path to the object, or the one that exceeds limits least.

    Args:
        offset: Offset of the palm from the object, its rate and acceleration, shape (3, 3).
        motion: Position, velocity and acceleration of the object, shape (3, 3).
        turn: Times of the extremes of its coordinates, shape (3,), in seconds.
        place: Coordinates then, shape (3,), in metres.
        tau: Times until the meetings, shape (times,), in seconds.
        step: Time between them, in seconds.
        height: Least height over the object, in metres.
        sideways: Largest offset sideways of a direct path, in metres.
        lower: Smallest coordinates of the palm, shape (3,), in metres.
        upper: Largest coordinates of the palm, shape (3,), in metres.
        speed: Largest speeds, shape (3,), in m/s.
        acceleration: Largest accelerations, shape (3,), in m/s².
        cost: Result of `write_possible`, shape (times,).
        row: Row of the present plan, -1 without one.
        column: Its column.
        shares: Scratch, shape (times, 2 + number of heights, 2).

    Returns:
        Row and column as for the reference; 1 if speed exceeds its limit more than
        acceleration; and the larger share of a limit, which is above 1 if no path keeps them.
    """
    x, v, a = motion
    best, best_row, best_column = np.inf, 0, 0
    least, is_slow = np.inf, 0
    for k in range(len(tau)):
        T = tau[k]
        for j in range(2 + _NUM_RISES):  # Sideways, directly, and to each height.
            shares[k, j, 0] = shares[k, j, 1] = 0.0
            up = height + RISES[j - 2] if j > 1 else 0.0
            for axis in range(3):
                if (axis == 2) != (j > 0):
                    continue
                f, h = path_shares(
                    *(offset[0, axis] - up, offset[1, axis], offset[2, axis]),
                    *(x[axis] + up, v[axis], a[axis], T),
                    *(lower[axis], upper[axis], speed[axis], acceleration[axis]),
                )
                shares[k, j, 0], shares[k, j, 1] = max(shares[k, j, 0], f), max(shares[k, j, 1], h)
        if cost[k] == np.inf:
            continue
        aside = 0.0
        for axis in range(2):
            aside = max(aside, abs(offset[0, axis]) + T * abs(offset[1, axis]))
        clear = clear_time(offset[0, 2], offset[1, 2], offset[2, 2], T, height)
        for c in range(1 + _NUM_DESCENTS * (1 + _NUM_RISES)):
            i, j = (c - 1) // (1 + _NUM_RISES), (c - 1) % (1 + _NUM_RISES)
            begun = k - _STEPS[i] if c else k
            if begun < 0 or (c == 0 and aside > sideways) or (c and j == 0 and tau[begun] > clear):
                continue
            up = height + RISES[j - 1] if c and j else 0.0
            if c and turns_outside(turn, place, tau[begun], T, up, lower, upper):
                continue
            if c == 0 or j == 0:
                speed_share, acceleration_share = shares[k, 1, 0], shares[k, 1, 1]
            else:
                down = step * _STEPS[i]
                rate = max(abs(v[2] + tau[begun] * a[2]), abs(v[2] + T * a[2]))
                speed_share = (rate + PEAK_SPEED * up / down) / speed[2]
                acceleration_share = abs(a[2]) + PEAK_ACCELERATION * up / (down * down)
                acceleration_share /= acceleration[2]
                speed_share = max(speed_share, shares[begun, 1 + j, 0])
                acceleration_share = max(acceleration_share, shares[begun, 1 + j, 1])
            speed_share = max(speed_share, shares[begun, 0, 0])
            acceleration_share = max(acceleration_share, shares[begun, 0, 1])
            worst = max(speed_share, acceleration_share)
            if worst < least:
                least, is_slow = worst, 1 if speed_share >= acceleration_share else 0
            if worst > 1:
                continue
            sum_ = cost[k] + speed_share * speed_share + acceleration_share * acceleration_share
            if k == row and c == column:
                sum_ *= PERSISTENCE
            if sum_ < best:
                best, best_row, best_column = sum_, k, c
    return best_row, best_column, is_slow, least


def compiled_choose_meeting(
    offset: FloatArray,
    motion: FloatArray,
    variance: float,
    now: float,
    kept: Meeting,
    settings: MeetingSettings,
) -> Choice:
    """See `choose_meeting`."""
    step, limits = settings.step, settings.limits
    first, tau = meeting_times(now, step)
    bounds = limits.lower, limits.upper, limits.speed, limits.acceleration
    given = settings.earliest, settings.lateness, settings.follow, settings.stop, settings.grip
    numbers = np.array([*given, settings.diffusion, variance])
    cost, passed = np.empty(NUM_TIMES), np.empty(len(CHECKS), dtype=np.int64)
    offset, motion = np.ascontiguousarray(offset), np.ascontiguousarray(motion)
    moving = motion, *turning_points(motion), tau
    write_possible(*moving, numbers, *bounds, cost, passed)
    if not passed.all():
        return no_meeting(CHECKS[int(np.argmin(passed != 0))])
    place = place_of(kept, now, first, settings) or (-1, -1)
    scratch = np.empty((NUM_TIMES, 2 + _NUM_RISES, 2))
    path = step, settings.height, settings.sideways
    row, column, is_slow, least = cheapest_path(
        offset, *moving, *path, *bounds, cost, *place, scratch
    )
    if least > 1:
        return no_meeting(limit_of_paths(least, is_slow))
    return meeting_at(row, column, first, settings)
