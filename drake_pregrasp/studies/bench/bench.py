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
from typing import Any

import pandas as pd
from threadpoolctl import threadpool_limits

from drake_pregrasp.config.planner_config import BlendConfig
from drake_pregrasp.fast import numba_is_installed
from drake_pregrasp.simulation.output import make_folder, write_text
from drake_pregrasp.simulation.scenario_file import read_mapping, shipped_scenarios
from drake_pregrasp.studies.bench.run_times import RunJob, time_run, time_starts
from drake_pregrasp.studies.bench.soak import drift, soak
from drake_pregrasp.studies.bench.tick_times import (
    LENGTH,
    PLAIN,
    Scene,
    TickJob,
    implementations,
    time_ticks,
)
from drake_pregrasp.studies.command_options import add_report_command
from drake_pregrasp.studies.report_page import Heading, Part, Table, write_report
from drake_pregrasp.studies.runner import OnProgress

STRATEGIES = {
    **{name: replace(PLAIN, strategy=name) for name in ("position", "msv", "gii", "vew", "margin")},
    "blend of gii and position": replace(
        PLAIN, strategy="blend", blend=BlendConfig(gii=1, position=1)
    ),
    "gii, reading contact": replace(PLAIN, strategy="gii", reading="contact"),
}
"""Timed settings of the planner, by name."""

MUG = "{planner: {strategy: margin, in_turns: true, limits: {guard: [margin]}}}"
HAND = """
surface: {{spacing: {spacing}}}
obstacles:
- !BoxObstacle {{size: [0.4, 0.02, 0.08], center: [0.0, -0.1, 0.045]}}
- !BallObstacle {{radius: 0.03, center: [0.3, 0.0, 0.05], velocity: [-0.02, 0.0, 0.0], body: false}}
planner: {{period: 0.01, limits: {{horizon: 0.5}}}}
"""
HAND_RATES = """
planner: {{period: 0.01}}
grasp: {{period: {period}}}
plant_config: {{time_step: {period}}}
"""
"""Overrides of the scenarios `mug`, `grasp_beside_wall` and `grasp_five_finger`."""

QUESTIONS = read_mapping(Path(__file__).with_name("questions.yaml"))
"""Questions of the report by the names of their sections of measurements, with goals."""

