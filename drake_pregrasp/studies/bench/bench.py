"""The benchmark: makes all measurements in turn, and writes a report."""

import argparse
import functools
import json
import os
import platform
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from threadpoolctl import threadpool_limits

from drake_pregrasp.simulation.output import make_folder, write_text, writing
from drake_pregrasp.studies.bench.base_case import PARTS, RunJob, time_run, time_starts
from drake_pregrasp.studies.bench.soak import drift, soak
from drake_pregrasp.studies.bench.tick_times import (
    MESH,
    WITHOUT_PORTS,
    Scene,
    TickJob,
    cube,
    implementations,
    time_ticks,
)
from drake_pregrasp.studies.report_page import Heading, Part, Picture, Table, write_report
from drake_pregrasp.studies.runner import OnProgress
from drake_pregrasp.studies.study_options import add_out_option, step_bar

BY_SIZE, ON_A_MESH = "size", "mesh"
BY_CONTACTS, BY_FORBIDDEN, BY_OBSTACLES = "contacts", "forbidden", "obstacles"
"""Series of tick times; in `BY_OBSTACLES`, forbidden points are obstacles in the world."""

STRATEGIES = ("position", "msv", "gii", "vew")
GROWTH_STRATEGIES = ("position", "gii")
"""Timed strategies, and those timed over the numbers of contacts and forbidden points."""

Job = tuple[str, Callable[[], list[dict[str, Any]]]]
Tables = dict[str, pd.DataFrame]

_STYLES = {
    WITHOUT_PORTS: ("#E69F00", "v--"),
    "reference": ("#0072B2", "s-"),
    "numba": ("#009E73", "o-"),
}
_PART_COLORS = ("#000000", "#E69F00", "#0072B2", "#CC79A7")
_GROWTH = {
    ON_A_MESH: "N",
    BY_CONTACTS: "contacts",
    BY_FORBIDDEN: "forbidden",
    BY_OBSTACLES: "forbidden",
}
_SECTIONS = ("memory", "ticks", "runs", "starts")

_WORDS = {
    BY_SIZE: "Planning tick over the number of candidates",
    "growth": "Planning tick on a mesh, and over the numbers of contacts and forbidden points",
    "ticks": "Medians / 99th percentiles in ms, for 5 contacts and 200 forbidden points on a cube"
    " of 0.1 m. *no ports*: the reference's functions alone.",
    ON_A_MESH: f"Medians in ms on `{MESH}`, with 5 contacts and up to 200 forbidden points.",
    BY_CONTACTS: "Medians in ms on the cube, N = 20,164, with 200 forbidden points.",
    BY_FORBIDDEN: "Medians in ms on the cube, N = 20,164, with 5 contacts.",
    BY_OBSTACLES: "The same with the forbidden points as obstacles in the world.",
    "runs": "Simulated seconds in one second, with more and more parts of the simulation.",
    "added": "Milliseconds of processor time that a simulated second takes for each part.",
    "base_case": "Parts of a simulated second",
    "starts": "Medians of fresh processes. The first tick includes loading or compiling the code.",
    "memory": "Resident memory of the base case at 1,000 Hz.",
}


