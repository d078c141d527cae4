"""Pages of docs/reference with the keys of YAML files, from dataclasses."""

import ast
import dataclasses
import inspect
import json
import re
import textwrap
import typing
from collections.abc import Iterator
from typing import Any

from drake_pregrasp.config.hand_description import HandDescription
from drake_pregrasp.config.validation import is_scalar, scalar_problem
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.studies.measures import MEASURES
from drake_pregrasp.studies.study_config import Condition, Method, PairedTest, StudyConfig

MADE = "*This page is made by `.ci/reference_pages.py` from {}.*"
"""Line under the title of each page."""

DRAKE = "https://drake.mit.edu/pydrake/pydrake.{0}.html#pydrake.{0}.{1}"
"""Address of Drake's documentation of a module and a class."""


def field_comments(schema: type) -> dict[str, str]:
    """Returns the comment above each field of a dataclass; neighbours may share one."""
    lines = textwrap.dedent(inspect.getsource(schema)).splitlines()
    (node,) = ast.parse("\n".join(lines)).body
    comments, comment, end = {}, "", 0
    for part in typing.cast(ast.ClassDef, node).body:
        if isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name):
            above: list[str] = []
            line = part.lineno - 2
            while lines[line].strip().startswith("#"):
                above.insert(0, lines[line].strip("# "))
                line -= 1
            if above or part.lineno != end + 1:
                comment = " ".join(above)
            elif not isinstance(part.value, ast.Call):
                comment = ""
            comments[part.target.id] = comment
        end = part.end_lineno or 0
    return comments


def all_comments(schema: type) -> dict[str, str]:
    """Returns the comments of a dataclass's own and inherited fields."""
    bases = [base for base in reversed(schema.__mro__) if dataclasses.is_dataclass(base)]
    return {name: text for base in bases for name, text in field_comments(base).items()}


def variants(kind: Any) -> list[Any]:
    """Returns the types of a field: those of a union, or of the elements of a list."""
    if is_list(kind):
        return variants(typing.get_args(kind)[0])
    return list(typing.get_args(kind)) or [kind]


def is_list(kind: Any) -> bool:
    """Returns whether a field holds a list."""
    return typing.get_origin(kind) is list


def allowed(kind: Any, rules: Any) -> str:
    """Returns the type and range of a scalar field or a list, in the words of error messages."""
    if not is_list(kind):
        return str(scalar_problem(None, kind, rules))
    element = allowed(typing.get_args(kind)[0], rules.get("elements", rules))
    size = {key: rules[key] for key in ("length", "min_length", "max_length") if key in rules}
    words = {"length": "exactly {}", "min_length": "at least {}", "max_length": "at most {}"}
    number = " and ".join(words[key].format(value) for key, value in size.items())
    return f"a list of {number} elements, each {element}" if number else f"a list, each {element}"


def default_of(field: Any) -> str:
    """Returns the default value of a field in YAML."""
    if field.default_factory is not dataclasses.MISSING:
        value = field.default_factory()
    else:
        value = field.default
    if value in ("", []):
        return "empty"
    return f"`{value if isinstance(value, str) else json.dumps(value)}`"


