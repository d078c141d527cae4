"""The port block in each system's docstring equals the real ports, in their order."""

import importlib
import inspect
import itertools
import pkgutil
import re
from importlib.util import find_spec

import numpy as np
import pytest
import yaml
from driven import port_names
from five_finger_hand import HAND
from made_systems import AROUND, FRAMES
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.planning import RobotDiagramBuilder
from pydrake.systems.framework import Diagram, System

import drake_pregrasp.diagrams
import drake_pregrasp.studies
import drake_pregrasp.systems
from drake_pregrasp import LimitsConfig, load_scenario
from drake_pregrasp.diagrams.hand_parsing import add_hand_model
from drake_pregrasp.geometry.solids import BoxSolid
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.studies.grasps.baseline_goals import (
    RayTarget,
    ReactiveChoice,
    StationaryHand,
)
from drake_pregrasp.systems.mujoco_plant import MujocoPlant
from drake_pregrasp.systems.object_drag import ObjectDrag

pytestmark = pytest.mark.slow  # Diagrams of many scenarios are made.

CORNERS = np.array(list(itertools.product((-1, 1), repeat=3)))
SCENARIOS = (
    *("catch_tossed", "pose_stream", "reach", "passing_ball", "see_and_grasp", "catch_handed_over"),
    "see_by_profile",
)
"""Scenarios whose diagrams hold all systems but those of studies and arms; the last sensor of poses
has all ports."""


def all_parts(system):
    yield system
    for part in system.GetSystems() if isinstance(system, Diagram) else []:
        yield from all_parts(part)


def made_diagrams():
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    for name in SCENARIOS:
        scenario = load_scenario(name)
        sinks = {"sink": print, "grasp_sink": print, "picture_sink": print}
        forces = [("object_drag", ObjectDrag)]
        yield make_diagram(scenario, meshcat=meshcat, forces=forces, **sinks)


def mujoco_plants():
    """MuJoCo with a hand, if the extra `mujoco` is installed."""
    if find_spec("mujoco"):
        builder = RobotDiagramBuilder(time_step=0.01)
        add_hand_model(builder.plant(), HAND.description)
        builder.plant().Finalize()
        diagram = builder.Build()
        yield MujocoPlant(diagram.plant(), diagram.scene_graph().model_inspector())


@pytest.fixture(scope="module")
def systems() -> dict[type, System]:
    limits = LimitsConfig(tip_radii=[0.009] * 5)
    solid, corners = BoxSolid(np.zeros(3), np.eye(3), np.full(3, 0.1)), 0.05 * CORNERS
    cube = {"target": RayTarget(solid, corners, np.zeros(3)), "limits": limits}
    stationary = StationaryHand(FRAMES, azimuths=AROUND, **cube)
    others = (
        *mujoco_plants(),
        ReactiveChoice(FRAMES, **cube, period=0.05),
    )
    alone = stationary, *others
    made = itertools.chain(alone, *map(all_parts, made_diagrams()))
    by_class = {type(system): system for system in made}
    return {c: s for c, s in by_class.items() if c.__module__.startswith("drake_pregrasp")}


def system_classes() -> set[type]:
    found = set()
    for package in (drake_pregrasp.systems, drake_pregrasp.diagrams, drake_pregrasp.studies):
        for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            for name, member in inspect.getmembers(importlib.import_module(module.name)):
                ours = getattr(member, "__module__", "").startswith("drake_pregrasp")
                public = ours and not name.startswith("_")
                if public and inspect.isclass(member) and issubclass(member, System):
                    found.add(member)
    return found


def test_every_system_is_looked_at(systems) -> None:
    assert system_classes() - set(systems) <= ({MujocoPlant} if not find_spec("mujoco") else set())


def test_port_blocks_equal_the_ports(systems) -> None:
    for system_class, system in systems.items():
        doc = inspect.getdoc(system_class) or ""
        block = doc.split(".. pydrake_system::\n\n")[1].split("\n\n")[0]
        documented = yaml.safe_load(inspect.cleandoc(block))
        assert documented["name"] == system_class.__name__
        listed = documented.get("input_ports", []), documented.get("output_ports", [])
        assert listed == port_names(system), system_class


def test_every_port_has_a_sentence(systems) -> None:
    docs = {c.__name__: inspect.getdoc(c) or "" for c in systems}
    for system_class, system in systems.items():
        doc = docs[system_class.__name__]
        if like := re.search(r"ports are those of `(\w+)`", doc):
            doc += docs[like.group(1)]
        assert [
            name for name in itertools.chain(*port_names(system)) if f"`{name}`" not in doc
        ] == []


def test_updates_are_at_multiples_of_their_periods(systems) -> None:
    timings = {
        c.__name__: system.GetUniquePeriodicDiscreteUpdateAttribute()
        for c, system in systems.items()
        if not issubclass(c, Diagram)
    }
    updating = {name: timing for name, timing in timings.items() if timing is not None}
    assert len(updating) > 5
    assert {name for name, timing in updating.items() if timing.offset_sec() != 0} == set()
