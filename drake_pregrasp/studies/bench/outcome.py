"""What the benchmark has measured."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from drake_pregrasp.studies.bench.base_case import RunTime
from drake_pregrasp.studies.bench.global_times import Choice
from drake_pregrasp.studies.bench.memory import MemoryUse
from drake_pregrasp.studies.bench.shares import Shares
from drake_pregrasp.studies.bench.startup import StartTime
from drake_pregrasp.studies.bench.tick_times import TickTimes


@dataclass
class Outcome:
    """All measurements.

    Attributes:
        machine: Where they were made.
        ticks: Of planning ticks.
        choices: Of the planner and of global selection.
        runs: Of the base case.
        starts: Of fresh processes.
        memory: Of many ticks.
        shares: Of the stages of ticks.
    """

    machine: str
    ticks: list[TickTimes] = field(default_factory=list)
    choices: list[Choice] = field(default_factory=list)
    runs: list[RunTime] = field(default_factory=list)
    starts: list[StartTime] = field(default_factory=list)
    memory: list[MemoryUse] = field(default_factory=list)
    shares: list[Shares] = field(default_factory=list)

    def to_json(self) -> dict[str, Any]:
        """Returns the same in mappings and lists."""
        return {
            name: value if isinstance(value, str) else [row._asdict() for row in value]
            for name, value in vars(self).items()
        }

    def series(self, name: str) -> list[TickTimes]:
        """Returns the ticks of one series."""
        return [row for row in self.ticks if row.series == name]


def median_choices(choices: Sequence[Choice]) -> list[tuple[str, bool, list[list[float]]]]:
    """Returns each method, whether it is of the planner, and its numbers over the scenes.

    The numbers are seconds, Q_MSV and margin, each a list with a value for each scene.
    """
    methods = dict.fromkeys((choice.method, choice.is_planner) for choice in choices)
    return [
        (
            method,
            is_planner,
            [
                [getattr(choice, name) for choice in choices if choice[:2] == (method, is_planner)]
                for name in ("seconds", "q_msv", "margin")
            ],
        )
        for method, is_planner in methods
    ]
