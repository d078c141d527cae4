"""The paper's tables, figures and claims, from runs of its ten cases."""

import argparse
import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.errors import ScenarioError
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.regions.safe_regions import NO_REGION, compute_safe_regions
from drake_pregrasp.simulation.output import write_text, writing
from drake_pregrasp.simulation.scenario_file import load_scenario
from drake_pregrasp.studies.case_runs import CaseLog, Job, case_job, run_jobs
from drake_pregrasp.studies.claims import STRATEGY_CASES, judge_claims
from drake_pregrasp.studies.discretisation import (
    SPACINGS,
    discretisation_costs,
    drops_come_from_spacing,
    spacing_costs_quality,
)
from drake_pregrasp.studies.paper_figures import figure_2c, figure_4, figure_6
from drake_pregrasp.studies.published import SCENARIOS
from drake_pregrasp.studies.rendered_goals import render_goals
from drake_pregrasp.studies.report import write_report
from drake_pregrasp.studies.study_options import add_out_option, names, step_bar
from drake_pregrasp.studies.tables import make_tables

SEEDS = tuple(range(10))
"""Seeds each case is run with."""

DURATION = 20.0
"""Seconds simulated in each run: the contacts have settled long before."""

FIGURES = ("figure_2c", "figure_4", "figure_5", "figure_6")
"""Names of the figures' files, without their endings."""

REPORT_FILES = (
    "report.html",
    "report.md",
    "tables.json",
    *(f"{name}.{ending}" for name in FIGURES for ending in ("png", "svg")),
)
"""What the folder holds beside the runs; a new report replaces these and touches nothing else."""

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
    cases = list(dict.fromkeys(cases))
    start = time.perf_counter()
    out = Path(out)
    jobs = [case_job(case, seed, duration) for seed in seeds for case in cases]
    spacing_jobs = [_spacing_job(spacing, duration) for spacing in SPACINGS]
    steps = len(jobs) + len(spacing_jobs) + 2
    done = 0

    def advance() -> None:
        nonlocal done
        done += 1
        on_progress(done, steps)

    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
        for name in REPORT_FILES:
            (out / name).unlink(missing_ok=True)
    runs = run_jobs([*jobs, *spacing_jobs], out / "runs", on_done=advance)
    logs = {case: [CaseLog(run) for run in runs[: len(jobs)] if run.case == case] for case in cases}
    spacing_logs = [CaseLog(run) for run in runs[len(jobs) :]]
    costs = discretisation_costs(load_scenario("a_base"))
    advance()
    claims = [
        *judge_claims(logs, _tick_ms(logs)),
        spacing_costs_quality(costs),
        drops_come_from_spacing(dict(zip(SPACINGS, spacing_logs, strict=True))),
    ]
    tables = make_tables(logs)
    content = {**tables, "claims": [claim.to_dict() for claim in claims]}
    write_text(out / "tables.json", json.dumps(content, indent=1) + "\n")
    with writing(out):
        figures = _write_figures(out, logs)
        advance()
        minutes = (time.perf_counter() - start) / 60
        write_report(out, tables, claims, figures, _notes(logs, duration, minutes))
    return out / "report.html"


def _spacing_job(spacing: float, duration: float) -> Job:
    text = (
        f"{{surface: {{spacing: {spacing}}}, sensor: {{position_std: 0, orientation_std: 0}},"
        f" simulation_duration: {duration}}}"
    )
    return Job("a", 0, text, f"a_base_without_noise_spacing_{1e3 * spacing:g}_mm")


