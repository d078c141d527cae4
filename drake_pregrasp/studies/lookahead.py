"""What look-ahead gains on fast objects: a study with a table, a plot and a verdict."""

import csv
import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.simulation.output import write_text, writing
from drake_pregrasp.studies.lookahead_plot import Curves, plot_lookahead
from drake_pregrasp.studies.lookahead_runs import (
    CASES,
    PERIOD,
    LookaheadJob,
    LookaheadRun,
    run_lookahead,
)
from drake_pregrasp.studies.lookback import LookbackErrors, lookback_errors
from drake_pregrasp.studies.processes import in_processes

SEEDS = tuple(range(5))
"""Seeds each run is made with."""

DELAYS = (0, 2, 4, 8, 16)
"""Delays of the hand, in ticks: 0 to 200 ms."""

SHARES = (0.0, 1.0, 0.75, 1.25)
"""How far goals look ahead, in delays: not at all, right, and wrong by a quarter either way."""

SETTLED = 8
"""Tick from which on goals count: after 0.1 s the velocity is known well enough."""

WANTED_SHARE = 1 / 3
"""Largest share of the error without look-ahead that may be left with it."""

CHI_SQUARE_95 = 7.815
"""Value below which 95 % of chi-square numbers of three degrees of freedom are."""

_HEAD = (
    "object",
    "delay [ms]",
    "look-ahead [ms]",
    "median [mm]",
    "95 % [mm]",
    "e'Σ⁻¹e / 3",
    "in 95 %",
)


class Row(NamedTuple):
    """One line of the table.

    Attributes:
        case: Key of `CASES`.
        delay: Of the hand, in seconds.
        lookahead: In seconds.
        median: Of the goal errors at the moment of contact, in metres.
        p95: Their 95th percentile, in metres.
        normalised: Mean of the normalised squared position errors, divided by their expectation 3.
        inside: Share of them within the 95 % ellipsoid of the covariance.
    """

    case: str
    delay: float
    lookahead: float
    median: float
    p95: float
    normalised: float
    inside: float