def bench(
    out: str | Path, *, quick: bool = False, on_progress: OnProgress = lambda done, total: None
) -> Path:
    """Runs the benchmark on one thread and writes `bench.md`, its plots, and `bench.json`.

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
    rows: dict[str, list[dict[str, Any]]] = {section: [] for section in _SECTIONS}
    with threadpool_limits(1):
        for done, (section, measure) in enumerate(jobs):
            rows[section] += measure()
            on_progress(done + 1, len(jobs))
    packages = ("numpy", "scipy", "drake", *implementations()[1:])
    machine = (
        f"{platform.machine()}, {os.cpu_count()} cores, load {load:.1f} at first and"
        f" {os.getloadavg()[0]:.1f} at last; Python {platform.python_version()}, "
        + ", ".join(f"{package} {version(package)}" for package in packages)
    )
    write_text(out / "bench.json", json.dumps({"machine": machine, **rows}, indent=1) + "\n")
    tables = {section: pd.DataFrame(own) for section, own in rows.items() if own}
    with writing(out):
        plot(out, tables)
    parts = report(machine, tables)
    return write_report(out, "Benchmarks", parts, name="bench", formats=("md",))


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
    """Returns the measurements, of about nine minutes, or of less than one if `quick`."""
    sizes = (24, 71) if quick else (16, 24, 35, 71, 158)
    spacings = (0.004, 0.0028) if quick else (0.006, 0.004, 0.0028, 0.002)
    contacts = (2, 5, 32) if quick else (2, 3, 5, 8, 16, 32)
    forbidden = (0, 20, 200) if quick else (0, 20, 200, 2000)
    periods = {0.05: 1.0, 0.001: 0.1} if quick else {0.05: 2.0, 0.01: 1.0, 0.001: 0.3}
    ticks: list[tuple[str, Scene, tuple[str, ...]]]
    ticks = [(BY_SIZE, cube(cells), STRATEGIES) for cells in sizes]
    ticks += [(BY_SIZE, cube(cells), ("margin",)) for cells in sizes if cells <= 71]
    ticks += [(ON_A_MESH, Scene(spacing, shape=MESH), STRATEGIES) for spacing in spacings]
    ticks += [(BY_CONTACTS, cube(71, n), GROWTH_STRATEGIES) for n in contacts]
    ticks += [
        (series, cube(71, forbidden=m), GROWTH_STRATEGIES)
        for series in (BY_FORBIDDEN, BY_OBSTACLES)
        for m in (forbidden if series == BY_FORBIDDEN else forbidden[1:3])
    ]
    seconds = 0.3 if quick else 3.0
    # Memory comes first: memory that other measurements free would hide growth.
    jobs: list[Job] = [] if quick else [("memory", _memory)]
    for series, scene, strategies in ticks:
        for strategy in strategies:
            job = TickJob(series, scene, strategy, series == BY_OBSTACLES, seconds=seconds)
            jobs.append(("ticks", functools.partial(time_ticks, job)))
    for period, duration in periods.items():
        for implementation in implementations():
            run = RunJob(implementation, period, duration, 3 if quick else 7)
            jobs.append(("runs", functools.partial(time_run, run)))
    starts = functools.partial(time_starts, 1 if quick else 3, compiling=not quick)
    return [*jobs, ("starts", starts)]


def _memory() -> list[dict[str, Any]]:
    hours = soak(40, seconds=1.0, period=0.001)
    slope = drift(hours, "resident")[0] / hours[-1]["ticks"]
    mebibytes = [hour["resident"] / 2**20 for hour in (hours[10], hours[-1])]
    columns = ("ticks", "MiB after a quarter", "MiB at the end", "bytes a tick")
    ticks = sum(hour["ticks"] for hour in hours)
    return [dict(zip(columns, (ticks, *mebibytes, slope), strict=True))]


def report(machine: str, tables: Tables) -> list[Part]:
    """Returns the parts of the report.

    Args:
        machine: Description of the machine and of the versions of libraries.
        tables: Table of rows of each measured section, by the section's name.
    """
    parts: list[Part] = [f"Machine: {machine}. One thread."]
    if "ticks" in tables:
        ticks = tables["ticks"]
        ticks["ms"] = ticks["median [ms]"].map("{:,.3g}".format)
        whole = ticks.assign(ms=ticks["ms"] + " / " + ticks["99 % [ms]"].map("{:,.3g}".format))
        parts += [Heading("Ticks"), _WORDS["ticks"], _picture("ticks", BY_SIZE)]
        for strategy, own in whole[whole.series == BY_SIZE].groupby("strategy", sort=False):
            parts += [Heading(strategy, 3), _pivot(own, "N", ["implementation"])]
        parts += [Heading("Growth"), _picture("growth", "growth")]
        for series, index in _GROWTH.items():
            own = ticks[ticks.series == series]
            table = _pivot(own, index, ["strategy", "implementation"])
            parts += [Heading(series.capitalize(), 3), _WORDS[series], table]
    if "runs" in tables:
        parts.append(Heading("The base case, simulated"))
        for key, column in (("runs", "x real time"), ("added", "added [ms]")):
            own = tables["runs"].assign(ms=tables["runs"][column].map("{:,.2f}".format))
            parts += [_WORDS[key], _pivot(own, ["planning", "implementation"], ["part"])]
        parts.append(_picture("base_case", "base_case"))
    for section, title in (("starts", "Starting"), ("memory", "Memory")):
        if section in tables:
            parts += [Heading(title), _WORDS[section], Table(tables[section].round(4))]
    return parts


def _picture(name: str, caption: str) -> Picture:
    return Picture(Path(f"{name}.png"), _WORDS[caption])


def _pivot(rows: pd.DataFrame, index: str | list[str], columns: list[str]) -> Table:
    """Returns a table of the column `ms` over `index` and the joined names of `columns`."""
    table = rows.pivot(index=index, columns=columns, values="ms")
    order = rows[columns].drop_duplicates().itertuples(index=False)
    table = table[[key if len(columns) > 1 else key[0] for key in map(tuple, order)]]
    table.columns = [key if isinstance(key, str) else ", ".join(key) for key in table.columns]
    return Table(table.reset_index())


def plot(out: Path, tables: Tables) -> None:
    """Writes `ticks.png`, `growth.png` and `base_case.png` for the measured sections."""
    if "ticks" in tables:
        ticks = tables["ticks"]
        own = ticks[ticks.series == BY_SIZE]
        sizes = {name: (own[own.strategy == name], "N") for name in STRATEGIES}
        _panels(out / "ticks.png", sizes)
        own = ticks[ticks.strategy == "gii"]
        growth = {
            f"gii, {series}": (own[own.series == series], index)
            for series, index in _GROWTH.items()
        }
        _panels(out / "growth.png", growth)
    if "runs" in tables:
        runs = tables["runs"]
        shares = runs.pivot(
            index=["planning", "implementation"], columns="part", values="added [ms]"
        )[list(PARTS)].clip(lower=0)
        shares = 100 * shares.div(shares.sum(axis=1), axis=0)
        figure = Figure(figsize=(8.4, 1.4 + 0.5 * len(shares)), layout="constrained")
        axis = figure.subplots()
        shares.plot.barh(stacked=True, ax=axis, color=_PART_COLORS, legend=False)
        axis.set(xlabel="share of the processor time of a simulated second [%]", ylabel="")
        figure.legend(loc="outside upper center", ncols=4, frameon=False)
        figure.savefig(out / "base_case.png", dpi=140)


def _panels(path: Path, panels: dict[str, tuple[pd.DataFrame, str]]) -> None:
    """Plots median tick times, shaded up to the 99th percentile, with one panel for each title."""
    figure = Figure(figsize=(3.6 * len(panels), 4.0), layout="constrained")
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    entries: dict[str, Artist] = {}
    for axis, (title, (rows, index)) in zip(axes, panels.items(), strict=True):
        for name, own in rows.groupby("implementation", sort=False):
            color, style = _STYLES[name]
            median, high = own["median [ms]"], own["99 % [ms]"]
            (entries[name],) = axis.plot(own[index], median, style, color=color)
            axis.fill_between(own[index], median, high, color=color, alpha=0.12, linewidth=0)
        axis.set_xscale("symlog" if index == "forbidden" else "log")
        axis.set(yscale="log", title=title, xlabel=index)
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.grid(True, color="0.9", linewidth=0.6)
    axes[0].set_ylabel("planning tick [ms]")
    figure.legend(entries.values(), entries, loc="outside upper center", ncols=3, frameon=False)
    figure.savefig(path, dpi=140)
