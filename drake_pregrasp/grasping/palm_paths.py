"""Paths of a palm to a moving object: quintics that end with the object's motion, and their bounds.

Coordinates are along the axes of the palm's approach A, whose z axis points from the object to the
palm: x = R_AW p. The palm's offset from the object's centre of mass is d(t). It starts with the
palm's present motion, and ends with d = 0 and no relative velocity and acceleration.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from drake_pregrasp.arrays import FloatArray

SAMPLES = 16
"""Number of equal parts of a quintic, whose ends bound its peaks."""

_S = np.linspace(0.0, 1.0, SAMPLES + 1)
FINENESS = 1 / (8 * SAMPLES**2)
"""Bound of |f - linear interpolation| between samples of a unit interval over max |f''|."""

PEAK_SPEED, PEAK_ACCELERATION = 15 / 8, 10 / np.sqrt(3)
"""Peaks of the quintic over unit distance and time from rest to rest."""


@dataclass(frozen=True, eq=False)
class PalmLimits:
    """Limits of a palm's position along the axes of A.

    Attributes:
        lower: Smallest coordinates, shape (3,), in metres.
        upper: Largest coordinates, shape (3,), in metres.
        speed: Largest speeds, shape (3,), in m/s.
        acceleration: Largest accelerations, shape (3,), in m/s².
    """

    lower: FloatArray
    upper: FloatArray
    speed: FloatArray
    acceleration: FloatArray


@dataclass(frozen=True, eq=False)
class Meeting:
    """Plan of a palm that meets an object, or that comes to rest.

    From `start` on, d(t) is a quintic that ends at `over` with d = (0, 0, height), over the object
    and at rest relative to it; then a quintic from there to d = 0 at `time`. Without a height it is
    on the axis of A from `over` on, and along that axis one quintic from `start` to `time`. If
    `time` is infinite, the palm stays over the object.

    Attributes:
        start: Time of the plan, in seconds.
        over: Time from which on the palm's axis goes through the object, in seconds.
        time: Time of the meeting, in seconds.
        height: Height of the palm over its place at the object at `over`, in metres.
        offset: Offset of the palm from the object, its velocity and acceleration at `start`, shape
            (3, 3).
        motion: Position, velocity and constant acceleration of the object at `start`, shape (3, 3).
        follows: Whether the object is where it is estimated, not where `motion` predicts it.
        meets: Whether the palm meets the object; otherwise it comes to rest where `motion` is.
    """

    start: float
    over: float
    time: float
    height: float
    offset: FloatArray
    motion: FloatArray
    follows: bool
    meets: bool

    @staticmethod
    def at_rest(x: FloatArray) -> "Meeting":
        """Returns the plan of a palm that rests at a position, shape (3,), in metres."""
        still = np.array([x, np.zeros(3), np.zeros(3)])
        return Meeting(0.0, 0.0, 0.0, 0.0, np.zeros((3, 3)), still, follows=False, meets=False)

    @staticmethod
    def stopping(palm: FloatArray, now: float, duration: float) -> "Meeting":
        """Returns the plan of a palm that comes to rest on its way.

        Args:
            palm: Position, velocity and acceleration of the palm, shape (3, 3).
            now: Present time, in seconds.
            duration: Duration of the stop, in seconds, above 0.
        """
        there = palm[0] + duration / 2 * palm[1]
        rest = Meeting.at_rest(there)
        over, offset = now + duration, palm - rest.motion
        return replace(rest, start=now, over=over, time=over, offset=offset)

    @staticmethod
    def above(height: float) -> "Meeting":
        """Returns the plan of a palm that stays at a height in metres over the object."""
        rest = Meeting.at_rest(np.zeros(3))
        return replace(rest, time=np.inf, height=height, follows=True)

    def offset_at(self, time: float) -> FloatArray:
        """Returns the offset, its velocity and acceleration at a time in seconds, shape (3, 3)."""
        high = np.outer([1.0, 0.0, 0.0], [0.0, 0.0, self.height])
        if time >= self.time:
            return np.zeros((3, 3))
        if self.time == np.inf:
            return high
        since, ends, start = time - self.start, self.over - self.start, self.offset - high
        offset = high + quintic(start, since, ends) if time < self.over else np.zeros((3, 3))
        if self.height == 0:
            along = self.offset[:, 2:]
            offset[:, 2:] = quintic(along, since, self.time - self.start)
        elif time >= self.over:
            offset = quintic(high, time - self.over, self.time - self.over)
        return offset

    def object_at(self, time: float) -> FloatArray:
        """Returns the predicted motion of the object at a time in seconds, shape (3, 3)."""
        return moved(self.motion, time - self.start)


def moved(motion: FloatArray, t: float) -> FloatArray:
    """Returns position, velocity and constant acceleration t seconds later, shape (3, 3)."""
    x, v, a = motion
    return np.array([x + t * v + t * t / 2 * a, v + t * a, a])


def turning_points(motion: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns when and where the coordinates of a motion have their extremes, shape (3,) each.

    It is x - v²/(2a) at the time -v/a, which is infinite for a coordinate that has none.

    Args:
        motion: Position, velocity and constant acceleration, shape (3, 3).
    """
    x, v, a = motion
    turns = a != 0
    a = np.where(turns, a, 1.0)
    return np.where(turns, -v / a, np.inf), x - v**2 / (2 * a)


def quintic(start: FloatArray, t: float, duration: float) -> FloatArray:
    """Returns value, rate and acceleration of the quintic from a start to rest at zero, (3, k).

    With s = t/T it is d(t) = d₀ H₀(s) + T ḋ₀ H₁(s) + T² d̈₀ H₂(s), Hermite's polynomials.

    Args:
        start: Value, rate and acceleration at t = 0, shape (3, k).
        t: Time, in seconds.
        duration: Time T at which it is at rest at zero, in seconds, above 0.
    """
    scale = duration ** np.arange(3)
    basis = _COEFFICIENTS[:3] @ (t / duration) ** _POWERS
    value: FloatArray = basis @ (scale[:, None] * start) / scale[:, None]
    return value


