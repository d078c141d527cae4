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
from drake_pregrasp.errors import ScenarioError, nearest

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
    if not isinstance(data, Mapping):
        _reject(source, key, data, f"a mapping with keys out of: {', '.join(_fields(schema))}")
    fields = _fields(schema)
    for name, (_, rules) in fields.items():
        if rules.get("required") and name not in data:
            raise ScenarioError(source, key, f"lacks the key {name}; it has no default")
    for name, value in data.items():
        if name == TAG_KEY:
            raise ScenarioError(source, key, f"the tag {value} is not allowed here; leave it out")
        if not isinstance(name, str):
            raise ScenarioError(source, key, f"the key {_short(name)} must be a name")
        path = f"{key}.{name}" if key else name
        if name not in fields:
            hint = nearest(name, fields, "keys are")
            raise ScenarioError(source, path, f"unknown key (value {_short(value)}); {hint}")
        _check_value(source, path, value, *fields[name])


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
            if _is_union(kind):
                value[TAG_KEY] = f"!{type(part).__name__}"
            elif typing.get_origin(kind) is list and _is_union(*typing.get_args(kind)):
                for element, mapping in zip(part, value, strict=True):
                    mapping[TAG_KEY] = f"!{type(element).__name__}"


def _is_union(kind: Any) -> bool:
    return typing.get_origin(kind) in (typing.Union, types.UnionType)


def _fields(schema: Any) -> dict[str, tuple[Any, Mapping[str, Any]]]:
    if dataclasses.is_dataclass(schema):
        hints = typing.get_type_hints(schema)
        return {f.name: (hints[f.name], f.metadata) for f in dataclasses.fields(schema)}
    return {f.name: (f.type, _DRAKE_RULES.get(f.name, {})) for f in schema.__fields__}


def _check_value(source: str, key: str, value: object, kind: Any, rules: Mapping[str, Any]) -> None:
    if typing.get_origin(kind) is list:
        (element_kind,) = typing.get_args(kind)
        if not isinstance(value, list):
            _reject(source, key, value, "a list")
        if problem := length_problem(len(value), rules):
            _reject(source, key, value, problem)
        element_rules = rules.get("elements", rules)
        for index, element in enumerate(value):
            _check_value(source, f"{key}[{index}]", element, element_kind, element_rules)
    elif _is_union(kind):
        _check_variant(source, key, value, typing.get_args(kind))
    elif typing.get_origin(kind) is dict:
        if not isinstance(value, Mapping):
            _reject(source, key, value, "a mapping")
    elif is_scalar(kind):
        number = _number(value, kind) if kind in (int, float) else value
        if problem := scalar_problem(number, kind, rules):
            _reject(source, key, value, problem)
    else:
        check_mapping(source, key, value, kind)


def _check_variant(source: str, key: str, value: object, kinds: tuple[Any, ...]) -> None:
    tags = {f"!{kind.__name__}": kind for kind in kinds}
    if not isinstance(value, Mapping):
        _reject(source, key, value, f"a mapping with a tag out of: {', '.join(tags)}")
    data = dict(value)
    tag = data.pop(TAG_KEY, next(iter(tags)))
    if not isinstance(tag, str) or tag not in tags:
        raise ScenarioError(source, key, f"no such tag {tag}; there are: {', '.join(tags)}")
    try:
        check_mapping(source, key, data, tags[tag])
    except ScenarioError as error:
        if TAG_KEY in value:
            raise
        hint = f"{error.problem}; without a tag it is a {tag}, of: {', '.join(tags)}"
        raise ScenarioError(source, error.key, hint) from error


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


def _reject(source: str, key: str, value: object, expected: str) -> typing.NoReturn:
    _, has_choices, choices = expected.rpartition("one of: ")
    names = choices.split(", ") if has_choices else []
    close = difflib.get_close_matches(str(value), names, n=1)
    hint = f"; did you mean {close[0]}?" if close else ""
    raise ScenarioError(source, key, f"{_short(value)} must be {expected}{hint}")
