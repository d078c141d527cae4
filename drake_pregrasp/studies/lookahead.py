"""Study of look-ahead: errors of goals on fast objects that a delayed hand reaches."""

import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import yaml
from matplotlib.figure import Figure
from pydrake.systems.analysis import Simulator
from scipy.stats import chi2

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.selection_input import is_active
from drake_pregrasp.simulation.output import writing
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import load_scenario, read_mapping
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.studies.report_page import Heading, Part, Picture, Table, write_report
from drake_pregrasp.studies.runner import OnProgress, run_jobs
from drake_pregrasp.systems.loggers import TickRecord

PERIOD = 0.0125
"""Planning period in seconds; the hand's delays are multiples of it."""

SETTLED = 8
"""First tick whose goals count: after 0.1 s, the velocity estimate has converged."""

CASES = read_mapping(Path(__file__).with_name("lookahead_cases.yaml"))
"""Shipped scenario and overrides of each case, by the case's name."""

SEEDS = tuple(range(5))
"""Default seeds of each case."""

DELAYS = (0, 2, 4, 8, 16)
"""Default delays of the hand, in ticks: 0 to 200 ms."""

SHARES = {"no look-ahead": 0.0, "look-ahead = delay": 1.0, "25 % too short": 0.75}
SHARES |= {"25 % too long": 1.25}
"""Look-aheads as shares of the hand's delay, by label."""

WANTED_SHARE = 1 / 3
"""Largest accepted ratio of the error with look-ahead to the error without it."""

# Colours of Okabe and Ito's colour-blind-safe set, with markers that differ as well.
_STYLES = (
    ("#000000", "o", "-"),
    ("#009E73", "s", "-"),
    ("#E69F00", "v", "--"),
    ("#0072B2", "^", "--"),
)


def study_lookahead(
    out: str | Path,
    *,
    seeds: Sequence[int] = SEEDS,
    cases: Sequence[str] = tuple(CASES),
    delays: Sequence[int] = DELAYS,
    on_progress: OnProgress = lambda done, total: None,
) -> Path:
    """Runs the study, and writes its rows, `lookahead.png` and `lookahead.md`.

    Args:
        out: Folder of the study, made if it is not there.
        seeds: Seeds of the measurement noise.
        cases: Keys of `CASES` to run.
        delays: Delays of the hand, in ticks.
        on_progress: Called with the number of finished jobs and the number of jobs to do.

    Returns:
        The path of `lookahead.md`.

    Raises:
        OutputError: If the folder cannot be used, or a run fails.
    """
    out = Path(out)
    delays_of: dict[float, list[int]] = {}
    for delay in delays:
        for share in SHARES.values() if delay else (0.0,):
            delays_of.setdefault(share * delay * PERIOD, []).append(delay)
    jobs = [{"case": case, "lookahead": ahead} for case in cases for ahead in sorted(delays_of)]
    rows = run_jobs(
        functools.partial(lookahead_errors, seeds=seeds, delays=delays_of),
        jobs,
        folder=out,
        settings={"seeds": list(seeds), "cases": list(cases), "delays": list(delays)},
        on_progress=on_progress,
    ).rows.sort_values(["case", "delay", "lookahead"])
    with writing(out):
        plot_lookahead(rows).savefig(out / "lookahead.png", dpi=140)
    parts: list[Part] = [
        f"{len(seeds)} seeds a run. A goal issued at time t is reached by the hand at t + delay;"
        " its error is the distance to the same point of the object at the true pose of that"
        f" moment. Goals of the first {SETTLED * PERIOD:g} s do not count.",
        Picture(out / "lookahead.png", "Goal error at the moment of contact over the hand's delay"),
        Table(goal_table(rows)),
        Heading("Is at most a third of the error left?"),
        Table(remaining_table(rows)),
    ]
    return write_report(out, "Look-ahead", parts, name="lookahead", formats=("md",))


def goal_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Returns a table of goal errors for each case, delay and look-ahead."""
    return pd.DataFrame(
        {
            "object": rows["case"],
            "delay [ms]": rows["delay"].map(lambda t: f"{1e3 * t:g}"),
            "look-ahead [ms]": rows["lookahead"].map(lambda t: f"{1e3 * t:g}"),
            "median [mm]": rows["median"].map(lambda e: f"{1e3 * e:.1f}"),
            "95 % [mm]": rows["p95"].map(lambda e: f"{1e3 * e:.1f}"),
            "e'Σ⁻¹e / 3": rows["normalised"].map("{:.2f}".format),
            "in 95 %": rows["inside"].map(lambda share: f"{100 * share:.0f} %"),
        }
    )


def remaining_shares(rows: pd.DataFrame) -> pd.DataFrame:
    """Returns ratios of the error with look-ahead = delay to the error without look-ahead.

    Args:
        rows: Rows of `lookahead_errors`, with the columns of their jobs.

    Returns:
        The ratios of the `median` and of the 95th percentile `p95`, by case and delay.
    """
    keys, errors = ["case", "delay"], ["median", "p95"]
    without = rows[rows.lookahead == 0].set_index(keys)[errors]
    right = rows[np.isclose(rows.lookahead, rows.delay) & (rows.delay > 0)].set_index(keys)[errors]
    return right / without.loc[right.index]


def remaining_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Formats `remaining_shares` as a table with verdicts by `WANTED_SHARE`."""
    shares = remaining_shares(rows)
    return pd.DataFrame(
        {
            "object": shares.index.get_level_values("case"),
            "delay [ms]": [f"{1e3 * t:g}" for t in shares.index.get_level_values("delay")],
            "median left": [f"{100 * share:.1f} %" for share in shares["median"]],
            "95th percentile left": [f"{100 * share:.1f} %" for share in shares["p95"]],
            "at most a third": np.where(shares.max(axis=1) <= WANTED_SHARE, "yes", "no"),
        }
    )


