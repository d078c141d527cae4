"""What is swept over random values: a field, or several fields with the same value."""

import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from drake_pregrasp.errors import ScenarioError
from drake_pregrasp.studies.sweep.field_path import read_field
from drake_pregrasp.studies.sweep.grid_axis import Label, label_of, number

KINDS = ("uniform", "log_uniform", "integer", "choice")
"""How values can be distributed."""

_FIELDS = "fields"
_WHOLE = np.iinfo(np.int64)


@dataclass(frozen=True)
class RandomAxis:
    """One thing that has another value in each sample.

    Attributes:
        name: Path of the field, or the name of several that get the same value.
        fields: The paths of all of them.
        kind: One of `KINDS`.
        arguments: The two ends of the range, or what is chosen from.
    """

    name: str
    fields: tuple[str, ...]
    kind: str
    arguments: tuple[Any, ...]

    def draw(self, seed: int, sample: int) -> Any:
        """Returns the value of a sample.

        It is drawn by numpy's default generator with the seed [`seed`, CRC-32 of the name,
        `sample`]: whatever else is swept, and however many samples there are, it is the same.

        Args:
            seed: Of all samples of a study.
            sample: Which, from 0 on.
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

    def label(self, value: Any) -> Label:
        """Returns what rows say of a value."""
        return label_of(value)


def random_axis(name: str, entry: Any, data: Mapping[str, Any], source: str) -> RandomAxis:
    """Returns the axis of an entry of `random`.

    Args:
        name: The entry's key: a field's path, or a name if the entry has the key `fields`.
        entry: A mapping with one of `KINDS`, and `fields`, a list of paths, if there are several.
        data: The scenario that is swept.
        source: Of the study, for messages.

    Raises:
        ScenarioError: If the entry can't be used.
    """
    key = f"random.{name}"
    kinds = [kind for kind in entry if kind != _FIELDS] if isinstance(entry, Mapping) else []
    if len(kinds) != 1 or kinds[0] not in KINDS:
        problem = f"{entry!r} must be a mapping with one of: {', '.join(KINDS)}; and perhaps fields"
        raise ScenarioError(source, key, problem)
    fields = entry.get(_FIELDS, [name])
    if not isinstance(fields, list) or not fields:
        raise ScenarioError(source, f"{key}.{_FIELDS}", f"{fields!r} must be a list of paths")
    for path in fields:
        read_field(data, str(path), f"{source}: random")
    kind, arguments = kinds[0], entry[kinds[0]]
    if not isinstance(arguments, list) or not arguments:
        raise ScenarioError(source, f"{key}.{kind}", f"{arguments!r} must be a list of values")
    arguments = [number(value) for value in arguments]
    if kind != "choice":
        _check_range(source, f"{key}.{kind}", kind, arguments)
    return RandomAxis(name, tuple(map(str, fields)), kind, tuple(arguments))


def _check_range(source: str, key: str, kind: str, ends: list[Any]) -> None:
    allowed = int if kind == "integer" else int | float
    right = len(ends) == 2 and all(
        isinstance(e, allowed) and not isinstance(e, bool) and math.isfinite(e) for e in ends
    )
    if right and kind == "integer":
        right = all(_WHOLE.min <= end <= _WHOLE.max for end in ends)
    if not right or ends[0] > ends[1] or (kind == "log_uniform" and ends[0] <= 0):
        what = (
            f"whole numbers from {_WHOLE.min} to {_WHOLE.max}" if kind == "integer" else "numbers"
        )
        above = " above 0" if kind == "log_uniform" else ""
        raise ScenarioError(source, key, f"{ends} must be two {what}{above}, the lower one first")
