"""Runs of a study: the scenario of a job, its simulation, and its rows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.errors import InvalidArgumentError, NoGraspError, ScenarioError, one_line
from drake_pregrasp.geometry.shapes import Shape
from drake_pregrasp.simulation.hand_file import HandSource
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario, resolve_scenario
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import LoadedScenario, scenario_from_data
from drake_pregrasp.simulation.simulation_diagram import make_diagram, make_simulator
from drake_pregrasp.studies.grasps.fitting_objects import fits, opening
from drake_pregrasp.studies.grasps.goal_sources import GoalSource
from drake_pregrasp.studies.grasps.grasp_trial import GraspTrial
from drake_pregrasp.studies.measures import PLANNED_CONTACTS, SimulatedRun, measure
from drake_pregrasp.studies.study_axes import RANDOM_OBJECTS
from drake_pregrasp.studies.study_file import Study, check_at_ticks
from drake_pregrasp.systems.loggers import TickRecord

REFUSED = "refused"
"""Cause of a failure before the simulation, which the missing property may follow."""

UNFIT = "does not fit the hand"
"""Cause of a random object that is not grasped, and does not count."""


@dataclass(frozen=True)
class StudyRun:
    """Simulates and measures runs of a study, without leaving files.

    Attributes:
        study: The study.
        sources: Sources of goals by the names that methods use. They are passed on, because another
            process may not have registered them.
    """

    study: Study
    sources: Mapping[str, GoalSource]

    def __call__(self, job: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Returns the rows of a job: one for each closing time, or one."""
        scenario, hand = self._loaded(job)
        if hand is None:
            resolved = resolve_scenario(scenario, self.study.source)
            return [self._measured(simulated(resolved), job)]
        times, shape = self._times(scenario, job), None
        if self._has_random_object(job) and (shape := _fitting_shape(scenario, hand)) is None:
            return self._ungrasped(times, UNFIT, np.nan)
        try:
            resolved = resolve_scenario(scenario, self.study.source, hand=hand, shape=shape)
        except ScenarioError as error:
            lack = error.__cause__.lack if isinstance(error.__cause__, NoGraspError) else ""
            cause = f"{REFUSED}: {lack}" if lack else REFUSED
            return self._ungrasped(times, cause, False, one_line(error))
        trial = GraspTrial(resolved, self._source(job))
        return [
            self._measured(SimulatedRun(resolved, trial.ticks, outcome), job)
            for outcome in trial.outcomes(times)
        ]

    def resolved(self, job: Mapping[str, Any]) -> ResolvedScenario:
        """Returns the scenario of a job with everything that it needs to be simulated.

        Raises:
            ScenarioError: If the scenario cannot be simulated.
        """
        scenario, hand = self._loaded(job)
        return resolve_scenario(scenario, self.study.source, hand=hand)

    def trial(self, job: Mapping[str, Any]) -> GraspTrial:
        """Returns the trial of a job with a hand, before its simulation.

        Raises:
            ScenarioError: If the scenario cannot be simulated.
        """
        return GraspTrial(self.resolved(job), self._source(job))

    def _source(self, job: Mapping[str, Any]) -> GoalSource | None:
        goals = self.study.method_of(job).goals
        return self.sources[goals] if goals else None

    def _loaded(self, job: Mapping[str, Any]) -> LoadedScenario:
        study = self.study
        return scenario_from_data(
            study.scenario_of(job),
            source=study.source,
            folder=study.folder,
            folders=study.folders,
        )

    def _has_random_object(self, job: Mapping[str, Any]) -> bool:
        axes = self.study.random[job.get("condition", "")]
        return any(axis.kind == RANDOM_OBJECTS for axis in axes)

    def _times(self, scenario: Scenario, job: Mapping[str, Any]) -> list[float]:
        if not (times := self.study.closing_times(job)):
            return [scenario.grasp.close_at]
        check_at_ticks(times, scenario.planner.period, self.study.source, "closing_times")
        return times

    def _measured(self, run: SimulatedRun, job: Mapping[str, Any]) -> dict[str, Any]:
        """Returns the measures of a run; nan for contacts that its hand does not follow."""
        found = measure(run, self.study.config.measures)
        if not self.study.method_of(job).goals:
            return found
        return found | dict.fromkeys(PLANNED_CONTACTS & found.keys(), np.nan)

    def _ungrasped(
        self, times: Sequence[float], cause: str, held: float, why: str = ""
    ) -> list[dict[str, Any]]:
        """Returns the rows of a run that was not simulated."""
        row = dict.fromkeys(self.study.config.measures, np.nan)
        row |= {name: held for name in ("held", "clean") if name in row}
        reasons = {"cause": cause, "gave_up": why}
        return [{"close_at": time} | reasons | row for time in times]


def _fitting_shape(scenario: Scenario, hand: HandSource) -> Shape | None:
    """Returns the shape of an object; None if it does not fit the hand, or cannot be made."""
    try:
        shape = scenario.object.make_shape()
    except InvalidArgumentError:
        return None
    made = HandModel(hand.description, model=hand.model)
    return shape if fits(shape, opening(made, scenario.grasp.standoff)) else None


def simulated(resolved: ResolvedScenario) -> SimulatedRun:
    """Simulates a scenario without a hand."""
    ticks: list[TickRecord] = []
    simulator = make_simulator(make_diagram(resolved, sink=ticks.append), resolved.scenario)
    simulator.AdvanceTo(resolved.scenario.simulation_duration)
    return SimulatedRun(resolved, ticks, None)