def study_lookahead(
    out: str | Path,
    *,
    seeds: Sequence[int] = SEEDS,
    cases: Sequence[str] = tuple(CASES),
    delays: Sequence[int] = DELAYS,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> Path:
    """Runs the study and writes `lookahead.csv`, `lookahead.png` and `lookahead.md`.

    Args:
        out: Their folder; made if it isn't there.
        seeds: Of the measurement noise.
        cases: Keys of `CASES`.
        delays: Of the hand, in ticks.
        on_progress: Called with the number of runs done and of all.

    Returns:
        The path of `lookahead.md`.

    Raises:
        OutputError: If the folder can't be written.
    """
    out = Path(out)
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
    lookaheads = sorted({share * delay * PERIOD for delay in delays for share in SHARES})
    jobs = [LookaheadJob(*job) for job in _product(cases, lookaheads, seeds)]
    done = 0

    def advance() -> None:
        nonlocal done
        done += 1
        on_progress(done, len(jobs))

    runs = dict(zip(jobs, in_processes(run_lookahead, jobs, on_done=advance), strict=True))
    rows = [
        _row(runs, case, delay, share * delay * PERIOD, seeds)
        for case in cases
        for delay in delays
        for share in (SHARES if delay else SHARES[:1])
    ]
    write_text(out / "lookahead.csv", _csv(rows))
    with writing(out):
        plot_lookahead(out / "lookahead.png", _curves(rows))
    write_text(out / "lookahead.md", _report(rows, _lookback(runs, cases, seeds), seeds))
    return out / "lookahead.md"


def remaining_share(rows: Sequence[Row], case: str, delay: float) -> tuple[float, float]:
    """Returns the shares of median and 95th percentile that the right look-ahead leaves."""
    without, right = (
        next(r for r in rows if (r.case, r.delay, r.lookahead) == (case, delay, ahead))
        for ahead in (0.0, delay)
    )
    return right.median / without.median, right.p95 / without.p95


def _product(
    cases: Sequence[str], lookaheads: Sequence[float], seeds: Sequence[int]
) -> list[tuple[str, float, int]]:
    return [(case, ahead, seed) for case in cases for ahead in lookaheads for seed in seeds]


def _row(
    runs: dict[LookaheadJob, LookaheadRun],
    case: str,
    delay: int,
    lookahead: float,
    seeds: Sequence[int],
) -> Row:
    chosen = [runs[LookaheadJob(case, lookahead, seed)] for seed in seeds]
    errors = np.concatenate([run.goal_errors(delay, SETTLED) for run in chosen])
    squares = np.concatenate([run.normalised_errors(delay, SETTLED) for run in chosen])
    return Row(
        case,
        delay * PERIOD,
        lookahead,
        float(np.median(errors)),
        float(np.percentile(errors, 95)),
        float(np.mean(squares)) / 3,
        float(np.mean(squares < CHI_SQUARE_95)),
    )


def _lookback(
    runs: dict[LookaheadJob, LookaheadRun], cases: Sequence[str], seeds: Sequence[int]
) -> list[tuple[str, FloatArray, bool]]:
    """Returns for each case the errors, filtered above smoothed, and whether the newest agree."""
    found = []
    for case in cases:
        jobs = [LookaheadJob(case, 0.0, seed) for seed in seeds]
        errors = [lookback_errors(job, runs[job]) for job in jobs]
        squares = [[np.square(filtered), np.square(smoothed)] for filtered, smoothed, _ in errors]
        found.append((case, np.sqrt(np.mean(squares, axis=0)), all(same for *_, same in errors)))
    return found


def _curves(rows: Sequence[Row]) -> Curves:
    names = ("no look-ahead", "look-ahead = delay", "25 % too short", "25 % too long")
    return {
        case: {
            name: np.array(
                [
                    (r.delay, r.median, r.p95)
                    for r in rows
                    if r.case == case and r.lookahead == share * r.delay
                ]
            )
            for name, share in zip(names, SHARES, strict=True)
        }
        for case in dict.fromkeys(r.case for r in rows)
    }


def _csv(rows: Sequence[Row]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = ("case", "delay_s", "lookahead_s", "median_m", "p95_m", "normalised", "inside_95")
    writer.writerows([names, *rows])
    return text.getvalue()


def _report(
    rows: Sequence[Row], lookback: Sequence[tuple[str, FloatArray, bool]], seeds: Sequence[int]
) -> str:
    lines = [
        "# Look-ahead and look-back",
        "",
        f"{len(seeds)} seeds a run. A goal issued at time t is reached by the hand at t + delay;"
        " its error is the distance to the same point of the object at the true pose of that"
        f" moment. Goals of the first {SETTLED * PERIOD:g} s don't count.",
        "",
        "![Goal error at the moment of contact over the hand's delay](lookahead.png)",
        "",
        "| " + " | ".join(_HEAD) + " |",
        "|" + "---|" * len(_HEAD),
    ]
    lines += [
        f"| {r.case} | {1e3 * r.delay:g} | {1e3 * r.lookahead:g} | {1e3 * r.median:.1f} |"
        f" {1e3 * r.p95:.1f} | {r.normalised:.2f} | {100 * r.inside:.0f} % |"
        for r in rows
    ]
    lines += ["", "## Is at most a third of the error left?", ""]
    for case, delay in dict.fromkeys((r.case, r.delay) for r in rows if r.delay > 0):
        median, p95 = remaining_share(rows, case, delay)
        verdict = "yes" if max(median, p95) <= WANTED_SHARE else "no"
        lines.append(
            f"- {case}, {1e3 * delay:g} ms: **{verdict}**, {100 * median:.1f} % of the median and"
            f" {100 * p95:.1f} % of the 95th percentile are left."
        )
    lines += [
        "",
        "## Look-back: errors of past poses, root mean square",
        "",
        "| object | | position [mm] | orientation [mrad] | velocity [mm/s] |",
        "|---|---|---|---|---|",
    ]
    for case, (filtered, smoothed), same in lookback:
        for name, values in (("filtered", filtered), ("smoothed", smoothed)):
            errors = LookbackErrors(*(1e3 * values))
            lines.append(
                f"| {case} | {name} | {errors.position:.2f} | {errors.orientation:.2f} |"
                f" {errors.velocity:.1f} |"
            )
        lines.append(f"| {case} | newest equal | {'yes' if same else 'no'} | | |")
    return "\n".join(lines) + "\n"
