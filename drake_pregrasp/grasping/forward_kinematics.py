"""Forward kinematics of a hand: where its bodies are, and how its joints move them."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.geometry.rotations import skew


@dataclass(frozen=True, eq=False)
class KinematicTree:
    """Bodies and joints of a hand as a product of exponentials; each joint turns or slides.

    Attributes:
        screws: Screws of the joints in W with all joints at 0, shape (6, nq). Column j is the
            spatial velocity, at the origin of W, of all that joint j moves, per unit rate.
        before: Index of the joint before each joint, nq for a joint on W, shape (nq,).
        order: Indices of the joints, each after those before it, shape (nq,).
        levels: The same in groups: the joints with no joint before them, with one, and so on.
        X_WB: Rotation and, as the last column, position of each body in W with all joints at 0,
            shape (b, 3, 4).
        moved_by: Index of the last joint that moves each body, nq for none, shape (b,).
        tip_bodies: Index of the body of each fingertip, shape (n,).
        p_BT: Centre of each fingertip in its body, shape (n, 3), in metres.
        moves_tip: Whether each joint moves each fingertip, shape (n, nq).
    """

    screws: FloatArray
    before: IntArray
    order: IntArray
    levels: tuple[IntArray, ...]
    X_WB: FloatArray
    moved_by: IntArray
    tip_bodies: IntArray
    p_BT: FloatArray
    moves_tip: BoolArray


class HandPose(NamedTuple):
    """Kinematics of a hand at positions of its joints.

    Attributes:
        X_WB: Rotation and, as the last column, position of each body in W, shape (b, 3, 4).
        screws: Screws of the joints in W, as those of `KinematicTree`, shape (6, nq). The Jacobian
            of a body has the columns of the joints that move it, and zeros.
        p_WT: Centres of the fingertips in W, shape (n, 3), in metres.
        J_WT: Jacobians of the fingertips' velocities in W, shape (n, 3, nq).
    """

    X_WB: FloatArray
    screws: FloatArray
    p_WT: FloatArray
    J_WT: FloatArray


def forward_kinematics(tree: KinematicTree, q: FloatArray) -> HandPose:
    """Returns the kinematics at positions of the joints; NaN where these are NaN.

    A joint moves what it carries by exp([S] q), whose rotation R is about the point w x v of its
    axis, after the joints before it (Murray, Li and Sastry, "A Mathematical Introduction to Robotic
    Manipulation", section 3.2).

    Args:
        tree: Bodies and joints of the hand.
        q: Positions of the joints, shape (nq,), in radians or metres.
    """
    w, v = tree.screws.T.reshape(-1, 2, 3).swapaxes(0, 1)
    turns, cross, sine = np.logical_or.reduce(w != 0, axis=1), skew(w), np.sin(q)[:, None, None]
    center = np.cross(w, v)
    slide = np.where(turns[:, None], np.add.reduce(w * v, axis=1)[:, None] * w, v)
    # The last motion is that of W, which stays.
    R, p = np.empty((len(q) + 1, 3, 3)), np.zeros((len(q) + 1, 3))
    R[-1] = np.eye(3)
    R[:-1] = R[-1] + sine * cross + (1 - np.cos(q))[:, None, None] * (cross @ cross)
    p[:-1] = center - _turned(R[:-1], center) + q[:, None] * slide
    for joints in tree.levels[1:]:
        before = tree.before[joints]
        p[joints] = _turned(R[before], p[joints]) + p[before]
        R[joints] = R[before] @ R[joints]
    # A joint does not move its own screw.
    w_now = _turned(R[:-1], w)
    v_now = _turned(R[:-1], v) + _turned(skew(p[:-1]), w_now)
    screws = np.concatenate([w_now, v_now], axis=1).T
    X_WB = R[tree.moved_by] @ tree.X_WB
    X_WB[:, :, 3] += p[tree.moved_by]
    X_WT = X_WB[tree.tip_bodies]
    p_WT = _turned(X_WT[:, :, :3], tree.p_BT) + X_WT[:, :, 3]
    J_WT = (screws[3:] - skew(p_WT) @ screws[:3]) * tree.moves_tip[:, None]
    return HandPose(X_WB, screws, p_WT, J_WT)


def _turned(R: FloatArray, vectors: FloatArray) -> FloatArray:
    turned: FloatArray = (R @ vectors[:, :, None])[:, :, 0]
    return turned
