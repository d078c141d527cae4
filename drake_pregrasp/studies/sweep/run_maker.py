"""Makes one run of a sweep, in whatever process or machine it is called."""

import copy
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.simulation.logged_run import LoggedRun
from drake_pregrasp.simulation.scenario_file import scenario_from_data
from drake_pregrasp.studies.error_words import in_words
from drake_pregrasp.studies.sweep.field_path import set_field
from drake_pregrasp.studies.sweep.measures import MEASURES, Ran
from drake_pregrasp.studies.sweep.package_digest import differences, package_digest
from drake_pregrasp.studies.sweep.plan import SEED_FIELD, SweepRun

# A run with a hand redirects the output of its process, and a cluster's worker may have threads.
_ONE_AT_A_TIME = threading.Lock()


@dataclass(frozen=True)
class RunMaker:
    """Simulates runs of a sweep and measures them; nothing is left behind.

    Attributes:
        scenario: What all runs start from, as `scenario_data` has it.
        source: Of the study, for messages.
        folder: Where relative paths in swept values start.
        measures: Names of the numbers to return.
        package: The package that the runs are to be made with.
        folders: Where files may be, beside `folder`.
    """

    scenario: Mapping[str, Any]
    source: str
    folder: Path
    measures: tuple[str, ...]
    package: Mapping[str, str]
    folders: tuple[str, ...] = ()

    def __call__(self, run: SweepRun) -> list[float] | str:
        """Returns the measures or, as not all errors get from process to process, the words."""
        try:
            with _ONE_AT_A_TIME:
                return self._measure(run)
        except Exception as error:
            return in_words(error)

    def _measure(self, run: SweepRun) -> list[float]:
        if differing := differences(package_digest(), dict(self.package)):
            raise InvalidArgumentError(f"this worker's package is another one: {differing}")
        data = copy.deepcopy(dict(self.scenario))
        for path, value in {**run.changes, SEED_FIELD: run.seed}.items():
            set_field(data, path, value, self.source)
        scenario = scenario_from_data(
            data, source=self.source, folder=self.folder, folders=self.folders
        )
        logged = LoggedRun(scenario)
        with TemporaryDirectory(prefix="drake_pregrasp_") as folder:
            logged.simulate(Path(folder))
            ran = Ran(scenario, logged)
            return [MEASURES[name].of(ran) for name in self.measures]
