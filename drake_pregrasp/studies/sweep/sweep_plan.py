"""The swept fields of a study and their values, and its runs, each a function of its index."""

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
"""The field that differs between the runs of a point."""

_WHOLE = np.iinfo(np.int64)
_RANGES: Mapping[str, tuple[type, Mapping[str, Any]]] = {
    "uniform": (float, {}),
    "log_uniform": (float, {"above": 0}),
    "integer": (int, {"at_least": _WHOLE.min, "at_most": _WHOLE.max}),
}  # The type of both ends of a range, and what they must be.

KINDS = (*_RANGES, "choice")
"""The distributions of random values."""

Label = float | int | bool | str
"""A value as a row shows it."""

_FIELDS = "fields"


@dataclass(frozen=True)
class GridAxis:
    """A swept field, or several that change together, and the values in turn.

    Attributes:
        name: Path of the field, or the name of several.
        labels: Label of each value, for rows.
        changes: Fields that each value sets, by their paths.
    """

    name: str
    labels: tuple[Label, ...]
    changes: tuple[Mapping[str, Any], ...]

    @property
    def fields(self) -> tuple[str, ...]:
        """The paths of all fields that the axis sets."""
        return tuple(dict.fromkeys(path for change in self.changes for path in change))


@dataclass(frozen=True)
class RandomAxis:
    """A field, or several with the same value, that each sample draws anew.

    Attributes:
        name: Path of the field, or the name of several.
        fields: The paths of all of them.
        kind: One of `KINDS`.
        arguments: The two ends of the range, or the values to choose from.
    """

    name: str
    fields: tuple[str, ...]
    kind: str
    arguments: tuple[Any, ...]

    def draw(self, seed: int, sample: int) -> Any:
        """Returns the value of a sample, whatever else is swept and however many samples there are.

        Args:
            seed: The study's `sampling_seed`.
            sample: Number of the sample, from 0 on.
        """
        generator = np.random.default_rng([seed, zlib.crc32(self.name.encode()), sample])
        if self.kind == "choice":
            return self.arguments[int(generator.integers(len(self.arguments)))]
        low, high = self.arguments
        if self.kind == "integer":
            return int(generator.integers(low, high, endpoint=True))
        if self.kind == "log_uniform":
            value = low * (high / low) ** generator.random()
            return float(min(max(value, low), high))  # Rounding may lead past an end.
        return float(low + (high - low) * generator.random())


@dataclass(frozen=True)
class SweepPlan:
    """The runs: the grid's product, the last axis fastest, times samples, times seeds.

    Attributes:
        grid: The axes with given values.
        random: The axes that each sample draws.
        samples: Number of samples for each combination of the grid.
        sampling_seed: Seed of the samples.
        seeds: The `random_seed` of the runs of each point.
    """

    grid: tuple[GridAxis, ...]
    random: tuple[RandomAxis, ...]
    samples: int
    sampling_seed: int
    seeds: range

    def __len__(self) -> int:
        """Number of runs."""
        return math.prod(len(axis.labels) for axis in self.grid) * self.samples * len(self.seeds)

    @property
    def axes(self) -> list[GridAxis | RandomAxis]:
        """All axes."""
        return [*self.grid, *self.random]

    def changes(self, index: int) -> dict[str, Any]:
        """Returns what differs from the scenario in a run, by the paths of fields."""
        return self._run(index)[0]

    def job(self, index: int) -> dict[str, Label]:
        """Returns the first columns of a run's row: index, axes, fields that they set, and seed."""
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
            source: The study's file, for messages.
            columns: Names that rows have besides those of axes.

        Raises:
            ScenarioError: If two axes set the same field; if a name is there twice; if the seed is
                swept; or if there are too many runs.
        """
        if not self.axes:
            raise ScenarioError(source, "", "sweeps nothing; give it a grid, or random fields")
        for place, axis in enumerate(self.axes):
            if any(overlap(field, SEED_FIELD) for field in axis.fields):
                problem = "cannot be swept here; the key seeds says how many there are"
                raise ScenarioError(source, SEED_FIELD, problem)
            if axis.name in columns:
                raise ScenarioError(source, axis.name, "is a column of its own; use another name")
            for other in self.axes[:place]:
                if axis.name == other.name:
                    raise ScenarioError(source, axis.name, "is swept twice")
                for field in axis.fields:
                    if any(overlap(field, taken) for taken in other.fields):
                        problem = f"is set by {axis.name} and by {other.name}"
                        raise ScenarioError(source, field, problem)
        if self.samples > 1 and not self.random:
            problem = f"{self.samples} samples would be all alike: nothing is random"
            raise ScenarioError(source, "samples", problem)
        if len(self) > MOST_RUNS:
            problem = f"{len(self)} runs are too many; at most {MOST_RUNS} can be made"
            raise ScenarioError(source, "", problem)


def grid_axis(name: str, values: Any, data: Mapping[str, Any], source: str) -> GridAxis:
    """Returns the axis of an entry of `grid`.

    Args:
        name: The entry's key: a field's path if `values` is a list; a name if it is a mapping from
            labels to mappings from paths to values.
        values: The entry.
        data: The scenario that is swept.
        source: The study's file, for messages.

    Raises:
        ScenarioError: If the entry cannot be used.
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
        problem = "must be a list of values, or a mapping from labels to what each sets; not empty"
        raise ScenarioError(source, key, problem)
    for label, change in zip(labels, changes, strict=True):
        with_fields(data, change, source_of or f"{source}: {key}.{label}")
    texts = [str(label) for label in labels]
    if twice := [text for text in texts if texts.count(text) > 1]:
        raise ScenarioError(source, key, f"{twice[0]} is there twice; give each value once")
    return GridAxis(name, tuple(labels), tuple(changes))


def random_axis(name: str, entry: Any, data: Mapping[str, Any], source: str) -> RandomAxis:
    """Returns the axis of an entry of `random`.

    Args:
        name: The entry's key: a field's path, or a name if the entry has the key `fields`.
        entry: A mapping with one of `KINDS`, and `fields`, a list of paths, if there are several.
        data: The scenario that is swept.
        source: The study's file, for messages.

    Raises:
        ScenarioError: If the entry cannot be used.
    """
    key = f"random.{name}"
    kinds = [kind for kind in entry if kind != _FIELDS] if isinstance(entry, Mapping) else []
    if len(kinds) != 1 or kinds[0] not in KINDS:
        problem = f"{entry!r} must be a mapping with one of: {', '.join(KINDS)}; and perhaps fields"
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
            problem = f"must be two, the lower first, each {scalar_problem(None, type_, rules)}"
            raise ScenarioError(source, f"{key}.{kind}", f"{arguments} {problem}")
    return RandomAxis(name, tuple(map(str, fields)), kind, tuple(arguments))


def _label(value: Any) -> Label:
    """Returns a value as rows show it: a scalar, or JSON."""
    return value if isinstance(value, float | int | str) else json.dumps(value)


def _number(value: Any) -> Any:
    """Returns the number of a text that YAML 1.1 does not read as one, as 1e-3; else the value."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value