_POWERS = np.arange(6)
_COEFFICIENTS = np.zeros((5, 3, 6))
"""Coefficients of H₀, H₁ and H₂ and of their derivatives up to the fourth, by rising powers."""
_COEFFICIENTS[0] = np.array(
    [[1, 0, 0, -10, 15, -6], [0, 1, 0, -6, 8, -3], [0, 0, 0.5, -1.5, 1.5, -0.5]]
)
for _order in range(1, 5):
    _COEFFICIENTS[_order, :, :-1] = _COEFFICIENTS[_order - 1, :, 1:] * _POWERS[1:]


def _hermite(s: FloatArray) -> FloatArray:
    """Returns H₀, H₁ and H₂ and their derivatives up to the fourth, shape (5, 3, len(s))."""
    values: FloatArray = _COEFFICIENTS @ s ** _POWERS[:, None]
    return values


BASIS = _hermite(_S)
SNAP_ENDS = _hermite(np.array([0.0, 1.0]))[4]
# Bernstein coefficients of the third derivative, a parabola: it is within their range.
_FIRST, _LAST = _hermite(np.array([0.0, 1.0]))[3].T
JERK_RANGE = np.column_stack([_FIRST, _FIRST + SNAP_ENDS[:, 0] / 2, _LAST])


class Peaks(NamedTuple):
    """Bounds of a palm's motions along one axis, each of shape (k,).

    Attributes:
        speed: Largest speed, in m/s.
        acceleration: Largest acceleration, in m/s².
        lowest: Smallest coordinate, in metres.
        highest: Largest coordinate, in metres.
    """

    speed: FloatArray
    acceleration: FloatArray
    lowest: FloatArray
    highest: FloatArray


def peaks(offset: FloatArray, motion: FloatArray, durations: FloatArray) -> Peaks:
    """Returns bounds of motions along one axis that end with an object.

    Between samples a distance h apart, a function is within h²/8 max |f''| of its chord.

    Args:
        offset: Offset from the object, its rate and acceleration at the start, shape (3,).
        motion: Position, velocity and acceleration of the object at the start, shape (3,).
        durations: Durations of the motions, shape (k,), in seconds.
    """
    T = durations[:, None]
    c, t = offset * T ** np.arange(3), T * _S
    x, v, a = motion
    place = x + t * v + t * t / 2 * a + c @ BASIS[0]
    rate = v + t * a + c @ BASIS[1] / T
    change = a + c @ BASIS[2] / T**2
    snap = np.max(np.abs(c @ SNAP_ENDS), axis=1) / durations**2
    jerk = np.max(np.abs(c @ JERK_RANGE), axis=1) / durations
    acceleration = np.max(np.abs(change), axis=1) + FINENESS * snap
    slack = FINENESS * acceleration * durations**2
    speed = np.max(np.abs(rate), axis=1) + FINENESS * jerk
    return Peaks(speed, acceleration, np.min(place, axis=1) - slack, np.max(place, axis=1) + slack)


def path_shares(
    offset: FloatArray, motion: FloatArray, tau: FloatArray, axis: int, limits: PalmLimits
) -> FloatArray:
    """Returns shares of the limits of one axis on its paths, shape (3, times).

    Returns:
        Shares of the largest speed, of the largest acceleration, and 1 if a path leaves the travel.
    """
    found = peaks(offset, motion, tau)
    beyond = (found.lowest < limits.lower[axis]) | (found.highest > limits.upper[axis])
    speed, acceleration = limits.speed[axis], limits.acceleration[axis]
    return np.array([found.speed / speed, found.acceleration / acceleration, beyond])


def descent_shares(
    rate: FloatArray, height: FloatArray | float, duration: FloatArray, a: float, limits: PalmLimits
) -> FloatArray:
    """Returns shares as `path_shares`, for ways down to an object along the palm's own axis.

    Args:
        rate: Largest speed of the object along this axis meanwhile, in m/s.
        height: Height over the object at the start, in metres.
        duration: Duration, in seconds.
        a: Acceleration of the object along this axis, in m/s².
        limits: Limits of the palm.
    """
    falls = (rate + PEAK_SPEED * height / duration) / limits.speed[2]
    yields = (abs(a) + PEAK_ACCELERATION * height / duration**2) / limits.acceleration[2]
    return np.array([falls, np.broadcast_to(yields, np.shape(falls)), np.zeros(np.shape(falls))])


def clear_times(offset: FloatArray, durations: FloatArray, height: float) -> FloatArray:
    """Returns until when quintics to zero stay above a height, shape (k,), in seconds.

    They are negative for quintics that start below it. Bounds are as for `peaks`.

    Args:
        offset: Value, rate and acceleration at the start, shape (3,), in metres.
        durations: Durations of the quintics, shape (k,), in seconds.
        height: The height, in metres, above 0.
    """
    c = offset * durations[:, None] ** np.arange(3)
    bend = np.max(np.abs(c @ BASIS[2]), axis=1) + FINENESS * np.max(np.abs(c @ SNAP_ENDS), axis=1)
    room = c @ BASIS[0] - height - FINENESS * bend[:, None]
    last = np.argmax(room < 0, axis=1)  # All end below the height.
    before, after = room[np.arange(len(last)), [last - 1, last]]
    parts = last - 1 + before / np.where(last, before - after, 1.0)
    clear: FloatArray = np.where(last, parts, -1.0) / SAMPLES * durations
    return clear
