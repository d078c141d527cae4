"""What became of one grasp: a row of the study."""

from dataclasses import dataclass
from typing import NamedTuple

LIFTED_ABOVE_MM = 80.0
"""How far above its place the object is at the end of the hold, if it is lifted."""

LEVEL_BELOW_DEG = 20.0
"""How far it is tilted at most, if it is level."""

MAX_PUSHED_MM = 5.0
"""How far the hand may move the object in a clean grasp, before it closes and in closing each."""

MAX_TURNED_DEG = 5.0
"""How far it may turn it before it closes."""

MAX_SLIP_MM = 5.0
"""How far the object may slip in the hand."""

CLEAN_IN_WORDS = (
    f"A grasp is clean if the object is lifted by more than {LIFTED_ABOVE_MM:g} mm and tilted by"
    f" less than {LEVEL_BELOW_DEG:g}°, slips by less than {MAX_SLIP_MM:g} mm, and was moved by less"
    f" than {MAX_PUSHED_MM:g} mm and turned by less than {MAX_TURNED_DEG:g}° before the hand"
    f" closed, and moved by less than {MAX_PUSHED_MM:g} mm in closing."
)
"""The definition, as reports quote it."""


class TrialJob(NamedTuple):
    """A trial to make: one arm under one condition with one seed.

    Attributes:
        condition: Key of `CONDITIONS`.
        arm: Key of `ARMS`.
        seed: Of all that is random in it.
    """

    condition: str
    arm: str
    seed: int

    def __str__(self) -> str:
        return f"{self.condition}, {self.arm}, seed {self.seed}"


class OutcomeKey(NamedTuple):
    """What an outcome is about: a trial's job, and when the hand was told to close, in seconds."""

    condition: str
    arm: str
    seed: int
    close_at: float


@dataclass(frozen=True)
class Outcome:
    """One grasp of a trial: what the hand did to the object from its first tick to the hold.

    Attributes:
        condition: Key of `CONDITIONS`.
        arm: Key of `ARMS`.
        seed: Of all that is random in the trial.
        close_at: When the hand was told to close, in seconds.
        lifted: Whether the object was lifted, and still was at the end of the hold.
        level: Whether it was level then.
        pushed_before_mm: How far the hand had moved the object before the command to close.
        turned_before_deg: How far it had turned it.
        pushed_closing_mm: How far it moved it in closing.
        slip_mm: How far the object slipped in the hand; nan if it was never lifted.
        tilt_deg: At the end of the hold.
        residual_n: Of the balance of forces of the contacts; nan if not all fingers had touched.
        fingers: How many took part.
        waited_s: How long the gate held the command to close back.
        withdrawn: How many fingers that were not lost had no goal to go to, as it was out of reach
            or too near to the no-touch area; mean over the planner's ticks before closing.
        goal_in_area: Share of those ticks at which a goal of the others, for a fingertip in contact
            or standing off, was in the no-touch area; nan if there is no such area.
        tip_in_area: Share of the control ticks from 1 s until the lift at which a fingertip was.
        q_msv: Of the contacts at the end of closing; nan if not all fingers had touched.
        q_gii: The same.
        gave_up: Why the hand gave up, in words; empty if it did not.
    """

    condition: str
    arm: str
    seed: int
    close_at: float
    lifted: bool
    level: bool
    pushed_before_mm: float
    turned_before_deg: float
    pushed_closing_mm: float
    slip_mm: float
    tilt_deg: float
    residual_n: float
    fingers: int
    waited_s: float
    withdrawn: float
    goal_in_area: float
    tip_in_area: float
    q_msv: float
    q_gii: float
    gave_up: str

    @property
    def key(self) -> OutcomeKey:
        """Returns what it is about; rows are sorted by it."""
        return OutcomeKey(self.condition, self.arm, self.seed, self.close_at)

    @property
    def job(self) -> TrialJob:
        """Returns the job of the trial it is from."""
        return TrialJob(self.condition, self.arm, self.seed)

    @property
    def clean(self) -> bool:
        """Whether all of `CLEAN_IN_WORDS` holds; what is nan is not within its bound."""
        return (
            self.lifted
            and self.level
            and self.pushed_before_mm < MAX_PUSHED_MM
            and self.turned_before_deg < MAX_TURNED_DEG
            and self.pushed_closing_mm < MAX_PUSHED_MM
            and self.slip_mm < MAX_SLIP_MM
        )
