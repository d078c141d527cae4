"""The commands of the studies; each study is imported only when its command is given."""

import argparse
import functools
import importlib
from typing import Any

_STUDIES = "drake_pregrasp.studies"

# For each command: a module with `add_options(parser)`, or the function of a study whose only
# option is --out; and its line of help.
_COMMANDS = {
    "reproduce": ("paper.reproduce", "reproduce the paper's tables and figures"),
    "sweep": ("sweep.sweep_command", "simulate a scenario with many values of its fields"),
    "bench": ("bench.bench", "measure planning times"),
}
_STUDY_COMMANDS = {
    "gallery": ("gallery:make_gallery", "pictures of the shipped scenarios, with their measures"),
    "grasps": ("gallery:picture_grasps", "pictures of the shipped hands"),
    "lookahead": ("lookahead:study_lookahead", "gain of look-ahead on fast objects"),
    "shapes": ("shape_study:study_shapes", "check of the contacts on ten shapes"),
    "faults": ("faults", "robustness against faulty measurements"),
    "static-versus-dynamic": (
        "static_versus_dynamic.comparison_command",
        "gain of dynamic planning in simulated grasps",
    ),
    "objects": ("objects.objects_command", "grasps of many objects by many hands"),
}

_EXTRA = "dask distributed jinja2 markupsafe pandas seaborn statsmodels tabulate threadpoolctl"
"""The libraries of the extra `studies`."""


def add_commands(commands: "argparse._SubParsersAction[Any]") -> None:
    """Adds the commands to those of `drake-pregrasp`."""
    _add(commands, _COMMANDS)
    student = commands.add_parser("study", help="measure what a feature gains")
    _add(student.add_subparsers(required=True, metavar="NAME", dest="study"), _STUDY_COMMANDS)


def _add(commands: "argparse._SubParsersAction[Any]", table: dict[str, tuple[str, str]]) -> None:
    for name, (where, text) in table.items():
        parser: Any = commands.add_parser(name, help=text)  # A `OneLineParser`.
        parser.add_options = functools.partial(_add_options, where=where, name=name)


def _add_options(parser: argparse.ArgumentParser, *, where: str, name: str) -> None:
    module, _, function = where.partition(":")
    try:
        study = importlib.import_module(f"{_STUDIES}.{module}")
        options = importlib.import_module(f"{_STUDIES}.study_options")
    except ModuleNotFoundError as error:
        library = str(error.name).partition(".")[0]
        if library not in _EXTRA.split():
            raise
        parser.error(f"{library} is missing; install the extra: pip install '.[studies]'")
    if function:
        options.add_report_command(parser, getattr(study, function), f"study_{name}")
    else:
        study.add_options(parser)
