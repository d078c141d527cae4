"""What a scenario's hand asks of the planner."""

from dataclasses import replace

from drake_pregrasp.diagrams.limits_config import LimitsConfig
from drake_pregrasp.diagrams.pregrasp_planner import PlannerConfig
from drake_pregrasp.simulation.hand_file import load_hand
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.systems.fingertip_goal_shaper import OTHER_CLEARANCE


def hand_planner(scenario: Scenario) -> PlannerConfig:
    """Returns a scenario's planner, with limits that are those of its hand.

    With a hand whose fingers may not touch all faces, the planner knows it; with `use_reach` also
    what fingers reach, and the tips' size and gap. Limits that the scenario gives come first.
    """
    config, grasp = scenario.planner, scenario.grasp
    if not grasp.has_hand:
        return config
    tips, limits = load_hand(grasp.hand).fingertips, config.limits
    changes: dict[str, object] = {}
    faces = [tip.forbidden_faces for tip in tips]
    if any(faces) and not limits.forbidden_faces:
        changes["forbidden_faces"] = faces
    if grasp.use_reach and not limits.reach:
        changes["reach"] = [tip.reach for tip in tips]
    if grasp.use_reach and not limits.tip_radii:
        changes |= {
            "tip_radii": [tip.radius for tip in tips],
            "tip_gap": max(limits.tip_gap, OTHER_CLEARANCE),
            "standoff": limits.standoff or grasp.standoff,
        }
    changed: LimitsConfig = replace(limits, **changes)  # type: ignore[arg-type]
    return replace(config, limits=changed)
