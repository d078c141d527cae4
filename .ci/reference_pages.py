"""Writes the pages of docs/reference from dataclasses, docstrings and options.

    .venv/bin/python .ci/reference_pages.py

A test fails if a page differs from what this script would write.
"""

import argparse
import ast
import enum
import importlib
import inspect
import itertools
import re
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from key_pages import MADE, key_pages, study_page

import drake_pregrasp
from drake_pregrasp.cli import command
from drake_pregrasp.grasping.held_criterion import held_measures
from drake_pregrasp.interfaces import lcm, lcm_status
from drake_pregrasp.simulation.grasp_export import export_grasp
from drake_pregrasp.simulation.run_log import grasp_columns, log_columns
from drake_pregrasp.simulation.summary import object_fate, summarize, summarize_grasp

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "docs" / "reference"


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
        "seconds, forces in newtons. `{i}` is the index of a contact or finger. Numbers that stand "
        "for names are [codes](codes.md).",
        MADE.format("docstrings"),
        *sections,
    ]
    return "\n\n".join(lines) + "\n"


# Codes.


def codes_page() -> str:
    """Returns the page of the numbers that ports and logs use for names."""
    public = [getattr(drake_pregrasp, name) for name in drake_pregrasp.__all__]
    sections = []
    for kind in (item for item in public if isinstance(item, enum.EnumMeta)):
        *texts, attributes = (inspect.getdoc(kind) or "").split("\n\n")
        entries = re.findall(r"^    ([A-Z_, ]+): (.*(?:\n     .*)*)", attributes, flags=re.M)
        meanings = {
            name: " ".join(text.split()) for names, text in entries for name in names.split(", ")
        }
        members = sorted(kind, key=lambda member: member.value)
        rows = [f"| {m.value} | `{m.name}` | {meanings[m.name]} |" for m in members]
        rows = ["| code | name | meaning |", "|---|---|---|", *rows]
        sections += [f"## {kind.__name__}", *(" ".join(text.split()) for text in texts)]
        sections.append("\n".join(rows))
    lines = [
        "# Codes",
        "Ports and logs hold these numbers. In Python, `TrackingStatus(2).name` returns the name.",
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


def inner_ports(system: type) -> dict[tuple[str, str], str]:
    """Returns links to what other systems of a module say of ports of the same name."""
    found: dict[tuple[str, str], list[str]] = {}
    for name, inner in vars(inspect.getmodule(system)).items():
        is_ours = str(getattr(inner, "__module__", "")).startswith("drake_pregrasp.")
        if inspect.isclass(inner) and is_ours and inner is not system and port_block(inner):
            for port in ports(inner):
                found.setdefault(port, []).append(f"[`{name}`](#{name.lower()})")
    return {port: f"as for {' and '.join(links)}" for port, links in found.items()}


def arguments(system: type) -> list[tuple[str, str]]:
    """Returns the name of each argument of the constructor, and what the docstring says of it."""
    _, _, after = (inspect.getdoc(system) or "").partition("\nArgs:\n")
    section = re.split(r"\n\n|\n(?=\S)", after)[0]
    found = re.findall(r"^    (\w+): (.*(?:\n {5,}.*)*)", section, flags=re.M)
    return [(name, " ".join(text.split())) for name, text in found]


def ports_page() -> str:
    """Returns the page of the ports and arguments of all public systems."""
    public = [getattr(drake_pregrasp, name) for name in drake_pregrasp.__all__]
    public += [getattr(module, name) for name, module in names_of_interfaces().items()]
    lines = [
        "# Ports",
        "The ports of the public systems and diagrams, in their order, and the arguments of their "
        "constructors. W is the world, O the object, n the number of contacts; units are SI. "
        "[The diagram](../architecture.md#the-diagram) shows how they are connected.",
        MADE.format("docstrings"),
    ]
    for system in public:
        if not inspect.isclass(system) or not port_block(system):
            continue
        text = inspect.getdoc(system) or ""
        said = inner_ports(system) | described(system)
        rows = [
            f"| {way} | `{port}` | {said.get((way, port), '')} |" for way, port in ports(system)
        ]
        rows += [f"| argument | `{name}` | {meaning} |" for name, meaning in arguments(system)]
        parts = [" ".join(part.split()) for part in text.split("\n\n")]
        shared = [part for part in parts if "ports are those" in part]
        lines += [f"## {system.__name__}", text.splitlines()[0], *shared]
        lines.append("\n".join(["| | port | |", "|---|---|---|", *rows]))
    return "\n\n".join(lines) + "\n"


# Commands.


def commands_page() -> str:
    """Returns the page of all commands with their options."""
    lines = [
        "# Commands",
        "`drake-pregrasp COMMAND --help` prints the same. The exit status is 0; 1 if runs of a "
        "study failed; 2 for bad input, with one line that names the file, the key and the value, "
        "or if output cannot be written; 130 after an interruption; and 141 if whatever reads the "
        "output has ended.",
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
        "codes.md": codes_page(),
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
