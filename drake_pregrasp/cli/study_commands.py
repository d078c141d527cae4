"""The commands of the studies; each study is imported only when its command is given."""

import argparse
import functools
import importlib
from typing import Any

from drake_pregrasp.resources import missing_package

_STUDIES = "drake_pregrasp.studies"

# For each command: a module with `add_options(parser)`, or the function of a report whose only
# option is --out; and its line of help.
_COMMANDS = {
    "study": ("study_command", "simulate scenarios under many conditions, by several methods"),
    "reproduce": ("paper.reproduce", "reproduce the paper's tables and figures"),
    "bench": ("bench.bench", "measure planning times"),
    "gallery": ("gallery.gallery:make_gallery", "make pictures of the shipped scenarios"),
    "grasps": ("gallery.gallery:picture_grasps", "make pictures of the shipped hands"),
    "tracking": ("tracking", "measure the errors of the pose estimate on random motions"),
}

_EXTRA = "dask distributed jinja2 markupsafe pandas seaborn statsmodels tabulate"
"""The libraries of the extra `studies`."""


def add_commands(commands: "argparse._SubParsersAction[Any]") -> None:
    """Adds the commands to those of `drake-pregrasp`."""
    for name, (where, text) in _COMMANDS.items():
        parser: Any = commands.add_parser(name, help=text)  # A `OneLineParser`.
        parser.add_options = functools.partial(_add_options, where=where, name=name)


def _add_options(parser: argparse.ArgumentParser, *, where: str, name: str) -> None:
    module, _, function = where.partition(":")
    try:
        study = importlib.import_module(f"{_STUDIES}.{module}")
        options = importlib.import_module(f"{_STUDIES}.command_options")
    except ModuleNotFoundError as error:
        library = str(error.name).partition(".")[0]
        if library not in _EXTRA.split():
            raise
        parser.error(str(missing_package(library, extra="studies", purpose=name)))
    if function:
        options.add_report_command(parser, getattr(study, function), name)
    else:
        study.add_options(parser)