def _notes(logs: Mapping[str, Sequence[CaseLog]], duration: float, minutes: float) -> list[str]:
    runs = sum(len(of_case) for of_case in logs.values())
    left_out = [case for case in SCENARIOS if case not in logs]
    notes = [
        f"{runs} runs of {duration:g} s took {minutes:.1f} minutes on {os.cpu_count()} processors."
        " A run's value, best, is its maximum after the static phase, and after the damage in f, as"
        " in the paper's tables. Settled is the mean once the contacts have come to rest, or into"
        " the cycle they stay in. Shown are medians over the seeds, with the range of the best."
        " Seeds differ in the measurement noise alone; Q_VEW doesn't see it, because all contacts"
        " shift together.",
        "Best and settled values follow from the log.csv files in the folder runs, where each run"
        " folder is named after its scenario and seed. The static set of f after the damage, and"
        " Fig. 2c, follow from the scenario; planning times are in each summary.json.",
        "The paper's initial contacts are not published. Ours are calibrated: five contacts that"
        " meet its nine static values of a, d and e together, chosen among such sets so that the"
        " strategies' best values come within 0.3 % (Q_MSV, Q_VEW) and 1 % (Q_GII) of Table III,"
        " and two fingers to lose that come nearest to its static row f.",
    ]
    measured = [of_case[0].scenario.planner for of_case in logs.values()]
    settings = {
        f"{planner.strategy}: reading {planner.reading},"
        f" {'' if planner.stretch else 'not '}stretched,"
        f" {'best point' if planner.best_point else 'centroid'}"
        for planner in measured
        if planner.strategy != "position"
    }
    if settings:
        notes.append("Settings of the metric strategies: " + "; ".join(sorted(settings)) + ".")
    if left_out:
        notes.append(f"Cases left out, and with them the claims about them: {', '.join(left_out)}.")
    return notes


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
            f"Fig. 2c: the strategies' weights on the safe region of contact {SHOWN_REGION}"
            " among the static contacts of a_base (cross: the contact, dot: the goal it leads"
            " to). The side faces are unrolled; the measures' weights are stretched, so that the"
            " least is 0.",
            figure_2c(load_scenario("a_base"), SHOWN_REGION),
        ),
        (
            "figure_4",
            "Fig. 4: the measures over time, divided by their values for n active contacts at the"
            f" centre of mass. Runs {_folders(first)}.",
            figure_4(first),
        ),
    ]
    if all(case in first for case in "afj"):
        caption = (
            "Fig. 5: regions and goals, rendered by Drake from the same camera (above) and from"
            " behind (below): the first tick of a and the last of a, f and j. Runs"
            f" {_folders({case: first[case] for case in 'afj'})}."
        )
        made.append(("figure_5", caption, _figure_5(first)))
    strategies = {name: case for name, case in STRATEGY_CASES.items() if case in first}
    if len(strategies) == len(STRATEGY_CASES):
        of_strategy = {name: first[case] for name, case in strategies.items()}
        caption = f"Fig. 6: displacement and energy of the goals. Runs {_folders(of_strategy)}."
        made.append(("figure_6", caption, figure_6(of_strategy)))
    for name, _, figure in made:
        for ending in ("png", "svg"):
            figure.savefig(out / f"{name}.{ending}", dpi=130)
    return [(name, caption) for name, caption, _ in made]


def _folders(logs: Mapping[str, CaseLog]) -> str:
    return ", ".join(log.folder.name for log in logs.values())


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
    count = scenario.num_contacts
    contacts = [i for i in range(count) if log.columns[f"c{i}_active"][tick]]
    weights = np.zeros(len(contacts))
    regions = compute_safe_regions(surface.p_OQ, p_OC, weights, surface.forbidden)
    # Regions count the active contacts; the picture counts all of them.
    labels = np.append(contacts, NO_REGION)[regions.labels]
    return surface, labels, p_OC, contacts


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `drake-pregrasp reproduce`."""
    add_out_option(parser, "reproduction")
    parser.add_argument(
        "--cases",
        type=names,
        default=list(SCENARIOS),
        metavar="a,b,...",
        help=f"which; {','.join(SCENARIOS)} if not set",
    )
    parser.set_defaults(command=_command)


def _command(options: argparse.Namespace) -> int:
    start = time.perf_counter()
    with step_bar() as on_progress:
        report = reproduce(options.out, options.cases, on_progress=on_progress)
    print(f"reproduced in {(time.perf_counter() - start) / 60:.1f} minutes")
    print(f"report in {report}: open it in a browser")
    return 0
