"""Reproduction of the paper's tables, figures and claims by runs of its ten cases."""

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from drake_pregrasp.errors import ScenarioError
from drake_pregrasp.quality.grasp_quality import QUALITY_MEASURES
from drake_pregrasp.simulation.output import make_folder, write_text, writing
from drake_pregrasp.simulation.scenario_file import load_resolved
from drake_pregrasp.studies.command_options import add_report_command, names
from drake_pregrasp.studies.paper import paper_cases
from drake_pregrasp.studies.paper.claims import STRATEGY_CASES, discretisation_costs, judge_claims
from drake_pregrasp.studies.paper.paper_cases import LITERAL, SCENARIOS, TABLE_2, TABLE_3, CaseLog
from drake_pregrasp.studies.paper.paper_figures import figure_2c, figure_4, figure_5, figure_6
from drake_pregrasp.studies.report_page import (
    NO_VALUE,
    Heading,
    Part,
    Picture,
    Table,
    write_report,
)
from drake_pregrasp.studies.runner import OnProgress

SEEDS = tuple(range(10))
"""Default seeds of each case."""

DURATION = 20.0
"""Default simulated time of each run in seconds, long after the contacts have settled."""

SHOWN_REGION = 4
"""Index of the contact whose region Fig. 2c shows, as its caption says."""

CAPTIONS = {
    "figure_2c": "Fig. 2c: stretched weights on the safe region of contact 4 of the static contacts"
    " of a_base (cross: the contact, dot: the goal), side faces unrolled.",
    "figure_4": "Fig. 4: the measures, divided by their values for contacts at the centre of mass.",
    "figure_5": "Fig. 5: regions and goals from two sides: first tick of a, last of a, f and j.",
    "figure_6": "Fig. 6: displacement and energy of the goals, summed over the contacts.",
}
"""Captions of the figures, by the names of their files."""

NOTES = (
    "A run's best value is its maximum after the static phase, and after the damage in f, as in"
    " the paper; the settled value is the mean once the contacts have come to rest, or into the"
    " cycle they stay in. A best value is transient if the measure stays below it by more than"
    " 0.01 % from then on. Values are medians over the seeds, which differ in the measurement"
    " noise, and follow from log.csv and scenario.yaml of the folders in runs.",
    "Random values are medians of 1000 sets of as many contacts, drawn from the allowed surface."
    " The share of the gain is our best value minus our static one, over the same difference of"
    " the paper; it is left out where the paper prints no gain of more than one unit of the last"
    " digit. Cells hold Q_MSV, Q_GII and Q_VEW.",
    "The paper's initial contacts are not published. Ours are fitted to its nine static values of"
    " a, d and e, and chosen among such sets so that the best values come near Table III.",
    "The rows h, i and j stretch the weights over each region to b - min b. The paper does not"
    " print this; it is our interpretation. The literal rows have the weights as printed.",
    "Two published values are in doubt. The static Q_VEW of f, 26.8783, is impossible: three"
    " contacts have at least 3³ = 27. And 125.7573 is printed for both h and j.",
)
"""Paragraphs at the start of the report."""

_TRANSIENT = 1e-4  # Least relative loss of a transient best value.
_ROUNDING = 1.5e-4  # A smaller published gain can be due to the rounding of its two values.
_SHORT = [
    "static, paper",
    "static, ours",
    "random",
    "best, paper",
    "best, ours",
    "share of the gain [%]",
]


