"""One simulated trial: the diagram of a run with the goals of a method, and its grasps."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, System

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.selection_input import is_active
from drake_pregrasp.diagrams.grasping_hand import GoalInputs, GoalSource
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.hand_station import TABLE
from drake_pregrasp.diagrams.pregrasp_planner import PregraspPlanner
from drake_pregrasp.diagrams.start_grasp import hand_planner
from drake_pregrasp.diagrams.wiring import connect
from drake_pregrasp.grasping.grasp_state import GraspPhase, GraspState, state_unpacker
from drake_pregrasp.regions.constraints import Obstacles
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.studies.static_versus_dynamic import (
    baseline_goals,
    conditions,
    failure_cause,
    grasp_outcome,
    methods,
)
from drake_pregrasp.studies.static_versus_dynamic.grasp_outcome import GoalSample, Outcome, TrialJob
from drake_pregrasp.systems.loggers import GraspRecord
from drake_pregrasp.systems.palm_frames import reach_frame

# Modules of this folder on which the rows of the study depend.
_OTHERS = (conditions, failure_cause, grasp_outcome, methods, baseline_goals)
MODULES = (__name__, *(module.__name__ for module in _OTHERS))

_START_TICKS = 60  # Planning ticks within which the contacts of a fixed plan converge.
_FOREVER = 1e6  # Static duration of the methods that plan at most once, in seconds.
_CLOSE_DELAY = 3  # Control ticks between a stationary hand's jump to the object and the closing.
_HOLD = 1.0  # Seconds of holding before the outcome is measured.
_LONGEST_GRASP = 8.0  # Seconds after the command until a grasp counts as failed.
_NAME = "goal_source"


def make_trial(job: TrialJob) -> "Trial":
    """Returns the trial of a job of the study."""
    resolved = conditions.CONDITIONS[job.condition].scenario
    start = conditions.random_start(resolved, seed=job.seed)
    return Trial(start.resolved, methods.METHODS[job.method], start.misplacement)


def run_trial(job: TrialJob) -> list[dict[str, Any]]:
    """Simulates a trial, and returns a row for each closing time of its condition."""
    outcomes = make_trial(job).outcomes(conditions.CONDITIONS[job.condition].closing_times)
    return [asdict(outcome) | {"clean": outcome.clean} for outcome in outcomes]


def resolved_for(resolved: ResolvedScenario, method: methods.Method) -> ResolvedScenario:
    """Returns a scenario with the planner and the initial contacts of a method."""
    planned = _with_planner(resolved, method)
    p_OC = resolved.start.p_OC
    if method.plans_start:
        p_OC = _planned_start(resolved)
    elif method.is_stationary:
        hand, surface, R_WO = _hand(resolved), resolved.surface, resolved.X_WO.rotation().matrix()
        rays = methods.rays_at(hand.azimuths + resolved.start.yaw)
        p_OC = surface.project(surface.p_OCoM + rays @ R_WO)[0]
    return replace(planned, start=replace(resolved.start, p_OC=p_OC))


def _with_planner(resolved: ResolvedScenario, method: methods.Method) -> ResolvedScenario:
    """Returns a scenario with the planner's settings for a method."""
    scenario, hand = resolved.scenario, _hand(resolved)
    grasp = replace(scenario.grasp, use_reach=method.uses_reach)
    config = hand_planner(scenario.planner, grasp, hand.description)
    limits = replace(config.limits, recover=method.replans)
    duration = 0.0 if method.replans else _FOREVER
    config = replace(config, limits=limits, static_duration=duration)
    return replace(resolved, planner=config)


def _hand(resolved: ResolvedScenario) -> HandModel:
    assert resolved.hand is not None
    return resolved.hand


def _planned_start(resolved: ResolvedScenario) -> FloatArray:
    """Returns the contacts to which the planner converges at the start, in O, shape (n, 3).

    The planner respects the reach of the fingers and the obstacles at the start.
    """
    hand, start, X_WO = _hand(resolved), resolved.start, resolved.X_WO
    config = _with_planner(resolved, methods.METHODS[methods.TESTED]).planner
    planner = PregraspPlanner(config, resolved.surface, start.p_OC)
    solids = [moving.solid for moving in [*conditions.area(resolved.scenario), TABLE]]
    p_WCoM, yaw_range = X_WO @ resolved.surface.p_OCoM, resolved.scenario.grasp.yaw_range
    X_WH = reach_frame(p_WCoM, start.yaw, yaw_range, hand.X_LA)
    values = {"X_WO_measured": X_WO, "X_WH": X_WH, "obstacles": Obstacles(tuple(solids))}
    simulator = Simulator(planner)
    context = simulator.get_mutable_context()
    for name, value in values.items():
        planner.GetInputPort(name).FixValue(context, value)
    simulator.AdvanceTo(_START_TICKS * config.period)
    p_WC = planner.GetOutputPort("p_WC").Eval(context).reshape(-1, 3)
    return np.array((X_WO.inverse() @ p_WC.T).T)


