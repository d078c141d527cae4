"""Compiled goals of a hand, and steps of fingertips that move straight to their goals."""

import math

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.fast.compiling import compiled
from drake_pregrasp.fast.pose_steps import exponential
from drake_pregrasp.fast.predicates import distance_to
from drake_pregrasp.geometry.solids import PlacedSolid
from drake_pregrasp.grasping.fingertip_paths import (
    GRAZE,
    PATH_PARTS,
    ROUNDING,
    Pace,
    TipRoom,
    straight_step,
)
from drake_pregrasp.grasping.forward_kinematics import HandPose
from drake_pregrasp.grasping.hand_commands import GraspCommand
from drake_pregrasp.grasping.hand_goals import HandGoals, PalmAxis


@compiled()
def is_clear_path(row, p, goal, least):  # type: ignore[no-untyped-def]
    """Returns whether points of a straight path keep a least distance from a solid.

    Args:
        row: The solid, as for `distance_to`.
        p: Start of the path, shape (3,), in metres.
        goal: End of the path, shape (3,), in metres.
        least: Least distance, in metres.
    """
    for part in range(1, PATH_PARTS + 1):
        s = part / PATH_PARTS
        x, y = p[0] + s * (goal[0] - p[0]), p[1] + s * (goal[1] - p[1])
        if not distance_to(row, x, y, p[2] + s * (goal[2] - p[2])) >= least:
            return False
    return True


@compiled()
def are_apart(p, rows, clearances, spacing):  # type: ignore[no-untyped-def]
    """Returns whether tips are clear of the solids after the first one, and of each other.

    Args:
        p: Centres of the tips, shape (n, 3), in metres.
        rows: The object and the other solids, as for `distance_to`, shape (1 + m, 19).
        clearances: Least distances of the tips from these, shape (1 + m, n), in metres.
        spacing: Least distances of the tips from each other, shape (n, n), in metres.
    """
    for i in range(len(p)):
        x, y, z = p[i, 0], p[i, 1], p[i, 2]
        for k in range(1, len(rows)):
            if not clearances[k, i] - distance_to(rows[k], x, y, z) <= ROUNDING:
                return False
        for j in range(i):
            a, b, c = x - p[j, 0], y - p[j, 1], z - p[j, 2]
            if not spacing[i, j] - math.sqrt(a * a + b * b + c * c) <= ROUNDING:
                return False
    return True


@compiled()
def write_toward(wanted, v_last, speed, change, v):  # type: ignore[no-untyped-def]
    """Writes the next velocity of a point, as `Pace.toward`.

    Args:
        wanted: Velocity that reaches its place in one period, shape (3,), in m/s.
        v_last: Present velocity, shape (3,), in m/s.
        speed: Largest speed, in m/s.
        change: Largest change of the velocity in one period, in m/s.
        v: Result, shape (3,), in m/s.
    """
    fastest = math.sqrt(wanted[0] ** 2 + wanted[1] ** 2 + wanted[2] ** 2)
    stopping = math.sqrt(change * (change / 4 + 2 * fastest)) - change / 2
    share = min(1.0, min(stopping, speed) / max(fastest, 1e-12))
    squares = 0.0
    for axis in range(3):
        squares += (share * wanted[axis] - v_last[axis]) ** 2
    excess = max(1.0, math.sqrt(squares) / change)
    for axis in range(3):
        v[axis] = v_last[axis] + (share * wanted[axis] - v_last[axis]) / excess


