"""Axes of a sweep, and its runs, each of which is a function of its index."""

import json
import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from drake_pregrasp.config.validation import scalar_problem
from drake_pregrasp.errors import ScenarioError
from drake_pregrasp.simulation.yaml_text import TAG_KEY
from drake_pregrasp.studies.sweep.field_path import overlap, read_field, with_fields

MOST_RUNS = 1_000_000
"""Largest number of runs of a sweep."""

SEED_FIELD = "random_seed"
"""Field that differs between the runs of a point."""

_WHOLE = np.iinfo(np.int64)
_RANGES: Mapping[str, tuple[type, Mapping[str, Any]]] = {
    "uniform": (float, {}),
    "log_uniform": (float, {"above": 0}),
    "integer": (int, {"at_least": _WHOLE.min, "at_most": _WHOLE.max}),
}  # Type and range of both ends of an interval, by distribution.

KINDS = (*_RANGES, "choice")
"""Distributions of random values."""

Label = float | int | bool | str
"""A value in a row."""

_FIELDS = "fields"


@dataclass(frozen=True)
class GridAxis:
    """A swept field, or several fields that change together, with their values.

    Attributes:
        name: Path of the field, or name of several fields.
        labels: Label of each value in the rows.
        changes: Fields that each value sets, by their paths.
    """

    name: str
    labels: tuple[Label, ...]
    changes: tuple[Mapping[str, Any], ...]

    @property
    def fields(self) -> tuple[str, ...]:
        """Paths of all fields that the axis sets."""
        return tuple(dict.fromkeys(path for change in self.changes for path in change))


@dataclass(frozen=True)
class RandomAxis:
    """A field, or several fields with the same value, that each sample draws at random.

    Attributes:
        name: Path of the field, or name of several fields.
        fields: Paths of all fields that the axis sets.
        kind: Distribution of the values, one of `KINDS`.
        arguments: Both ends of the interval, or the values to choose from.
    """

    name: str
    fields: tuple[str, ...]
    kind: str
    arguments: tuple[Any, ...]

    def draw(self, seed: int, sample: int) -> Any:
        """Returns the value of a sample, independent of other axes and of the number of samples.

        Args:
            seed: Key `sampling_seed` of the study.
            sample: Index of the sample, 0 or more.
        """
        generator = np.random.default_rng([seed, zlib.crc32(self.name.encode()), sample])
        if self.kind == "choice":
            return self.arguments[int(generator.integers(len(self.arguments)))]
        low, high = self.arguments
        if self.kind == "integer":
            return int(generator.integers(low, high, endpoint=True))
        if self.kind == "log_uniform":
            value = low * (high / low) ** generator.random()
            return float(min(max(value, low), high))  # Rounding may exceed an end.
        return float(low + (high - low) * generator.random())


@dataclass(frozen=True)
class SweepPlan:
    """Plan of the runs: product of the grid (last axis fastest), the samples and the seeds.

    Attributes:
        grid: Axes with listed values.
        random: Axes whose values each sample draws.
        samples: Number of samples for each combination of the grid.
        sampling_seed: Seed of the samples.
        seeds: Values of `random_seed` for the runs of each point.
    """

    grid: tuple[GridAxis, ...]
    random: tuple[RandomAxis, ...]
    samples: int
    sampling_seed: int
    seeds: range

    def __len__(self) -> int:
        """Returns the number of runs."""
        return math.prod(len(axis.labels) for axis in self.grid) * self.samples * len(self.seeds)

    @property
    def axes(self) -> list[GridAxis | RandomAxis]:
        """All axes, those of the grid first."""
        return [*self.grid, *self.random]

    def changes(self, index: int) -> dict[str, Any]:
        """Returns the values that a run changes in the scenario, by the paths of fields."""
        return self._run(index)[0]

    def job(self, index: int) -> dict[str, Label]:
        """Returns the first columns of a run's row: index, axes, their fields, and seed."""
        changes, said, seed = self._run(index)
        names = [axis.name for axis in self.axes]
        fields = [field for axis in self.axes for field in axis.fields]
        said = {path: _label(value) for path, value in changes.items()} | said
        cells = {name: said.get(name, "") for name in dict.fromkeys([*names, *fields])}
        return {"index": index, **cells, "seed": seed}

    def _run(self, index: int) -> tuple[dict[str, Any], dict[str, Label], int]:
        rest, seed = divmod(index, len(self.seeds))
        rest, sample = divmod(rest, self.samples)
        changes: dict[str, Any] = {}
        said: dict[str, Label] = {}
        for axis in reversed(self.grid):
            rest, place = divmod(rest, len(axis.labels))
            said[axis.name] = axis.labels[place]
            changes.update(axis.changes[place])
        for random in self.random:
            value = random.draw(self.sampling_seed, sample)
            said[random.name] = _label(value)
            changes.update(dict.fromkeys(random.fields, value))
        return changes, said, self.seeds[seed]

    def check(self, source: str, columns: Sequence[str]) -> None:
        """Checks axes against each other, and the number of runs.

        Args:
            source: File of the study, for messages.
            columns: Names of the rows' columns besides those of axes.

        Raises:
            ScenarioError: If two axes set the same field or have the same name; if the seed is
                swept; if several samples would be the same; or if there are too many runs.
        """
        if not self.axes:
            raise ScenarioError(source, "", "sweeps nothing; give it a grid, or random fields")
        for place, axis in enumerate(self.axes):
            if any(overlap(field, SEED_FIELD) for field in axis.fields):
                problem = "cannot be swept; use the key seeds instead"
                raise ScenarioError(source, SEED_FIELD, problem)
            if axis.name in columns:
                raise ScenarioError(source, axis.name, "is another column; use another name")
            for other in self.axes[:place]:
                if axis.name == other.name:
                    raise ScenarioError(source, axis.name, "is swept twice")
                for field in axis.fields:
                    if any(overlap(field, taken) for taken in other.fields):
                        problem = f"is set by {axis.name} and by {other.name}"
                        raise ScenarioError(source, field, problem)
        if self.samples > 1 and not self.random:
            problem = f"{self.samples} samples would be the same: no field is random"
            raise ScenarioError(source, "samples", problem)
        if len(self) > MOST_RUNS:
            problem = f"{len(self)} runs are too many; at most {MOST_RUNS} can be made"
            raise ScenarioError(source, "", problem)