def goal_source(resolved: ResolvedScenario, method: methods.Method) -> GoalSource | None:
    """Returns the source of a method's goals in a diagram; None for the planner."""
    hand, limits, period = _hand(resolved), resolved.planner.limits, resolved.planner.period
    frames, azimuths = hand.kinematics.tip_frames, hand.azimuths

    def stationary(builder: DiagramBuilder, inputs: GoalInputs) -> System:
        turned, target = azimuths + resolved.start.yaw, _target(resolved)
        goals = baseline_goals.StationaryHand(frames, azimuths=turned, target=target, limits=limits)
        builder.AddNamedSystem(_NAME, goals)
        connect(builder, inputs.planner, "X_WO_estimated", goals)
        connect(builder, inputs.weights, "contact_weights", goals)
        connect(builder, inputs.obstacles, "obstacles", goals)
        return goals

    def reassigned(builder: DiagramBuilder, inputs: GoalInputs) -> System:
        goals = methods.Reassignment(frames, azimuths=azimuths, period=period)
        builder.AddNamedSystem(_NAME, goals)
        connect(builder, inputs.planner, "fingertip_targets contact_status", goals)
        connect(builder, inputs.weights, "contact_weights", goals)
        connect(builder, inputs.controller, "X_WH", goals)
        return goals

    def reactive(builder: DiagramBuilder, inputs: GoalInputs) -> System:
        goals = baseline_goals.ReactiveChoice(
            frames, target=_target(resolved), limits=limits, period=period
        )
        builder.AddNamedSystem(_NAME, goals)
        connect(builder, inputs.planner, "X_WO_estimated", goals)
        connect(builder, inputs.weights, "contact_weights", goals)
        connect(builder, inputs.obstacles, "obstacles", goals)
        connect(builder, inputs.controller, "p_WT", goals)
        return goals

    if method.is_stationary:
        return stationary
    if method.is_reassigned:
        return reassigned
    return reactive if method.is_reactive else None


def _target(resolved: ResolvedScenario) -> baseline_goals.RayTarget:
    """Returns the object, with rays at the height of its centre of mass over the table."""
    limits, p_OV = resolved.planner.limits, np.asarray(resolved.shape.mesh.vertices)
    p_OA = resolved.surface.p_OCoM.copy()
    lowest = float(np.min(p_OV[:, 2])) + max(limits.tip_radii) + limits.clearance
    p_OA[2] = max(p_OA[2], lowest)
    return baseline_goals.RayTarget(resolved.shape.solid, p_OV, p_OA)


