"""The benchmark: makes all measurements in turn, and writes a report."""

import argparse
import json
import os
import platform
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from threadpoolctl import threadpool_limits

from drake_pregrasp.config.planner_config import BlendConfig
from drake_pregrasp.fast import numba_is_installed
from drake_pregrasp.simulation.output import make_folder, write_text
from drake_pregrasp.simulation.scenario_file import shipped_scenarios
from drake_pregrasp.studies.bench.run_times import FIRST_TICK, RunJob, time_run, time_starts
from drake_pregrasp.studies.bench.soak import drift, soak
from drake_pregrasp.studies.bench.tick_times import (
    LENGTH,
    PLAIN,
    Scene,
    TickJob,
    implementations,
    time_ticks,
)
from drake_pregrasp.studies.report_page import Heading, Part, Table, write_report
from drake_pregrasp.studies.runner import OnProgress
from drake_pregrasp.studies.study_options import add_out_option, step_bar

CONFIGS = {
    **{name: replace(PLAIN, strategy=name) for name in ("position", "msv", "gii", "vew")},
    "margin": replace(PLAIN, strategy="margin"),
    "gii and position": replace(PLAIN, strategy="blend", blend=BlendConfig(gii=1, position=1)),
    "gii of a contact alone": replace(PLAIN, strategy="gii", reading="contact"),
}
"""Timed settings of the planner, by name: the paper's strategies first."""

BY_CONTACTS, BY_OBSTACLES, BY_TRIANGLES = "contacts", "obstacle points", "triangles of the mesh"
"""Series in which something else than the number of candidates grows."""

SIZES = {24: 2304, 71: 20164, 158: 99856}
"""Numbers of candidates on the four side faces of a cube, by the number along its edge."""

HAND = """
surface: {{spacing: {spacing}}}
obstacles:
- !BoxObstacle {{size: [0.4, 0.02, 0.08], center: [0.0, -0.1, 0.045]}}
- !BallObstacle {{radius: 0.03, center: [0.3, 0.0, 0.05], velocity: [-0.02, 0.0, 0.0], body: false}}
planner: {{period: 0.01, limits: {{horizon: 0.5}}}}
"""
"""Overrides of `grasp_beside_wall`: another obstacle, which moves, and more candidates."""

MUG = "mug, guarded margin in turns"
IN_TURNS = "{planner: {strategy: margin, in_turns: true, limits: {guard: [margin]}}}"
"""Overrides of a scenario: contacts move in turns, and no step may reduce the margin."""

BASE_RATE = "base case, planning at 1,000 Hz"
HAND_RATES = {
    f"hand, planning at 100 Hz, control at {1 / period:,.0f} Hz": (
        f"{{planner: {{period: 0.01}}, grasp: {{period: {period}}}}}"
    )
    for period in (0.002, 0.001)
}
"""Rates of whole simulations; for the hand, overrides of `grasp_five_finger` by name."""

Row = dict[str, Any]
Job = tuple[str, Callable[[], list[Row]]]
Tables = dict[str, pd.DataFrame]


class Goal(NamedTuple):
    """A bound on measurements of the implementation `fast`, all of which have to meet it.

    Attributes:
        what: Description, with the unit.
        section: Section of the rows.
        rows: Query that selects rows of the section.
        column: Name of the column.
        bound: Largest value, or the least one if `at_least`.
        at_least: Whether `bound` is the least value.
    """

    what: str
    section: str
    rows: str
    column: str
    bound: float
    at_least: bool = False

    def outcome(self, tables: Tables) -> Row:
        """Returns the goal, the worst value reached, and whether the goal is met."""
        goal = {"what": self.what, "goal": f"{'≥' if self.at_least else '≤'} {self.bound:g}"}
        found = pd.Series(dtype=float)
        if self.section in tables:
            rows = tables[self.section].query("implementation == 'fast'").query(self.rows)
            found = rows[self.column]
        if found.empty:
            return {**goal, "reached": "not measured", "met": "–"}
        worst = found.min() if self.at_least else found.max()
        is_met = worst >= self.bound if self.at_least else worst <= self.bound
        reached = f"{worst:.3g}" + (f", worst of {len(found)}" if len(found) > 1 else "")
        return {**goal, "reached": reached, "met": "yes" if is_met else "no"}


HAND_500 = next(iter(HAND_RATES))
_MEDIAN, _SPREAD, _LOAD, _FACTOR = "median [ms]", "99 % / median", "processor s / s", "x real time"
_PAPER = f"series in {list(CONFIGS)[:4]} and N =="
_OTHERS = f"series in {list(CONFIGS)[4:]} and N =="

