"""The benchmark's tables."""

from collections.abc import Sequence

from drake_pregrasp.studies.bench_runs import SLOW, RunTime, TickTimes
from drake_pregrasp.studies.bench_scene import (
    DIRECT_SAMPLE,
    NUM_CONTACTS,
    NUM_FORBIDDEN,
    NUM_SETS,
)


def bench_markdown(ticks: Sequence[TickTimes], runs: Sequence[RunTime], machine: str) -> str:
    """Returns the report as Markdown."""
    lines = [
        "# How long a planning tick takes",
        "",
        f"Regions, weights, selection, projection and measures for {NUM_CONTACTS} contacts and"
        f" {NUM_FORBIDDEN} forbidden points on a cube of 0.1 m, from {NUM_SETS} random contact sets"
        " in turn; one thread, all ways in turn in one run, the fast ones twice, of which the"
        " second counts. Median / 99th percentile in ms, over"
        " the ticks that are stated. *direct*: the printed equations, with one decomposition a"
        f" point, timed on {DIRECT_SAMPLE} points and scaled where there are more. *BLAS*: all"
        " points and planes as matrix products, closed forms for the weights. *in Drake*: through"
        f" the ports of partitioner, selector and monitor. Machine: {machine}.",
        "",
        "![Planning tick over the number of candidate points](bench.png)",
    ]
    for strategy in dict.fromkeys(row.strategy for row in ticks):
        own = [row for row in ticks if row.strategy == strategy]
        ways = list(dict.fromkeys(row.way for row in own))
        lines += ["", f"## {strategy}", ""]
        lines.append("| N | ticks | " + " | ".join(ways) + " | times BLAS | times direct |")
        lines.append("|" + "---|" * (len(ways) + 4))
        for size in dict.fromkeys(row.size for row in own):
            cells = {row.way: row for row in own if row.size == size}
            fastest = min(row.p50 for way, row in cells.items() if way not in SLOW)
            counts = f"{max(row.ticks for row in cells.values())}, {cells['BLAS'].ticks}"
            lines.append(
                f"| {size:,} | {counts} | "
                + " | ".join(_cell(cells[way]) for way in ways)
                + "".join(f" | {cells[way].p50 / fastest:.0f}" for way in SLOW)
                + " |"
            )
    lines += [
        "",
        "The last columns say how many times faster the fastest kernel is. Of *ticks*, the second"
        " number is for BLAS and direct.",
        "",
        "## The base case, simulated",
        "",
        "Seconds simulated in one second: the whole diagram, without recording.",
        "",
    ]
    rates = list(dict.fromkeys(run.rate for run in runs))
    lines.append("| kernel | " + " | ".join(f"{rate:g} Hz" for rate in rates) + " |")
    lines.append("|" + "---|" * (1 + len(rates)))
    for implementation in dict.fromkeys(run.implementation for run in runs):
        factors = [
            run.factor for rate in rates for run in runs if run[:2] == (implementation, rate)
        ]
        lines.append(f"| {implementation} | " + " | ".join(f"{f:.1f}" for f in factors) + " |")
    return "\n".join(lines) + "\n"


def _cell(row: TickTimes) -> str:
    mark = "*" if row.scaled > 1 else ""
    return f"{1e3 * row.p50:.3g} / {1e3 * row.p99:.3g}{mark}"
