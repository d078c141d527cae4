"""Goals of fingertips and palm in the world, and the velocities that follow them."""

from dataclasses import dataclass

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.contacts.assignment import palm_turn
from drake_pregrasp.geometry.rotations import rotation_matrix, skew
from drake_pregrasp.grasping.fingertip_paths import Pace
from drake_pregrasp.grasping.forward_kinematics import HandPose
from drake_pregrasp.grasping.hand_commands import GraspCommand


@dataclass(frozen=True, eq=False)
class PalmAxis:
    """Axis of a palm over an object, and the fingers around it.

    Attributes:
        R_AL: Orientation of the world in the approach A, shape (3, 3).
        p_AL: Position of the centre of mass in A, shape (3,), in metres.
        p_OCoM: Centre of mass of the object in O, shape (3,), in metres.
        finger_azimuths: Azimuths of the fingers about the axis at yaw 0, shape (n,), in radians.
        yaw_range: Smallest and largest yaw of the palm, in radians.
        yaw_slack: Angle by which the yaw may be off before the palm turns, in radians.
    """

    R_AL: FloatArray
    p_AL: FloatArray
    p_OCoM: FloatArray
    finger_azimuths: FloatArray
    yaw_range: tuple[float, float]
    yaw_slack: float = 0.0


@dataclass(frozen=True, eq=False)
class HandGoals:
    """Goals of the fingertips and of the palm in W.

    Attributes:
        p_WT: Centres of the fingertips when the goals are due, shape (n, 3), in metres.
        v_WT: Velocities of these goals, shape (n, 3), in m/s.
        p_WL: Point on the palm's axis, the centre of mass of an object at G, shape (3,), in metres.
        v_WL: Velocity of that point, shape (3,), in m/s.
        yaw: Yaw of the palm about z of the approach A, in radians.
        yaw_rate: Rate of change of the yaw, in rad/s.
        pan: Angle by which A has turned about the vertical, in radians.
        pan_rate: Rate of change of the pan, in rad/s.
        active: Whether each finger has a contact, shape (n,), so that the palm helps it; None if
            all have one.
    """

    p_WT: FloatArray
    v_WT: FloatArray
    p_WL: FloatArray
    v_WL: FloatArray
    yaw: float
    yaw_rate: float
    pan: float = 0.0
    pan_rate: float = 0.0
    active: BoolArray | None = None


def hand_goals(
    axis: PalmAxis,
    command: GraspCommand,
    p_GT: FloatArray,
    v_GT: FloatArray,
    yaw: float,
    lead: float,
) -> HandGoals:
    """Returns the goals in W of fingertips and palm that move with the frame G of a command.

    Args:
        axis: Axis of the palm.
        command: Command of the grasp's phase, with the motion of G.
        p_GT: Goals of the fingertips' centres in G, shape (n, 3), in metres.
        v_GT: Velocities of these goals in G, shape (n, 3), in m/s.
        yaw: Last yaw of the palm, turned on with G since, in radians.
        lead: Seconds by which the goals of fingertips are ahead.
    """
    (w_WG, v_WG), R_WG, spin = command.V_WG, command.R_WG, skew(command.V_WG[0])
    R_ahead, p_GL_W = rotation_matrix(w_WG * lead) @ R_WG, R_WG @ axis.p_OCoM
    p_AT = (p_GT @ R_WG.T - p_GL_W) @ axis.R_AL.T + axis.p_AL
    return HandGoals(
        p_WT=p_GT @ R_ahead.T + command.p_WG + v_WG * lead,
        v_WT=p_GT @ (spin @ R_WG).T + v_WG + v_GT @ R_WG.T,
        p_WL=command.p_WG + p_GL_W,
        v_WL=v_WG + spin @ p_GL_W,
        yaw=palm_turn(p_AT, axis.finger_azimuths, yaw, axis.yaw_range, axis.yaw_slack),
        yaw_rate=float(axis.R_AL[2] @ w_WG),
    )


def goal_velocities(
    goals: HandGoals, pose: HandPose, v_last: FloatArray, v_WT_last: FloatArray, pace: Pace
) -> FloatArray:
    """Returns the velocities with which fingertips follow their goals in W, shape (3n,), in m/s.

    Relative to its goal, which may itself accelerate, a fingertip keeps the limits of a pace.

    Args:
        goals: Goals of the fingertips.
        pose: Present kinematics of the hand.
        v_last: Present velocities of its joints, shape (nq,).
        v_WT_last: Present velocities of the goals, to which they change, shape (n, 3), in m/s.
        pace: Limits of the motion relative to the goals.
    """
    wanted = (goals.p_WT - pose.p_WT) / pace.period - goals.v_WT
    V = goals.v_WT + pace.toward(wanted, pose.J_WT @ v_last - v_WT_last)
    return np.asarray(V.ravel())
