"""The benchmark's report."""

import numpy as np

from drake_pregrasp.studies.bench.base_case import PARTS, WITH_RECORDING, WITHOUT_RECORDING
from drake_pregrasp.studies.bench.direct_tick import DIRECT_SAMPLE
from drake_pregrasp.studies.bench.global_times import LAST, PER_EDGE, SETTLING
from drake_pregrasp.studies.bench.markdown import milliseconds, table
from drake_pregrasp.studies.bench.memory import SAMPLES, WARM_UP, first_settled
from drake_pregrasp.studies.bench.outcome import Outcome, median_choices
from drake_pregrasp.studies.bench.plan import GROWTH_SIZE
from drake_pregrasp.studies.bench.scene import (
    LARGEST_RADIUS,
    MESH,
    NUM_CONTACTS,
    NUM_FORBIDDEN,
    NUM_SETS,
)
from drake_pregrasp.studies.bench.shares import REST, STAGES
from drake_pregrasp.studies.bench.targets import targets
from drake_pregrasp.studies.bench.tick_tables import (
    goals_table,
    medians_table,
    tick_sections,
)
from drake_pregrasp.studies.bench.tick_times import BY_CONTACTS, BY_FORBIDDEN, BY_MESH_SIZE, BY_SIZE


def report(outcome: Outcome) -> str:
    """Returns the report as Markdown."""
    lines = [
        "# How long planning takes",
        "",
        f"Machine: {outcome.machine}. One thread, all ways in turn in one run.",
        "",
        "## Goals, and what is reached",
        *_targets_table(outcome),
        "Medians of a tick in ms, and their goals; bold where they are reached. After the"
        " semicolon, the median of the thread's processor time, of which others on the machine take"
        " nothing.",
        *goals_table(outcome.series(BY_SIZE)),
        "![Planning tick over the number of candidates: four strategies, four ways](ticks.png)",
        "",
        "## Ticks",
        "",
        f"Regions, weights, selection, projection and measures for {NUM_CONTACTS} contacts and"
        f" {NUM_FORBIDDEN} forbidden points on a cube of 0.1 m, from {NUM_SETS} random contact sets"
        " in turn. Each cell is the median / the 99th percentile in ms. Of the kernels, and in"
        " Drake, every second tick counts, so that caches hold their own data, as in a planner."
        " *In Drake* is through the ports of partitioner, selector and monitor. *BLAS*: all points"
        " and planes as matrix products, closed forms for the weights. *direct*: the printed"
        " equations, one decomposition a point; with a star, timed on"
        f" {DIRECT_SAMPLE:,} points and scaled. *Times* says how many times faster the fastest"
        " kernel is. Of *ticks*, the second number is for what is slow. Measures are of the hand's"
        " matrix unless it says *of the contact*; these, and `margin`, which no paper has printed,"
        " use the kernels for the regions only.",
        "",
        *tick_sections(outcome.series(BY_SIZE)),
        f"## On a mesh: `{MESH}`",
        "",
        f"Medians in ms; {NUM_CONTACTS} contacts, {NUM_FORBIDDEN} forbidden points.",
        *medians_table(outcome.series(BY_MESH_SIZE), "size", "N"),
        "## Growth",
        "",
        "![Planning tick on a mesh, over contacts, and over forbidden points](growth.png)",
        "",
        f"Medians in ms on the cube, N = {GROWTH_SIZE:,}. With more contacts,"
        f" {NUM_FORBIDDEN} forbidden points:",
        *medians_table(outcome.series(BY_CONTACTS), "contacts", "n"),
        f"With more forbidden points, {NUM_CONTACTS} contacts. *As obstacles*: the same points as"
        " obstacles in the world:",
        *medians_table(outcome.series(BY_FORBIDDEN), "forbidden", "m"),
        "## Where a tick goes",
        *_shares(outcome),
        "## Against choosing all contacts anew",
        *_choices(outcome),
        "## The base case, simulated",
        *_runs(outcome),
        "## Starting",
        "",
        "Fresh processes, medians in s. The kernel's time holds importing numba, and loading or"
        " making compiled code.",
        *_starts(outcome),
        "## Memory",
        *_memory(outcome),
    ]
    return "\n".join(lines).rstrip() + "\n"


def _targets_table(outcome: Outcome) -> list[str]:
    marks = {True: "yes", False: "no"}
    rows = [
        [t.what, t.goal, t.reached, "—" if t.reached == "not measured" else marks[t.met]]
        for t in targets(outcome)
    ]
    return table(["what", "goal", "reached", "met"], rows)