def reproduce(
    out: str | Path,
    cases: Sequence[str] = tuple(SCENARIOS),
    *,
    seeds: Sequence[int] = SEEDS,
    duration: float = DURATION,
    on_progress: OnProgress = lambda done, total: None,
) -> Path:
    """Runs the cases and writes the report, the tables and the figures.

    Args:
        out: Folder of the report; run folders go into its folder `runs`.
        cases: Keys of `SCENARIOS` to run.
        seeds: Random seeds of each case; figures show the first seed.
        duration: Simulated time of each run in seconds.
        on_progress: Called with the number of finished runs and the number of all runs.

    Returns:
        The path of `report.html`.

    Raises:
        ScenarioError: If a case is unknown.
        OutputError: If the folder cannot be written.
    """
    for case in cases:
        if case not in SCENARIOS:
            raise ScenarioError("--cases", case, f"no such case; there are: {','.join(SCENARIOS)}")
    out, cases = Path(out), list(dict.fromkeys(cases))
    make_folder(out)
    with writing(out):
        for name in CAPTIONS:  # Figures of an earlier report.
            (out / f"{name}.png").unlink(missing_ok=True)
            (out / f"{name}.svg").unlink(missing_ok=True)
    rows = [*cases, *(LITERAL[case] for case in cases if case in LITERAL)]
    jobs = [paper_cases.case_job(row, seed, duration) for seed in seeds for row in rows]
    jobs += [paper_cases.spacing_job(spacing, duration) for spacing in paper_cases.SPACINGS]
    runs = paper_cases.run_cases(jobs, out / "runs", on_progress=on_progress)
    claims = judge_claims(runs, discretisation_costs(load_resolved("a_base")))
    first = {job.case: CaseLog(out / "runs" / job.folder) for job in jobs if job.seed == seeds[0]}
    random = {row: paper_cases.random_quality(first[row].resolved) for row in rows}
    tables = {
        "table2": paper_table(TABLE_2, runs, random),
        "table3": paper_table(TABLE_3, runs, random),
    }
    content = {
        name: json.loads(table.to_json(orient="records", double_precision=15))
        for name, table in {**tables, "claims": claims}.items()
    }
    write_text(out / "tables.json", json.dumps(content, indent=1) + "\n")
    with writing(out):
        figures = _figures({case: first[case] for case in cases})
        for name, figure in figures.items():
            for ending in ("png", "svg"):
                figure.savefig(out / f"{name}.{ending}", dpi=130)
    verdicts = pd.DataFrame("", claims.index, claims.columns)
    verdicts["verdict"] = np.where(claims["verdict"] == "holds", "holds", "fails")
    parts: list[Part] = [
        f"Cases {', '.join(cases)}; {len(seeds)} seeds; {duration:g} s each.",
        *NOTES,
        Heading("Claims"),
        Table(claims.style.set_td_classes(verdicts)),
        Heading("Table II: position tracking"),
        Table(short_table(tables["table2"])),
        Heading("Table III: the four strategies"),
        Table(short_table(tables["table3"])),
        Heading("Spread over the seeds, and when the best value is reached"),
        *(
            Table(_texts(table.drop(columns={*_SHORT} - {"best, ours"})))
            for table in tables.values()
        ),
        Heading("Figures"),
        *(Picture(out / f"{name}.png", CAPTIONS[name]) for name in figures),
    ]
    return write_report(out, "Dynamic pre-grasp planning: the paper, reproduced", parts)


def paper_table(
    table: Mapping[str, paper_cases.Published],
    runs: pd.DataFrame,
    random: Mapping[str, Mapping[str, float]],
) -> pd.DataFrame:
    """Returns Table II or III beside our values, with a row for each measure of each run case.

    The share of the gain is our best value minus our static one, over the published difference. It
    is NaN where the paper prints no gain beyond rounding.

    Args:
        table: Published table, `TABLE_2` or `TABLE_3`.
        runs: Rows of `run_cases`.
        random: Values of `random_quality` of each run case.
    """
    found = []
    rows = [(row, table[case]) for case in table for row in (case, LITERAL.get(case)) if row]
    for row, published in rows:
        own = runs[runs["case"] == row]
        for k, measure in enumerate(QUALITY_MEASURES if len(own) else ()):
            static, best, at, settled, later = (
                own[f"{kind} {measure}"] for kind in ("static", "best", "at", "settled", "later")
            )
            before, after = (printed[k] or np.nan for printed in published)
            gain = best.median() - static.median()
            is_transient = best.median() - later.median() > _TRANSIENT * best.median()
            found.append(
                {
                    "case": row,
                    "measure": measure,
                    "static, paper": published.static[k],
                    "static, ours": static.median(),
                    "random": random[row][measure],
                    "best, paper": published.dynamic[k],
                    "best, ours": best.median(),
                    "share of the gain [%]": (
                        100 * gain / (after - before) if after - before > _ROUNDING else np.nan
                    ),
                    "lowest": best.min(),
                    "highest": best.max(),
                    "at [s]": at.median(),
                    "transient": "yes" if is_transient else "",
                    "settled, ours": settled.median(),
                }
            )
    return pd.DataFrame(found)


def short_table(table: pd.DataFrame) -> pd.DataFrame:
    """Returns a table of `paper_table` with a row for each case, and three measures in a cell."""
    texts = table[["case"]].copy()
    for name, digits in (*dict.fromkeys(_SHORT[:-1], 4).items(), (_SHORT[-1], 0)):
        values = table[name].astype(float)
        texts[name] = [NO_VALUE if np.isnan(x) else f"{x:.{digits}f}" for x in values]
    return texts.groupby("case", sort=False).agg(" ".join).reset_index()


def _texts(table: pd.DataFrame) -> pd.DataFrame:
    return table.map(lambda value: f"{value:.4f}" if isinstance(value, float) else value)


def _figures(logs: Mapping[str, CaseLog]) -> dict[str, Figure]:
    """Returns the figures whose cases were run, by the names of their files."""
    figures = {
        "figure_2c": figure_2c(load_resolved("a_base"), SHOWN_REGION),
        "figure_4": figure_4(logs),
    }
    if set("afj") <= set(logs):
        figures["figure_5"] = figure_5(*(logs[case] for case in "afj"))
    if set(STRATEGY_CASES.values()) <= set(logs):
        figures["figure_6"] = figure_6({name: logs[c] for name, c in STRATEGY_CASES.items()})
    return figures


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `drake-pregrasp reproduce`."""
    add_report_command(parser, reproduce, "reproduction", "cases")
    parser.add_argument(
        "--cases",
        type=names,
        default=list(SCENARIOS),
        metavar="a,b,...",
        help=f"cases to run; {','.join(SCENARIOS)} if not set",
    )
