"""What is swept over given values: a field, or several fields together."""

import copy
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from drake_pregrasp.errors import ScenarioError
from drake_pregrasp.simulation.yaml_text import TAG_KEY
from drake_pregrasp.studies.settings_file import text_keys
from drake_pregrasp.studies.sweep.field_path import read_field, set_field

Label = float | int | bool | str
"""What a row says of a value."""


@dataclass(frozen=True)
class GridAxis:
    """One swept thing, and the values that it has in turn.

    Attributes:
        name: Path of the field, or the name of several that change together.
        labels: What rows say of each value.
        changes: For each value, the fields that it sets, by their paths.
    """

    name: str
    labels: tuple[Label, ...]
    changes: tuple[Mapping[str, Any], ...]

    @property
    def fields(self) -> tuple[str, ...]:
        """The paths of all fields that it sets."""
        return tuple(dict.fromkeys(path for change in self.changes for path in change))


def grid_axis(name: str, values: Any, data: dict[str, Any], source: str) -> GridAxis:
    """Returns the axis of an entry of `grid`.

    Args:
        name: The entry's key: a field's path if `values` is a list; a name if it is a mapping from
            labels to mappings from paths to values.
        values: What the entry holds.
        data: The scenario that is swept.
        source: Of the study, for messages.

    Raises:
        ScenarioError: If the entry can't be used.
    """
    if isinstance(values, list) and values:
        axis = _of_a_field(name, values, data, source)
    elif isinstance(values, Mapping) and values and TAG_KEY not in values:
        axis = _of_fields_together(name, values, data, source)
    else:
        problem = "must be a list of values, or a mapping from labels to what each sets; not empty"
        raise ScenarioError(source, f"grid.{name}", problem)
    said = [label_text(label) for label in axis.labels]
    twice = next((text for text in said if said.count(text) > 1), None)
    if twice is not None:
        raise ScenarioError(source, f"grid.{name}", f"{twice} is there twice; give each value once")
    return axis


def label_of(value: Any) -> Label:
    """Returns what rows say of a value: itself, or what is no scalar as JSON."""
    if isinstance(value, float | int | str):
        return value
    return json.dumps(text_keys(value), sort_keys=True)


def label_text(label: Label) -> str:
    """Returns a label as a row has it, numbers with all their digits."""
    if isinstance(label, bool):
        return "true" if label else "false"
    if isinstance(label, float) and label.is_integer() and abs(label) < 1e15:
        return str(int(label))
    return label if isinstance(label, str) else repr(label)


def number(value: Any) -> Any:
    """Returns the number of a text that YAML 1.1 doesn't read as one, as 1e-3; else the value."""
    if not isinstance(value, str):
        return value
    try:
        return float(value)
    except ValueError:
        return value


def _of_a_field(name: str, values: list[Any], data: dict[str, Any], source: str) -> GridAxis:
    source = f"{source}: grid"
    if not isinstance(read_field(data, name, source), str):
        values = [number(value) for value in values]
    for value in values:
        set_field(copy.deepcopy(data), name, value, source)
    return GridAxis(name, tuple(map(label_of, values)), tuple({name: v} for v in values))


def _of_fields_together(
    name: str, values: Mapping[Any, Any], data: dict[str, Any], source: str
) -> GridAxis:
    labels, changes = [], []
    for label, fields in values.items():
        if not isinstance(label, float | int | str):
            raise ScenarioError(source, f"grid.{name}", f"{label} must be a number or a text")
        where = f"{source}: grid.{name}.{label}"
        if not isinstance(fields, Mapping) or not fields:
            problem = f"{fields!r} must be a mapping from paths of fields to values"
            raise ScenarioError(source, f"grid.{name}.{label}", problem)
        scratch = copy.deepcopy(data)
        for path, value in fields.items():
            set_field(scratch, str(path), value, where)
        labels.append(label)
        changes.append({str(path): value for path, value in fields.items()})
    return GridAxis(name, tuple(labels), tuple(changes))
