"""What a tracker remembers: measurements with the beliefs after them, and a rival belief."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from typing import ClassVar

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.estimation.pose_filter import PoseBelief
from drake_pregrasp.geometry.input_validation import is_usable_pose

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


# Where in a track's vector its parts begin; five single numbers come first.
_SQUARED_FROM = 5
_INNOVATION_FROM = _SQUARED_FROM + 2
_SEEN_FROM = _INNOVATION_FROM + 6
_RIVAL_FROM = _SEEN_FROM + PoseMeasurement.SIZE
_STEPS_FROM = _RIVAL_FROM + PoseBelief.SIZE


@dataclass(frozen=True, eq=False)
class Step:
    """A measurement that was used, and the belief after it, at its time."""

    measurement: PoseMeasurement
    belief: PoseBelief

    SIZE: ClassVar[int] = PoseMeasurement.SIZE + PoseBelief.SIZE

    def to_vector(self) -> FloatArray:
        """Returns it as one vector."""
        return np.concatenate([*self.measurement.parts, *self.belief.parts])

    @staticmethod
    def from_vector(vector: FloatArray) -> "Step":
        """Inverse of `to_vector`."""
        return Step(
            PoseMeasurement.from_vector(vector[: PoseMeasurement.SIZE]),
            PoseBelief.from_vector(vector[PoseMeasurement.SIZE :]),
        )


@dataclass(frozen=True, eq=False)
class PoseTrack:
    """What is remembered of an object's measurements.

    Attributes:
        steps: The newest steps, the oldest of them first, shape (memory, `Step.SIZE`); rows that
            aren't filled yet come first, and have the time -inf.
        last_seen: The last measurement that was a pose, used or not.
        rival: What refused measurements that agree with each other say; empty if there are none.
        rival_count: How many they are.
        refused: How many outliers there were in a row.
        noisiness: How much of its expected noise the sensor has shown of late, from 0 to 1.
        excess: How much larger innovations were of late than expected, as a variance.
        verdict: What became of the last measurement.
        last_innovation: Of the newest that was used in time, shape (2, 3).
        innovation_squared: Of the last one that was compared with a prediction: νᵀ S⁻¹ ν of
            position and orientation, shape (2,).
    """

    steps: FloatArray
    last_seen: PoseMeasurement
    rival: PoseBelief
    rival_count: int
    refused: int
    noisiness: float
    excess: float
    verdict: MeasurementVerdict
    last_innovation: FloatArray
    innovation_squared: FloatArray

    @staticmethod
    def empty(memory: int) -> "PoseTrack":
        """Returns the track before the first measurement.

        Args:
            memory: How many steps are remembered, at least 1.
        """
        nothing = Step(PoseMeasurement.none(), PoseBelief.empty()).to_vector()
        return PoseTrack(
            steps=np.tile(nothing, (memory, 1)),
            last_seen=PoseMeasurement.none(),
            rival=PoseBelief.empty(),
            rival_count=0,
            refused=0,
            noisiness=0.0,
            excess=1.0,
            verdict=MeasurementVerdict.NOTHING_NEW,
            last_innovation=np.zeros((2, 3)),
            innovation_squared=np.zeros(2),
        )

    @cached_property
    def newest(self) -> PoseBelief:
        """The belief after the newest measurement that was used."""
        return PoseBelief.from_vector(self.steps[-1, PoseMeasurement.SIZE :])

    @property
    def is_empty(self) -> bool:
        """Whether no measurement was used yet."""
        return bool(self.steps[-1, 0] == -np.inf)

    @property
    def times_seen(self) -> list[float]:
        """Times of the measurements that are remembered, in seconds."""
        return [self.last_seen.time, *self.steps[:, 0].tolist()]

    def divided(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Returns the steps up to a time, and those after it."""
        steps = self.steps[self.steps[:, 0] > -np.inf]
        index = int(np.searchsorted(steps[:, 0], time, side="right"))
        return steps[:index], steps[index:]

    def judged(self, verdict: MeasurementVerdict) -> "PoseTrack":
        """Returns the track with nothing more to it than a verdict."""
        return replace(self, verdict=verdict)

    def begun(self, step: Step, verdict: MeasurementVerdict) -> "PoseTrack":
        """Returns a track that knows of one step only, and of the sensor what it knew before."""
        nothing = PoseTrack.empty(len(self.steps))
        return replace(
            self,
            steps=nothing.steps_with(step),
            rival=nothing.rival,
            rival_count=0,
            refused=0,
            verdict=verdict,
        )

    def steps_with(self, step: Step) -> FloatArray:
        """Returns the steps with one more, the newest, in place of the oldest."""
        steps = np.empty_like(self.steps)
        steps[:-1] = self.steps[1:]
        steps[-1] = step.to_vector()
        return steps

    def rewritten(self, before: FloatArray, steps: Sequence[Step]) -> "PoseTrack":
        """Returns the track whose steps after `before` are others."""
        memory = len(self.steps)
        rows = np.vstack([PoseTrack.empty(memory).steps, before, *(s.to_vector() for s in steps)])
        return replace(self, steps=rows[-memory:])

    def to_vector(self) -> FloatArray:
        """Returns it as one vector, for a discrete state."""
        return np.concatenate(
            [
                [self.rival_count, self.refused, self.noisiness, self.excess, self.verdict],
                self.innovation_squared,
                self.last_innovation.ravel(),
                *self.last_seen.parts,
                *self.rival.parts,
                self.steps.ravel(),
            ]
        )

    @staticmethod
    def from_vector(vector: FloatArray) -> "PoseTrack":
        """Inverse of `to_vector`."""
        return PoseTrack(
            steps=vector[_STEPS_FROM:].reshape(-1, Step.SIZE),
            last_seen=PoseMeasurement.from_vector(vector[_SEEN_FROM:_RIVAL_FROM]),
            rival=PoseBelief.from_vector(vector[_RIVAL_FROM:_STEPS_FROM]),
            rival_count=int(vector[0]),
            refused=int(vector[1]),
            noisiness=float(vector[2]),
            excess=float(vector[3]),
            verdict=MeasurementVerdict(int(vector[4])),
            innovation_squared=vector[_SQUARED_FROM:_INNOVATION_FROM],
            last_innovation=vector[_INNOVATION_FROM:_SEEN_FROM].reshape(2, 3),
        )
