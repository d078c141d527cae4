"""Checks raw YAML against a dataclass schema, with errors that name the key and the fix.

Drake's own loader rejects unknown keys and wrong types, but its errors do not name the place, and
it does not check ranges. A schema's field has its range in its metadata; see `config.validation`.

The YAML tag of a union's field selects its dataclass, as in `!Cylinder {radius: 0.03}`; without a
tag, the first dataclass of the union is used.

The content of a field of type `dict` is not checked here.
"""

import dataclasses
import difflib
import types
import typing
from collections.abc import Mapping
from typing import Any, TypeVar

from drake_pregrasp.config.validation import is_scalar, length_problem, scalar_problem
from drake_pregrasp.config.yaml_text import TAG_KEY, load_typed
from drake_pregrasp.errors import Problems, ScenarioError, nearest

Config = TypeVar("Config")

# Values outside these rules abort in Drake's own classes, or make a run impossible.
_DRAKE_RULES: Mapping[str, Mapping[str, Any]] = {
    "max_step_size": {"above": 0},
    "accuracy": {"above": 0},
    "start_time": {"at_least": 0, "at_most": 0},
    "target_realtime_rate": {"at_least": 0},
    "time_step": {"at_least": 1e-5, "at_most": 0.1},
    "penetration_allowance": {"above": 0},
    "stiction_tolerance": {"above": 0},
    "sap_near_rigid_threshold": {"at_least": 0},
}


def check_mapping(source: str, key: str, data: object, schema: Any) -> None:
    """Raises a `ScenarioError` unless `data` fits into an instance of `schema`.

    Args:
        source: Name of the data's origin, for the message.
        key: Dotted path of the data in its origin.
        data: Plain data, as `parse_yaml` returns it.
        schema: Dataclass, or one of Drake's configuration classes.
    """
    for path, problem in mapping_problems(key, data, schema):
        raise ScenarioError(source, path, problem)


def mapping_problems(key: str, data: object, schema: Any) -> Problems:
    """Yields the problems because of which data do not fit; the arguments are as above."""
    fields = _fields(schema)
    if not isinstance(data, Mapping):
        yield key, _rejected(data, f"a mapping with keys out of: {', '.join(fields)}")
        return
    for name, (_, rules) in fields.items():
        if rules.get("required") and name not in data:
            yield key, f"lacks the key {name}; it has no default"
    for name, value in data.items():
        path = f"{key}.{name}" if key else name
        if name == TAG_KEY:
            yield key, f"the tag {value} is not allowed here; leave it out"
        elif not isinstance(name, str):
            yield key, f"the key {_short(name)} must be a name"
        elif name not in fields:
            hint = nearest(name, fields, "keys are")
            yield path, f"unknown key (value {_short(value)}); {hint}"
        else:
            yield from _value_problems(path, value, *fields[name])


def load_checked(source: str, key: str, data: object, defaults: Config) -> Config:
    """Checks data like `check_mapping`, and returns them as an instance of the defaults' class.

    Args:
        source: Name of the data's origin, for the message.
        key: Dotted path of the data in its origin.
        data: Plain data, as `parse_yaml` returns it.
        defaults: Instance with the values of missing keys.
    """
    check_mapping(source, key, data, type(defaults))
    config: Config = load_typed(type(defaults), data, defaults)
    return config


def add_tags(data: object, config: object) -> None:
    """Adds the tags of unions to mappings, in place.

    Args:
        data: Plain data of the dumped configuration, in which the first types of unions have no
            tags.
        config: Configuration as a dataclass or a list of dataclasses; other types have no tags.
    """
    if isinstance(config, list) and isinstance(data, list):
        for element, part in zip(data, config, strict=True):
            add_tags(element, part)
    elif dataclasses.is_dataclass(config) and isinstance(data, dict):
        for name, (kind, _) in _fields(type(config)).items():
            part, value = getattr(config, name), data[name]
            add_tags(value, part)
            if is_union(kind):
                value[TAG_KEY] = f"!{type(part).__name__}"
            elif typing.get_origin(kind) is list and is_union(*typing.get_args(kind)):
                for element, mapping in zip(part, value, strict=True):
                    mapping[TAG_KEY] = f"!{type(element).__name__}"


def is_union(kind: Any) -> bool:
    """Returns whether a field of that type holds one of several dataclasses, which a tag names."""
    return typing.get_origin(kind) in (typing.Union, types.UnionType)


def _fields(schema: Any) -> dict[str, tuple[Any, Mapping[str, Any]]]:
    if dataclasses.is_dataclass(schema):
        hints = typing.get_type_hints(schema)
        return {f.name: (hints[f.name], f.metadata) for f in dataclasses.fields(schema)}
    return {f.name: (f.type, _DRAKE_RULES.get(f.name, {})) for f in schema.__fields__}


def _value_problems(key: str, value: object, kind: Any, rules: Mapping[str, Any]) -> Problems:
    if typing.get_origin(kind) is list:
        (element_kind,) = typing.get_args(kind)
        if not isinstance(value, list):
            yield key, _rejected(value, str(length_problem(None, rules)))
            return
        if problem := length_problem(len(value), rules):
            yield key, _rejected(value, problem)
        element_rules = rules.get("elements", rules)
        for index, element in enumerate(value):
            yield from _value_problems(f"{key}[{index}]", element, element_kind, element_rules)
    elif is_union(kind):
        yield from _variant_problems(key, value, typing.get_args(kind))
    elif typing.get_origin(kind) is dict:
        if not isinstance(value, Mapping):
            yield key, _rejected(value, "a mapping")
    elif is_scalar(kind):
        number = _number(value, kind) if kind in (int, float) else value
        if problem := scalar_problem(number, kind, rules):
            yield key, _rejected(value, problem)
    else:
        yield from mapping_problems(key, value, kind)


def _variant_problems(key: str, value: object, kinds: tuple[Any, ...]) -> Problems:
    tags = {f"!{kind.__name__}": kind for kind in kinds}
    if not isinstance(value, Mapping):
        yield key, _rejected(value, f"a mapping with a tag out of: {', '.join(tags)}")
        return
    data = dict(value)
    tag = data.pop(TAG_KEY, next(iter(tags)))
    if not isinstance(tag, str) or tag not in tags:
        yield key, f"no such tag {tag}; there are: {', '.join(tags)}"
        return
    for path, problem in mapping_problems(key, data, tags[tag]):
        hint = "" if TAG_KEY in value else f"; without a tag it is a {tag}, of: {', '.join(tags)}"
        yield path, f"{problem}{hint}"


def _number(value: object, kind: Any) -> float | int | None:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    if isinstance(value, int):
        return value
    if kind is int or "_" in str(value):  # Python's own notation for thousands.
        return None
    try:
        return float(value)  # YAML 1.1 reads 1e-3, without a point, as a text.
    except ValueError:
        return None


def _short(value: object) -> str:
    if isinstance(value, Mapping) and TAG_KEY in value:
        rest = {name: element for name, element in value.items() if name != TAG_KEY}
        return f"{value[TAG_KEY]} {_short(rest)}"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _rejected(value: object, expected: str) -> str:
    """Returns the problem of a value that is not as expected."""
    _, has_choices, choices = expected.rpartition("one of: ")
    names = choices.split(", ") if has_choices else []
    close = difflib.get_close_matches(str(value), names, n=1)
    hint = f"; did you mean {close[0]}?" if close else ""
    return f"{_short(value)} must be {expected}{hint}"
