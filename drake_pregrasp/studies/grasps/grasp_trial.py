"""One simulated trial: the diagram of a run with the goals of a method, and its grasps."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from pydrake.systems.framework import Context

from drake_pregrasp.arrays import TIME_ROUNDING
from drake_pregrasp.grasping.catch_limits import CatchLimit
from drake_pregrasp.grasping.grasp_state import GraspPhase, GraspState
from drake_pregrasp.grasping.held_criterion import SHAKE_END
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.simulation.simulation_diagram import make_diagram, make_simulator
from drake_pregrasp.studies.grasps.baseline_goals import StationaryHand
from drake_pregrasp.studies.grasps.goal_sources import GoalSource
from drake_pregrasp.studies.grasps.grasp_outcome import Outcome, Status, grasp_outcome
from drake_pregrasp.systems.loggers import GraspRecord, TickRecord

_CLOSE_DELAY = 3  # Control ticks between a stationary hand's jump to the object and the closing.
_LONGEST_GRASP = 8.0
"""Seconds after the command until a grasp without a lift has failed.

A wait for an object that the hand can meet does not count."""

_LONGEST_WAIT = 3.0  # Seconds without a possible meeting after which the hand waits no more.


class GraspTrial:
    """A trial whose simulation can be advanced step by step.

    Its diagram is that of a run, but for the source of the hand's goals. A held object is shaken.

    Args:
        resolved: Scenario with a hand.
        source: Source of the hand's goals; None for the planner.

    Attributes:
        resolved: The scenario.
        diagram: Simulated diagram.
        goals: System that emits the hand's `fingertip_targets` and `contact_status`.
        context: Context of the diagram.
        ticks: Records of all planning ticks so far.
        records: Records of all control ticks so far.
        statuses: Status of the fingers at the planner's ticks of the tracking run so far.
    """

    def __init__(self, resolved: ResolvedScenario, source: GoalSource | None = None) -> None:
        if source is not None:  # It chooses contacts for all fingers.
            everywhere = np.ones(resolved.num_contacts, dtype=bool)
            resolved = replace(resolved, start=replace(resolved.start, has_contact=everywhere))
        scenario = resolved.scenario
        grasp = replace(scenario.grasp, shake=True)
        resolved = replace(resolved, scenario=replace(scenario, grasp=grasp))
        self.resolved = resolved
        self._period = resolved.planner.period
        self.ticks: list[TickRecord] = []
        self.records: list[GraspRecord] = []
        self.statuses: list[Status] = []
        goals = None if source is None else source(resolved)
        self.diagram = make_diagram(
            resolved,
            sink=self.ticks.append,
            grasp_sink=self.records.append,
            goals=goals,
        )
        self.goals = goals or self.diagram.GetSubsystemByName("pregrasp_planner")
        self._simulator = make_simulator(self.diagram, scenario)
        self.context = self._simulator.get_mutable_context()
        self.command(self.context, np.inf)

    def command(self, context: Context, time: float) -> None:
        """Commands the hand to close from a time in seconds on.

        A stationary hand first moves its goals from the ring to the object.
        """
        command = self.diagram.GetSubsystemByName("close_command")
        delay = 0.0
        if isinstance(self.goals, StationaryHand):
            self.goals.set_time(self.goals.GetMyMutableContextFromRoot(context), time)
            delay = _CLOSE_DELAY * self.resolved.scenario.grasp.period
        command.set_time(command.GetMyMutableContextFromRoot(context), time + delay)

    def outcomes(self, closing_times: Sequence[float]) -> Iterator[Outcome]:
        """Tracks the object, grasps it at each closing time, and yields the outcome of each grasp.

        While an outcome is yielded, `ticks` and `records` are those of its grasp.

        Args:
            closing_times: Times in seconds, in ascending order, at ticks of the planner.
        """
        for close_at in closing_times:
            self.track(close_at)
            saved, ticks, records = self.context.Clone(), len(self.ticks), len(self.records)
            state = self.grasp(close_at)
            yield grasp_outcome(self.resolved, close_at, self.records, self.statuses, state)
            if close_at != closing_times[-1]:
                self.context.SetTimeStateAndParametersFrom(saved)
                self._simulator.Initialize()
                del self.ticks[ticks:], self.records[records:]

    def track(self, until: float) -> None:
        """Tracks the object until a time in seconds, which is a tick of the planner."""
        while self.context.get_time() < until - TIME_ROUNDING:
            self._advance()
            self.statuses.append(self._status())

    def grasp(self, close_at: float) -> GraspState:
        """Closes the hand, simulates until the end of the shake or a failure, returns the state."""
        self.command(self.context, close_at)
        phase, lasted, begun = GraspPhase.TRACK, 0.0, close_at
        while phase != GraspPhase.BACK_OFF and lasted < SHAKE_END - TIME_ROUNDING:
            self._advance()
            record = self.records[-1]
            phase, since, *_ = record.report
            lasted = record.time - since if phase == GraspPhase.HOLD else 0.0
            if phase == GraspPhase.APPROACH:
                limit = record.catch_certificate[0]  # NaN without meetings.
                if limit == CatchLimit.NONE:
                    begun = record.time
                if limit > CatchLimit.NONE and record.time >= begun + _LONGEST_WAIT:
                    break
            if phase < GraspPhase.LIFT and record.time >= begun + _LONGEST_GRASP:
                break
        controller = self.diagram.GetSubsystemByName("hand_controller")
        sequencer = controller.GetSubsystemByName("grasp_sequencer")
        state: GraspState = sequencer.state(sequencer.GetMyContextFromRoot(self.context))
        return state

    def _advance(self) -> None:
        """Advances to the exact time of the next planning tick, so that the planner runs once."""
        tick = round(self.context.get_time() / self._period) + 1
        self._simulator.AdvanceTo(tick * self._period)

    def _status(self) -> Status:
        context = self.goals.GetMyContextFromRoot(self.context)
        status = np.asarray(self.goals.GetOutputPort("contact_status").Eval(context))
        return tuple(status.astype(int).tolist())
