"""The command `drake-pregrasp hand`."""

import argparse
import sys
from pathlib import Path
from typing import Any

from drake_pregrasp.cli.run_command import add_allow_option
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.errors import InvalidArgumentError, printable
from drake_pregrasp.simulation.hand_check import check_hand, description_yaml, hand_page
from drake_pregrasp.simulation.output import check_new, write_named_text


def add_command(commands: "argparse._SubParsersAction[Any]") -> None:
    """Adds the command to those of `drake-pregrasp`."""
    parser = commands.add_parser("hand", help="check a hand's description, or propose one")
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    check = actions.add_parser(
        "check", help="print all problems of a description, or propose one for a model"
    )
    check.set_defaults(command=_check)
    add = check.add_argument
    add("file", metavar="FILE", help="description (YAML), or SDF, URDF, MJCF or model directives")
    add("-o", dest="out", metavar="OUT.yaml", help="write the proposed description")
    add("--page", metavar="PAGE.html", help="write a page with the hand, its tips and its reach")
    add_allow_option(check, "description or the model")


def _check(options: argparse.Namespace) -> int:
    for out in filter(None, (options.out, options.page)):
        check_new(Path(out))
    found = check_hand(options.file, folders=options.allow)
    if options.out and found.description is not None and not found.is_proposal:
        problem = "is a description already; -o writes one for a model"
        raise InvalidArgumentError(f"{options.file}: {problem}")
    for problem in found.problems:
        print(f"{options.file}: {printable(problem)}", file=sys.stderr)
    if found.model is not None:
        _print_hand(found.model)
        if options.page:
            write_named_text(Path(options.page), hand_page(found.model))
            print(f"page in {options.page}: open it in a browser")
    if found.description is not None and found.is_proposal:
        text = description_yaml(found.description, Path(options.out or ".").parent)
        if options.out:
            write_named_text(Path(options.out), text)
            print(f"description in {options.out}")
        else:
            print(text, end="")
    return 2 if found.problems else 0


def _print_hand(model: HandModel) -> None:
    kind, height = type(model.description.base).__name__, 1e3 * model.description.palm_height
    print(f"base        {kind}, palm {height:.0f} mm over the object")
    for tip, place in zip(model.description.fingertips, model.p_HT, strict=True):
        at = ", ".join(f"{1e3 * x:.0f}" for x in place)
        print(f"fingertip   {tip.frame}: radius {1e3 * tip.radius:.1f} mm, at home ({at}) mm")
