"""Settings with which a hand plans its meeting with an object."""

import numpy as np
from pydrake.math import RigidTransform

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.config.object_config import GRAVITY
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.palm_base import PalmCarrier
from drake_pregrasp.geometry.solids import SignedDistance
from drake_pregrasp.grasping.interception import NUM_TIMES, MeetingSettings
from drake_pregrasp.grasping.palm_paths import PalmLimits
from drake_pregrasp.systems.hand_kinematics import moving_joints, point_jacobian, scoped_frame

_SPEED_SHARE = 0.9  # Share of the axes' largest speed that the path to the meeting uses.
_AXIS_SHARE = 0.9  # Share of the axes' largest acceleration: corrections need the rest.
_TIP_SHARE = 0.6  # Share of `tip_acceleration`, within which fingertips keep up with the palm.


def palm_limits(hand: HandModel, q: FloatArray, tip_acceleration: float) -> PalmLimits:
    """Returns the limits of a palm's position on its way to a meeting.

    Those of a carrier are those of its axes. The palm of an arm moves along one axis, without
    turning, as fast as the arm's joints allow at q; what the arm reaches is not known here.

    Args:
        hand: Model of the hand with its approach.
        q: Positions of the joints, shape (nq,).
        tip_acceleration: Largest acceleration of fingertips on the way to their goals, in m/s².
    """
    model, base = hand.kinematics, hand.base
    if isinstance(base, PalmCarrier):
        axes = base.joints[:3]
        speed, acceleration = model.rate_limit[axes], model.acceleration_limit[axes]
        travel = np.array([model.lower[axes], model.upper[axes]]) - base.p_AL
    else:
        palm = scoped_frame(model.plant, base.palm_frame)
        pose, carrying = model.pose(q), moving_joints(model.plant, palm)
        X_WP = RigidTransform(pose.X_WB[int(palm.body().index())])
        X_WP = X_WP @ palm.GetFixedPoseInBodyFrame()
        J = point_jacobian(carrying * pose.screws, X_WP.translation())
        along = np.abs(np.linalg.pinv(J)[:, 3:] @ hand.X_LA.rotation().matrix())
        with np.errstate(divide="ignore"):  # Without limits of joints, the palm has none.
            speed = 1 / np.max(along / model.rate_limit[:, None], axis=0)
            acceleration = 1 / np.max(along / model.acceleration_limit[:, None], axis=0)
        travel = np.array([np.full(3, -np.inf), np.full(3, np.inf)])
    return PalmLimits(
        lower=travel[0],
        upper=travel[1],
        speed=_SPEED_SHARE * speed,
        acceleration=np.minimum(_AXIS_SHARE * acceleration, _TIP_SHARE * tip_acceleration),
    )


def meeting_settings(
    config: GraspConfig,
    hand: HandModel,
    q: FloatArray,
    object_solid: SignedDistance,
    mass: float,
    p_OCoM: FloatArray,
    R_WO: FloatArray,
    gravity: float,
    diffusion: float,
) -> MeetingSettings:
    """Returns the settings with which a hand plans its meeting with an object.

    Args:
        config: Configuration of the grasp.
        hand: Model of the hand with its approach.
        q: Initial positions of its joints, shape (nq,).
        object_solid: The object in O.
        mass: Mass of the object, in kg.
        p_OCoM: Centre of mass of the object in O, shape (3,), in metres.
        R_WO: Initial orientation of the object, shape (3, 3).
        gravity: Acceleration of the object along -z of W, in m/s².
        diffusion: Spectral density of its random acceleration, in m²/s³.
    """
    settings = config.make_settings(hand.description.fingertips)
    limits = palm_limits(hand, q, config.tip_acceleration)
    R_AW = hand.X_LA.rotation().matrix().T
    down, up = -R_WO[2], R_WO.T @ R_AW[2]
    if hand.X_LA.rotation().IsNearlyIdentity():  # On the table, the centre of mass is so high.
        lowest = object_solid.highest(down) - down @ p_OCoM - config.standoff
        limits.lower[2] = max(limits.lower[2], lowest)
    spare = config.largest_lift(hand.description.fingertips) - mass * GRAVITY
    return MeetingSettings(
        limits=limits,
        step=config.meeting.latest / NUM_TIMES,
        earliest=config.meeting.earliest,
        lateness=config.meeting.lateness,
        follow=settings.closing_duration + settings.squeeze_duration,
        stop=settings.stop_duration,
        height=object_solid.highest(up) + object_solid.highest(-up),
        sideways=config.standoff / 2,
        grip=max(0.0, spare) / mass,
        gravity=R_AW @ [0.0, 0.0, -gravity],
        diffusion=diffusion,
    )
