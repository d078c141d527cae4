"""The picture grid of the headline condition: what the hand does under some of the arms."""

import itertools
import textwrap
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from matplotlib.image import imsave

from drake_pregrasp.simulation.output import without_solver_chatter, writing
from drake_pregrasp.studies.processes import in_processes
from drake_pregrasp.studies.static_versus_dynamic.arms import ARMS
from drake_pregrasp.studies.static_versus_dynamic.outcome import (
    LEVEL_BELOW_DEG,
    MAX_PUSHED_MM,
    MAX_SLIP_MM,
    MAX_TURNED_DEG,
    Outcome,
    TrialJob,
)
from drake_pregrasp.studies.static_versus_dynamic.photograph import photograph
from drake_pregrasp.studies.static_versus_dynamic.picture_grid import plot_picture_grid
from drake_pregrasp.studies.static_versus_dynamic.scene import FINGERS
from drake_pregrasp.studies.static_versus_dynamic.trial import Trial

PICTURES = "pictures.png"
"""The file of the grid, in the study's folder."""

ROWS = ("frozen", "still", "dynamic_reach")
"""The arms that have a row."""

CLOSED_AT = 8.0
"""When the hand is told to close, in seconds: the last of the moments before it."""

MOMENTS = (0.5, 4.0, CLOSED_AT)
"""When pictures are taken before the grasp, in seconds, at ticks of the planner."""

_CHARACTERS_A_LINE = 34  # That fit below a picture.


class _Sitting(NamedTuple):
    """A trial to take pictures of, and their files: for each moment, and for the grasp's end."""

    trial: TrialJob
    moments: tuple[float, ...]
    files: tuple[Path, ...]


def make_pictures(
    folder: Path,
    outcomes: Mapping[TrialJob, Outcome],
    *,
    moments: tuple[float, ...] = MOMENTS,
    processes: int | None = None,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> Path:
    """Makes the grid, a row for each trial, each in a process of its own.

    Args:
        folder: Where it goes.
        outcomes: For each trial that is shown, that of the grasp closed at the last moment.
        moments: When pictures are taken before the grasp, in seconds, at ticks of the planner.
        processes: How many at a time; as many as there are processors if not set.
        on_progress: Called with the number of rows done and of all.

    Returns:
        Its path.

    Raises:
        OutputError: If it can't be written.
    """
    with TemporaryDirectory() as temporary:
        sittings = [
            _Sitting(
                job,
                moments,
                tuple(Path(temporary) / f"{job.arm}_{k}.png" for k in range(len(moments) + 1)),
            )
            for job in outcomes
        ]
        done = itertools.count(1)
        on_progress(0, len(sittings))
        usable = in_processes(
            _take,
            sittings,
            processes=processes,
            on_done=lambda: on_progress(next(done), len(sittings)),
        )
        captions = [
            [*(f"{k} of {FINGERS} fingers usable" for k in of_row), _wrapped(in_few_words(outcome))]
            for of_row, outcome in zip(usable, outcomes.values(), strict=True)
        ]
        path = folder / PICTURES
        with writing(path):
            plot_picture_grid(
                path,
                [sitting.files for sitting in sittings],
                rows=[ARMS[job.arm].label for job in outcomes],
                columns=[
                    *(f"t = {moment:g} s" for moment in moments),
                    f"end of grasp closed at {moments[-1]:g} s",
                ],
                captions=captions,
            )
    return path


def _take(sitting: _Sitting) -> Sequence[int]:
    """Takes the pictures of a trial; returns how many fingers are usable in those before the end.

    It runs in another process, so it is a module's function.
    """
    *before, end = sitting.files
    usable = []
    with without_solver_chatter():
        trial = Trial(sitting.trial)
        for moment, file in zip(sitting.moments, before, strict=True):
            trial.track(moment)
            imsave(file, photograph(trial, marks=True))
            usable.append(trial.looks[-1].usable)
        trial.grasp(sitting.moments[-1])
        imsave(end, photograph(trial, marks=False))
    return usable


def _wrapped(words: str) -> str:
    return textwrap.fill(words, _CHARACTERS_A_LINE)


def in_few_words(outcome: Outcome) -> str:
    """Returns what became of a grasp, in words that fit below a picture."""
    if outcome.clean:
        return f"clean grasp with {outcome.fingers} fingers"
    if outcome.gave_up:
        return f"gave up: {outcome.gave_up}"
    if not outcome.lifted:
        return "not lifted"
    for is_why, why in (
        (outcome.pushed_before_mm >= MAX_PUSHED_MM, f"pushed {outcome.pushed_before_mm:.0f} mm"),
        (outcome.turned_before_deg >= MAX_TURNED_DEG, f"turned {outcome.turned_before_deg:.0f}°"),
        (
            outcome.pushed_closing_mm >= MAX_PUSHED_MM,
            f"pushed {outcome.pushed_closing_mm:.0f} mm in closing",
        ),
        (outcome.tilt_deg >= LEVEL_BELOW_DEG, f"tilted {outcome.tilt_deg:.0f}°"),
        (outcome.slip_mm >= MAX_SLIP_MM, f"slipped {outcome.slip_mm:.0f} mm"),
    ):
        if is_why:
            return f"lifted, but {why}"
    return "lifted, but not clean"
