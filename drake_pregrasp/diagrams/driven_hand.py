"""A hand over an object on the conveyor, and what drives it."""

from dataclasses import dataclass

import numpy as np
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.framework import DiagramBuilder

from drake_pregrasp.diagrams.expected_path import initial_pose
from drake_pregrasp.diagrams.grasp_config import GraspConfig
from drake_pregrasp.diagrams.hand_controller import HandController
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.hand_station import HandStation
from drake_pregrasp.diagrams.motion_config import Conveyor
from drake_pregrasp.diagrams.object_config import Box
from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.solids import BoxSolid, HalfSpace
from drake_pregrasp.systems.moving_obstacles import MovingSolid

TABLE = MovingSolid(HalfSpace(np.zeros(3), np.array([0.0, 0.0, 1.0])), np.zeros(3))
"""The conveyor's top, which no fingertip may touch."""


@dataclass(frozen=True, eq=False)
class DrivenHand:
    """A hand in a diagram that is being built.

    Attributes:
        station: The plant with object and hand.
        controller: What drives the hand.
        tip_frames: Scoped names of the fingertips' frames.
    """

    station: HandStation
    controller: HandController
    tip_frames: list[str]


def add_driven_hand(
    builder: DiagramBuilder,
    object_config: Box,
    motion_config: Conveyor,
    plant_config: MultibodyPlantConfig,
    grasp: GraspConfig,
    hand: HandModel,
    *,
    p_OCoM: FloatArray,
    p_OC: FloatArray,
    target_period: float,
) -> DrivenHand:
    """Adds a plant with object and hand, and the hand's controller; connects them.

    Args:
        builder: Where to add them.
        object_config: The box.
        motion_config: How it moves.
        plant_config: Time step and contact model.
        grasp: How the hand grasps.
        hand: The hand.
        p_OCoM: The box's centre of mass in O, shape (3,), in metres.
        p_OC: Initial contacts in O, in the order of the fingers, shape (n, 3), in metres.
        target_period: Seconds between changes of the contact goals in O.

    Raises:
        InvalidArgumentError: If an argument is out of its range.
    """
    size = np.array(object_config.size)
    controller = builder.AddNamedSystem(
        "hand_controller",
        HandController(
            grasp,
            hand,
            object_solid=BoxSolid(np.zeros(3), np.eye(3), size),
            object_top=float(size[2] / 2),
            mass=object_config.mass,
            p_OCoM=p_OCoM,
            fixed=[TABLE.solid],
            X_WO=initial_pose(motion_config, object_config),
            p_OC=p_OC,
            target_period=target_period,
            plant_time_step=plant_config.time_step,
        ),
    )
    station = builder.AddNamedSystem(
        "object_plant",
        HandStation(
            object_config,
            motion_config,
            plant_config,
            hand.description,
            friction=grasp.friction,
            initial=controller.initial,
            yaw_range=grasp.yaw_range,
        ),
    )
    for name in ("hand_state", "net_actuation"):
        builder.Connect(station.GetOutputPort(name), controller.GetInputPort(name))
    builder.Connect(
        controller.GetOutputPort("desired_state"), station.GetInputPort("desired_state")
    )
    return DrivenHand(station, controller, hand.kinematics.tip_frames)