def anchor(title: str) -> str:
    """Returns the anchor that GitHub and the site give to a heading."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def key_sections(schema: type, title: str, path: str, known: dict[type, str]) -> Iterator[str]:
    """Yields the section of a dataclass, and those of the dataclasses in it.

    Args:
        schema: The dataclass.
        title: Heading of its section.
        path: Dotted path of the dataclass in the file; empty for the whole file.
        known: Link to the section of each dataclass that has one; new ones are added.
    """
    summary = " ".join((schema.__doc__ or "").split("\n\n")[0].split())
    hints, comments, inner = typing.get_type_hints(schema), all_comments(schema), []
    rows = ["| key | meaning | values | default |", "|---|---|---|---|"]
    for field in dataclasses.fields(schema):
        kind, meaning = hints[field.name], comments[field.name]
        nested = [variant for variant in variants(kind) if not is_scalar(variant)]
        default = "required" if field.metadata.get("required") else ""
        if not nested:
            values, default = allowed(kind, field.metadata), default or default_of(field)
        else:
            key, links = f"{path}.{field.name}" if path else field.name, []
            for variant in nested:
                tag = f"!{variant.__name__}" if len(nested) > 1 else ""
                if variant.__module__.startswith("pydrake."):
                    module = variant.__module__.removeprefix("pydrake.")
                    known[variant] = DRAKE.format(module, variant.__name__)
                    tag = variant.__name__
                elif variant not in known:
                    heading = f"`{key}`{' `' + tag + '`' if tag else ''}"
                    known[variant] = f"#{anchor(heading)}"
                    inner.append((variant, heading, key))
                links.append(f"[`{tag or key}`]({known[variant]})")
            values = ("a list of " if is_list(kind) else "") + ", ".join(links)
            if len(nested) == 1:
                meaning = meaning or (nested[0].__doc__ or "").split("\n")[0]
            elif not default and not is_list(kind):
                default = f"`!{nested[0].__name__}`"
        cells = (f"`{field.name}`", meaning, values, default)
        rows.append("| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |")
    yield "\n\n".join([f"## {title}", summary, "\n".join(rows)])
    for variant, heading, key in inner:
        yield from key_sections(variant, heading, key, known)


def key_pages() -> dict[str, str]:
    """Returns the pages of the keys of scenarios and hands."""
    known: dict[type, str] = {}
    scenario = [
        "# Scenario keys",
        "All keys of a scenario file; [Scenarios](../scenarios.md) shows how to use them. Lengths "
        "are in metres, angles in radians, times in seconds. The values are those that the error "
        "messages name. Where several tags are possible, the first one may be left out.",
        MADE.format("the configuration dataclasses"),
        *key_sections(Scenario, "Scenario", "", known),
    ]
    known = {
        kind: link if link.startswith("https") else f"scenario_keys.md{link}"
        for kind, link in known.items()
    }
    hand = [
        "# Hand keys",
        "All keys of a hand's description; [Your hand](../own_hand.md) explains them.",
        MADE.format("the configuration dataclasses"),
        *key_sections(HandDescription, "Hand", "", known),
    ]
    return {
        "scenario_keys.md": "\n\n".join(scenario) + "\n",
        "hand_keys.md": "\n\n".join(hand) + "\n",
    }


def study_page() -> str:
    """Returns the page of the keys and measures of studies."""
    sections = []
    for schema in (StudyConfig, Condition, Method, PairedTest):
        rows, comments = ["| key | meaning | default |", "|---|---|---|"], field_comments(schema)
        for field in dataclasses.fields(schema):
            required = field.metadata.get("required")
            default = "required" if required else default_of(field).replace("`{}`", "empty")
            rows.append(f"| `{field.name}` | {comments[field.name]} | {default} |")
        summary = (schema.__doc__ or "").removeprefix("Schema of ").partition(". ")[0].rstrip(".")
        title = re.sub(r"(?<=[a-z])[A-Z]", lambda m: f" {m[0].lower()}", schema.__name__)
        sections += [f"## {title.removesuffix(' config')}"]
        sections += [f"{summary[0].upper()}{summary[1:]}.", "\n".join(rows)]
    measures = [f"| `{name}` | {label} |" for name, label in MEASURES.items()]
    return (
        "\n\n".join(
            [
                "# Study keys",
                "All keys of a study's file, and the measures that it may name; "
                "[Studies](../studies.md) shows how to use them.",
                MADE.format("the dataclasses and measures of studies"),
                *sections,
                "## Measures",
                "\n".join(["| measure | label |", "|---|---|", *measures]),
            ]
        )
        + "\n"
    )
