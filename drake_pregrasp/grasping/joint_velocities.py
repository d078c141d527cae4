"""Joint velocities that follow goals first and a posture second, within linear constraints."""

from typing import NamedTuple

import numpy as np
from scipy.linalg import pinv
from scipy.linalg.lapack import dposv, dpotrf, dtrtrs
from scipy.optimize import nnls

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.grasping.clearances import RETREAT, Clearances
from drake_pregrasp.grasping.grasp_state import BASE, NOT_BLOCKED

LIMIT_RATE = 10.0
"""Largest ratio of a joint's speed to its distance from a limit, in 1/s."""

DAMPING = 1e-3
"""Singular value of a Jacobian, in metres, below which its direction is given up."""

TOLERANCE = 1e-9
"""Violation of a constraint that is rounding, in m/s or rad/s."""

_TRACKING_WEIGHT = 1e4  # Weight of goals against posture.


class JointLimits(NamedTuple):
    """Limits of the joints of a hand.

    Attributes:
        lower: Lower limits of their positions, shape (nq,), in radians or metres.
        upper: Upper limits of their positions, shape (nq,), in radians or metres.
        fastest: Largest rates, shape (nq,), in rad/s or m/s.
        change: Largest changes of the rates from tick to tick, shape (nq,), in rad/s or m/s.
    """

    lower: FloatArray
    upper: FloatArray
    fastest: FloatArray
    change: FloatArray


def next_velocities(
    q: FloatArray,
    v_last: FloatArray,
    J: FloatArray,
    V: FloatArray,
    v_posture: FloatArray,
    limits: JointLimits,
    clear: Clearances,
) -> tuple[FloatArray, int]:
    """Returns the velocities of the joints until the next tick, and what stops them.

    They follow goals and a posture (`joint_velocities`), within the limits of the joints and
    clearances. If no velocities do, the joints stop with their largest deceleration; unless an
    object comes too fast for that, and a hand that follows its goals gets less in its way.

    Args:
        q: Positions of the joints, shape (nq,).
        v_last: Velocities until now, shape (nq,).
        J: Jacobian of the goals, shape (k, nq).
        V: Velocities of the goals, shape (k,).
        v_posture: Velocities toward the posture, shape (nq,).
        limits: Limits of the joints.
        clear: Constraints that keep the hand clear.

    Returns:
        The velocities, shape (nq,); and the index of the finger that stops the hand, `BASE`, or
        `NOT_BLOCKED`.
    """
    lower, upper, fastest, change = limits
    least = np.minimum(np.maximum(LIMIT_RATE * (lower - q), -fastest), 0.0)
    most = np.maximum(np.minimum(LIMIT_RATE * (upper - q), fastest), 0.0)
    least = np.maximum(v_last - change, np.minimum(least, v_last + change))
    most = np.minimum(v_last + change, np.maximum(most, v_last - change))
    each = np.eye(len(q))
    A = np.concatenate([each, -each, clear.rows])
    b = np.concatenate([least, -most, clear.least])
    v = joint_velocities(J, V, v_posture, A, b)
    if v is not None:
        return np.minimum(np.maximum(v, least), most), NOT_BLOCKED
    stopped = np.minimum(np.maximum(0.0, v_last - change), v_last + change)
    if not len(clear.least):
        return stopped, BASE
    lacking = clear.least - clear.rows @ stopped
    blocked = int(clear.fingers[np.argmax(lacking)])
    if (worst := np.max(lacking)) > RETREAT:
        moving = joint_velocities(J, V, v_posture, A[: 2 * len(q)], b[: 2 * len(q)])
        if moving is not None and np.max(clear.least - clear.rows @ moving) < worst - TOLERANCE:
            return np.minimum(np.maximum(moving, least), most), blocked
    return stopped, blocked


def joint_velocities(
    J: FloatArray, V: FloatArray, v_posture: FloatArray, A: FloatArray, b: FloatArray
) -> FloatArray | None:
    """Returns the v with A v >= b that follows goals, and a posture where they leave it free.

    Without constraints it is u = v₀ + J⁺ (V - J v₀) with the velocity v₀ of the posture. If this
    violates a constraint, the growth of the same two errors is minimised with weights:

        min W |J (v - u)|² + |(I - J⁺ J)(v - u)|² + d² |v - u|²  subject to  A v >= b

    where directions that J⁺ gives up count by the damping d alone.

    Args:
        J: Jacobian of the goals, shape (k, nq).
        V: Velocities of the goals, shape (k,).
        v_posture: Velocities v₀ toward the posture, shape (nq,).
        A: Gradients of the constraints, shape (m, nq).
        b: Least values of the constraints, shape (m,).

    Returns:
        The velocities, shape (nq,), or None if no v satisfies all constraints.
    """
    J_plus = _pseudoinverse(J)
    v: FloatArray = v_posture + J_plus @ (V - J @ v_posture)
    if np.minimum.reduce(A @ v - b) >= -TOLERANCE:
        return v
    each = np.eye(len(v))
    H = _TRACKING_WEIGHT * J.T @ J + (each - J_plus @ J) + DAMPING**2 * each
    return constrained_velocities(H, v, A, b)


def constrained_velocities(
    H: FloatArray, v_free: FloatArray, A: FloatArray, b: FloatArray
) -> FloatArray | None:
    """Returns the v with A v >= b that minimises (v - v_free)ᵀ H (v - v_free), or None without one.

    In x = Lᵀ (v - v_free) with H = L Lᵀ it is the point of a polyhedron that is nearest to the
    origin, which non-negative least squares find (Lawson and Hanson, "Solving Least Squares
    Problems", chapter 23).

    Args:
        H: Positive definite matrix, shape (nq, nq).
        v_free: Velocities without constraints, shape (nq,).
        A: Gradients of the constraints, shape (m, nq).
        b: Least values of the constraints, shape (m,).
    """
    lacking = b - A @ v_free
    if not np.isfinite(lacking).all():
        return None
    scale = np.maximum.reduce(lacking)
    if scale <= 0:
        return v_free
    L, failure = dpotrf(H, lower=True, clean=True)
    if failure:
        return None
    G, _ = dtrtrs(L, A.T, lower=True)  # Of the constraints Gᵀ x >= lacking.
    target = np.append(np.zeros(len(v_free)), 1.0)
    rows = np.concatenate([G, [lacking / scale]])
    try:
        multipliers, distance = nnls(rows, target)
    except RuntimeError:  # It has not converged.
        return None
    if distance < TOLERANCE:  # A positive combination of constraints is a contradiction.
        return None
    residual = rows @ multipliers - target
    change, _ = dtrtrs(L, -scale / residual[-1] * residual[:-1], lower=True, trans=True)
    return np.asarray(v_free + change)


def _pseudoinverse(J: FloatArray) -> FloatArray:
    """Returns J⁺, in which directions of singular values up to `DAMPING` are given up."""
    _, inverse, failure = dposv(J @ J.T, np.eye(len(J)))  # Takes half as long as numpy's.
    # The norm of the inverse is at least the largest 1/s².
    if not failure and np.vdot(inverse, inverse) < DAMPING**-4:
        return np.asarray(J.T @ inverse)
    return np.asarray(pinv(J, atol=DAMPING, rtol=0))
