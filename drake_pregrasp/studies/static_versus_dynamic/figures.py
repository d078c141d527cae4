"""The figures of the study's report: pictures and strip charts of one seed under the headline."""

from collections.abc import Callable, Sequence
from pathlib import Path

from drake_pregrasp.simulation.output import writing
from drake_pregrasp.studies.static_versus_dynamic.arms import ARMS
from drake_pregrasp.studies.static_versus_dynamic.closings import CLOSING_TIMES, strips_of
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.experiment import ReportFigure
from drake_pregrasp.studies.static_versus_dynamic.outcome import Outcome, TrialJob
from drake_pregrasp.studies.static_versus_dynamic.photograph import has_regions
from drake_pregrasp.studies.static_versus_dynamic.picture_figure import (
    CLOSED_AT,
    ROWS,
    make_pictures,
)
from drake_pregrasp.studies.static_versus_dynamic.representative import representative_seed
from drake_pregrasp.studies.static_versus_dynamic.scene import FINGERS
from drake_pregrasp.studies.static_versus_dynamic.strip_charts import FARTHEST_SHOWN_MM, plot_strips

STRIPS = "strips.png"
"""The file of the strip charts, in the study's folder."""

HEADLINE = "headline"
"""The condition that is shown."""

SEEDS_FOR_STRIPS = 5
"""From how many seeds on there are strip charts: they take as long as some fifty trials."""

_PICTURES_SAY = (
    "{rule} Red: the wall, which no fingertip is to touch. Rings: where usable fingers would touch"
    " if the hand closed now.{dots} A finger without a goal waits above the object."
)
_DOTS_SAY = (
    " Dots, in the colours of the fingertips: the safe regions of the arms that plan anew, here {}."
)
_STRIPS_SAY = (
    "The same seed, {seed}. For each arm, while the hand follows: how many fingers are usable; how"
    " far a fingertip at a goal of the arm's plan, in contact or standing off, is from the wall,"
    " with its inside shaded, up to {farthest:g} mm; and whether a grasp that closes then is clean,"
    " tried every {step:g} s."
)


def make_figures(
    folder: Path,
    outcomes: Sequence[Outcome],
    *,
    processes: int | None = None,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[ReportFigure]:
    """Makes the figures that there are outcomes for, and leaves them in the study's folder.

    Without the headline condition, or without a seed that all shown arms have, there are none; with
    few seeds there are pictures alone.

    Args:
        folder: Of the study.
        outcomes: All there are.
        processes: How many at a time; as many as there are processors if not set.
        on_progress: Called with the number of rows and strips made and of those to make; strips
            that are kept are not counted.

    Raises:
        OutputError: If a file can't be read or written.
    """
    closed = {o.job: o for o in outcomes if (o.condition, o.close_at) == (HEADLINE, CLOSED_AT)}
    rows = [arm for arm in ROWS if any(job.arm == arm for job in closed)]
    chosen = representative_seed(outcomes, HEADLINE, rows, CLOSED_AT)
    if chosen is None:
        return []
    label = CONDITIONS[HEADLINE].label.capitalize()
    shown = [TrialJob(HEADLINE, arm, chosen.seed) for arm in rows]
    figures = [
        ReportFigure(
            f"{label}: what the hand does",
            make_pictures(
                folder,
                {job: closed[job] for job in shown},
                processes=processes,
                on_progress=on_progress,
            ),
            _PICTURES_SAY.format(rule=chosen.in_words(CLOSED_AT), dots=_dots_say(rows)),
        )
    ]
    if chosen.seeds >= SEEDS_FOR_STRIPS:
        jobs = [TrialJob(HEADLINE, arm, chosen.seed) for arm in ARMS]
        strips = strips_of(
            folder,
            [job for job in jobs if job in closed],
            processes=processes,
            on_progress=lambda done, total: on_progress(len(shown) + done, len(shown) + total),
        )
        path = folder / STRIPS
        with writing(path):
            plot_strips(path, strips, num_fingers=FINGERS)
        step = CLOSING_TIMES[1] - CLOSING_TIMES[0]
        text = _STRIPS_SAY.format(seed=chosen.seed, step=step, farthest=FARTHEST_SHOWN_MM)
        figures.append(ReportFigure(f"{label}: when closing would be clean", path, text))
    return figures


def _dots_say(rows: Sequence[str]) -> str:
    dotted = [ARMS[arm].label for arm in rows if has_regions(arm)]
    return _DOTS_SAY.format(" and ".join(dotted)) if dotted else ""
