"""One trial: a tracking run, and a grasp from it at each closing time."""

from collections.abc import Sequence

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.planner_config import PlannerConfig
from drake_pregrasp.contacts.selection_input import ContactStatus, is_active
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.geometry.box_surface import box_surface
from drake_pregrasp.grasping.grasp_state import GraspPhase, GraspState
from drake_pregrasp.simulation.hand_file import load_hand
from drake_pregrasp.simulation.output import without_solver_chatter
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.grasp_outcome import GoalLook, grasp_outcome
from drake_pregrasp.studies.static_versus_dynamic.outcome import Outcome, TrialJob
from drake_pregrasp.studies.static_versus_dynamic.scene import BOX, SCENES, SPACING, Scene
from drake_pregrasp.studies.static_versus_dynamic.start import Start, random_start
from drake_pregrasp.studies.static_versus_dynamic.trial_diagram import (
    TrialDiagram,
    make_trial_diagram,
)
from drake_pregrasp.systems.loggers import GraspRecord

_TICK = PlannerConfig.period  # Seconds between looks at goals.
_HOLD = 1.0  # Seconds of holding, after which the outcome is read.
_LONGEST_GRASP = 8.0  # Seconds after the command, after which it has failed in any case.


def run_trial(job: TrialJob) -> list[Outcome]:
    """Makes a trial; returns an outcome for each closing time of its condition."""
    with without_solver_chatter():
        return Trial(job).outcomes()


class Trial:
    """A trial that can be looked at while it goes on.

    Args:
        job: Which it is.
    """

    def __init__(self, job: TrialJob) -> None:
        self.job = job
        self.scene: Scene = SCENES[job.condition]
        self.surface = box_surface(BOX.size, spacing=SPACING, forbidden_faces=["+z", "-z"])
        grasp = self.scene.grasp()
        self.standoff = grasp.standoff
        self.hand = HandModel(load_hand(grasp.hand), grasp.yaw_range)
        self.start: Start = random_start(self.scene, self.surface, self.hand, job.seed)
        self.records: list[GraspRecord] = []
        self.looks: list[GoalLook] = []
        self.parts: TrialDiagram = make_trial_diagram(
            job.arm, self.scene, self.start, self.surface, self.hand, self.records.append
        )
        self.simulator = Simulator(self.parts.diagram)
        self.context: Context = self.simulator.get_mutable_context()
        self.parts.diagram.GetInputPort("close").FixValue(self.context, [0.0])
        self._misplace()

    def outcomes(self, closing_times: Sequence[float] | None = None) -> list[Outcome]:
        """Tracks the object, and grasps it at each closing time.

        Args:
            closing_times: In seconds, in their order, at ticks of the planner; those of the
                condition if not set.
        """
        outcomes = []
        if closing_times is None:
            closing_times = CONDITIONS[self.job.condition].closing_times
        for close_at in closing_times:
            self.track(close_at)
            saved, tracked = self.context.Clone(), len(self.records)
            self.grasp(close_at)
            outcomes.append(
                grasp_outcome(
                    self.job,
                    close_at,
                    self.scene,
                    self.records,
                    self.looks,
                    state=self.state(),
                    p_OCoM=self.surface.p_OCoM,
                    tip_radii=self.hand.tip_radii,
                )
            )
            del self.records[tracked:]
            self.context.SetTimeStateAndParametersFrom(saved)
            self.parts.diagram.GetInputPort("close").FixValue(self.context, [0.0])
            self.simulator.Initialize()
            del self.records[tracked:]
        return outcomes

    def track(self, until: float) -> None:
        """Lets the hand follow until a time, in seconds: that of a tick of the planner."""
        while self.context.get_time() < until - 1e-9:
            self._advance()
            self.looks.append(self._look())

    def grasp(self, close_at: float) -> None:
        """Tells the hand to close, and goes on until it has held the object for a while."""
        self.parts.diagram.GetInputPort("close").FixValue(self.context, [1.0])
        while self.context.get_time() < close_at + _LONGEST_GRASP:
            self._advance()
            phase, since, *_ = self.records[-1].report
            held = self.context.get_time() - since
            if phase == GraspPhase.BACK_OFF or (phase == GraspPhase.HOLD and held >= _HOLD):
                return

    def _advance(self) -> None:
        """Goes on to the planner's next tick: to its very time, so that it plans only once."""
        self.simulator.AdvanceTo((round(self.context.get_time() / _TICK) + 1) * _TICK)

    def state(self) -> GraspState:
        """Returns what the hand remembers."""
        sequencer = self.parts.controller.GetSubsystemByName("grasp_sequencer")
        context = sequencer.GetMyContextFromRoot(self.context)
        return GraspState.from_vector(context.get_discrete_state(0).value())

    def _misplace(self) -> None:
        plant = self.parts.station.plant
        context = plant.GetMyMutableContextFromRoot(self.context)
        body = plant.GetBodyByName("cube")
        X_WO = plant.GetFreeBodyPose(context, body)
        x, y, angle = self.start.misplacement
        moved = RigidTransform(
            RotationMatrix.MakeZRotation(angle) @ X_WO.rotation(),
            X_WO.translation() + np.array([x, y, 0.0]),
        )
        plant.SetFreeBodyPose(context, body, moved)

    def _look(self) -> GoalLook:
        goals = self.parts.goals
        context = goals.GetMyContextFromRoot(self.context)
        status: FloatArray = goals.GetOutputPort("contact_status").Eval(context)
        targets = goals.GetOutputPort("fingertip_targets").Eval(context)
        active = is_active(np.asarray(status))
        time = self.context.get_time()
        distance = np.inf
        frames, radii = self.hand.kinematics.tip_frames, self.hand.tip_radii
        for name, radius, is_active_goal in zip(frames, radii, active, strict=True):
            if not is_active_goal:
                continue
            X_WC: RigidTransform = targets.Find(name)
            out = -X_WC.rotation().matrix()[:, 2]
            tips = X_WC.translation() + np.array([[radius], [radius + self.standoff]]) * out
            for solid in self.scene.area_at(time):
                distance = min(distance, float(np.min(solid.distance(tips))) - radius)
        withdrawn = np.sum(~active & (status != ContactStatus.LOST))
        return GoalLook(time, int(np.sum(active)), int(withdrawn), distance)
