"""The study's report: one HTML page with everything inside."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from drake_pregrasp.simulation.output import write_text, writing
from drake_pregrasp.studies import markup
from drake_pregrasp.studies.report_style import STYLE
from drake_pregrasp.studies.settings_file import digest
from drake_pregrasp.studies.static_versus_dynamic.arms import ARMS
from drake_pregrasp.studies.static_versus_dynamic.clean_figure import plot_clean_shares
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.experiment import ReportFigure
from drake_pregrasp.studies.static_versus_dynamic.goals import judge_goals
from drake_pregrasp.studies.static_versus_dynamic.no_worse import no_worse_in_words
from drake_pregrasp.studies.static_versus_dynamic.outcome import (
    CLEAN_IN_WORDS,
    Outcome,
    TrialJob,
)
from drake_pregrasp.studies.static_versus_dynamic.outcome_table import outcome_table, surrenders
from drake_pregrasp.studies.static_versus_dynamic.report_tables import (
    goal_table,
    overview_table,
    paired_table,
    ranking_table,
)
from drake_pregrasp.studies.static_versus_dynamic.results import Results
from drake_pregrasp.studies.static_versus_dynamic.share_interval import CONFIDENCE
from drake_pregrasp.studies.static_versus_dynamic.verdicts import Verdict, judge
from drake_pregrasp.studies.static_versus_dynamic.words import (
    comparisons_in_words,
    condition_in_words,
    overview,
)

REPORT = "report.html"
"""The page."""

_TITLE = "Static or dynamic contacts: which hand grasps better?"
_CAVEATS = (
    "All of this is simulated: rigid bodies, point contact, one friction, and a hand without"
    " gravity. It says nothing on real hands that the simulation does not hold.",
    "There is one object, a cube, and one hand. Speeds, sizes and bounds were chosen by those who"
    " made the planner.",
    "Closing times of one trial follow from the same tracking, so they are not independent: a test"
    " is of one time, and an interval holds for one time. Holm's correction allows for that.",
    "Pairs are trials with the same seed: the same start, misplacement and noise.",
)


def write_report(
    path: Path,
    outcomes: Sequence[Outcome],
    settings: Mapping[str, Any],
    *,
    failures: Mapping[TrialJob, str],
    figures: Sequence[ReportFigure] = (),
) -> None:
    """Writes the page. All that it says is computed from the outcomes.

    Args:
        path: Of the page.
        outcomes: All there are.
        settings: That they were made with.
        failures: Trials that have none, and why.
        figures: Pictures to show after the summary.

    Raises:
        OutputError: If it can't be written, or a picture can't be read.
    """
    results = Results(outcomes)
    verdicts = judge(results)
    parts = [
        markup.heading(_TITLE, 1),
        *_summary(results, verdicts, failures),
        *(_shares(path, results) if results.conditions else []),
        *(part for f in figures for part in _shown(f)),
        markup.heading("Goals", 2),
        goal_table(judge_goals(results)),
        *(part for verdict in verdicts for part in _condition(results, verdict)),
        markup.heading("Do measures of the contacts predict success?", 2),
        ranking_table(results),
        markup.heading("What to keep in mind", 2),
        markup.bullets([comparisons_in_words(verdicts), *_CAVEATS]),
        markup.heading("What is compared", 2),
        markup.bullets(f"{arm.label}: {arm.text}." for arm in ARMS.values()),
        markup.details(f"Settings, {digest(settings)}", json.dumps(settings, indent=1)),
    ]
    if failures:
        lines = [f"{job}: {why}" for job, why in sorted(failures.items())]
        parts.append(markup.details(f"Failed trials, {len(failures)}", "\n".join(lines)))
    write_text(path, markup.page(_TITLE, STYLE, parts))


def _summary(
    results: Results, verdicts: Sequence[Verdict], failures: Mapping[TrialJob, str]
) -> list[str]:
    trials = len({outcome.job for outcome in results.outcomes})
    lead = (
        f"{trials} trials, {len(results.outcomes)} grasps. {CLEAN_IN_WORDS} Arms are"
        " compared by trials with the same seed, and each p is corrected for the"
        " number of all tests (Holm)."
    )
    parts = [markup.paragraph(lead, "lead")]
    if failures:
        parts.append(
            markup.paragraph(
                f"{len(failures)} trials ended with an error and are left out; what is below is"
                " about the others.",
                "behind",
            )
        )
    if not verdicts:
        return [*parts, markup.paragraph("There are no outcomes yet.")]
    parts += [
        markup.heading("Summary", 2),
        markup.bullets([*overview(verdicts), *no_worse_in_words(results)]),
        overview_table(verdicts),
        '<div class="cards">',
    ]
    num_tests = sum(len(of_arm) for v in verdicts for of_arm in v.against.values())
    for verdict in verdicts:
        parts += [
            '<div class="card">',
            markup.heading(CONDITIONS[verdict.condition].label, 3),
            markup.paragraph(f"{CONDITIONS[verdict.condition].text.capitalize()}.", "muted"),
            markup.bullets(condition_in_words(results, verdict, num_tests)),
            "</div>",
        ]
    return [*parts, "</div>"]


def _shares(path: Path, results: Results) -> list[str]:
    with TemporaryDirectory() as folder, writing(path):
        picture = Path(folder) / "clean_shares.png"
        plot_clean_shares(picture, results)
        caption = (
            f"Share of clean grasps, with exact {100 * CONFIDENCE:.0f} % intervals (Clopper and"
            " Pearson), at each closing time."
        )
        return [markup.heading("Clean grasps", 2), markup.figure(picture, caption)]


def _shown(figure: ReportFigure) -> list[str]:
    return [markup.heading(figure.title, 2), markup.figure(figure.path, figure.caption)]


def _condition(results: Results, verdict: Verdict) -> list[str]:
    condition = CONDITIONS[verdict.condition]
    parts = [
        markup.heading(f"Condition: {condition.label}", 2, verdict.condition),
        markup.paragraph(f"{condition.text.capitalize()}."),
        outcome_table(results, verdict.condition),
    ]
    if why := surrenders(results, verdict.condition):
        parts += [markup.paragraph("Why hands gave up, and how often:"), markup.bullets(why)]
    if verdict.against:
        parts.append(paired_table(results, verdict))
    return parts
