"""Compiled forward kinematics of a hand."""

import math

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.fast.compiling import compiled
from drake_pregrasp.grasping.forward_kinematics import HandPose, KinematicTree


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
        S: `KinematicTree.screws`, and the next ones its other fields.
        before: As the name says.
        order: Indices of the joints, each after those before it, shape (nq,).
        X_0: `KinematicTree.X_WB`.
        moved_by: As the name says.
        tip_bodies: As the name says.
        p_BT: As the name says.
        moves_tip: As the name says.
        E: Memory for the motions of what each joint carries, shape (nq + 1, 3, 4).
        X_WB: Result.
        screws: Result.
        p_WT: Result.
        J_WT: Result.
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
