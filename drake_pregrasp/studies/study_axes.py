"""Axes of a study: fields of a scenario with listed values, and fields that each seed draws."""

import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from drake_pregrasp.config.validation import scalar_problem
from drake_pregrasp.config.yaml_text import TAG_KEY
from drake_pregrasp.errors import ScenarioError
from drake_pregrasp.geometry.random_objects import MASS, NUM_OBJECTS, object_url
from drake_pregrasp.studies.field_path import overlap, read_field, with_fields

SEED_FIELD = "random_seed"
"""Field whose value is the seed."""

RANDOM_OBJECTS = "random_objects"
"""Distribution of an axis whose values are shipped random objects, in another order."""

_WHOLE = np.iinfo(np.int64)
_RANGES: Mapping[str, tuple[type, Mapping[str, Any]]] = {
    "uniform": (float, {}),
    "log_uniform": (float, {"above": 0}),
    "integer": (int, {"at_least": _WHOLE.min, "at_most": _WHOLE.max}),
    RANDOM_OBJECTS: (int, {"at_least": 0, "at_most": NUM_OBJECTS - 1}),
}  # Type and range of both ends of an interval, by distribution.

KINDS = (*_RANGES, "choice")
"""Distributions of random values."""

Label = float | int | bool | str
"""A value in a row."""

_FIELDS = "fields"


@dataclass(frozen=True)
class GridAxis:
    """A field, or several fields that change together, with their values.

    Attributes:
        name: Path of the field, or name of several fields.
        changes: Fields that each value sets, by their paths; by the label of the value in the rows.
    """

    name: str
    changes: Mapping[Label, Mapping[str, Any]]

    @property
    def fields(self) -> tuple[str, ...]:
        """Paths of all fields that the axis sets."""
        return tuple(dict.fromkeys(path for set_ in self.changes.values() for path in set_))


