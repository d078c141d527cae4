"""What a scenario's hand asks of the planner."""

from dataclasses import replace

from drake_pregrasp.diagrams.pregrasp_planner import PlannerConfig
from drake_pregrasp.simulation.hand_file import load_hand
from drake_pregrasp.simulation.scenario import Scenario


def hand_planner(scenario: Scenario) -> PlannerConfig:
    """Returns a scenario's planner, with faces forbidden to fingers as its hand's description says.

    The scenario's own limits come first.
    """
    config = scenario.planner
    if not scenario.grasp.has_hand or config.limits.forbidden_faces:
        return config
    faces = [tip.forbidden_faces for tip in load_hand(scenario.grasp.hand).fingertips]
    if not any(faces):
        return config
    return replace(config, limits=replace(config.limits, forbidden_faces=faces))