def _shares(outcome: Outcome) -> list[str]:
    rows = [
        [
            f"{row.size:,}",
            row.way,
            row.strategy,
            *(f"{100 * row.shares[stage]:.0f} %" for stage in (*STAGES, REST)),
        ]
        for row in outcome.shares
    ]
    return [
        "",
        "By cProfile, which adds to what is written in Python, so that the rest looks larger than"
        " it is.",
        *table(["N", "kernel", "strategy", *STAGES, REST], rows),
    ]


def _choices(outcome: Outcome) -> list[str]:
    size = 4 * PER_EDGE**2
    scenes = len({choice.seed for choice in outcome.choices})
    rows = []
    for method, is_planner, values in median_choices(outcome.choices):
        seconds, q_msv, margin = (np.median(v) for v in values)
        rows.append(
            [
                f"planner: {method}" if is_planner else method,
                milliseconds(seconds),
                f"{q_msv:.4f}",
                f"{np.min(values[1]):.4f}",
                f"{margin:.3f}",
                f"{np.min(values[2]):.3f}",
            ]
        )
    return [
        "",
        f"Medians and least values over {scenes} scenes of {NUM_FORBIDDEN} forbidden points and"
        f" random contacts on the cube, {NUM_CONTACTS} contacts, {size:,} candidates. The margin"
        " is the normalised min-weight one, friction 0.7, eight edges; Q_MSV is at most"
        f" sqrt({NUM_CONTACTS}) = {np.sqrt(NUM_CONTACTS):.4f}. All keep out of the balls around"
        f" forbidden points, SLSQP and evolution by {1e3 * LARGEST_RADIUS:g} mm from top and"
        " bottom. A planner's values are means of the last"
        f" {LAST} of {SETTLING} ticks; its time is that of a tick then, from contacts that differ"
        " from tick to tick, so that nothing is remembered. Greedy decomposes 6 x 6 matrices with"
        " numpy, or has the planner's closed form; SLSQP makes gradients out of differences, or is"
        " told them.",
        *table(
            ["method", "time, ms", "Q_MSV", "least", "margin", "least"],
            rows,
        ),
    ]


def _runs(outcome: Outcome) -> list[str]:
    factors = [
        [
            f"{run.rate:,.0f} Hz",
            run.implementation,
            f"{run.factor(WITHOUT_RECORDING):.2f}",
            f"{run.factor(WITH_RECORDING):.2f}",
        ]
        for run in outcome.runs
    ]
    parts = [
        [
            f"{run.rate:,.0f} Hz",
            run.implementation,
            *(f"{1e3 * run.parts[part]:,.1f}" for part in PARTS),
        ]
        for run in outcome.runs
    ]
    return [
        "",
        "Contacts adapt from the start. Seconds simulated in one second:",
        *table(["planning", "kernel", "without recording", "with recording"], factors),
        "What a simulated second takes, in ms of processor time, which others on the machine take"
        " none of: diagrams with one part more and more advance in turn, and the parts are the"
        " medians of their differences. What Drake itself takes is in each. 1,000 ms in all are"
        " real time on a quiet machine.",
        *table(["planning", "kernel", *PARTS], parts),
        "![What a simulated second takes, by parts](base_case.png)",
        "",
    ]


def _starts(outcome: Outcome) -> list[str]:
    rows = [
        [
            start.implementation,
            "nothing compiled yet" if start.compiles else "as ever after",
            f"{start.processes}",
            *(f"{seconds:.2f}" for seconds in start[3:5]),
            f"{start.ticks:.4f}",
        ]
        for start in outcome.starts
    ]
    return table(["kernel", "", "processes", "import", "surface and kernel", "first tick"], rows)


def _memory(outcome: Outcome) -> list[str]:
    command = "`python -m drake_pregrasp.studies.bench.memory` does the same a million times."
    if not outcome.memory:
        return ["", f"Left out. {command}"]
    rows = [
        [
            use.implementation,
            f"{use.ticks[-1]:,}",
            f"{use.resident[first_settled(use.ticks)] / 2**20:.2f}",
            f"{use.resident[-1] / 2**20:.2f}",
            f"{use.slope:+.2f}",
        ]
        for use in outcome.memory
    ]
    head = ["kernel", "ticks", "MiB after the warm-up", "MiB at the end", "bytes a tick"]
    return [
        "",
        "Resident memory over ticks of estimator, partitioner, selector, monitor and logger,"
        " through their ports, in one process, on 400 candidates; the slope is of the straight"
        f" line through {SAMPLES} readings without those of the first {WARM_UP:,} ticks. {command}",
        *table(head, rows),
    ]
