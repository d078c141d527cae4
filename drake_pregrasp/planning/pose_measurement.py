"""A measured pose with the time it is for, and what a tracker makes of it."""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar

import numpy as np

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.usable_inputs import is_usable_pose

OLDEST = 1e6
"""How old a usable measurement may be, and how far beliefs are predicted, in seconds."""

_SLACK = 1e-6  # Seconds that rounding may put a time ahead of the clock.


class MeasurementVerdict(IntEnum):
    """What became of a measurement.

    Attributes:
        NOTHING_NEW: None came: its time is that of one before.
        USED: It corrected the newest belief.
        USED_LATE: It corrected the belief of its own time, and what followed was worked out anew.
        STARTED: It is what the belief starts from: it is the first one, or what was believed
            before can't be kept.
        REACQUIRED: With those before it, it has refuted the belief, which goes on from them.
        UNUSABLE: Refused: its time or its pose is no such thing.
        TOO_LATE: Refused: it is older than all that is remembered.
        OUTLIER: Refused: it is too far from what was to be expected.
        REPEATED: Refused: a sensor with noise has repeated itself to the last bit.
    """

    NOTHING_NEW = 0
    USED = 1
    USED_LATE = 2
    STARTED = 3
    REACQUIRED = 4
    UNUSABLE = 5
    TOO_LATE = 6
    OUTLIER = 7
    REPEATED = 8

    @property
    def is_refusal(self) -> bool:
        """Whether the measurement was refused."""
        return self >= MeasurementVerdict.UNUSABLE


@dataclass(frozen=True, eq=False)
class PoseMeasurement:
    """A measured pose.

    Attributes:
        time: When it was measured, in seconds; -inf if there is none.
        p_WCoM: Where it puts the centre of mass, shape (3,), in metres.
        R_WO: The orientation, shape (3, 3).
    """

    time: float
    p_WCoM: FloatArray
    R_WO: FloatArray

    SIZE: ClassVar[int] = 13
    """How many numbers its vector form has."""

    @property
    def is_there(self) -> bool:
        """Whether there is one at all."""
        return self.time != -math.inf

    def is_usable(self, now: float) -> bool:
        """Whether it is a pose that can be used, of a time that isn't to come.

        Args:
            now: The time, in seconds.
        """
        if not now - OLDEST <= self.time <= now + _SLACK:  # As NaN isn't.
            return False
        return is_usable_pose(self.R_WO, self.p_WCoM)

    def repeats(self, other: "PoseMeasurement") -> bool:
        """Whether it has the value of another one, to the last bit."""
        # So few numbers are compared sooner as lists than by numpy.
        same_place = self.p_WCoM.tolist() == other.p_WCoM.tolist()
        return bool(same_place and self.R_WO.tolist() == other.R_WO.tolist())

    @property
    def parts(self) -> list[FloatArray]:
        """What its vector form has, one after another; `SIZE` numbers in all."""
        return [np.array([self.time]), self.p_WCoM, self.R_WO.ravel()]

    @staticmethod
    def from_vector(vector: FloatArray) -> "PoseMeasurement":
        """Returns it from its vector form."""
        return PoseMeasurement(
            float(vector[0]), vector[1:4], vector[4 : PoseMeasurement.SIZE].reshape(3, 3)
        )

    @staticmethod
    def none() -> "PoseMeasurement":
        """Returns what stands for no measurement."""
        return PoseMeasurement(-math.inf, np.zeros(3), np.eye(3))
