"""Differential inverse kinematics for the fingertips of a hand, by Drake's system."""

import numpy as np
from pydrake.multibody.inverse_kinematics import DifferentialInverseKinematicsSystem
from pydrake.multibody.math import SpatialVelocity
from pydrake.planning import DofMask, JointLimits

from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.systems.joint_reference import LARGEST_RATE

POSTURE_GAIN = 5.0
"""How fast the carrier follows its nominal posture, in 1/s."""

_LIMIT_INFLUENCE = 0.05  # Radians or metres from a limit, in which joints slow down.
_TRACKING_WEIGHT = 100.0  # Of fingertips against posture, as Drake's documentation advises.
_POSITION_ONLY = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
_LARGEST_TWIST = SpatialVelocity([5.0] * 3, [1.0] * 3)  # rad/s and m/s, of any fingertip.


def fingertip_kinematics(
    hand: HandModel, more_masks: dict[str, FloatArray], period: float
) -> DifferentialInverseKinematicsSystem:
    """Returns Drake's system for fingertip positions, and for what more there is to follow.

    Its fingertips share out what joints at their limits can't do.

    Args:
        hand: The hand.
        more_masks: Of the frames that it follows beside the fingertips, shape (6,): which of their
            rotations and translations count.
        period: Seconds between control ticks.
    """
    masks = dict.fromkeys(hand.kinematics.tip_frames, _POSITION_ONLY) | more_masks
    tracking = DifferentialInverseKinematicsSystem.LeastSquaresCost.Config()
    tracking.cartesian_qp_weight = _TRACKING_WEIGHT
    tracking.cartesian_axis_masks = masks
    centering = DifferentialInverseKinematicsSystem.JointCenteringCost.Config()
    centering.posture_gain = POSTURE_GAIN
    centering.cartesian_axis_masks = masks
    recipe = DifferentialInverseKinematicsSystem.Recipe()
    recipe.AddIngredient(DifferentialInverseKinematicsSystem.LeastSquaresCost(tracking))
    recipe.AddIngredient(DifferentialInverseKinematicsSystem.JointCenteringCost(centering))
    margins = DifferentialInverseKinematicsSystem.JointVelocityLimitConstraint.Config()
    margins.min_margin, margins.influence_margin = 0.0, _LIMIT_INFLUENCE
    rates = np.full(hand.kinematics.num_positions, LARGEST_RATE)
    endless = np.full(hand.kinematics.num_positions, np.inf)
    limits = JointLimits(
        hand.kinematics.lower, hand.kinematics.upper, -rates, rates, -endless, endless
    )
    recipe.AddIngredient(
        DifferentialInverseKinematicsSystem.JointVelocityLimitConstraint(margins, limits)
    )
    return DifferentialInverseKinematicsSystem(
        recipe=recipe,
        task_frame="world",
        collision_checker=hand.checker,
        active_dof=DofMask([True] * hand.kinematics.num_positions),
        time_step=period,
        K_VX=1.0,
        Vd_TG_limit=_LARGEST_TWIST,
    )
