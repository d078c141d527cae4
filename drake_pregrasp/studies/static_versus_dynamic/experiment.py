"""What a study is given to run: how a trial is made, and what its outcomes depend on."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from drake_pregrasp.studies.static_versus_dynamic.outcome import Outcome, TrialJob


class ReportFigure(NamedTuple):
    """A picture that the report shows.

    Attributes:
        title: Heading above it.
        path: Of the PNG.
        caption: What is seen, and how it was chosen.
    """

    title: str
    path: Path
    caption: str


class FigureMaker(Protocol):
    """Makes pictures of some trials."""

    def __call__(
        self,
        folder: Path,
        outcomes: Sequence[Outcome],
        *,
        processes: int | None = None,
        on_progress: Callable[[int, int], None] = lambda done, total: None,
    ) -> Sequence[ReportFigure]:
        """Makes them.

        Args:
            folder: Of the study.
            outcomes: All there are.
            processes: How many at a time; as many as there are processors if not set.
            on_progress: Called with the number of trials made for them and of those needed, which
                may become more.
        """


def no_figures(
    folder: Path,
    outcomes: Sequence[Outcome],
    *,
    processes: int | None = None,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[ReportFigure]:
    """Makes none."""
    return []


@dataclass(frozen=True)
class Experiment:
    """Trials of a study.

    Attributes:
        run_trial: Makes a trial, and returns an outcome for each closing time of its condition. It
            runs in another process, so it is a module's function, and draws on nothing but its job.
        settings: All that outcomes depend on but for their keys, as JSON can say it; outcomes
            of different settings are never mixed.
        make_figures: Makes pictures of some trials.
    """

    run_trial: Callable[[TrialJob], list[Outcome]]
    settings: Mapping[str, Any]
    make_figures: FigureMaker = no_figures
