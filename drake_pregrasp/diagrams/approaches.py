"""Directions from which a palm may come to an object, and the choice among them."""

import contextlib
from collections.abc import Callable, Sequence

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.grasp_config import ABOVE, SIDE, GraspConfig
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.systems.hand_scene import LINK_CLEARANCE
from drake_pregrasp.systems.palm_posture import FROM_ABOVE

_YAWS = np.linspace(-np.pi, np.pi, 73)
_SIDES = np.pi / 2 * np.arange(4)  # Azimuths from which palms come from the side, in radians.


def candidate_approaches(
    config: GraspConfig, hand: HandModel, X_WO: RigidTransform, p_OCoM: FloatArray
) -> list[RigidTransform]:
    """Returns the approaches X_LA to choose from (see `HandModel`).

    Those from the side are along x and y of an upright object.

    Args:
        config: Configuration of the grasp.
        hand: Model of the hand, from above.
        X_WO: Initial pose of the object.
        p_OCoM: Centre of mass of the object in O, shape (3,), in metres.
    """
    height = config.side_height or max((X_WO @ p_OCoM)[2], least_side_height(hand))
    p_LA = [0.0, 0.0, height - X_WO.translation()[2]]
    yaw, level = RollPitchYaw(X_WO.rotation()).yaw_angle(), RotationMatrix.MakeYRotation(np.pi / 2)
    turns = [RotationMatrix.MakeZRotation(yaw + turn) for turn in _SIDES]
    found = {ABOVE: [FROM_ABOVE], SIDE: [RigidTransform(turn @ level, p_LA) for turn in turns]}
    return [X_LA for kind in config.approaches for X_LA in found[kind]]


def least_side_height(hand: HandModel) -> float:
    """Returns the least height over the table of a palm from the side, in metres.

    A quarter of its yaws clear the table there.
    """
    return LINK_CLEARANCE + float(np.quantile([hand.side_depth(yaw) for yaw in _YAWS], 0.25))


def best_approach(
    candidates: Sequence[RigidTransform], score_of: Callable[[RigidTransform], float]
) -> RigidTransform:
    """Returns the approach with the best start contacts; the first one if there are none at all.

    Args:
        candidates: Approaches, from `candidate_approaches`.
        score_of: Function that returns the score of an approach's start contacts.
    """
    best, most = candidates[0], -np.inf
    for X_LA in candidates:
        with contextlib.suppress(InvalidArgumentError):
            if (score := score_of(X_LA)) > most:
                best, most = X_LA, score
    return best
