"""Who says where fingers go in a trial: what the arms of the study differ in."""

from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder, System
from pydrake.systems.primitives import DiscreteTimeDelay

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.planner_config import PlannerConfig
from drake_pregrasp.diagrams.hand_controller import HandController
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.pregrasp_planner import AddPregraspPlanner, PregraspPlanner
from drake_pregrasp.geometry.solids import BoxSolid
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.regions.constraints import RegionConstraints
from drake_pregrasp.studies.static_versus_dynamic.planned_start import planned_start, planner_config
from drake_pregrasp.studies.static_versus_dynamic.reassignment import Reassignment
from drake_pregrasp.studies.static_versus_dynamic.scene import BOX, Scene
from drake_pregrasp.studies.static_versus_dynamic.start import Start
from drake_pregrasp.studies.static_versus_dynamic.still_hand import StillHand

_RING = 0.092  # Radius on which fingertips of a still hand wait, in metres.
_GOALS_FIRST = 3  # Control ticks in which the goals of a still hand become those of closing.


@dataclass(frozen=True, eq=False)
class ArmStart:
    """With what an arm starts.

    Attributes:
        config: Of its planner, whose estimate of the pose it uses in any case.
        p_OC: Its contacts in the order of the fingers, in O, shape (n, 3), in metres.
        target_period: Seconds between changes of its goals.
    """

    config: PlannerConfig
    p_OC: FloatArray
    target_period: float


def arm_start(
    arm: str,
    scene: Scene,
    start: Start,
    surface: ObjectSurface,
    hand: HandModel,
    X_WO: RigidTransform,
) -> ArmStart:
    """Returns with what an arm starts.

    Args:
        arm: Key of `ARMS`.
        scene: What happens.
        start: Where the trial starts.
        surface: The object's.
        hand: The hand.
        X_WO: Where the object is taken to be.
    """
    hold = not arm.startswith("dynamic")
    config = planner_config(scene, hand, reach=arm == "dynamic_reach", hold=hold)
    p_OC, period = start.p_OC, config.period
    if arm in ("world", "frozen", "reassigned"):
        p_OC = planned_start(scene, surface, p_OC, X_WO, hand=hand, yaw=start.yaw)
    elif arm == "still":
        azimuths = hand.azimuths + start.yaw
        level = np.zeros(len(azimuths))
        p_OC = surface.project(np.stack([np.cos(azimuths), np.sin(azimuths), level], axis=1))[0]
        period = scene.grasp().period  # It doesn't wait for a planner.
    return ArmStart(config, p_OC, period)


def add_goals(
    builder: DiagramBuilder,
    arm: str,
    first: ArmStart,
    start: Start,
    surface: ObjectSurface,
    controller: HandController,
    hand: HandModel,
) -> tuple[PregraspPlanner, System]:
    """Adds a planner, and what stands between it and the hand; exports the input `close`.

    Returns the planner, and the system whose `fingertip_targets` and `contact_status` the hand gets
    and which is told of losses by `contact_weights`; it may be the planner itself.

    Args:
        builder: Where to add them.
        arm: Key of `ARMS`.
        first: Of the arm.
        start: Where the trial starts.
        surface: The object's.
        controller: The hand's.
        hand: The hand.
    """
    frames = hand.kinematics.tip_frames
    planner = AddPregraspPlanner(
        builder, first.config, surface, first.p_OC, fingertip_frames=frames
    )
    builder.Connect(
        controller.GetOutputPort("hold_contacts"), planner.GetInputPort("hold_contacts")
    )
    goals: System = planner
    if arm == "still":
        goals = _still_hand(first.config, start, hand)
        builder.AddNamedSystem("still_hand", goals)
        builder.Connect(
            planner.GetOutputPort("X_WO_estimated"), goals.GetInputPort("X_WO_estimated")
        )
    elif arm == "reassigned":
        goals = builder.AddNamedSystem(
            "reassignment",
            Reassignment(tip_frames=frames, azimuths=hand.azimuths, period=first.config.period),
        )
        for name in ("fingertip_targets", "contact_status"):
            builder.Connect(planner.GetOutputPort(name), goals.GetInputPort(name))
        builder.Connect(controller.GetOutputPort("X_WH"), goals.GetInputPort("X_WH"))
    if first.config.limits.reach:
        builder.Connect(controller.GetOutputPort("X_WH"), planner.GetInputPort("X_WH"))
    for name in ("fingertip_targets", "contact_status"):
        builder.Connect(goals.GetOutputPort(name), controller.GetInputPort(name))
    for name in ("X_WO_estimated", "V_WO_estimated"):
        builder.Connect(planner.GetOutputPort(name), controller.GetInputPort(name))
    if arm == "still":  # Its goals first have to get from the ring to the object.
        told = builder.AddSystem(DiscreteTimeDelay(first.target_period, _GOALS_FIRST, 1))
        builder.ExportInput(goals.GetInputPort("close"), "close")
        builder.ConnectInput("close", told.get_input_port())
        builder.Connect(told.get_output_port(), controller.GetInputPort("close"))
    else:
        builder.ExportInput(controller.GetInputPort("close"), "close")
    return planner, goals


def _still_hand(config: PlannerConfig, start: Start, hand: HandModel) -> StillHand:
    return StillHand(
        tip_frames=hand.kinematics.tip_frames,
        azimuths=hand.azimuths + start.yaw,
        ring_radius=_RING,
        box=BoxSolid(np.zeros(3), np.eye(3), np.array(BOX.size)),
        constraints=RegionConstraints(
            clearance=config.limits.clearance,
            tip_radii=np.array(config.limits.tip_radii),
            standoff=config.limits.standoff,
        ),
    )
