"""One simulated trial: the diagram of a method, its tracking run, and its grasps."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import partial
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, System
from pydrake.systems.primitives import DiscreteTimeDelay

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.planner_config import PlannerConfig
from drake_pregrasp.contacts.selection_input import is_active
from drake_pregrasp.diagrams.expected_path import initial_pose
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.hand_station import TABLE, add_simulated_hand
from drake_pregrasp.diagrams.pregrasp_planner import AddPregraspPlanner, PregraspPlanner
from drake_pregrasp.diagrams.wiring import connect
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.grasping.grasp_state import GraspPhase, GraspState, state_unpacker
from drake_pregrasp.regions.constraints import Obstacles
from drake_pregrasp.simulation.scenario import Scenario, hand_planner
from drake_pregrasp.studies.static_versus_dynamic import (
    baseline_goals,
    conditions,
    failure_cause,
    grasp_outcome,
    methods,
)
from drake_pregrasp.studies.static_versus_dynamic.grasp_outcome import GoalSample, Outcome, TrialJob
from drake_pregrasp.systems.loggers import GraspLogger, GraspRecord
from drake_pregrasp.systems.palm_frames import reach_frame
from drake_pregrasp.systems.pose_sensor import NoiseSource, NoisyPoseSensor
from drake_pregrasp.systems.sources import ContactWeights, MovingObstacles

# Modules of this folder on which the rows of the study depend.
_OTHERS = (conditions, failure_cause, grasp_outcome, methods, baseline_goals)
MODULES = (__name__, *(module.__name__ for module in _OTHERS))

_START_TICKS = 60  # Planning ticks within which the contacts of a fixed plan converge.
_FOREVER = 1e6  # Static duration of the methods that plan at most once, in seconds.
_CLOSE_DELAY = 3  # Control ticks between the goals' jump to the object and the closing.
_HOLD = 1.0  # Seconds of holding before the outcome is measured.
_LONGEST_GRASP = 8.0  # Seconds after the command until a grasp counts as failed.


StartOf = Callable[[Scenario, ObjectSurface, HandModel], conditions.Start]
"""Function that returns the start of a trial."""


def make_trial(job: TrialJob) -> "Trial":
    """Returns the trial of a job of the study."""
    start_of = partial(conditions.random_start, seed=job.seed)
    scenario = conditions.CONDITIONS[job.condition].scenario
    return Trial(scenario, methods.METHODS[job.method], start_of)


def run_trial(job: TrialJob) -> list[dict[str, Any]]:
    """Simulates a trial, and returns a row for each closing time of its condition."""
    outcomes = make_trial(job).outcomes(conditions.CONDITIONS[job.condition].closing_times)
    return [asdict(outcome) | {"clean": outcome.clean} for outcome in outcomes]


class Trial:
    """A trial whose simulation can be advanced step by step.

    Args:
        scenario: Scenario with object, motion, sensor noise, hand and obstacles.
        method: Method that chooses the contacts.
        start_of: Function that returns the start for the scenario, its surface and its hand.

    Attributes:
        scenario: Scenario of the trial.
        method: Method of the trial.
        surface: Surface of the object.
        hand: Model of the hand.
        diagram: Simulated diagram, with the input port `close`.
        station: Plant with the object and the hand.
        planner: Planner, whose pose estimate the hand uses.
        goals: System that emits the hand's `fingertip_targets` and `contact_status`.
        context: Context of the diagram.
        records: Records of all control ticks so far.
        samples: Goals at the planner's ticks of the tracking run so far.
    """

    def __init__(self, scenario: Scenario, method: methods.Method, start_of: StartOf) -> None:
        self.scenario, self.method = scenario, method
        self._grasp = scenario.grasp
        self.surface = scenario.make_surface()
        self.hand = scenario.load_hand_model(self._grasp.yaw_range)
        self._start = start_of(scenario, self.surface, self.hand)
        self._X_WO = initial_pose(scenario.motion, scenario.object)
        self._config = self._planner_config(self.method)
        self._period = self._config.period
        self.records: list[GraspRecord] = []
        self.samples: list[GoalSample] = []
        self._build()
        self._simulator = Simulator(self.diagram)
        self.context = self._simulator.get_mutable_context()
        self._close = self.diagram.GetInputPort("close")
        self._close.FixValue(self.context, [0.0])
        self._misplace_object()

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
                    self.scenario, close_at, self.records, self.samples, state, radii
                )
            )
            self.context.SetTimeStateAndParametersFrom(saved)
            self._close.FixValue(self.context, [0.0])
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
        self._close.FixValue(self.context, [1.0])
        while self.context.get_time() < close_at + _LONGEST_GRASP:
            self._advance()
            phase, since, *_ = self.records[-1].report
            held = self.context.get_time() - since
            if phase == GraspPhase.BACK_OFF or (phase == GraspPhase.HOLD and held >= _HOLD):
                break
        sequencer = self._controller.GetSubsystemByName("grasp_sequencer")
        context = sequencer.GetMyContextFromRoot(self.context)
        return state_unpacker(len(self.hand.tip_radii))(context.get_discrete_state(0).value())

    def _advance(self) -> None:
        """Advances to the exact time of the next planning tick, so that the planner runs once."""
        tick = round(self.context.get_time() / self._period) + 1
        self._simulator.AdvanceTo(tick * self._period)

    def _planner_config(self, method: methods.Method) -> PlannerConfig:
        """Returns the planner's settings for a method."""
        grasp = replace(self._grasp, use_reach=method.uses_reach)
        config = hand_planner(replace(self.scenario, grasp=grasp))
        limits = replace(config.limits, recover=method.replans)
        return replace(config, limits=limits, static_duration=0.0 if method.replans else _FOREVER)

    def _planned_start(self) -> FloatArray:
        """Returns the contacts to which the planner converges at the start, in O, shape (n, 3).

        The planner respects the reach of the fingers and the obstacles at the start.
        """
        config = self._planner_config(methods.METHODS["dynamic_reach"])
        planner = PregraspPlanner(config, self.surface, self._start.p_OC)
        solids = tuple(moving.solid for moving in [*conditions.area(self.scenario), TABLE])
        p_WCoM = self._X_WO @ self.surface.p_OCoM
        X_WH = reach_frame(p_WCoM, self._start.yaw, self._grasp.yaw_range, self.hand.X_LA)
        values = {"X_WO_measured": self._X_WO, "X_WH": X_WH, "obstacles": Obstacles(solids)}
        simulator = Simulator(planner)
        context = simulator.get_mutable_context()
        for name, value in values.items():
            planner.GetInputPort(name).FixValue(context, value)
        simulator.AdvanceTo(_START_TICKS * config.period)
        p_WC = planner.GetOutputPort("p_WC").Eval(context).reshape(-1, 3)
        return np.array((self._X_WO.inverse() @ p_WC.T).T)

    def _initial_contacts(self) -> FloatArray:
        """Returns the initial contacts in O, in the order of the fingers, shape (n, 3)."""
        if self.method.plans_start:
            return self._planned_start()
        if self.method.is_stationary:
            rays = methods.rays_at(self.hand.azimuths + self._start.yaw)
            R_WO = self._X_WO.rotation().matrix()
            return self.surface.project(self.surface.p_OCoM + rays @ R_WO)[0]
        return self._start.p_OC

    def _build(self) -> None:
        """Builds the diagram of the trial."""
        scenario, config, p_OC = self.scenario, self._config, self._initial_contacts()
        fingers = len(p_OC)
        own_goals = self.method.is_stationary or self.method.is_reactive
        builder = DiagramBuilder()
        driven = add_simulated_hand(
            builder,
            scenario.object,
            scenario.motion,
            scenario.plant_settings,
            self._grasp,
            self.hand,
            p_OCoM=self.surface.p_OCoM,
            p_OC=p_OC,
            # Goals that do not come from the planner do not wait for its ticks.
            target_period=self._grasp.period if own_goals else self._period,
            obstacles=scenario.obstacle_bodies,
        )
        controller = self._controller = driven.controller
        self.station = driven.station
        self.planner = AddPregraspPlanner(
            builder, config, self.surface, p_OC, fingertip_frames=driven.tip_frames
        )
        self.goals = self._add_goals(builder)
        ports = f"hold_contacts V_WO_held{' X_WH' if self.method.uses_reach else ''}"
        connect(builder, controller, ports, self.planner)
        connect(builder, self.goals, "fingertip_targets contact_status", controller)
        connect(builder, self.planner, "X_WO_estimated V_WO_estimated", controller)
        self._add_measurements(builder)
        weights = builder.AddSystem(ContactWeights(np.zeros(fingers), self._start.losses))
        connect(builder, weights, "contact_weights", self.goals)
        obstacles = builder.AddSystem(MovingObstacles([*conditions.area(self.scenario), TABLE]))
        for system in {self.planner, self.goals}:
            if system.HasInputPort("obstacles"):
                connect(builder, obstacles, "obstacles", system)
        area = builder.AddSystem(MovingObstacles(conditions.area(self.scenario)))
        connect(builder, area, "obstacles", controller)
        period, sink = self._grasp.period, self.records.append
        logger = builder.AddSystem(GraspLogger(num_fingers=fingers, period=period, sink=sink))
        connect(builder, controller, "grasp_report p_GT p_WT X_WG", logger)
        connect(builder, self.station, "X_WO X_WD link_forces", logger)
        self.diagram = builder.Build()

    def _add_goals(self, builder: DiagramBuilder) -> System:
        """Adds the system that emits the hand's goals, and exports the input `close`."""
        goals: System = self.planner
        limits = self._config.limits
        frames, azimuths = self.hand.kinematics.tip_frames, self.hand.azimuths
        if self.method.is_stationary:
            azimuths = azimuths + self._start.yaw
            goals = builder.AddSystem(
                baseline_goals.StationaryHand(
                    frames, azimuths=azimuths, target=self._target(), limits=limits
                )
            )
            connect(builder, self.planner, "X_WO_estimated", goals)
            # The controller closes after the goals have moved from the ring to the object.
            delay = builder.AddSystem(DiscreteTimeDelay(self._grasp.period, _CLOSE_DELAY, 1))
            builder.ExportInput(goals.GetInputPort("close"), "close")
            builder.ConnectInput("close", delay.get_input_port())
            builder.Connect(delay.get_output_port(), self._controller.GetInputPort("close"))
            return goals
        if self.method.is_reassigned:
            goals = builder.AddSystem(
                methods.Reassignment(frames, azimuths=azimuths, period=self._period)
            )
            connect(builder, self.planner, "fingertip_targets contact_status", goals)
            connect(builder, self._controller, "X_WH", goals)
        if self.method.is_reactive:
            goals = builder.AddSystem(
                baseline_goals.ReactiveChoice(
                    frames, target=self._target(), limits=limits, period=self._period
                )
            )
            connect(builder, self.planner, "X_WO_estimated", goals)
            connect(builder, self._controller, "p_WT", goals)
        builder.ExportInput(self._controller.GetInputPort("close"), "close")
        return goals

    def _target(self) -> baseline_goals.RayTarget:
        """Returns the object, with rays at the height of its centre of mass over the table."""
        limits, p_OV = self._config.limits, np.asarray(self.surface.mesh.vertices)
        p_OA = self.surface.p_OCoM.copy()
        lowest = float(np.min(p_OV[:, 2])) + max(limits.tip_radii) + limits.clearance
        p_OA[2] = max(p_OA[2], lowest)
        solid = self.scenario.object.make_shape().solid
        return baseline_goals.RayTarget(solid, p_OV, p_OA)

    def _add_measurements(self, builder: DiagramBuilder) -> None:
        """Connects measured poses to the planner."""
        size, seed = NoisyPoseSensor.NOISE_SIZE, self._start.noise_seed
        noise = builder.AddSystem(NoiseSource(size=size, period=self._period, seed=seed))
        sensor = builder.AddSystem(NoisyPoseSensor(self.scenario.sensor))
        builder.Connect(noise.get_output_port(), sensor.GetInputPort("noise"))
        connect(builder, self.station, "X_WO", sensor)
        connect(builder, sensor, "X_WO_measured", self.planner)

    def _misplace_object(self) -> None:
        plant = self.station.plant
        context = plant.GetMyMutableContextFromRoot(self.context)
        body = plant.GetBodyByName("object")
        X_WO = plant.GetFreeBodyPose(context, body)
        x, y, angle = self._start.misplacement
        R_WO = RotationMatrix.MakeZRotation(angle) @ X_WO.rotation()
        plant.SetFreeBodyPose(
            context, body, RigidTransform(R_WO, X_WO.translation() + np.array([x, y, 0.0]))
        )

    def _sample(self) -> GoalSample:
        context = self.goals.GetMyContextFromRoot(self.context)
        status = np.asarray(self.goals.GetOutputPort("contact_status").Eval(context))
        targets = self.goals.GetOutputPort("fingertip_targets").Eval(context)
        active = is_active(status)
        distance, solids = np.inf, conditions.area_at(self.scenario, self.context.get_time())
        for finger in np.flatnonzero(active):
            X_WC: RigidTransform = targets.Find(self.hand.kinematics.tip_frames[finger])
            radius = self.hand.tip_radii[finger]
            out = -X_WC.rotation().matrix()[:, 2]
            tips = X_WC.translation() + np.array([[radius], [radius + self._grasp.standoff]]) * out
            distance = min([distance, *(float(np.min(s.distance(tips))) - radius for s in solids)])
        return GoalSample(tuple(status.astype(int).tolist()), distance)
