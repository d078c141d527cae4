"""All runs of a sweep, each a function of its index."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from drake_pregrasp.errors import ScenarioError
from drake_pregrasp.studies.sweep.field_path import overlap
from drake_pregrasp.studies.sweep.grid_axis import GridAxis, Label, label_of, label_text
from drake_pregrasp.studies.sweep.random_axis import RandomAxis

MOST_RUNS = 1_000_000
"""How many runs a sweep may have."""

SEED_FIELD = "random_seed"
"""The field that differs between the runs of a point."""


@dataclass(frozen=True)
class SweepRun:
    """One run to make.

    Attributes:
        index: Which, from 0 on.
        labels: What its row says of each axis and of other fields that are swept.
        seed: Its `random_seed`.
        changes: What differs from the scenario, by the paths of fields.
    """

    index: int
    labels: tuple[Label, ...]
    seed: int
    changes: Mapping[str, Any]

    @property
    def cells(self) -> tuple[str, ...]:
        """What its row begins with; `SweepPlan.cell_names` names them."""
        return str(self.index), *map(label_text, self.labels), str(self.seed)


@dataclass(frozen=True)
class SweepPlan:
    """The runs: the grid's product, the last axis fastest, times samples, times seeds.

    Attributes:
        grid: What is swept over given values.
        random: What is drawn for each sample.
        samples: How many there are of each combination of the grid.
        sampling_seed: What they follow from.
        seeds: The `random_seed` of the runs of each point.
    """

    grid: tuple[GridAxis, ...]
    random: tuple[RandomAxis, ...]
    samples: int
    sampling_seed: int
    seeds: range

    def __len__(self) -> int:
        """How many runs there are."""
        return math.prod(len(axis.labels) for axis in self.grid) * self.samples * len(self.seeds)

    @property
    def axes(self) -> list[GridAxis | RandomAxis]:
        """All that is swept."""
        return [*self.grid, *self.random]

    @property
    def columns(self) -> list[str]:
        """Names of what `SweepRun.labels` says: the axes, and fields that change with them."""
        names = [axis.name for axis in self.axes]
        fields = [field for axis in self.axes for field in axis.fields]
        return list(dict.fromkeys([*names, *fields]))

    @property
    def cell_names(self) -> list[str]:
        """Names of `SweepRun.cells`."""
        return ["index", *self.columns, "seed"]

    def run(self, index: int) -> SweepRun:
        """Returns the run of an index."""
        rest, seed = divmod(index, len(self.seeds))
        rest, sample = divmod(rest, self.samples)
        said: dict[str, Label] = {}
        changes: dict[str, Any] = {}
        for axis in reversed(self.grid):
            rest, place = divmod(rest, len(axis.labels))
            said[axis.name] = axis.labels[place]
            changes.update(axis.changes[place])
        for random in self.random:
            value = random.draw(self.sampling_seed, sample)
            said[random.name] = label_of(value)
            changes.update(dict.fromkeys(random.fields, value))
        said = {**{path: label_of(value) for path, value in changes.items()}, **said}
        labels = tuple(said.get(name, "") for name in self.columns)
        return SweepRun(index, labels, self.seeds[seed], changes)

    def check(self, source: str) -> None:
        """Checks what no single axis shows.

        Raises:
            ScenarioError: If two axes set the same field, or have one name; if the seed is swept;
                or if there are too many runs.
        """
        if not self.axes:
            raise ScenarioError(source, "", "sweeps nothing; give it a grid, or random fields")
        for place, axis in enumerate(self.axes):
            if any(overlap(field, SEED_FIELD) for field in axis.fields):
                problem = "can't be swept here; the key seeds says how many there are"
                raise ScenarioError(source, SEED_FIELD, problem)
            for other in self.axes[:place]:
                _check_apart(source, axis, other)
        if self.samples > 1 and not self.random:
            problem = f"{self.samples} samples would be all alike: nothing is random"
            raise ScenarioError(source, "samples", problem)
        if len(self) > MOST_RUNS:
            problem = f"{len(self)} runs are too many; at most {MOST_RUNS} can be made"
            raise ScenarioError(source, "", problem)


def _check_apart(source: str, axis: GridAxis | RandomAxis, other: GridAxis | RandomAxis) -> None:
    if axis.name == other.name:
        raise ScenarioError(source, axis.name, "is swept twice")
    for field in axis.fields:
        for taken in other.fields:
            if overlap(field, taken):
                raise ScenarioError(source, field, f"is set by {axis.name} and by {other.name}")
