"""Grasps in plants of one's own: arms, hands, objects and bases, all combined.

Each case must be held, or refused for a reason after whose removal it is refused no longer for it.
"""

import argparse
import collections
import csv
import logging
import sys
import tempfile
import time
from dataclasses import astuple, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drake_pregrasp.errors import Lack, NoGraspError
from drake_pregrasp.studies.workers import Failure, call_for_all
from tests.plants.own_plants import ALL, BASES, CARRIER, OBJECTS, Case, OwnRobot, grasp, own_robot

LEAST_SHARE = 0.95
"""Share of the cases that must be held."""

STRONGER = 10.0
"""Factor of the torques after which they are no reason."""


class Row(NamedTuple):
    """Result of a case.

    Attributes:
        result: `held`, `refused` or `failed`.
        reason: Why it is not held.
        removed: What the grasp became without the reason of a refusal.
        lift: Height of the object at the end over that at the start, in mm.
        drift: Distance that it moved in the last second, in mm.
        seconds: Processor time.
    """

    result: str
    reason: str = ""
    removed: str = ""
    lift: float = 0.0
    drift: float = 0.0
    seconds: float = 0.0


def result_of(case: Case, folder: Path) -> Row:
    """Returns the result of a case.

    Args:
        case: The case.
        folder: Folder for directives.
    """
    logging.getLogger("drake").setLevel(logging.ERROR)  # Hundreds of warnings about these models.
    start = time.process_time()
    robot = own_robot(case.arm, case.hand, folder)
    thing, base = OBJECTS[case.thing], BASES[case.base]
    try:
        outcome = grasp(robot, thing, base)
    except NoGraspError as error:
        row = Row("refused", str(error), _without(error.lack, case, robot, folder))
    else:
        reason = "" if outcome.is_held else outcome.reason or outcome.phase.name
        row = Row(
            "held" if outcome.is_held else "failed",
            reason,
            lift=round(1e3 * outcome.lift, 1),
            drift=round(1e3 * outcome.drift, 2),
        )
    return row._replace(seconds=round(time.process_time() - start, 1))


def _without(lack: Lack, case: Case, robot: OwnRobot, folder: Path) -> str:
    """Returns what a refused grasp becomes without what it is refused for."""
    thing, base, friction = OBJECTS[case.thing], BASES[case.base], {}
    match lack:
        case Lack.ARM:
            robot = own_robot(CARRIER, case.hand, folder)
        case Lack.FRICTION:
            friction = {"friction": 3.0, "planned_friction": 2.0}
        case Lack.TORQUE:
            drives = [replace(d, effort=STRONGER * d.effort) for d in robot.description.drives]
            robot = robot._replace(description=replace(robot.description, drives=drives))
        case _:
            return "not tried"
    try:
        return "held" if grasp(robot, thing, base, **friction).is_held else "not refused"
    except NoGraspError as error:
        return f"refused for lack of {error.lack}"


def main() -> int:
    """Prints the table; returns 1 if too few cases are held, or a reason is not true."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=len(ALL), help="number of cases")
    parser.add_argument("--seed", type=int, default=0, help="seed with which they are drawn")
    parser.add_argument("--match", default="", help="only cases with this text, such as panda")
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    cases = [case for case in ALL if options.match in str(case)]
    drawn = np.random.default_rng(options.seed).permutation(len(cases))[: options.count]
    cases = [cases[index] for index in drawn]
    table, counts = csv.writer(sys.stdout), collections.Counter()
    table.writerow(["arm", "hand", "object", "base", *Row._fields])

    def write(index: int, row: Row | Failure) -> None:
        if isinstance(row, Failure):
            row = Row("failed", row.error)
        is_true = row.removed in ("held", "not refused")
        counts[row.result if row.result != "refused" or is_true else "untrue"] += 1
        table.writerow([*astuple(cases[index]), *row])
        sys.stdout.flush()

    with tempfile.TemporaryDirectory() as folder:
        function = partial(result_of, folder=Path(folder))
        call_for_all(function, cases, write, processes=options.processes)
    print(", ".join(f"{count} {result}" for result, count in sorted(counts.items())))
    is_enough = counts["held"] >= LEAST_SHARE * len(cases)
    return 0 if is_enough and counts["held"] + counts["refused"] == len(cases) else 1


if __name__ == "__main__":
    sys.exit(main())