@compiled(
    "i8(f8[:,::1], f8[:,::1], f8[:,::1], f8, f8, f8, f8[:,::1], f8[:,::1], f8[:,::1], f8[::1],"
    " f8[:,::1])"
)
def write_straight_step(  # type: ignore[no-untyped-def]
    p, v, goal, speed, acceleration, period, rows, clearances, spacing, intrusions, moved
):
    """Writes the next positions of tips, and returns 1 if they move straight there.

    It returns 2 if they rest at their goals, and 0 if they may not move straight.

    Args:
        p: Centres of the tips in G, shape (n, 3), in metres.
        v: Velocities of the tips in G, shape (n, 3), in m/s.
        goal: Goals of the centres in G, shape (n, 3), in metres.
        speed: Largest speed of a tip, in m/s.
        acceleration: Largest acceleration of a tip, in m/s².
        period: Seconds between ticks.
        rows: The object and the other solids, as for `distance_to`, shape (1 + m, 19).
        clearances: Least distances of the tips from these, shape (1 + m, n), in metres.
        spacing: Least distances of the tips from each other, shape (n, n), in metres.
        intrusions: `TipRoom.intrusions`, shape (n,), in metres.
        moved: Result, shape (n, 3), in metres.
    """
    if not are_apart(goal, rows, clearances, spacing):
        return 0
    change, left, wanted, next_v = acceleration * period, 0.0, np.empty(3), np.empty(3)
    for i in range(len(p)):
        there = distance_to(rows[0], goal[i, 0], goal[i, 1], goal[i, 2])
        least = min(max(there, clearances[0, i] - intrusions[i]), clearances[0, i])
        here = distance_to(rows[0], p[i, 0], p[i, 1], p[i, 2])
        is_permitted = least - there <= ROUNDING
        if not (is_permitted and is_clear_path(rows[0], p[i], goal[i], min(least, here) - GRAZE)):
            return 0
        for axis in range(3):
            way = goal[i, axis] - p[i, axis]
            wanted[axis] = way / period
            left += way * way + (period * v[i, axis]) ** 2
        write_toward(wanted, v[i], speed, change, next_v)
        for axis in range(3):
            moved[i, axis] = p[i, axis] + period * next_v[axis]
        if not least - distance_to(rows[0], moved[i, 0], moved[i, 1], moved[i, 2]) <= ROUNDING:
            return 0
    if not are_apart(moved, rows, clearances, spacing):
        return 0
    return 2 if left <= ROUNDING**2 else 1


def compiled_straight_step(
    p_GT: FloatArray, v_GT: FloatArray, goal: FloatArray, pace: Pace, room: TipRoom
) -> FloatArray | None:
    """See `straight_step`, which computes steps around objects that are not a `PlacedSolid`."""
    if not isinstance(room.object, PlacedSolid):
        return straight_step(p_GT, v_GT, goal, pace, room)
    rows = np.array([room.object.row, *[solid.rounded_box() for solid, _ in room.others]])
    clearances = np.array([room.object_clearances, *[least for _, least in room.others]])
    moved, limits = np.empty(p_GT.shape), (pace.speed, pace.acceleration, pace.period)
    solids = rows, clearances, room.spacing, room.intrusions
    found = write_straight_step(p_GT, v_GT, goal, *limits, *solids, moved)
    return (None, moved, p_GT)[found]


@compiled(
    "Tuple((f8, f8))(f8[:,::1], f8[::1], f8[::1], f8[::1], f8, f8, f8, f8[:,:], f8[:], f8[:,:],"
    " f8[:,::1], f8[:,::1], f8, f8, f8[:,::1], f8[:,::1], f8[:,::1])"
)
def write_hand_goals(  # type: ignore[no-untyped-def]
    R_AL, p_AL, p_OCoM, azimuths, low, high, slack, R, p_WG, V_WG, p, v, yaw, lead, p_WT, v_WT, palm
):
    """Writes fields of `HandGoals`, and returns the yaw of the palm and its rate.

    Args:
        R_AL: `PalmAxis.R_AL`, shape (3, 3).
        p_AL: `PalmAxis.p_AL`, shape (3,), in metres.
        p_OCoM: `PalmAxis.p_OCoM`, shape (3,), in metres.
        azimuths: `PalmAxis.finger_azimuths`, shape (n,), in radians.
        low: Smallest yaw, in radians.
        high: Largest yaw, in radians.
        slack: `PalmAxis.yaw_slack`, in radians.
        R: `GraspCommand.R_WG`, shape (3, 3).
        p_WG: `GraspCommand.p_WG`, shape (3,), in metres.
        V_WG: `GraspCommand.V_WG`, shape (2, 3).
        p: Goals of the fingertips in G, shape (n, 3), in metres.
        v: Their velocities in G, shape (n, 3), in m/s.
        yaw: Last yaw of the palm, turned on with G since, in radians.
        lead: Seconds by which the goals of fingertips are ahead.
        p_WT: Result, shape (n, 3), in metres.
        v_WT: Result, shape (n, 3), in m/s.
        palm: Result: `HandGoals.p_WL` and `HandGoals.v_WL`, shape (2, 3).
    """
    w = V_WG[0]
    rows = exponential(w[0] * lead, w[1] * lead, w[2] * lead, 0)
    to_mass, to_tip, along, across = np.empty(3), np.empty(3), 0.0, 0.0
    for row in range(3):
        to_mass[row] = R[row, 0] * p_OCoM[0] + R[row, 1] * p_OCoM[1] + R[row, 2] * p_OCoM[2]
    for i in range(len(p)):
        for row in range(3):
            to_tip[row] = R[row, 0] * p[i, 0] + R[row, 1] * p[i, 1] + R[row, 2] * p[i, 2]
            v_WT[i, row] = R[row, 0] * v[i, 0] + R[row, 1] * v[i, 1] + R[row, 2] * v[i, 2]
        x, y = p_AL[0], p_AL[1]
        for k in range(3):
            x += R_AL[0, k] * (to_tip[k] - to_mass[k])
            y += R_AL[1, k] * (to_tip[k] - to_mass[k])
            ahead = rows[k][0] * to_tip[0] + rows[k][1] * to_tip[1] + rows[k][2] * to_tip[2]
            p_WT[i, k] = ahead + p_WG[k] + V_WG[1, k] * lead
        c, s = math.cos(azimuths[i]), math.sin(azimuths[i])
        along, across = along + c * x + s * y, across + c * y - s * x
        v_WT[i, 0] += V_WG[1, 0] + w[1] * to_tip[2] - w[2] * to_tip[1]
        v_WT[i, 1] += V_WG[1, 1] + w[2] * to_tip[0] - w[0] * to_tip[2]
        v_WT[i, 2] += V_WG[1, 2] + w[0] * to_tip[1] - w[1] * to_tip[0]
    palm[1, 0] = V_WG[1, 0] + w[1] * to_mass[2] - w[2] * to_mass[1]
    palm[1, 1] = V_WG[1, 1] + w[2] * to_mass[0] - w[0] * to_mass[2]
    palm[1, 2] = V_WG[1, 2] + w[0] * to_mass[1] - w[1] * to_mass[0]
    for k in range(3):
        palm[0, k] = p_WG[k] + to_mass[k]
    turn = math.atan2(across, along) - yaw
    turn -= 2 * math.pi * np.rint(turn / (2 * math.pi))
    turn = max(low, min(yaw + turn, high)) - yaw
    turn -= max(-slack, min(turn, slack))
    rate = R_AL[2, 0] * w[0] + R_AL[2, 1] * w[1] + R_AL[2, 2] * w[2]
    return max(low, min(yaw + turn, high)), rate


