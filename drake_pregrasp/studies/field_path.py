"""Fields of a scenario by dotted paths, such as `planner.period` or `object.size[0]`.

A scenario is plain data with every key, as `scenario_data` returns it: mappings, lists and scalars.
"""

import copy
import difflib
import re
from collections.abc import Iterator, Mapping
from typing import Any

from drake_pregrasp.config.yaml_text import TAG_KEY
from drake_pregrasp.errors import ScenarioError

_NAME = r"[A-Za-z_]\w*"
_PATH = re.compile(rf"{_NAME}(?:\.{_NAME}|\[\d+\])*")
_STEP = re.compile(rf"({_NAME})|\[(\d+)\]")


def read_field(data: Mapping[str, Any], path: str, source: str) -> Any:
    """Returns the value of a field.

    Args:
        data: Scenario as plain data.
        path: Dotted path of the field.
        source: Name of the data's origin, for messages.

    Raises:
        ScenarioError: If the field does not exist; the message suggests the nearest name.
    """
    holder, step = _find(data, path, source)
    return holder[step]


def set_field(data: Mapping[str, Any], path: str, value: Any, source: str) -> None:
    """Sets a field in place.

    A mapping changes only its own keys, like an overriding text. A mapping with another tag, or in
    place of another kind of value, replaces the value.

    Args:
        data: Scenario as plain data, which is changed.
        path: Dotted path of the field.
        value: New value of the field.
        source: Name of the data's origin, for messages.

    Raises:
        ScenarioError: If the field does not exist; the message suggests the nearest name.
    """
    holder, step = _find(data, path, source)
    before = holder[step]
    both = isinstance(before, Mapping) and isinstance(value, Mapping)
    if both and value.get(TAG_KEY, before.get(TAG_KEY)) == before.get(TAG_KEY):
        for key, element in value.items():
            if key != TAG_KEY:
                set_field(data, f"{path}.{key}", element, source)
    else:
        holder[step] = value


def with_fields(data: Mapping[str, Any], changes: Mapping[str, Any], source: str) -> dict[str, Any]:
    """Returns a copy of a scenario with some fields set.

    Args:
        data: Scenario as plain data.
        changes: New values by the fields' paths.
        source: Name of the data's origin, for messages.

    Raises:
        ScenarioError: If a field does not exist; the message suggests the nearest name.
    """
    changed = copy.deepcopy(dict(data))
    for path, value in changes.items():
        set_field(changed, str(path), value, source)
    return changed


def overlap(one: str, other: str) -> bool:
    """Returns whether one of two fields contains the other, or both are the same."""
    short, long = sorted((one, other), key=len)
    return long.startswith(short) and long[len(short) : len(short) + 1] in ("", ".", "[")


def _find(data: Mapping[str, Any], path: str, source: str) -> tuple[Any, str | int]:
    """Returns the mapping or list that holds a field, and its key or index there."""
    holder: Any = None
    step: str | int = path
    value: Any = data
    for name, digits in _STEP.findall(path) if _PATH.fullmatch(path) else [(path, "")]:
        holder, step = value, int(digits) if digits else name
        if isinstance(step, int) and isinstance(holder, list):
            if step >= len(holder):
                problem = f"no element [{step}]: the list has {len(holder)} in the scenario"
                raise ScenarioError(source, path, problem)
        elif not isinstance(holder, Mapping) or step not in holder or step == TAG_KEY:
            raise _unknown(data, path, source)
        value = holder[step]
    return holder, step


def _unknown(data: Mapping[str, Any], path: str, source: str) -> ScenarioError:
    known = [name for name, _ in walk(data)]
    near = [k for k in known if k.rpartition(".")[2] == path.rpartition(".")[2]]
    near = difflib.get_close_matches(path, known, n=1) or near
    hint = f"did you mean {near[0]}?" if near else f"fields are: {', '.join(data)}"
    return ScenarioError(source, path, f"no such field in the scenario; {hint}")


def walk(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yields the path and the value of a field and of all fields inside it.

    Args:
        value: Value of the field.
        path: Path of the field; empty for a whole scenario.
    """
    if path:
        yield path, value
    if isinstance(value, Mapping):
        for key, element in value.items():
            if key != TAG_KEY:
                yield from walk(element, f"{path}.{key}".lstrip("."))
    elif isinstance(value, list):
        for index, element in enumerate(value):
            yield from walk(element, f"{path}[{index}]")
