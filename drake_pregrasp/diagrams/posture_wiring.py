"""What holds a hand's palm over the object, by what carries it."""

from dataclasses import dataclass, field

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort

from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.palm_base import PalmCarrier
from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.systems.arm_posture import ArmPosture
from drake_pregrasp.systems.carrier_posture import CarrierPosture


@dataclass(frozen=True)
class AddedPosture:
    """A posture in a diagram that is being built.

    Attributes:
        system: It has the ports `tip_goals`, `X_WG`, `V_WG`, `X_WO_estimated`, `nominal_posture`
            and `X_WH`.
        goals: All that differential inverse kinematics follows.
        masks: Of frames that it follows beside the fingertips.
    """

    system: CarrierPosture | ArmPosture
    goals: OutputPort
    masks: dict[str, FloatArray] = field(default_factory=dict)


def add_posture(
    builder: DiagramBuilder,
    hand: HandModel,
    tip_goals: OutputPort,
    *,
    p_WG: FloatArray,
    yaw: float,
    yaw_range: tuple[float, float],
    lead: float,
    gain: float,
    period: float,
) -> AddedPosture:
    """Adds the posture system for what carries a hand.

    Args:
        builder: Where to add it.
        hand: The hand.
        tip_goals: Of `FingertipGoalShaper`.
        p_WG: Where the goals' frame G is at the start, shape (3,), in metres.
        yaw: Of the palm at the start, in radians.
        yaw_range: Least and largest angle of the palm, in radians.
        lead: For when the goals are, in seconds after the Context's time.
        gain: With which joints follow a posture, in 1/s.
        period: Seconds between control ticks.
    """
    base = hand.base
    if isinstance(base, PalmCarrier):
        carried = builder.AddNamedSystem(
            "carrier_posture",
            CarrierPosture(
                tip_frames=hand.kinematics.tip_frames,
                finger_azimuths=hand.azimuths,
                home=hand.home(np.zeros(3), yaw),
                carrier=base.joints,
                gain=gain,
                period=period,
                yaw_range=yaw_range,
            ),
        )
        builder.Connect(tip_goals, carried.GetInputPort("tip_goals"))
        return AddedPosture(carried, tip_goals)
    held = builder.AddNamedSystem(
        "arm_posture",
        ArmPosture(
            tip_frames=hand.kinematics.tip_frames,
            palm_frame=base.palm_frame,
            finger_azimuths=hand.azimuths,
            X_GP=base.X_GP,
            home=hand.relaxed,
            p_WG=p_WG,
            yaw=yaw,
            lead=lead,
            period=period,
            yaw_range=yaw_range,
        ),
    )
    builder.Connect(tip_goals, held.GetInputPort("tip_goals"))
    masks = {base.palm_frame: np.ones(6)}
    return AddedPosture(held, held.GetOutputPort("goals"), masks)