def compiled_hand_goals(
    axis: PalmAxis,
    command: GraspCommand,
    p_GT: FloatArray,
    v_GT: FloatArray,
    yaw: float,
    lead: float,
) -> HandGoals:
    """See `hand_goals`."""
    p_WT, v_WT, palm = np.empty(p_GT.shape), np.empty(p_GT.shape), np.empty((2, 3))
    yaw, yaw_rate = write_hand_goals(
        *(axis.R_AL, axis.p_AL, axis.p_OCoM, axis.finger_azimuths, *axis.yaw_range, axis.yaw_slack),
        *(command.R_WG, command.p_WG, command.V_WG, p_GT, v_GT, yaw, lead),
        *(p_WT, v_WT, palm),
    )
    return HandGoals(p_WT, v_WT, palm[0], palm[1], yaw, yaw_rate)


@compiled(
    "void(f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,:,::1], f8[::1], f8, f8, f8, f8[:,::1])"
)
def write_goal_velocities(  # type: ignore[no-untyped-def]
    goal, v_goal, v_goal_last, p, J, v_last, speed, acceleration, period, V
):
    """Writes the velocities with which fingertips follow their goals.

    Args:
        goal: Goals of the fingertips in W, shape (n, 3), in metres.
        v_goal: Velocities of the goals, shape (n, 3), in m/s.
        v_goal_last: Their present velocities, shape (n, 3), in m/s.
        p: Centres of the fingertips in W, shape (n, 3), in metres.
        J: Jacobians of their velocities, shape (n, 3, nq).
        v_last: Present velocities of the joints, shape (nq,).
        speed: Largest speed relative to a goal, in m/s.
        acceleration: Largest acceleration relative to a goal, in m/s².
        period: Seconds between ticks.
        V: Result, shape (n, 3), in m/s.
    """
    wanted, v = np.empty(3), np.empty(3)
    for i in range(len(p)):
        for axis in range(3):
            wanted[axis] = (goal[i, axis] - p[i, axis]) / period - v_goal[i, axis]
            v[axis] = -v_goal_last[i, axis]
            for j in range(len(v_last)):
                v[axis] += J[i, axis, j] * v_last[j]
        write_toward(wanted, v, speed, acceleration * period, V[i])
        for axis in range(3):
            V[i, axis] += v_goal[i, axis]


def compiled_goal_velocities(
    goals: HandGoals, pose: HandPose, v_last: FloatArray, v_WT_last: FloatArray, pace: Pace
) -> FloatArray:
    """See `goal_velocities`."""
    V, limits = np.empty(goals.p_WT.shape), (pace.speed, pace.acceleration, pace.period)
    now = goals.p_WT, goals.v_WT, v_WT_last, pose.p_WT, pose.J_WT, v_last
    write_goal_velocities(*now, *limits, V)
    return V.ravel()
