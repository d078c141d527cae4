"""Writes the pages of docs/reference from dataclasses, docstrings and options.

    .venv/bin/python .ci/reference_pages.py

A test fails if a page differs from what this script would write.
"""

import argparse
import ast
import dataclasses
import importlib
import inspect
import itertools
import json
import re
import textwrap
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import drake_pregrasp
from drake_pregrasp.cli import command
from drake_pregrasp.config.hand_description import HandDescription
from drake_pregrasp.config.validation import is_scalar, scalar_problem
from drake_pregrasp.grasping.held_criterion import held_measures
from drake_pregrasp.interfaces import lcm, lcm_status
from drake_pregrasp.simulation.grasp_export import export_grasp
from drake_pregrasp.simulation.run_log import grasp_columns, log_columns
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.summary import object_fate, summarize, summarize_grasp
from drake_pregrasp.studies.measures import MEASURES
from drake_pregrasp.studies.study_config import Condition, Method, PairedTest, StudyConfig

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "docs" / "reference"
MADE = "*This page is made by `.ci/reference_pages.py` from {}.*"
DRAKE = "https://drake.mit.edu/pydrake/pydrake.{0}.html#pydrake.{0}.{1}"


# Keys of YAML files.


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


# Files of a run.


def run_page() -> str:
    """Returns the page of the columns of logs and of the keys of the summary."""
    sections = []
    for title, head, functions in (
        ("log.csv", "column", [log_columns]),
        ("grasp.csv", "column", [grasp_columns]),
        ("summary.json", "key", [summarize, object_fate]),
        ("`grasp` in summary.json", "key", [summarize_grasp, held_measures]),
        ("grasp.npz", "array", [export_grasp]),
    ):
        rows = [f"| {head} | content |", "|---|---|"]
        for function in functions:
            text = inspect.getdoc(function) or ""
            for bullet in re.findall(r"^- (.*(?:\n  .*)*)", text, flags=re.M):
                names, _, content = " ".join(bullet.split()).partition(": ")
                rows.append(f"| {names} | {content} |")
        sections += [f"## {title}", "\n".join(rows)]
    lines = [
        "# Columns and keys of a run",
        "[The files of a run](../run_folder.md) explains them. Lengths are in metres, times in "
        "seconds, forces in newtons. `{i}` is the index of a contact or finger.",
        MADE.format("docstrings"),
        *sections,
    ]
    return "\n\n".join(lines) + "\n"


# Limits.


def limits_page() -> str:
    """Returns the page of the limits on files and runs."""
    package, rows = Path(inspect.getfile(drake_pregrasp)).parent, []
    for path in sorted(package.rglob("*.py")):
        module = ".".join(path.relative_to(package).with_suffix("").parts)
        for node, after in itertools.pairwise(ast.parse(path.read_text(encoding="utf-8")).body):
            name = ast.unparse(node.targets[0]) if isinstance(node, ast.Assign) else ""
            if name.startswith("MAX_"):
                value = getattr(importlib.import_module(f"drake_pregrasp.{module}"), name)
                text = " ".join(ast.literal_eval(typing.cast(ast.Expr, after).value).split())
                rows.append(f"| {text} | {value:,} | `{module}.{name}` |")
    lines = [
        "# Limits",
        "What exceeds a limit is refused in one line, unless its row says otherwise; "
        "[Untrusted files](../untrusted_files.md) says what this protects.",
        MADE.format("the constants of the package"),
        "\n".join(["| limit | value | constant |", "|---|---|---|", *rows]),
    ]
    return "\n\n".join(lines) + "\n"


# Ports.


def ports(system: type) -> list[tuple[str, str]]:
    """Returns the direction and name of each port, in order."""
    found, direction = [], ""
    for line in port_block(system).splitlines():
        if line.strip() in ("input_ports:", "output_ports:"):
            direction = "in" if line.strip().startswith("in") else "out"
        elif line.strip().startswith("- "):
            found.append((direction, line.strip()[2:].strip().strip("'\"")))
    return found


def port_block(system: type) -> str:
    """Returns the `pydrake_system` block of a docstring; empty if there is none."""
    text = inspect.getdoc(system) or ""
    found = re.search(r"\.\. pydrake_system::\n\n((?:    .*\n|\n)+)", text)
    return found[1] if found else ""


def described(system: type) -> dict[tuple[str, str], str]:
    """Returns what a docstring says of each port, by its direction and name."""
    found: dict[tuple[str, str], str] = {}
    for paragraph in (inspect.getdoc(system) or "").split("\n\n"):
        words = " ".join(paragraph.split())
        if said := re.match(r"Ports? (`.*?) (accepts?|emits?) (.*)", words):
            direction = "in" if said[2].startswith("accept") else "out"
            for name in re.findall(r"`([^`]+)`", said[1]):
                found[direction, name] = said[3]
                if "(optional)" in said[1]:
                    found[direction, name] = f"(optional) {said[3]}"
    return found