def grid_axis(name: str, values: Any, data: Mapping[str, Any], source: str) -> GridAxis:
    """Returns the axis of an entry of `grid`.

    Args:
        name: Key of the entry: a field's path if `values` is a list, or a name if `values` is a
            mapping.
        values: List of values; or mapping from labels to mappings from paths to values.
        data: Scenario to sweep, as plain data.
        source: File of the study, for messages.

    Raises:
        ScenarioError: If the entry is invalid.
    """
    key, source_of = f"grid.{name}", f"{source}: grid"
    labels: list[Label]
    changes: list[dict[str, Any]]
    if isinstance(values, list) and values:
        if not isinstance(read_field(data, name, source_of), str):
            values = [_number(value) for value in values]
        labels, changes = [_label(value) for value in values], [{name: v} for v in values]
    elif isinstance(values, Mapping) and values and TAG_KEY not in values:
        labels, changes = list(values), []
        for label, fields in values.items():
            if not isinstance(label, float | int | str):
                raise ScenarioError(source, key, f"{label} must be a number or a text")
            if not isinstance(fields, Mapping) or not fields:
                problem = f"{fields!r} must be a mapping from paths of fields to values"
                raise ScenarioError(source, f"{key}.{label}", problem)
            changes.append({str(path): value for path, value in fields.items()})
        source_of = ""
    else:
        problem = "must be a list of values, or a mapping from labels to changes; not empty"
        raise ScenarioError(source, key, problem)
    for label, change in zip(labels, changes, strict=True):
        with_fields(data, change, source_of or f"{source}: {key}.{label}")
    texts = [str(label) for label in labels]
    if twice := [text for text in texts if texts.count(text) > 1]:
        raise ScenarioError(source, key, f"{twice[0]} occurs twice; give each value once")
    return GridAxis(name, tuple(labels), tuple(changes))


def random_axis(name: str, entry: Any, data: Mapping[str, Any], source: str) -> RandomAxis:
    """Returns the axis of an entry of `random`.

    Args:
        name: Key of the entry: a field's path, or a name if the entry has the key `fields`.
        entry: Mapping with one of `KINDS` and, for several fields, a list of paths `fields`.
        data: Scenario to sweep, as plain data.
        source: File of the study, for messages.

    Raises:
        ScenarioError: If the entry is invalid.
    """
    key = f"random.{name}"
    kinds = [kind for kind in entry if kind != _FIELDS] if isinstance(entry, Mapping) else []
    if len(kinds) != 1 or kinds[0] not in KINDS:
        problem = f"{entry!r} must be a mapping with one of: {', '.join(KINDS)}; and maybe fields"
        raise ScenarioError(source, key, problem)
    fields, (kind,) = entry.get(_FIELDS, [name]), kinds
    for where, values in ((_FIELDS, fields), (kind, entry[kind])):
        if not isinstance(values, list) or not values:
            raise ScenarioError(source, f"{key}.{where}", f"{values!r} must be a list, not empty")
    for path in fields:
        read_field(data, str(path), f"{source}: random")
    arguments = [_number(value) for value in entry[kind]]
    if kind != "choice":
        type_, rules = _RANGES[kind]
        fits = len(arguments) == 2 and not any(scalar_problem(e, type_, rules) for e in arguments)
        if not fits or arguments[0] > arguments[1]:
            problem = f"must be two, lower first, each {scalar_problem(None, type_, rules)}"
            raise ScenarioError(source, f"{key}.{kind}", f"{arguments} {problem}")
    return RandomAxis(name, tuple(map(str, fields)), kind, tuple(arguments))


def _label(value: Any) -> Label:
    """Returns a value for the rows: a scalar itself, or else JSON."""
    return value if isinstance(value, float | int | str) else json.dumps(value)


def _number(value: Any) -> Any:
    """Converts texts that YAML 1.1 does not read as numbers, such as 1e-3; keeps other values."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value