class Trial:
    """A trial whose simulation can be advanced step by step.

    Its diagram is that of a run, but for the source of the hand's goals.

    Args:
        resolved: Scenario with object, motion, sensor noise, hand, obstacles and start contacts.
        method: Method that chooses the contacts.
        misplacement: Offset of the object on the table, shape (3,): x and y in metres, angle about
            z in radians.

    Attributes:
        resolved: Scenario with the planner and the initial contacts of the method.
        method: Method of the trial.
        surface: Surface of the object.
        hand: Model of the hand.
        diagram: Simulated diagram.
        station: Plant with the object and the hand.
        planner: Planner, whose pose estimate the hand uses.
        goals: System that emits the hand's `fingertip_targets` and `contact_status`.
        context: Context of the diagram.
        records: Records of all control ticks so far.
        samples: Goals at the planner's ticks of the tracking run so far.
    """

    def __init__(
        self, resolved: ResolvedScenario, method: methods.Method, misplacement: FloatArray
    ) -> None:
        self.resolved, self.method = resolved_for(resolved, method), method
        self.surface, self.hand = resolved.surface, _hand(resolved)
        self._period = self.resolved.planner.period
        self.records: list[GraspRecord] = []
        self.samples: list[GoalSample] = []
        goals = goal_source(self.resolved, method)
        self.diagram = make_diagram(self.resolved, grasp_sink=self.records.append, goals=goals)
        find = self.diagram.GetSubsystemByName
        self.station, self.planner = find("object_plant"), find("pregrasp_planner")
        self.goals = self.planner if goals is None else find(_NAME)
        self._simulator = Simulator(self.diagram)
        self.context = self._simulator.get_mutable_context()
        self.command(self.context, np.inf)
        self._misplace_object(misplacement)

    def command(self, context: Context, time: float) -> None:
        """Commands the hand to close from a time in seconds on.

        A stationary hand first moves its goals from the ring to the object.
        """
        command = self.diagram.GetSubsystemByName("close_command")
        delay = 0.0
        if self.method.is_stationary:
            self.goals.set_time(self.goals.GetMyMutableContextFromRoot(context), time)
            delay = _CLOSE_DELAY * self.resolved.scenario.grasp.period
        command.set_time(command.GetMyMutableContextFromRoot(context), time + delay)

    def outcomes(self, closing_times: Sequence[float]) -> list[Outcome]:
        """Tracks the object, and grasps it at each closing time.

        Args:
            closing_times: Times in seconds, in ascending order, at ticks of the planner.
        """
        outcomes, radii = [], self.hand.tip_radii
        for close_at in closing_times:
            self.track(close_at)
            saved, tracked = self.context.Clone(), len(self.records)
            state = self.grasp(close_at)
            outcomes.append(
                grasp_outcome.grasp_outcome(
                    self.resolved.scenario, close_at, self.records, self.samples, state, radii
                )
            )
            self.context.SetTimeStateAndParametersFrom(saved)
            self._simulator.Initialize()
            del self.records[tracked:]
        return outcomes

    def track(self, until: float) -> None:
        """Tracks the object until a time in seconds, which is a tick of the planner."""
        while self.context.get_time() < until - 1e-9:
            self._advance()
            self.samples.append(self._sample())

    def grasp(self, close_at: float) -> GraspState:
        """Closes the hand, simulates until the hold or a failure, and returns the state."""
        self.command(self.context, close_at)
        while self.context.get_time() < close_at + _LONGEST_GRASP:
            self._advance()
            phase, since, *_ = self.records[-1].report
            held = self.context.get_time() - since
            if phase == GraspPhase.BACK_OFF or (phase == GraspPhase.HOLD and held >= _HOLD):
                break
        controller = self.diagram.GetSubsystemByName("hand_controller")
        sequencer = controller.GetSubsystemByName("grasp_sequencer")
        context = sequencer.GetMyContextFromRoot(self.context)
        unpack = state_unpacker(len(self.hand.tip_radii))
        return unpack(context.get_discrete_state(0).value())

    def _advance(self) -> None:
        """Advances to the exact time of the next planning tick, so that the planner runs once."""
        tick = round(self.context.get_time() / self._period) + 1
        self._simulator.AdvanceTo(tick * self._period)

    def _misplace_object(self, misplacement: FloatArray) -> None:
        plant = self.station.plant
        context = plant.GetMyMutableContextFromRoot(self.context)
        body = plant.GetBodyByName("object")
        X_WO = plant.GetFreeBodyPose(context, body)
        x, y, angle = misplacement
        R_WO = RotationMatrix.MakeZRotation(angle) @ X_WO.rotation()
        plant.SetFreeBodyPose(
            context, body, RigidTransform(R_WO, X_WO.translation() + np.array([x, y, 0.0]))
        )

    def _sample(self) -> GoalSample:
        context = self.goals.GetMyContextFromRoot(self.context)
        status = np.asarray(self.goals.GetOutputPort("contact_status").Eval(context))
        targets = self.goals.GetOutputPort("fingertip_targets").Eval(context)
        active, scenario = is_active(status), self.resolved.scenario
        distance, solids = np.inf, conditions.area_at(scenario, self.context.get_time())
        for finger in np.flatnonzero(active):
            X_WC: RigidTransform = targets.Find(self.hand.kinematics.tip_frames[finger])
            radius = self.hand.tip_radii[finger]
            out = -X_WC.rotation().matrix()[:, 2]
            away = np.array([[radius], [radius + scenario.grasp.standoff]])
            tips = X_WC.translation() + away * out
            distance = min([distance, *(float(np.min(s.distance(tips))) - radius for s in solids)])
        return GoalSample(tuple(status.astype(int).tolist()), distance)