def plot_lookahead(rows: pd.DataFrame) -> Figure:
    """Returns a figure of goal errors over the hand's delay, with one panel for each case."""
    cases = list(dict.fromkeys(rows["case"]))
    figure = Figure(figsize=(4.6 * len(cases), 4.2), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(cases), sharey=True))
    for panel, case in zip(panels, cases, strict=True):
        of_case = rows[rows["case"] == case]
        for (label, share), style in zip(SHARES.items(), _STYLES, strict=True):
            color, marker, line = style
            part = of_case[np.isclose(of_case.lookahead, share * of_case.delay)]
            delay, median, p95 = (1e3 * part[name] for name in ("delay", "median", "p95"))
            panel.plot(delay, median, color=color, marker=marker, linestyle=line, label=label)
            panel.fill_between(delay, median, p95, color=color, alpha=0.12, linewidth=0)
        panel.set_yscale("log")
        panel.set_title(case)
        panel.set_xlabel("delay of the hand [ms]")
        panel.grid(True, which="both", color="0.92", linewidth=0.6)
        panel.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("goal error at contact [mm]\nmedian, shaded up to 95 %")
    panels[0].legend(frameon=False, loc="upper left", fontsize=9)
    return figure


class LookaheadRun(NamedTuple):
    """Records of K ticks of a run, and what they do not hold.

    Attributes:
        records: Records of all ticks.
        p_WO_covariance: Covariances of the estimated positions, shape (K, 3, 3), in m².
    """

    records: Sequence[TickRecord]
    p_WO_covariance: FloatArray

    def goal_errors(self, delay: int, start: int) -> FloatArray:
        """Returns the errors of goals at the time when a delayed hand reaches them.

        The hand reaches the goal of tick k at tick k + delay. The goal's point of the object, from
        the estimated pose of tick k, is then at the true pose of tick k + delay.

        Args:
            delay: Delay of the hand, in ticks.
            start: First tick whose goals count.

        Returns:
            Distance between goal and point in metres, for each tick and active contact.
        """
        errors = []
        for record, later in zip(self.records[start:], self.records[start + delay :], strict=False):
            p_WC = record.p_WC[is_active(record.contact_status)]
            moved = later.X_WO @ record.X_WO_estimated.inverse()
            errors.append(np.linalg.norm((moved @ p_WC.T).T - p_WC, axis=1))
        return np.concatenate(errors)

    def normalised_errors(self, delay: int, start: int) -> FloatArray:
        """Returns squared errors of the predicted positions, normalised by covariance: e' Σ⁻¹ e.

        With a correct covariance they are chi-square distributed with mean 3.
        """
        p_WO = np.array([record.X_WO.translation() for record in self.records])
        predicted = np.array([record.X_WO_estimated.translation() for record in self.records])
        last = len(p_WO) - delay
        e = p_WO[start + delay :] - predicted[start:last]
        weighted = np.linalg.solve(self.p_WO_covariance[start:last], e[:, :, None])[:, :, 0]
        squares: FloatArray = np.sum(e * weighted, axis=1)
        return squares


def lookahead_scenario(case: str, lookahead: float, seed: int) -> Scenario:
    """Returns the scenario of a case, a key of `CASES`, with a look-ahead in seconds and a seed."""
    scenario = load_scenario(CASES[case]["scenario"], text=yaml.dump(CASES[case]["overrides"]))
    scenario.planner.estimator.lookahead = lookahead
    scenario.random_seed = seed
    return scenario


def run_lookahead(scenario: Scenario) -> LookaheadRun:
    """Simulates a scenario of `lookahead_scenario`."""
    records: list[TickRecord] = []
    covariances: list[FloatArray] = []

    def add(record: TickRecord) -> None:
        context = planner.GetMyContextFromRoot(simulator.get_context())
        covariances.append(covariance.Eval(context).reshape(3, 3).copy())
        records.append(record)

    diagram = make_diagram(scenario, sink=add)
    planner = diagram.GetSubsystemByName("pregrasp_planner")
    covariance = planner.GetOutputPort("p_WO_covariance")
    simulator = Simulator(diagram)
    simulator.AdvanceTo(scenario.simulation_duration)
    return LookaheadRun(records, np.array(covariances))


def lookahead_errors(
    job: dict[str, Any], *, seeds: Sequence[int], delays: dict[float, list[int]]
) -> list[dict[str, Any]]:
    """Returns the rows of a case and a look-ahead, one for each delay, in seconds and metres.

    Args:
        job: Name of the `case`, and `lookahead` in seconds.
        seeds: Seeds of the measurement noise, all of which contribute to each row.
        delays: Delays of the hand in ticks, by the look-ahead in seconds.
    """
    runs = [run_lookahead(lookahead_scenario(**job, seed=seed)) for seed in seeds]
    return [_goal_row(runs, delay) for delay in delays[job["lookahead"]]]


def _goal_row(runs: Sequence[LookaheadRun], delay: int) -> dict[str, float]:
    errors = np.concatenate([run.goal_errors(delay, SETTLED) for run in runs])
    squares = np.concatenate([run.normalised_errors(delay, SETTLED) for run in runs])
    return {
        "delay": PERIOD * delay,
        "median": float(np.median(errors)),
        "p95": float(np.percentile(errors, 95)),
        "normalised": float(np.mean(squares)) / 3,
        "inside": float(np.mean(squares < chi2.ppf(0.95, 3))),
    }
