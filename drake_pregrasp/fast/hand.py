"""Compiled kinematics of a hand, constraints on its velocities, and these velocities."""

import math

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.fast.compiling import compiled
from drake_pregrasp.grasping.clearances import (
    FINGER_CLEARANCE,
    LINK_CLEARANCE,
    RETREAT,
    TIP_CLEARANCE,
    TIP_LEAD,
    Clearances,
    Links,
    NearPairs,
)
from drake_pregrasp.grasping.forward_kinematics import HandPose, KinematicTree
from drake_pregrasp.grasping.grasp_state import NOT_BLOCKED
from drake_pregrasp.grasping.joint_velocities import (
    DAMPING,
    LIMIT_RATE,
    TOLERANCE,
    JointLimits,
    next_velocities,
)


@compiled(
    "void(f8[::1], f8[:,::1], i8[::1], i8[::1], f8[:,:,::1], i8[::1], i8[::1], f8[:,::1],"
    " b1[:,::1], f8[:,:,::1], f8[:,:,::1], f8[:,::1], f8[:,::1], f8[:,:,::1])"
)
def write_pose(  # type: ignore[no-untyped-def]
    q, S, before, order, X_0, moved_by, tip_bodies, p_BT, moves_tip, E, X_WB, screws, p_WT, J_WT
):
    """Writes the fields of `HandPose`.

    Args:
        q: Positions of the joints, shape (nq,).
        S: `KinematicTree.screws`, shape (6, nq).
        before: `KinematicTree.before`, shape (nq,).
        order: `KinematicTree.order`, shape (nq,).
        X_0: `KinematicTree.X_WB`, shape (b, 3, 4).
        moved_by: `KinematicTree.moved_by`, shape (b,).
        tip_bodies: `KinematicTree.tip_bodies`, shape (n,).
        p_BT: `KinematicTree.p_BT`, shape (n, 3), in metres.
        moves_tip: `KinematicTree.moves_tip`, shape (n, nq).
        E: Memory for the motions of what each joint carries, shape (nq + 1, 3, 4).
        X_WB: Result, shape (b, 3, 4).
        screws: Result, shape (6, nq).
        p_WT: Result, shape (n, 3), in metres.
        J_WT: Result, shape (n, 3, nq).
    """
    nq, own = len(q), np.empty((3, 4))
    for row in range(3):
        for column in range(4):
            E[nq, row, column] = 1.0 if row == column else 0.0
    for j in order:
        x, y, z, a, b, c = S[0, j], S[1, j], S[2, j], S[3, j], S[4, j], S[5, j]
        sine, versine = math.sin(q[j]), 1.0 - math.cos(q[j])
        pitch = x * a + y * b + z * c
        if x == 0.0 and y == 0.0 and z == 0.0:
            sine = versine = 0.0
            slides = (a * q[j], b * q[j], c * q[j])
        else:
            slides = (pitch * x * q[j], pitch * y * q[j], pitch * z * q[j])
        axis = (x, y, z)
        center = (y * c - z * b, z * a - x * c, x * b - y * a)
        W = ((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0))
        R = E[j]
        for row in range(3):
            for column in range(3):
                square = axis[row] * axis[column] - (1.0 if row == column else 0.0)
                own[row, column] = sine * W[row][column] + versine * square
            along = own[row, 0] * center[0] + own[row, 1] * center[1] + own[row, 2] * center[2]
            own[row, row] += 1.0
            own[row, 3] = slides[row] - along
        B = E[before[j]]
        for row in range(3):
            for column in range(4):
                R[row, column] = (
                    B[row, 0] * own[0, column]
                    + B[row, 1] * own[1, column]
                    + B[row, 2] * own[2, column]
                )
            R[row, 3] += B[row, 3]
        for row in range(3):
            screws[row, j] = R[row, 0] * x + R[row, 1] * y + R[row, 2] * z
            screws[3 + row, j] = R[row, 0] * a + R[row, 1] * b + R[row, 2] * c
        screws[3, j] += R[1, 3] * screws[2, j] - R[2, 3] * screws[1, j]
        screws[4, j] += R[2, 3] * screws[0, j] - R[0, 3] * screws[2, j]
        screws[5, j] += R[0, 3] * screws[1, j] - R[1, 3] * screws[0, j]
    for body in range(len(moved_by)):
        B, X = E[moved_by[body]], X_0[body]
        for row in range(3):
            for column in range(4):
                X_WB[body, row, column] = (
                    B[row, 0] * X[0, column] + B[row, 1] * X[1, column] + B[row, 2] * X[2, column]
                )
            X_WB[body, row, 3] += B[row, 3]
    for tip in range(len(tip_bodies)):
        X, p = X_WB[tip_bodies[tip]], p_WT[tip]
        for row in range(3):
            p[row] = X[row, 3]
            for k in range(3):
                p[row] += X[row, k] * p_BT[tip, k]
        for j in range(nq):
            moves = 1.0 if moves_tip[tip, j] else 0.0
            x, y, z = screws[0, j], screws[1, j], screws[2, j]
            J_WT[tip, 0, j] = moves * (screws[3, j] + y * p[2] - z * p[1])
            J_WT[tip, 1, j] = moves * (screws[4, j] + z * p[0] - x * p[2])
            J_WT[tip, 2, j] = moves * (screws[5, j] + x * p[1] - y * p[0])


