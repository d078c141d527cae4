"""What a hand asks of the planner."""

from dataclasses import replace

from drake_pregrasp.diagrams.grasp_config import GraspConfig
from drake_pregrasp.diagrams.hand_description import HandDescription
from drake_pregrasp.diagrams.limits_config import LimitsConfig
from drake_pregrasp.diagrams.pregrasp_planner import PlannerConfig
from drake_pregrasp.simulation.hand_file import load_hand
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.systems.fingertip_goal_shaper import OTHER_CLEARANCE


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


def hand_planner(scenario: Scenario) -> PlannerConfig:
    """Returns a scenario's planner, with the limits of its hand where it has one.

    What the scenario says of limits beyond their defaults comes first.
    """
    config = scenario.planner
    if not scenario.grasp.has_hand:
        return config
    own, none = config.limits, LimitsConfig()
    limits = hand_limits(
        load_hand(scenario.grasp.hand), scenario.grasp, reach=scenario.grasp.use_reach
    )
    said = {name: value for name, value in vars(own).items() if value != getattr(none, name)}
    return replace(config, limits=replace(limits, **said))
