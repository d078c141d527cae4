"""A scenario's planner, as its hand needs it."""

from dataclasses import replace

from drake_pregrasp.diagrams.hand_limits import hand_limits
from drake_pregrasp.diagrams.limits_config import LimitsConfig
from drake_pregrasp.diagrams.pregrasp_planner import PlannerConfig
from drake_pregrasp.simulation.hand_file import load_hand
from drake_pregrasp.simulation.scenario import Scenario


def hand_planner(scenario: Scenario) -> PlannerConfig:
    """Returns a scenario's planner, with the limits of its hand where it has one.

    What the scenario says of limits beyond their defaults comes first; but faces that are forbidden
    to a finger are those of the scenario and those of the hand.
    """
    config = scenario.planner
    if not scenario.grasp.has_hand:
        return config
    own, none = config.limits, LimitsConfig()
    limits = hand_limits(
        load_hand(scenario.grasp.hand), scenario.grasp, reach=scenario.grasp.use_reach
    )
    said = {name: value for name, value in vars(own).items() if value != getattr(none, name)}
    if len(own.forbidden_faces) == len(limits.forbidden_faces):
        both = zip(own.forbidden_faces, limits.forbidden_faces, strict=True)
        said["forbidden_faces"] = [list(dict.fromkeys([*a, *b])) for a, b in both]
    return replace(config, limits=replace(limits, **said))