GOALS = (
    Goal("hand, 2,304 candidates, tick [ms]", "hand", "run == '2,304'", _MEDIAN, 0.6),
    Goal("hand, 20,164 candidates, tick [ms]", "hand", "run == '20,164'", _MEDIAN, 1.5),
    Goal("hand, 99,856 candidates, tick [ms]", "hand", "run == '99,856'", _MEDIAN, 5),
    Goal(f"{MUG}, tick [ms]", "scenarios", f"run == '{MUG}'", _MEDIAN, 2),
    Goal(
        f"2,000 {BY_OBSTACLES}, 20,164 candidates, tick [ms]",
        "growth",
        f"series == '{BY_OBSTACLES}' and size == 2000",
        _MEDIAN,
        5,
    ),
    Goal(
        "strategies beyond the paper's, 20,164, tick [ms]", "ticks", _OTHERS + "20164", _MEDIAN, 1.5
    ),
    Goal("strategies of the paper, 2,304, tick [ms]", "ticks", _PAPER + "2304", _MEDIAN, 0.29),
    Goal("strategies of the paper, 99,856, tick [ms]", "ticks", _PAPER + "99856", _MEDIAN, 2.1),
    Goal("99 % / median of ticks, shipped scenarios", "scenarios", "ticks > 0", _SPREAD, 2),
    Goal("99 % / median of ticks, hand", "hand", "ticks > 0", _SPREAD, 2),
    Goal("99 % / median of ticks, strategies", "ticks", "ticks > 0", _SPREAD, 2),
    Goal(f"{HAND_500} [processor s / s]", "rates", f"run == '{HAND_500}'", _LOAD, 0.8),
    Goal("base case, 20 Hz [x real time]", "scenarios", "run == 'a_base'", _FACTOR, 60, True),
    Goal(f"{BASE_RATE} [x real time]", "rates", f"run == '{BASE_RATE}'", _FACTOR, 2, True),
    Goal("first use of `fast`, compiling [s]", "starts", "start == 'first'", FIRST_TICK, 15),
    Goal("memory that ticks leave behind [bytes a tick]", "memory", "ticks > 0", "bytes a tick", 1),
)
"""Goals of the planner with the extra `fast`."""

QUESTIONS = {
    "scenarios": (
        "How fast is each shipped scenario?",
        "Simulated without a recording, with `log.csv`. The static phase is left out.",
        ["run"],
    ),
    "hand": (
        "How does the planner of a hand with five fingers grow with the candidates?",
        "Scenario `grasp_beside_wall`: fingertips, reach, table and wall; and a moving obstacle,"
        " a horizon of 0.5 s, and planning at 100 Hz.",
        ["run"],
    ),
    "rates": (
        "How fast can planning and control run?",
        "Whole simulations. The hand is that of `grasp_five_finger`.",
        ["run"],
    ),
    "ticks": (
        "How fast is a tick of each strategy?",
        "A cube with 5 contacts, 200 forbidden points and no further constraints. *printed*: Eq. 1-2"
        " as printed, as matrices of all distances, and the reference's goals.",
        ["series", "N"],
    ),
    "growth": (
        "What makes a tick slower?",
        "Strategy `position`, with 5 contacts unless stated: contacts and obstacle points on a cube,"
        " and triangles of a ball's mesh with as many candidates.",
        ["series", "size", "N"],
    ),
    "starts": (
        "How long does a process take until its first tick?",
        "Wall times, medians of fresh processes. *first*: nothing is compiled yet.",
        None,
    ),
    "memory": ("Does memory grow?", "Resident memory of the base case at 1,000 Hz.", None),
}
"""Title, explanation, and index of the table of each section; without an index all columns."""