@dataclass(frozen=True)
class RandomAxis:
    """A field, or several fields with the same value, that each seed draws at random.

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

    def draw(self, seed: int) -> Any:
        """Returns the value for a seed, which depends on nothing but the seed and the name.

        Random objects do not repeat before all have been drawn, for seeds in a row.
        """
        key = zlib.crc32(self.name.encode())
        generator = np.random.default_rng([seed, key])
        if self.kind == "choice":
            return self.arguments[int(generator.integers(len(self.arguments)))]
        low, high = self.arguments
        if self.kind == RANDOM_OBJECTS:
            order = np.random.default_rng(key).permutation(np.arange(low, high + 1))
            return {TAG_KEY: "!Mesh", "file": object_url(order[seed % len(order)]), "mass": MASS}
        if self.kind == "integer":
            return int(generator.integers(low, high, endpoint=True))
        if self.kind == "log_uniform":
            value = low * (high / low) ** generator.random()
            return float(min(max(value, low), high))  # Rounding may exceed an end.
        return float(low + (high - low) * generator.random())

    def label(self, seed: int) -> Label:
        """Returns the value for a seed as it stands in the rows."""
        value = self.draw(seed)
        return as_label(value["file"] if self.kind == RANDOM_OBJECTS else value)

    def changes(self, seed: int) -> dict[str, Any]:
        """Returns the fields that the axis sets for a seed, by their paths."""
        return dict.fromkeys(self.fields, self.draw(seed))


Axis = GridAxis | RandomAxis


def grid_axis(name: str, values: Any, data: Mapping[str, Any], source: str) -> GridAxis:
    """Returns the axis of an entry of `grid`.

    Args:
        name: Key of the entry: a field's path if `values` is a list, or a name if `values` is a
            mapping.
        values: List of values; or mapping from labels to mappings from paths to values.
        data: Scenario whose fields change, as plain data.
        source: File of the study, for messages.

    Raises:
        ScenarioError: If the entry is invalid.
    """
    key = f"grid.{name}"
    if isinstance(values, list) and values:
        values = _numbers(values, [read_field(data, name, f"{source}: grid")])
        pairs: list[tuple[Any, Any]] = [(as_label(value), {name: value}) for value in values]
    elif isinstance(values, Mapping) and values and TAG_KEY not in values:
        pairs = list(values.items())
    else:
        problem = "must be a list of values, or a mapping from labels to changes; not empty"
        raise ScenarioError(source, key, problem)
    for label, change in pairs:
        if not isinstance(label, float | int | str):
            raise ScenarioError(source, key, f"{label} must be a number or a text")
        if not isinstance(change, Mapping) or not change:
            problem = f"{change!r} must be a mapping from paths of fields to values"
            raise ScenarioError(source, f"{key}.{label}", problem)
        where = "grid" if isinstance(values, list) else f"{key}.{label}"
        with_fields(data, change, f"{source}: {where}")
    texts = [str(label) for label, _ in pairs]
    if twice := [text for text in texts if texts.count(text) > 1]:
        raise ScenarioError(source, key, f"{twice[0]} occurs twice; give each value once")
    return GridAxis(name, {label: dict(change) for label, change in pairs})


def random_axis(
    name: str, entry: Any, data: Mapping[str, Any], source: str, key: str = "random"
) -> RandomAxis:
    """Returns the axis of an entry of `random`.

    Args:
        name: Key of the entry: a field's path, or a name if the entry has the key `fields`.
        entry: Mapping with one of `KINDS` and, for several fields, a list of paths `fields`.
        data: Scenario whose fields change, as plain data.
        source: File of the study, for messages.
        key: Key of the entries, for messages.

    Raises:
        ScenarioError: If the entry is invalid.
    """
    kinds = [kind for kind in entry if kind != _FIELDS] if isinstance(entry, Mapping) else []
    if len(kinds) != 1 or kinds[0] not in KINDS:
        problem = f"{entry!r} must be a mapping with one of: {', '.join(KINDS)}; and maybe fields"
        raise ScenarioError(source, f"{key}.{name}", problem)
    fields, (kind,) = entry.get(_FIELDS, [name]), kinds
    for where, values in ((_FIELDS, fields), (kind, entry[kind])):
        if not isinstance(values, list) or not values:
            problem = f"{values!r} must be a list, not empty"
            raise ScenarioError(source, f"{key}.{name}.{where}", problem)
    present = [read_field(data, str(path), f"{source}: {key}") for path in fields]
    arguments = _numbers(entry[kind], present)
    if kind != "choice":
        type_, rules = _RANGES[kind]
        fits = len(arguments) == 2 and not any(scalar_problem(e, type_, rules) for e in arguments)
        if not fits or arguments[0] > arguments[1]:
            problem = f"must be two, lower first, each {scalar_problem(None, type_, rules)}"
            raise ScenarioError(source, f"{key}.{name}.{kind}", f"{arguments} {problem}")
    return RandomAxis(name, tuple(map(str, fields)), kind, tuple(arguments))


def check_axes(axes: list[Axis], source: str, columns: list[str]) -> None:
    """Checks axes against each other.

    Args:
        axes: All axes of a condition.
        source: File of the study, for messages.
        columns: Names of the rows' columns besides those of axes.

    Raises:
        ScenarioError: If two axes set the same field or have the same name, or one sets the seed.
    """
    for place, axis in enumerate(axes):
        if any(overlap(field, SEED_FIELD) for field in axis.fields):
            raise ScenarioError(source, SEED_FIELD, "is the seed; use the key seeds instead")
        if axis.name in columns:
            raise ScenarioError(source, axis.name, "is another column; use another name")
        for other in axes[:place]:
            if axis.name == other.name:
                raise ScenarioError(source, axis.name, "is in grid and in random")
            for field in axis.fields:
                if any(overlap(field, taken) for taken in other.fields):
                    problem = f"is set by {axis.name} and by {other.name}"
                    raise ScenarioError(source, field, problem)


def as_label(value: Any) -> Label:
    """Returns a value for the rows: a scalar itself, or else JSON."""
    return value if isinstance(value, float | int | str) else json.dumps(value)


def _numbers(values: list[Any], present: list[Any]) -> list[Any]:
    """Converts texts that YAML 1.1 does not read as numbers, such as 1e-3; keeps other values.

    Args:
        values: New values of fields.
        present: Present values of the fields; if one is a text, nothing is converted.
    """
    if any(isinstance(value, str) for value in present):
        return values
    return [_number(value) for value in values]


def _number(value: Any) -> Any:
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value
