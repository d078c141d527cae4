"""Range checks of configuration dataclasses.

Each field states its range once, in its metadata:

    period: float = field(default=0.05, metadata={"above": 0})

The rules are `above`, `at_least` and `at_most` (for a number, or for each number of a list),
`one_of` (for a text, or for each text of a list), `length`, `min_length` and `max_length` (for a
list; `MAX_LENGTH` by default), `elements` (rules for the elements of a list) and `required`. Python
constructors apply them through `checked`, and YAML files through `simulation.schema_check`.

A field that a person may change in a live run also has `typical`, the lowest and the highest of the
usual values, and `unit`, the unit in which they are shown; the live view makes a slider of it.
"""

import dataclasses
import math
import operator
import typing
from collections.abc import Callable, Mapping
from numbers import Integral, Real
from typing import Any, TypeVar

from drake_pregrasp.errors import InvalidArgumentError

Config = TypeVar("Config")

MAX_LENGTH = 64
"""Largest number of elements of a list without a rule of its own, as one entry for each contact."""

MAX_TEXT = 2000
"""Largest number of characters of a text."""

_COMPARISONS: Mapping[str, Callable[[Any, Any], bool]] = {
    "above": operator.gt,
    "at_least": operator.ge,
    "at_most": operator.le,
}
_TYPES: Mapping[Any, tuple[type, str]] = {
    float: (Real, "a number"),
    int: (Integral, "a whole number"),
    bool: (bool, "true or false"),
    str: (str, "a text"),
}


def is_scalar(kind: Any) -> bool:
    """Returns whether a field of that type holds a number, a truth value or a text."""
    return kind in _TYPES


def scalar_problem(value: object, kind: Any, rules: Mapping[str, Any]) -> str | None:
    """Returns the requirement that a scalar violates, in words, or None if it is valid.

    Args:
        value: The value to check.
        kind: Type of its field: `float`, `int`, `bool` or `str`.
        rules: Metadata of the field.
    """
    type_, words = _TYPES[kind]
    bounds = [f"{rule.replace('_', ' ')} {rules[rule]}" for rule in _COMPARISONS if rule in rules]
    fits = isinstance(value, type_) and isinstance(value, bool) == (kind is bool)
    if fits and kind in (int, float):
        fits = -math.inf < typing.cast(float, value) < math.inf and all(
            holds(value, rules[rule]) for rule, holds in _COMPARISONS.items() if rule in rules
        )
    elif isinstance(value, str) and "one_of" not in rules and len(value) > MAX_TEXT:
        return f"a text of at most {MAX_TEXT} characters"
    if fits and value in rules.get("one_of", (value,)):
        return None
    if "one_of" in rules:
        return "one of: " + ", ".join(rules["one_of"])
    return " ".join([words, " and ".join(bounds)]).strip()


def length_problem(length: int | None, rules: Mapping[str, Any]) -> str | None:
    """Returns the requirement that the length of a list violates, in words, or None if it is valid.

    Args:
        length: Number of elements of the list; None for what is no list.
        rules: Metadata of the list's field.
    """
    least, most = rules.get("min_length", 0), rules.get("max_length", MAX_LENGTH)
    if length != (exact := rules.get("length", length)):
        return f"a list of exactly {exact} elements"
    if length is None:
        return "a list"
    if length < least:
        return f"a list of at least {least} elements"
    return f"a list of at most {most} elements" if length > most else None


def checked(config: Config) -> Config:
    """Returns a configuration after `check_fields`."""
    check_fields(config)
    return config


def check_fields(config: Any, key: str = "") -> None:
    """Raises an error unless every field of a configuration is within its range.

    Args:
        config: An instance of a dataclass; those inside it are checked too.
        key: Dotted path of `config`, for the message.

    Raises:
        InvalidArgumentError: If a value is out of its range, or of another type.
    """
    hints = typing.get_type_hints(type(config))
    for field in dataclasses.fields(config):
        path = f"{key}.{field.name}" if key else field.name
        _check(path, getattr(config, field.name), hints[field.name], field.metadata)


def _check(key: str, value: Any, kind: Any, rules: Mapping[str, Any]) -> None:
    problem = None
    if is_scalar(kind):
        problem = scalar_problem(value, kind, rules)
    elif typing.get_origin(kind) is list:
        try:
            problem = length_problem(len(value), rules)
        except TypeError:
            problem = length_problem(None, rules)
        if problem is None:
            (element_kind,) = typing.get_args(kind)
            for index, element in enumerate(value):
                _check(f"{key}[{index}]", element, element_kind, rules.get("elements", rules))
    elif dataclasses.is_dataclass(value):
        check_fields(value, key)
    if problem is not None:
        raise InvalidArgumentError(f"{key} must be {problem}, not {value!r}")