def bench(
    out: str | Path, *, quick: bool = False, on_progress: OnProgress = lambda done, total: None
) -> Path:
    """Runs the benchmark on one thread and writes `bench.md` and `bench.json`.

    Args:
        out: Folder of the report, made if it does not exist.
        quick: Whether to leave out long measurements.
        on_progress: Called with the number of finished measurements and the number of all.

    Returns:
        The path of `bench.md`.

    Raises:
        OutputError: If the folder cannot be written.
    """
    out = Path(out)
    make_folder(out)
    jobs, load = plan(quick=quick), os.getloadavg()[0]
    rows: dict[str, list[Row]] = {section: [] for section in QUESTIONS}
    with threadpool_limits(1):
        for done, (section, measure) in enumerate(jobs):
            rows[section] += measure()
            on_progress(done + 1, len(jobs))
    packages = ["numpy", "scipy", "drake", *["numba"] * numba_is_installed()]
    machine = (
        f"{platform.machine()}, {os.cpu_count()} cores, load {load:.1f} at first and"
        f" {os.getloadavg()[0]:.1f} at last; Python {platform.python_version()}, "
        + ", ".join(f"{package} {version(package)}" for package in packages)
    )
    write_text(out / "bench.json", json.dumps({"machine": machine, **rows}, indent=1) + "\n")
    tables = {section: pd.DataFrame(own) for section, own in rows.items() if own}
    return write_report(out, "Benchmarks", report(machine, tables), name="bench", formats=("md",))


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `drake-pregrasp bench`."""
    add_out_option(parser, "bench")
    parser.add_argument("--quick", action="store_true", help="leave out long measurements")
    parser.set_defaults(command=_command)


def _command(options: argparse.Namespace) -> int:
    with step_bar() as on_progress:
        report = bench(options.out, quick=options.quick, on_progress=on_progress)
    print(f"report in {report}")
    return 0


def plan(*, quick: bool) -> list[Job]:
    """Returns the measurements; if `quick`, fewer of them, of fewer ticks."""
    ticks, seconds = (30, 0.3) if quick else (200, 3.0)
    per_edge = (24, 71) if quick else (24, 71, 158)
    contacts = (2, 5, 32) if quick else (2, 5, 8, 16, 32)
    obstacles = (20, 200) if quick else (20, 200, 2000)
    subdivisions = (2, 4) if quick else (2, 3, 4, 5, 6)
    shipped = list(shipped_scenarios())
    if quick:  # The first scenario of each file.
        files = groupby(shipped, lambda name: shipped_scenarios()[name][0])
        shipped = [next(names) for _, names in files]
    runs = [
        *(("scenarios", RunJob(name, name, ticks=ticks)) for name in shipped),
        ("scenarios", RunJob(MUG, "mug", IN_TURNS, ticks)),
        *(
            (
                "hand",
                RunJob(
                    f"{SIZES[k]:,}", "grasp_beside_wall", HAND.format(spacing=LENGTH / k), ticks
                ),
            )
            for k in per_edge
        ),
        ("rates", RunJob(BASE_RATE, "a_base", "{planner: {period: 0.001}}", 5 * ticks)),
        *(
            ("rates", RunJob(name, "grasp_five_finger", text, 4 * ticks))
            for name, text in HAND_RATES.items()
        ),
    ]
    grown = [
        *((BY_CONTACTS, n, Scene(71, contacts=n)) for n in contacts),
        *((BY_OBSTACLES, m, Scene(71, points=m, obstacles=True)) for m in obstacles),
        *((BY_TRIANGLES, 20 * 4**k, Scene(80, subdivisions=k)) for k in subdivisions),
    ]
    timed = [
        *(
            ("ticks", TickJob(name, SIZES[k], Scene(k), config, seconds))
            for name, config in CONFIGS.items()
            for k in per_edge
        ),
        *(("growth", TickJob(*each, PLAIN, seconds)) for each in grown),
    ]
    starts = partial(time_starts, 1 if quick else 3, compiling=not quick)
    return [
        # Memory comes first: memory that other measurements free would hide growth.
        *([] if quick else [("memory", _memory)]),
        *((section, partial(time_run, run)) for section, run in runs),
        *((section, partial(time_ticks, job)) for section, job in timed),
        ("starts", starts),
    ]


def _memory() -> list[Row]:
    hours = soak(40, seconds=1.0, period=0.001)
    slope = drift(hours, "resident")[0] / hours[-1]["ticks"]
    mebibytes = [hour["resident"] / 2**20 for hour in (hours[10], hours[-1])]
    columns = ("implementation", "ticks", "MiB after a quarter", "MiB at the end", "bytes a tick")
    ticks = sum(hour["ticks"] for hour in hours)
    return [dict(zip(columns, (implementations()[-1], ticks, *mebibytes, slope), strict=True))]


def report(machine: str, tables: Tables) -> list[Part]:
    """Returns the parts of the report.

    Args:
        machine: Description of the machine and of the versions of libraries.
        tables: Table of rows of each measured section, by the section's name.
    """
    parts: list[Part] = [
        f"Machine: {machine}. One thread. Times are processor times, unless stated otherwise;"
        " those of ticks are medians / 99th percentiles, and implementations take turns. Real time"
        " is the simulated time over the processor time.",
        Heading("What is reached?"),
        "Goals are those of *fast*, and of the worst row.",
        Table(pd.DataFrame([goal.outcome(tables) for goal in GOALS])),
    ]
    for section, (title, words, index) in QUESTIONS.items():
        if section in tables:
            rows = tables[section]
            table = rows.round(4) if index is None else compared(rows, index)
            parts += [Heading(title), words, Table(table)]
            if "not run" in rows:
                skipped = rows.dropna(subset="not run")
                parts += [
                    f"Not run: {name}: {why}"
                    for name, why in zip(skipped["run"], skipped["not run"], strict=True)
                ]
    return parts


def compared(rows: pd.DataFrame, index: list[str]) -> pd.DataFrame:
    """Returns a table of texts with a row for each case, and columns for each implementation.

    Args:
        rows: Measurements, with the column `implementation`.
        index: Columns that tell cases apart.
    """
    median, high = (rows[name].map("{:,.3g}".format) for name in (_MEDIAN, "99 % [ms]"))
    values = {"tick [ms]": median + " / " + high}
    if _FACTOR in rows:
        values[_FACTOR] = rows[_FACTOR].map("{:,.3g}".format)
    table = rows.assign(**values).pivot_table(
        index=index, columns="implementation", values=[*values], aggfunc="first", sort=False
    )
    table.columns = [f"{name}, {value}" for value, name in table.columns]
    return table.reset_index()