def compiled_forward_kinematics(tree: KinematicTree, q: FloatArray) -> HandPose:
    """See `forward_kinematics`."""
    n, nq = tree.moves_tip.shape
    pose = HandPose(
        np.empty(tree.X_WB.shape), np.empty((6, nq)), np.empty((n, 3)), np.empty((n, 3, nq))
    )
    write_pose(
        np.array(q),  # Drake's vectors are read-only.
        tree.screws,
        tree.before,
        tree.order,
        tree.X_WB,
        tree.moved_by,
        tree.tip_bodies,
        tree.p_BT,
        tree.moves_tip,
        np.empty((nq + 1, 3, 4)),
        *pose,
    )
    return pose


@compiled(
    "i8(i8[::1], b1[::1], b1[::1], f8[:,::1], i8[::1], i8[::1], f8[::1], f8[:,::1], f8[:,::1],"
    " f8[:,:], f8[::1], b1[::1], f8, f8[:,::1], f8[::1], i8[::1])"
)
def write_clearances(  # type: ignore[no-untyped-def]
    finger,
    is_tip,
    is_last,
    moves,
    link,
    other,
    gaps,
    p,
    n,
    screws,
    V,
    holding,
    rate,
    rows,
    least,
    fingers,
):
    """Writes the fields of `Clearances`, and returns the number of constraints.

    Args:
        finger: `Links.finger`, shape (m,).
        is_tip: `Links.is_tip`, shape (m,).
        is_last: `Links.is_last`, shape (m,).
        moves: `Links.moves`, shape (m + 2, nq).
        link: `NearPairs.link`, shape (k,).
        other: `NearPairs.other`, shape (k,).
        gaps: `NearPairs.gaps`, shape (k,), in metres.
        p: `NearPairs.p_WQ`, shape (k, 3), in metres.
        n: `NearPairs.normals`, shape (k, 3).
        screws: Screws of the hand's joints, shape (6, nq).
        V: Velocity of the object at the origin of W, shape (6,), in rad/s and m/s.
        holding: Whether each fingertip holds the object or closes on it, shape (n,).
        rate: Largest ratio of the speed at which a gap closes to the gap that is left, in 1/s.
        rows: Result, shape (k, nq).
        least: Result, shape (k,).
        fingers: Result, shape (k,).
    """
    m, count = len(finger), 0
    touching, drifts = np.full(len(holding), -1), np.zeros(len(link))
    for k in range(len(link)):
        i, o = link[k], other[k]
        a = p[k, 1] * n[k, 2] - p[k, 2] * n[k, 1]
        b = p[k, 2] * n[k, 0] - p[k, 0] * n[k, 2]
        c = p[k, 0] * n[k, 1] - p[k, 1] * n[k, 0]
        for j in range(screws.shape[1]):
            along = a * screws[0, j] + b * screws[1, j] + c * screws[2, j]
            along += n[k, 0] * screws[3, j] + n[k, 1] * screws[4, j] + n[k, 2] * screws[5, j]
            rows[k, j] = along * (moves[i, j] - moves[o, j])
        if o == m:
            drifts[k] = a * V[0] + b * V[1] + c * V[2]
            drifts[k] += n[k, 0] * V[3] + n[k, 1] * V[4] + n[k, 2] * V[5]
            if is_tip[i] and finger[i] >= 0:
                touching[finger[i]] = k
        clearance = TIP_CLEARANCE if is_tip[i] else LINK_CLEARANCE
        if o < m:
            clearance = FINGER_CLEARANCE
        least[k] = min(rate * (clearance - gaps[k]), RETREAT) + drifts[k]
    for k in range(len(link)):
        i, f = link[k], finger[link[k]]
        if other[k] != m or is_tip[i] or not is_last[i] or f < 0 or not holding[f]:
            continue
        tip = touching[f]
        if tip >= 0:
            for j in range(screws.shape[1]):
                rows[k, j] -= rows[tip, j]
            fastest = min(rate * (TIP_LEAD - (gaps[k] - gaps[tip])), 0.0)
            least[k] = fastest + drifts[k] - drifts[tip]
    for k in range(len(link)):
        f = finger[link[k]]
        if other[k] >= m and is_tip[link[k]] and f >= 0 and holding[f]:
            continue
        for j in range(screws.shape[1]):
            rows[count, j] = rows[k, j]
        least[count], fingers[count] = least[k], f
        count += 1
    return count


