"""First contacts of a scenario's hand, and the limits that it sets to the planner."""

from dataclasses import replace
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np
from pydrake.math import RigidTransform

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.config.grasp_config import hand_limits
from drake_pregrasp.config.limits_config import LimitsConfig
from drake_pregrasp.config.planner_config import PlannerConfig
from drake_pregrasp.contacts.assignment import make_room, palm_turn
from drake_pregrasp.contacts.start_contacts import StartContacts
from drake_pregrasp.diagrams.expected_path import expected_poses, initial_pose
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.hand_station import TABLE
from drake_pregrasp.diagrams.start_grasp import choose_contacts, start_constraints
from drake_pregrasp.geometry.surface import ObjectSurface

if TYPE_CHECKING:
    from drake_pregrasp.simulation.scenario import Scenario


def hand_planner(scenario: "Scenario") -> PlannerConfig:
    """Returns the planner's configuration, with the limits of the scenario's hand if it has one.

    Limits of the scenario take precedence over those of the hand. The forbidden faces of a finger
    are those of the scenario and those of the hand.
    """
    config, grasp = scenario.planner, scenario.grasp
    if not grasp.has_hand:
        return config
    own, default = config.limits, LimitsConfig()
    hand = scenario.load_hand_model().description
    limits = hand_limits(hand, grasp, reach=grasp.use_reach)
    given = {name: value for name, value in vars(own).items() if value != getattr(default, name)}
    if len(own.forbidden_faces) == len(limits.forbidden_faces):
        both = zip(own.forbidden_faces, limits.forbidden_faces, strict=True)
        given["forbidden_faces"] = [list(dict.fromkeys([*a, *b])) for a, b in both]
    return replace(config, limits=replace(limits, **given))


def initial_contacts(scenario: "Scenario", surface: ObjectSurface) -> tuple[FloatArray, BoolArray]:
    """Returns the initial contacts in O, shape (n, 3), in metres, and which have room, shape (n,).

    Given contacts whose fingertips overlap are replaced by others on the allowed surface. A finger
    for which there is none within its reach stays away from the object.

    Args:
        scenario: Scenario whose other values have been checked.
        surface: Surface of the object, from `scenario.make_surface()`.
    """
    if scenario.chooses_contacts:
        start = chosen_contacts(scenario, surface)
        return start.p_OC, start.has_contact
    p_OC, grasp = scenario.initial_p_OC(surface), scenario.grasp
    if not grasp.has_hand:
        return p_OC, np.ones(len(p_OC), dtype=bool)
    hand, X_WO = scenario.load_hand_model(), initial_pose(scenario.motion, scenario.object)
    yaw_range = hand.yaw_range(grasp.yaw_range)
    R_WO = X_WO.rotation().matrix()
    yaw = palm_turn((p_OC - surface.p_OCoM) @ R_WO.T, hand.azimuths, 0.0, yaw_range)
    limits = hand_planner(scenario).limits
    return make_room(surface, p_OC, start_constraints(limits, X_WO, [TABLE.solid], yaw_range)(yaw))


_chosen: WeakKeyDictionary[ObjectSurface, dict[str, StartContacts]] = WeakKeyDictionary()


def chosen_contacts(scenario: "Scenario", surface: ObjectSurface) -> StartContacts:
    """Returns the first contacts that are chosen for a scenario's hand, from a cache if possible.

    Args:
        scenario: Scenario whose other values have been checked.
        surface: Surface of the object, from `scenario.make_surface()`.

    Raises:
        NoGraspError: If there are none.
    """
    hand, grasp = scenario.load_hand_model(), scenario.grasp
    X_WO, limits = initial_pose(scenario.motion, scenario.object), hand_planner(scenario).limits
    mass = scenario.object.mass
    key = repr((id(hand), grasp, limits, mass, scenario.motion, X_WO.GetAsMatrix4().tolist()))
    known = _chosen.setdefault(surface, {})
    if key not in known:
        known[key] = choose_contacts(
            hand,
            grasp,
            limits,
            surface,
            solid=scenario.object.make_shape().solid,
            mass=mass,
            X_WO=X_WO,
            fixed=[TABLE.solid],
            path=[X_WO for _, X_WO in followed_path(scenario, hand)],
        )
    return known[key]


def followed_path(scenario: "Scenario", hand: HandModel) -> list[tuple[float, RigidTransform]]:
    """Returns some times, in seconds, and expected poses X_WO until the hand comes to rest."""
    rest = scenario.grasp.latest_rest(hand.description.fingertips)
    end = min(scenario.simulation_duration, rest)
    poses = expected_poses(scenario.motion, end, scenario.object)
    return poses[:: max(1, len(poses) // 3)]
