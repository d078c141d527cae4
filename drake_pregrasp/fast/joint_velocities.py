"""Compiled constraints on a hand's velocities, and the velocities where they allow the goals."""

import math

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.fast.compiling import compiled
from drake_pregrasp.grasping.clearances import (
    FINGER_CLEARANCE,
    LINK_CLEARANCE,
    RATE,
    RETREAT,
    TIP_CLEARANCE,
    TIP_LEAD,
    Clearances,
    Links,
    NearPairs,
)
from drake_pregrasp.grasping.grasp_state import NOT_BLOCKED
from drake_pregrasp.grasping.joint_velocities import (
    DAMPING,
    LIMIT_RATE,
    TOLERANCE,
    JointLimits,
    next_velocities,
)


@compiled(
    "i8(i8[::1], b1[::1], b1[::1], f8[:,::1], i8[::1], i8[::1], f8[::1], f8[:,::1], f8[:,::1],"
    " f8[:,:], f8[::1], b1[::1], f8[:,::1], f8[::1], i8[::1])"
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
    rows,
    least,
    fingers,
):
    """Writes the fields of `Clearances`, and returns the number of constraints.

    Args:
        finger: As the next three, a field of `Links`.
        is_tip: As the name says.
        is_last: As the name says.
        moves: As the name says.
        link: As the next four, a field of `NearPairs`.
        other: As the name says.
        gaps: As the name says.
        p: Points p_WC.
        n: Normals.
        screws: As the next two, an argument of `clearances`.
        V: Motion of the object.
        holding: As the name says.
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
        least[k] = min(RATE * (clearance - gaps[k]), RETREAT) + drifts[k]
    for k in range(len(link)):
        i, f = link[k], finger[link[k]]
        if other[k] != m or is_tip[i] or not is_last[i] or f < 0 or not holding[f]:
            continue
        tip = touching[f]
        if tip >= 0:
            for j in range(screws.shape[1]):
                rows[k, j] -= rows[tip, j]
            fastest = min(RATE * (TIP_LEAD - (gaps[k] - gaps[tip])), 0.0)
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
    links: Links, near: NearPairs, screws: FloatArray, V_W: FloatArray, holding: BoolArray
) -> Clearances:
    """See `clearances`."""
    k, nq = len(near.link), screws.shape[1]
    found = Clearances(np.empty((k, nq)), np.empty(k), np.empty(k, dtype=np.int64))
    of_links = links.finger, links.is_tip, links.is_last, links.moves
    count = write_clearances(*of_links, *near, screws, V_W, holding, *found)
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
        q: As the next four, an argument of `next_velocities`.
        v_last: As the name says.
        J: As the name says.
        V: As the name says.
        v_posture: As the name says.
        lower: As the next three, a field of `JointLimits`.
        upper: As the name says.
        fastest: As the name says.
        change: As the name says.
        rows: As the next one, a field of `Clearances`.
        least: As the name says.
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
