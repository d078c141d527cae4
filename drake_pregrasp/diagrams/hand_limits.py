"""What a hand asks of the planner."""

from drake_pregrasp.diagrams.grasp_config import GraspConfig
from drake_pregrasp.diagrams.hand_description import HandDescription
from drake_pregrasp.diagrams.limits_config import LimitsConfig
from drake_pregrasp.planning.tip_places import OTHER_CLEARANCE


def hand_limits(hand: HandDescription, grasp: GraspConfig, *, reach: bool = True) -> LimitsConfig:
    """Returns limits with which goals are those that a hand's fingertips can go to.

    Args:
        hand: The hand.
        grasp: How it grasps.
        reach: Whether to heed what fingers reach.
    """
    tips = hand.fingertips
    return LimitsConfig(
        tip_radii=[tip.radius for tip in tips],
        tip_gap=OTHER_CLEARANCE,
        clearance=OTHER_CLEARANCE,
        standoff=grasp.standoff,
        reach=[tip.reach for tip in tips] if reach else [],
        forbidden_faces=[tip.forbidden_faces for tip in tips],
        recover=True,
    )