def compiled_clearances(
    links: Links,
    near: NearPairs,
    screws: FloatArray,
    V_W: FloatArray,
    holding: BoolArray,
    rate: float,
) -> Clearances:
    """See `clearances`."""
    k, nq = len(near.link), screws.shape[1]
    found = Clearances(np.empty((k, nq)), np.empty(k), np.empty(k, dtype=np.int64))
    of_links = links.finger, links.is_tip, links.is_last, links.moves
    count = write_clearances(*of_links, *near, screws, V_W, holding, rate, *found)
    return Clearances(found.rows[:count], found.least[:count], found.fingers[:count])


@compiled(
    "b1(f8[::1], f8[::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1],"
    " f8[:,::1], f8[::1], f8[::1], f8[:,::1], f8[:,::1], f8[::1])"
)
def write_velocities(  # type: ignore[no-untyped-def]
    q, v_last, J, V, v_posture, lower, upper, fastest, change, rows, least, v, L, inverse, y
):
    """Writes velocities that follow goals, and returns whether no constraint limits them.

    Args:
        q: Positions of the joints, shape (nq,).
        v_last: Their velocities until now, shape (nq,).
        J: Jacobian of the goals, shape (k, nq).
        V: Velocities of the goals, shape (k,).
        v_posture: Velocities toward the posture, shape (nq,).
        lower: `JointLimits.lower`, shape (nq,).
        upper: `JointLimits.upper`, shape (nq,).
        fastest: `JointLimits.fastest`, shape (nq,).
        change: `JointLimits.change`, shape (nq,).
        rows: `Clearances.rows`, shape (c, nq).
        least: `Clearances.least`, shape (c,), in m/s.
        v: Result, shape (nq,).
        L: Memory for the Cholesky factor of J Jᵀ, shape (k, k).
        inverse: Memory for its inverse, shape (k, k).
        y: Memory, shape (k,).
    """
    k, nq = J.shape
    trace = 0.0  # Of (J Jᵀ)⁻¹, which is at least the largest 1/s².
    for row in range(k):
        for column in range(row + 1):
            total = 0.0
            for j in range(nq):
                total += J[row, j] * J[column, j]
            for i in range(column):
                total -= L[row, i] * L[column, i]
            if row == column:
                if not total > 0.0:
                    return False
                L[row, row] = math.sqrt(total)
            else:
                L[row, column] = total / L[column, column]
        for column in range(row + 1):
            total = 1.0 if row == column else 0.0
            for i in range(column, row):
                total -= L[row, i] * inverse[i, column]
            inverse[row, column] = total / L[row, row]
            trace += inverse[row, column] * inverse[row, column]
    if not trace < DAMPING**-2:
        return False
    for row in range(k):
        y[row] = V[row]
        for j in range(nq):
            y[row] -= J[row, j] * v_posture[j]
    for row in range(k - 1, -1, -1):
        total = 0.0
        for i in range(row + 1):
            total += inverse[row, i] * y[i]
        y[row] = total
    for row in range(k):
        total = 0.0
        for i in range(row, k):
            total += inverse[i, row] * y[i]
        y[row] = total
    for j in range(nq):
        v[j] = v_posture[j]
        for row in range(k):
            v[j] += J[row, j] * y[row]
    for row in range(len(least)):
        total = 0.0
        for j in range(nq):
            total += rows[row, j] * v[j]
        if not total - least[row] >= -TOLERANCE:
            return False
    for j in range(nq):
        low, high = v_last[j] - change[j], v_last[j] + change[j]
        slowest = min(max(LIMIT_RATE * (lower[j] - q[j]), -fastest[j]), 0.0)
        most = max(min(LIMIT_RATE * (upper[j] - q[j]), fastest[j]), 0.0)
        slowest, most = max(low, min(slowest, high)), min(high, max(most, low))
        if not (v[j] - slowest >= -TOLERANCE and most - v[j] >= -TOLERANCE):
            return False
        v[j] = min(max(v[j], slowest), most)
    return True


def compiled_next_velocities(
    q: FloatArray,
    v_last: FloatArray,
    J: FloatArray,
    V: FloatArray,
    v_posture: FloatArray,
    limits: JointLimits,
    clear: Clearances,
) -> tuple[FloatArray, int]:
    """See `next_velocities`, which computes velocities that constraints limit."""
    (k, nq), rows, least = J.shape, clear.rows, clear.least
    v, memory = np.empty(nq), (np.empty((k, k)), np.empty((k, k)), np.empty(k))
    if write_velocities(q, v_last, J, V, v_posture, *limits, rows, least, v, *memory):
        return v, NOT_BLOCKED
    return next_velocities(q, v_last, J, V, v_posture, limits, clear)
