"""Dynamic pre-grasp planning for hands that track a moving object, made of Drake systems."""

__version__ = "0.1.0"

from drake_pregrasp.diagrams.object_plant import ObjectPlant
from drake_pregrasp.diagrams.pregrasp_planner import (
    AddPregraspPlanner,
    PlannerConfig,
    PregraspPlanner,
)
from drake_pregrasp.errors import InvalidArgumentError, OutputError, PregraspError, ScenarioError
from drake_pregrasp.planning.contact_selection import ContactStatus
from drake_pregrasp.planning.surface import ForbiddenPoints, ObjectSurface, box_surface
from drake_pregrasp.simulation.run import RunResult, run
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import load_scenario, shipped_scenarios
from drake_pregrasp.simulation.simulation_diagram import make_diagram

__all__ = [
    "AddPregraspPlanner",
    "ContactStatus",
    "ForbiddenPoints",
    "InvalidArgumentError",
    "ObjectPlant",
    "ObjectSurface",
    "OutputError",
    "PlannerConfig",
    "PregraspError",
    "PregraspPlanner",
    "RunResult",
    "Scenario",
    "ScenarioError",
    "box_surface",
    "load_scenario",
    "make_diagram",
    "run",
    "shipped_scenarios",
]