def ports_page() -> str:
    """Returns the page of the ports of all public systems."""
    public = [getattr(drake_pregrasp, name) for name in drake_pregrasp.__all__]
    public += [getattr(module, name) for name, module in names_of_interfaces().items()]
    lines = [
        "# Ports",
        "The ports of the public systems and diagrams, in their order. W is the world, O the "
        "object, n the number of contacts; units are SI. [The diagram](../architecture.md#the-"
        "diagram) shows how they are connected.",
        MADE.format("docstrings"),
    ]
    for system in public:
        if not inspect.isclass(system) or not port_block(system):
            continue
        text = inspect.getdoc(system) or ""
        said = described(system)
        rows = [
            f"| {way} | `{port}` | {said.get((way, port), '')} |" for way, port in ports(system)
        ]
        shared = [" ".join(part.split()) for part in text.split("\n\n") if "The ports are" in part]
        lines += [f"## {system.__name__}", text.splitlines()[0], *shared]
        lines.append("\n".join(["| | port | |", "|---|---|---|", *rows]))
    return "\n\n".join(lines) + "\n"


# Commands.


def commands_page() -> str:
    """Returns the page of all commands with their options."""
    lines = [
        "# Commands",
        "`drake-pregrasp COMMAND --help` prints the same. The exit status is 0, 2 for bad input, "
        "with one line that names the file, the key and the value, and 130 after an interruption.",
        MADE.format("the parsers of the commands"),
    ]
    for parser, text in subparsers(command._parser()):
        lines += [f"## `{parser.prog}`", text[0].upper() + text[1:] + "."]
        rows = [
            f"| `{option_name(action)}` | {help_text(parser, action)} |"
            for action in parser._actions
            if not isinstance(action, argparse._HelpAction)
        ]
        if rows:
            lines.append("| argument or option | |\n|---|---|\n" + "\n".join(rows))
    return "\n\n".join(lines) + "\n"


def subparsers(parser: Any) -> Iterator[tuple[Any, str]]:
    """Yields each command's parser and its line of help."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            texts = {choice.dest: choice.help for choice in action._choices_actions}
            for name, child in action.choices.items():
                if child.add_options is not None:
                    child.add_options(child)
                inner = list(subparsers(child))
                yield from inner or [(child, texts[name])]


def option_name(action: argparse.Action) -> str:
    """Returns an option with its placeholder, or the name of an argument."""
    name = action.metavar or (action.dest.upper() if action.nargs != 0 else "")
    if action.choices and not action.metavar:
        name = "{" + ",".join(map(str, action.choices)) + "}"
    return " ".join([*action.option_strings[:1], str(name)]).strip()


def help_text(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    """Returns the help of an option, with its default."""
    if not action.help:
        return ""
    text = parser._get_formatter()._expand_help(action).replace("|", r"\|")
    return re.sub(r"(--[\w-]+)", r"`\1`", text)


# Public names.


def api_page() -> str:
    """Returns the page of the public names."""
    lines = [
        "# API",
        "The public names of `drake_pregrasp`, by the folder of their source, and those of "
        "`interfaces.lcm` and `interfaces.lcm_status`. [Ports](ports.md) and "
        "[keys](scenario_keys.md) have pages of their own.",
        MADE.format("docstrings"),
    ]
    groups: dict[str, list[str]] = {}
    tree = ast.parse(inspect.getsource(drake_pregrasp))
    for node in tree.body:
        if not isinstance(node, ast.ImportFrom) or str(node.module).endswith("version"):
            continue
        module = importlib.import_module(str(node.module))
        file = str(node.module).replace(".", "/")
        for name in (alias.name for alias in node.names):
            entry = f"- [`{name}`](../../{file}.py): {summary_of(module, name)}"
            groups.setdefault(str(node.module).split(".")[1], []).append(entry)
    for name, module in names_of_interfaces().items():
        file = module.__name__.replace(".", "/")
        entry = f"- [`{name}`](../../{file}.py): {summary_of(module, name)}"
        groups.setdefault(module.__name__.partition(".")[2], []).append(entry)
    for group, entries in groups.items():
        lines += [f"## `{group}`", "\n".join(sorted(entries))]
    return "\n\n".join(lines) + "\n"


def names_of_interfaces() -> dict[str, types.ModuleType]:
    """Returns the modules of the public classes and functions for LCM, which need its messages."""
    return {
        name: module
        for module in (lcm, lcm_status)
        for name, item in vars(module).items()
        if getattr(item, "__module__", "") == module.__name__ and name[0] != "_"
    }


def summary_of(module: Any, name: str) -> str:
    """Returns the first sentence of a docstring; that of a constant is the string below it."""
    item = getattr(module, name)
    text = inspect.getdoc(item)
    if getattr(item, "__module__", "") != module.__name__:
        body = ast.parse(inspect.getsource(module)).body
        for node, after in itertools.pairwise(body):
            targets = getattr(node, "targets", [getattr(node, "target", None)])
            if any(isinstance(target, ast.Name) and target.id == name for target in targets):
                text = ast.literal_eval(typing.cast(ast.Expr, after).value)
    return " ".join((text or "").split("\n\n")[0].split())


def pages() -> dict[str, str]:
    """Returns the text of each page by its name."""
    return {
        **key_pages(),
        "study_keys.md": study_page(),
        "run_files.md": run_page(),
        "limits.md": limits_page(),
        "ports.md": ports_page(),
        "commands.md": commands_page(),
        "api.md": api_page(),
    }


def main() -> None:
    """Writes the pages that have changed."""
    FOLDER.mkdir(exist_ok=True)
    for name, text in pages().items():
        page = FOLDER / name
        if not page.exists() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")
            print(f"wrote {page.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
