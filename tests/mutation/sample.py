"""Runs a seeded sample of single-line mutations with cosmic-ray, and prints the score.

Everything happens in a clone of the last commit. A mutation is killed if a quick test that executes
its line fails; coverage.py records which these are. Survivors are printed, to be explained or
killed.

    python -m tests.mutation.sample --count 200 --seed 1
"""

import argparse
import ast
import os
import random
import subprocess
import sys
import tempfile
from pathlib import Path

from cosmic_ray.work_db import use_db
from cosmic_ray.work_item import TestOutcome, WorkItem

from tests.mutation.nearest_tests import PYTEST

ROOT = Path(__file__).resolve().parent.parent.parent
FOLDERS = ("geometry", "quality", "regions", "contacts", "estimation", "grasping", "systems")
SESSION = "mutations.sqlite"
CONFIG = """
[cosmic-ray]
module-path = [{modules}]
timeout = 600.0
excluded-modules = []
test-command = "{python} {nearest}"
[cosmic-ray.distributor]
name = "local"
"""


def unsuitable_lines(path: Path) -> set[int]:
    """Returns lines whose mutants change no behaviour: annotations, decorators and messages."""
    lines: set[int] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        parts: list[ast.AST | None] = []
        if isinstance(node, ast.FunctionDef):
            arguments = [*node.args.args, *node.args.kwonlyargs, *node.args.posonlyargs]
            parts = [node.returns, *(argument.annotation for argument in arguments)]
            parts += node.decorator_list
        elif isinstance(node, ast.ClassDef):
            parts = list(node.decorator_list)
        elif isinstance(node, ast.AnnAssign):
            parts = [node.annotation]
        elif isinstance(node, ast.Raise):
            parts = [node]
        for part in parts:
            if part is not None:
                lines |= set(range(part.lineno, (part.end_lineno or part.lineno) + 1))
    return lines


def choose(items: list[WorkItem], clone: Path, count: int, seed: int) -> list[WorkItem]:
    """Returns that many mutations, at most one a line, drawn with the seed."""
    unsuitable: dict[Path, set[int]] = {}
    by_line: dict[tuple[str, int], list[WorkItem]] = {}
    for item in items:
        (mutation,) = item.mutations
        path = clone / mutation.module_path
        if path not in unsuitable:
            unsuitable[path] = unsuitable_lines(path)
        if mutation.start_pos[0] not in unsuitable[path]:
            line = (str(mutation.module_path), mutation.start_pos[0])
            by_line.setdefault(line, []).append(item)
    draw = random.Random(seed)
    lines = draw.sample(sorted(by_line), min(count, len(by_line)))
    return [draw.choice(sorted(by_line[line], key=lambda i: str(i.mutations[0]))) for line in lines]


def main() -> int:
    """Prints survivors and the score; the exit status is 1 if it is below the goal."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200, help="number of lines")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--goal", type=float, default=0.9, help="least share of killed mutants")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        clone = Path(folder) / "clone"
        subprocess.run(["git", "clone", "-q", str(ROOT), str(clone)], check=True)
        nearest = clone / "tests" / "mutation" / "nearest_tests.py"
        modules = ", ".join(f'"drake_pregrasp/{name}"' for name in FOLDERS)
        config = clone / "mutations.toml"
        config.write_text(
            CONFIG.format(modules=modules, python=sys.executable, nearest=nearest), encoding="utf-8"
        )

        def cosmic_ray(*command: str) -> None:
            subprocess.run(
                [sys.executable, "-m", "cosmic_ray.cli", *command], cwd=clone, check=True
            )

        coverage = ("--cov=drake_pregrasp", "--cov-context=test", "--cov-report=")
        # Tests that count calls or time them may fail under coverage.
        subprocess.run(
            [*PYTEST, *coverage],
            cwd=clone,
            stdout=subprocess.DEVNULL,
            env=os.environ | {"PYTHONPATH": str(clone)},
        )
        cosmic_ray("init", config.name, SESSION)
        with use_db(str(clone / SESSION)) as database:
            chosen = choose(list(database.work_items), clone, args.count, args.seed)
            database.clear()
            database.add_work_items(chosen)
        cosmic_ray("exec", config.name, SESSION)
        with use_db(str(clone / SESSION)) as database:
            results = list(database.completed_work_items)
    survivors = [(item, r) for item, r in results if r.test_outcome == TestOutcome.SURVIVED]
    for _, result in survivors:
        print(result.diff)
    killed = len(results) - len(survivors)
    print(f"{killed} of {len(results)} mutants killed, {killed / len(results):.1%}")
    return 0 if killed >= args.goal * len(results) else 1


if __name__ == "__main__":
    sys.exit(main())
