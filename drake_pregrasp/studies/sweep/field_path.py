"""Fields of a scenario by dotted paths, such as `planner.period` or `object.size[0]`.

A scenario is here what YAML makes of it, with every key, as `scenario_data` returns it: mappings,
lists and scalars.
"""

import difflib
import re
from collections.abc import Iterator, Mapping
from typing import Any

from drake_pregrasp.errors import ScenarioError
from drake_pregrasp.simulation.yaml_text import TAG_KEY

_STEP = re.compile(r"\.?([A-Za-z_]\w*)|\[(\d+)\]")


def read_field(data: Mapping[str, Any], path: str, source: str) -> Any:
    """Returns the value of a field.

    Raises:
        ScenarioError: If there is no such field; the message has the nearest name.
    """
    value: Any = data
    for step in _steps(data, path, source):
        value = _step_into(data, value, step, path, source)
    return value


def set_field(data: dict[str, Any], path: str, value: Any, source: str) -> None:
    """Sets a field, in place.

    A mapping changes only the keys that it has, as an overriding text does; but with another tag
    than the one that is there, or where none is, it takes its place.

    Raises:
        ScenarioError: If there is no such field; the message has the nearest name.
    """
    *first, last = _steps(data, path, source)
    holder: Any = data
    for step in first:
        holder = _step_into(data, holder, step, path, source)
    before = _step_into(data, holder, last, path, source)
    if _merges(before, value):
        for key, element in value.items():
            if key != TAG_KEY:
                set_field(data, f"{path}.{key}", element, source)
    else:
        holder[last] = value


def overlap(one: str, other: str) -> bool:
    """Whether a field is another one, or is inside it."""
    short, long = sorted((one, other), key=len)
    return long.startswith(short) and long[len(short) : len(short) + 1] in ("", ".", "[")


def _merges(before: Any, value: Any) -> bool:
    if not (isinstance(before, Mapping) and isinstance(value, Mapping)):
        return False
    return TAG_KEY not in value or value[TAG_KEY] == before.get(TAG_KEY)


def _steps(data: Mapping[str, Any], path: str, source: str) -> list[str | int]:
    steps: list[str | int] = []
    end = 0
    while end < len(path):
        found = _STEP.match(path, end)
        if found is None or (end == 0) == path[end : end + 1].startswith((".", "[")):
            raise _unknown(data, path, source)
        name, index = found.groups()
        steps.append(name if index is None else int(index))
        end = found.end()
    if not steps:
        raise _unknown(data, path, source)
    return steps


def _step_into(data: Mapping[str, Any], value: Any, step: str | int, path: str, source: str) -> Any:
    if isinstance(step, int) and isinstance(value, list):
        if step >= len(value):
            problem = f"no element [{step}]: the list has {len(value)} in the scenario"
            raise ScenarioError(source, path, problem)
        return value[step]
    if isinstance(value, Mapping) and step in value and step != TAG_KEY:
        return value[step]
    raise _unknown(data, path, source)


def _unknown(data: Mapping[str, Any], path: str, source: str) -> ScenarioError:
    known = list(_paths(data))
    last = path.rpartition(".")[2]
    near = [k for k in known if k.rpartition(".")[2] == last][:1]
    near = difflib.get_close_matches(path, known, n=1) or near
    hint = f"did you mean {near[0]}?" if near else f"fields are: {', '.join(data)}"
    return ScenarioError(source, path, f"no such field in the scenario; {hint}")


def _paths(value: Any, path: str = "") -> Iterator[str]:
    if path:
        yield path
    if isinstance(value, Mapping):
        for key, element in value.items():
            if key != TAG_KEY:
                yield from _paths(element, f"{path}.{key}".lstrip("."))
    elif isinstance(value, list):
        for index, element in enumerate(value):
            yield from _paths(element, f"{path}[{index}]")
