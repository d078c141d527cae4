"""Outcomes, sorted by what they are about."""

from collections.abc import Iterable, Sequence
from typing import Literal

from drake_pregrasp.studies.static_versus_dynamic.arms import ARMS
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.outcome import Outcome
from drake_pregrasp.studies.static_versus_dynamic.paired_test import PairedTest, paired_test

Success = Literal["clean", "lifted"]
"""What a grasp is judged by."""


class Results:
    """All outcomes of a study, by condition, arm and closing time.

    Args:
        outcomes: In any order.
    """

    def __init__(self, outcomes: Iterable[Outcome]) -> None:
        self.outcomes: Sequence[Outcome] = sorted(outcomes, key=lambda outcome: outcome.key)
        self._cells: dict[tuple[str, str, float], list[Outcome]] = {}
        for outcome in self.outcomes:
            cell = (outcome.condition, outcome.arm, outcome.close_at)
            self._cells.setdefault(cell, []).append(outcome)

    @property
    def conditions(self) -> list[str]:
        """Returns those that there are outcomes of, in the order in which they are shown."""
        there = {condition for condition, _, _ in self._cells}
        return [condition for condition in CONDITIONS if condition in there]

    def arms(self, condition: str) -> list[str]:
        """Returns the arms of a condition, in the order in which they are shown."""
        there = {arm for of, arm, _ in self._cells if of == condition}
        return [arm for arm in ARMS if arm in there]

    def times(self, condition: str) -> list[float]:
        """Returns the closing times of a condition, in seconds."""
        return sorted({time for of, _, time in self._cells if of == condition})

    def cell(self, condition: str, arm: str, time: float) -> list[Outcome]:
        """Returns the outcomes of all seeds, in the order of the seeds."""
        return self._cells.get((condition, arm, time), [])

    def count(self, condition: str, arm: str, time: float, success: Success = "clean") -> int:
        """Returns how many of them are a success."""
        return sum(getattr(outcome, success) for outcome in self.cell(condition, arm, time))

    def test(
        self, condition: str, first: str, second: str, time: float, success: Success = "clean"
    ) -> PairedTest:
        """Compares two arms by the seeds that both have."""
        of_first, of_second = (
            {o.seed: bool(getattr(o, success)) for o in self.cell(condition, arm, time)}
            for arm in (first, second)
        )
        return paired_test(
            (of_first[seed], of_second[seed]) for seed in of_first if seed in of_second
        )