Row = dict[str, Any]
Job = tuple[str, Callable[[], list[Row]]]
Tables = dict[str, pd.DataFrame]


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
        + ("; `--quick`: fewer cases and ticks" if quick else "")
    )
    write_text(out / "bench.json", json.dumps({"machine": machine, **rows}, indent=1) + "\n")
    tables = {section: pd.DataFrame(own) for section, own in rows.items() if own}
    return write_report(out, "Benchmarks", report(machine, tables), name="bench", formats=("md",))


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `drake-pregrasp bench`."""
    add_report_command(parser, bench, "bench", "quick")
    parser.add_argument("--quick", action="store_true", help="leave out long measurements")


def plan(*, quick: bool) -> list[Job]:
    """Returns the measurements; if `quick`, those of fewer cases and ticks."""
    ticks, seconds = (20, 0.2) if quick else (200, 3.0)
    per_edge = (24, 71) if quick else (24, 71, 158)
    contacts = (2, 32) if quick else (2, 5, 8, 16, 32)
    obstacles = (20, 200) if quick else (20, 200, 2000)
    subdivisions = (2, 4) if quick else (2, 3, 4, 5, 6)
    scenarios = shipped_scenarios()
    if quick:  # The first scenario of each file.
        files = groupby(scenarios, lambda name: scenarios[name][0])
        scenarios = {name: scenarios[name] for name in [next(names) for _, names in files]}
    runs = [("scenarios", RunJob(name, name, "{}", ticks)) for name in scenarios]
    runs.append(("scenarios", RunJob("mug, guarded margin in turns", "mug", MUG, ticks)))
    for k in per_edge:
        text = HAND.format(spacing=LENGTH / k)
        runs.append(("hand", RunJob(f"{4 * k**2:,}", "grasp_beside_wall", text, ticks)))
    base = RunJob("base case, 1,000 Hz", "a_base", "{planner: {period: 0.001}}", 5 * ticks)
    runs.append(("rates", base))
    for period in (0.002, 0.001):
        name = f"five-finger hand, 100 and {1 / period:,.0f} Hz"
        text = HAND_RATES.format(period=period)
        runs.append(("rates", RunJob(name, "grasp_five_finger", text, 4 * ticks)))
    timed = [
        ("strategies", TickJob(name, 4 * k**2, Scene(k), config, seconds))
        for name, config in STRATEGIES.items()
        for k in per_edge
    ]
    grown = [
        *(("contacts", n, Scene(71, contacts=n)) for n in contacts),
        *(("obstacle points", m, Scene(71, points=m, obstacles=True)) for m in obstacles),
        *(("triangles", 20 * 4**k, Scene(80, subdivisions=k)) for k in subdivisions),
    ]
    timed += [("growth", TickJob(*each, PLAIN, seconds)) for each in grown]
    return [
        # Memory comes first: memory that other measurements free would hide growth.
        *([] if quick else [("memory", _memory)]),
        *((section, partial(time_run, run)) for section, run in runs),
        *((section, partial(time_ticks, job)) for section, job in timed),
        ("starts", partial(time_starts, 1 if quick else 3, compiling=not quick)),
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
        f"Machine: {machine}.",
        "All times are processor times of one thread, and implementations take turns. Times of"
        " planning ticks, in ms, are medians / 99th percentiles. *x real time* is simulated time"
        " over processor time.",
        Heading("Are the goals met?"),
        "Goals are for *fast*, and all cases have to meet them; the worst one is shown. *Not"
        " measured*: left out by `--quick`, or the extra `fast` is not installed.",
        Table(goals_table(tables)),
    ]
    for section, rows in tables.items():
        question = QUESTIONS[section]
        table = compared(rows, question["cases"]) if "cases" in question else rows.round(4)
        parts += [Heading(question["title"]), question["words"], Table(table)]
        if "not run" in rows:
            skipped = rows.dropna(subset="not run")
            parts += ("Not run: " + skipped["run"] + ": " + skipped["not run"]).tolist()
    return parts


def goals_table(tables: Tables) -> pd.DataFrame:
    """Returns the goals, the worst value reached of each, and whether all values meet it."""
    table = []
    for section, question in QUESTIONS.items():
        for goal in question["goals"]:
            is_upper, outcome = "at_most" in goal, ("not measured", "–")
            bound = goal["at_most" if is_upper else "at_least"]
            rows = tables.get(section, pd.DataFrame(columns=["implementation"]))
            rows = rows[rows["implementation"] == "fast"]
            if len(rows) and len(rows := rows.query(goal["rows"])):
                found = rows[goal["column"]]
                worst = found.idxmax() if is_upper else found.idxmin()
                is_met = found[worst] <= bound if is_upper else found[worst] >= bound
                case = f" ({rows.loc[worst].iloc[0]})" if len(found) > 1 else ""
                outcome = (f"{found[worst]:.3g}{case}", "yes" if is_met else "no")
            table.append((goal["what"], f"{'≤' if is_upper else '≥'} {bound}", *outcome))
    return pd.DataFrame(table, columns=["goal", "bound", "reached", "met"])


def compared(rows: pd.DataFrame, cases: dict[str, str]) -> pd.DataFrame:
    """Returns a table of texts with a row for each case, and columns for each implementation.

    Args:
        rows: Measurements.
        cases: Columns that tell cases apart, and their headings.
    """
    rows, text = rows.dropna(subset="implementation"), "{:,.3g}".format
    texts = {"ms": rows["median [ms]"].map(text) + " / " + rows["99 % [ms]"].map(text)}
    if "x real time" in rows:
        texts["x real time"] = rows["x real time"].map(text)
    layout = {"index": [*cases], "columns": "implementation", "aggfunc": "first", "sort": False}
    table = rows.assign(**texts).pivot_table(values=[*texts], **layout)
    table.columns = [f"{name}, {value}" for value, name in table.columns]
    medians = rows.pivot_table(values="median [ms]", **layout)
    if "fast" in medians:
        table["reference / fast"] = (medians["reference"] / medians["fast"]).map("{:.1f}".format)
    table = table.reset_index().rename(columns=cases)
    return table.map(lambda value: f"{value:,}" if isinstance(value, int) else value)
