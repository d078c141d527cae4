"""Random values of a schema, and invalid values."""

import dataclasses
import random
import types
import typing
from collections.abc import Mapping
from typing import Any

from drake_pregrasp.config.object_config import Box, Mesh, PoseStream
from drake_pregrasp.simulation.schema_check import _fields

LEFT_OUT = 0.8  # Share of a mapping's keys that keep their defaults.
PLAIN = 0.7  # Share of objects that are boxes, whose surfaces take least.

NASTY = (
    *("1e400", "-1e400", ".nan", ".inf", "-.inf", "1e-320", "0x" + "f" * 300, "9" * 5000),
    *("9" * 60, "-1", "0", "1.5", "1e9", "1e-9", "true", "null", "~", "''", "[]", "{}", "[[]]"),
    *("[1, [2, [3]]]", "{a: {b: {c: 1}}}", "2001-02-30", "2001-02-03", "1:2:3", "0o7", "1_000"),
    *("!!python/object/apply:os.system [echo]", "!!python/name:os.system", "!Box {}", "!x 3"),
    *("!!binary aGVsbG8=", "!!set {a, b}", "!!int x", "!!float x", "!!timestamp x", "!!omap [a]"),
    *('"\\x00"', '"\\n\\e[31m"', '"\\u202e"', '"\\U0001F600"', "\u00e9\u4e2d", "&a [*a]", "*none"),
    *("/etc/passwd", "../../../etc/passwd", "~/x", "~nobody/x", "package://drake_pregrasp/../x"),
    *("https://example.org/x.obj", "file:///etc/passwd", "robots://x", "x" * 5000, "a" * 300),
    *("[" * 50 + "]" * 50, "[" + "1," * 500 + "1]", "{" + "a: " * 3 + "1}", "<<", "=", "'", "%"),
    *("1e300", "1e154", "-1e300", "[1e300, 1e300, 1e300]", "[0, 0, 0]", "[.nan, 0, 0]", "@"),
    "{_tag: 3}",
)
"""Values that break careless programs, as YAML in flow style or nearly so."""


def some_text(rng: random.Random, schema: Any, bad: float = 0.0) -> str:
    """Returns YAML, in flow style, of an instance of a dataclass or of one of Drake's classes.

    A share `bad` of the values are out of `NASTY`.
    """
    parts = []
    for name, (kind, rules) in _fields(schema).items():
        if rules.get("required") or rng.random() > LEFT_OUT:
            parts.append(f"{name}: {_value(rng, kind, rules, bad)}")
    return "{" + ", ".join(parts) + "}"


def _value(rng: random.Random, kind: Any, rules: Mapping[str, Any], bad: float) -> str:
    if rng.random() < bad:
        return rng.choice(NASTY)
    origin = typing.get_origin(kind)
    if origin is list:
        least = rules.get("length", rules.get("min_length", 0))
        count = rules.get("length", least + rng.choice((0, 1, 2, 5)))
        (element,) = typing.get_args(kind)
        inner = rules.get("elements", rules)
        return "[" + ", ".join(_value(rng, element, inner, bad) for _ in range(count)) + "]"
    if origin in (typing.Union, types.UnionType):
        kinds = typing.get_args(kind)
        chosen = kinds[0] if Box in kinds and rng.random() < PLAIN else rng.choice(kinds)
        if chosen is Mesh:
            return f"!Mesh {{file: {rng.choice(MESHES)}}}"
        if chosen is PoseStream:
            return "!PoseStream {file: package://drake_pregrasp/carried_by_hand.csv}"
        return f"!{chosen.__name__} {some_text(rng, chosen, bad)}"
    if "one_of" in rules:
        return f"'{rng.choice(rules['one_of'])}'"
    if kind is bool:
        return rng.choice(("true", "false"))
    if kind is str:
        return rng.choice(("''", "x", "point", "sap", "'$x_{$ <b>'"))
    if kind in (int, float):
        return _number(rng, kind, rules)
    if dataclasses.is_dataclass(kind) or hasattr(kind, "__fields__"):
        return some_text(rng, kind, bad)
    return "null"


MESHES = ("package://drake_pregrasp/bracket.obj", "package://drake_pregrasp/none.obj", "x.stl")


def _number(rng: random.Random, kind: type, rules: Mapping[str, Any]) -> str:
    low = float(rules.get("at_least", rules.get("above", -1e9)))
    high = float(rules.get("at_most", 1e9))
    way = rng.random()
    if way < 0.1:
        number = low
    elif way < 0.2:
        number = high
    elif way < 0.6 and high > 0:
        least = max(low, 1e-6)
        number = least * (high / least) ** rng.random()
    else:
        number = min(max(rng.gauss(0.0, 0.3), low), high)
    return str(int(number)) if kind is int else repr(number)
