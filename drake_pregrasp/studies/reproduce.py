"""The paper's tables, figures and claims, from runs of its ten cases."""

import json
import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from drake_pregrasp.errors import OutputError, ScenarioError
from drake_pregrasp.planning.arrays import FloatArray, IntArray
from drake_pregrasp.planning.safe_regions import NO_REGION, compute_safe_regions
from drake_pregrasp.planning.surface import ObjectSurface
from drake_pregrasp.simulation.scenario_file import load_scenario
from drake_pregrasp.studies.case_runs import CaseLog, run_cases
from drake_pregrasp.studies.claims import STRATEGY_CASES, judge_claims
from drake_pregrasp.studies.discretisation import largest_drops
from drake_pregrasp.studies.paper_figures import figure_2c, figure_4, figure_6
from drake_pregrasp.studies.published import SCENARIOS
from drake_pregrasp.studies.rendered_goals import render_goals
from drake_pregrasp.studies.report import write_report
from drake_pregrasp.studies.tables import make_tables

SEEDS = tuple(range(10))
"""Seeds each case is run with."""

DURATION = 20.0
"""Seconds simulated in each run: the contacts have settled long before."""

SHOWN_REGION = 4
"""The contact whose region Fig. 2c shows."""


def reproduce(
    out: str | Path,
    cases: Sequence[str] = tuple(SCENARIOS),
    *,
    seeds: Sequence[int] = SEEDS,
    duration: float = DURATION,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> Path:
    """Runs the cases and writes the report, the tables and the figures.

    Args:
        out: Folder of the report; run folders go into its folder `runs`.
        cases: Keys of `SCENARIOS`.
        seeds: Random seeds for each case. Figures show the first.
        duration: Seconds simulated in each run.
        on_progress: Called with the number of steps done and of all.

    Returns:
        The path of `report.html`.

    Raises:
        ScenarioError: If there is no such case.
        OutputError: If the folder can't be written.
    """
    for case in cases:
        if case not in SCENARIOS:
            raise ScenarioError("--cases", case, f"no such case; there are: {','.join(SCENARIOS)}")
    start = time.perf_counter()
    out = Path(out)
    steps = len(cases) * len(seeds) + 1
    done = 0

    def advance() -> None:
        nonlocal done
        done += 1
        on_progress(done, steps)

    try:
        out.mkdir(parents=True, exist_ok=True)
        runs = run_cases(cases, seeds, out / "runs", duration=duration, on_done=advance)
        logs = {case: [CaseLog(run) for run in runs if run.case == case] for case in cases}
        drops = largest_drops(load_scenario("a_base"))
        advance()
        tables = make_tables(logs)
        claims = judge_claims(logs, _tick_ms(logs), drops)
        content = {**tables, "claims": [claim.to_dict() for claim in claims]}
        (out / "tables.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        figures = _write_figures(out, logs)
        minutes = (time.perf_counter() - start) / 60
        notes = [
            f"{len(runs)} runs of {duration:g} s, {len(seeds)} seeds a case:"
            f" {minutes:.1f} minutes on {os.cpu_count()} processors. A run's value is its maximum"
            " over the adapting phase, as in the paper; shown is the median over the seeds with"
            " their range. All of it follows from the log.csv files in the folder runs.",
            "The paper's initial contacts are not published. Ours are calibrated to its static rows"
            ", and chosen among such sets for what the strategies then reach.",
        ]
        write_report(out, tables, claims, figures, notes)
    except OSError as error:
        raise OutputError(f"{error.filename or out}: can't be written: {error.strerror}") from error
    return out / "report.html"


def _tick_ms(logs: dict[str, list[CaseLog]]) -> dict[str, float]:
    times = {}
    for case, runs in logs.items():
        summaries = [json.loads((log.folder / "summary.json").read_text()) for log in runs]
        times[case] = float(np.median([summary["tick_time_p50_ms"] for summary in summaries]))
    return times


def _write_figures(out: Path, logs: dict[str, list[CaseLog]]) -> list[tuple[str, str]]:
    first = {case: runs[0] for case, runs in logs.items()}
    made: list[tuple[str, str, Figure]] = [
        (
            "figure_2c",
            "Fig. 2c: the strategies' weights on one safe region and the goals they lead to;"
            " side faces unrolled.",
            figure_2c(load_scenario("a_base"), SHOWN_REGION),
        ),
        ("figure_4", "Fig. 4: the measures over time; the first 4 s are static.", figure_4(first)),
    ]
    if all(case in first for case in "afj"):
        caption = (
            "Fig. 5: regions and goals, rendered by Drake from the same camera (above) and from"
            " behind (below)."
        )
        made.append(("figure_5", caption, _figure_5(first)))
    strategies = {name: case for name, case in STRATEGY_CASES.items() if case in first}
    if strategies:
        of_strategy = {name: first[case] for name, case in strategies.items()}
        made.append(
            ("figure_6", "Fig. 6: displacement and energy of the goals.", figure_6(of_strategy))
        )
    for name, _, figure in made:
        for ending in ("png", "svg"):
            figure.savefig(out / f"{name}.{ending}", dpi=130)
    return [(name, caption) for name, caption, _ in made]


def _figure_5(first: dict[str, CaseLog]) -> Figure:
    figure = Figure(figsize=(12, 6.2), layout="constrained")
    columns = (
        ("i) static contacts", first["a"], 0),
        ("ii) position tracking", first["a"], -1),
        ("iii) after the damage", first["f"], -1),
        ("iv) VEW", first["j"], -1),
    )
    axes = figure.subplots(2, len(columns))
    for column, (title, log, tick) in enumerate(columns):
        scene = _regions_at(log, tick)
        for row, yaw in enumerate((0.9, 0.9 + np.pi)):
            axes[row, column].imshow(render_goals(*scene, yaw=yaw))
            axes[row, column].set_axis_off()
        axes[0, column].set_title(title)
    return figure


def _regions_at(log: CaseLog, tick: int) -> tuple[ObjectSurface, IntArray, FloatArray, list[int]]:
    """Returns surface, labels, goals and their indices at a tick."""
    scenario = log.scenario
    surface, p_OC = scenario.make_surface(), log.p_OC(tick)
    count = len(scenario.initial_contacts)
    contacts = [i for i in range(count) if log.columns[f"c{i}_active"][tick]]
    weights = np.zeros(len(contacts))
    regions = compute_safe_regions(surface.p_OQ, p_OC, weights, surface.forbidden)
    # Regions count the active contacts; the picture counts all of them.
    labels = np.append(contacts, NO_REGION)[regions.labels]
    return surface, labels, p_OC, contacts
