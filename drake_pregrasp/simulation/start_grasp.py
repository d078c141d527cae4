"""First contacts of a scenario's hand, and the limits that it sets to the planner."""

from dataclasses import replace
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np
from pydrake.math import RotationMatrix

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.config.grasp_config import hand_limits
from drake_pregrasp.config.limits_config import LimitsConfig
from drake_pregrasp.config.planner_config import PlannerConfig
from drake_pregrasp.contacts.assignment import make_room, palm_turn
from drake_pregrasp.contacts.start_contacts import (
    HandOverObject,
    StartContacts,
    choose_start_contacts,
)
from drake_pregrasp.diagrams.expected_path import initial_pose
from drake_pregrasp.diagrams.hand_station import TABLE
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.grasping.grasp_state import GraspSettings
from drake_pregrasp.regions.constraints import Obstacles, RegionConstraints
from drake_pregrasp.systems.grasp_sequencer import GRAVITY
from drake_pregrasp.systems.palm_posture import reach_frame

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


def initial_contacts(
    scenario: "Scenario", surface: ObjectSurface
) -> tuple[FloatArray, BoolArray]:
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
    hand = scenario.load_hand_model()
    R_WO = initial_pose(scenario.motion, scenario.object).rotation().matrix()
    yaw = palm_turn(
        (p_OC - surface.p_OCoM) @ R_WO.T, hand.azimuths, 0.0, hand.yaw_range(grasp.yaw_range)
    )
    return make_room(surface, p_OC, _constraints_at(scenario, yaw))


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
    key = repr((id(hand), grasp, limits, mass, X_WO.GetAsMatrix4().tolist()))
    known = _chosen.setdefault(surface, {})
    if key not in known:
        R_WO = X_WO.rotation().matrix()
        settings = grasp.make_settings(hand.description.fingertips)
        p_HT = hand.base.seen_from_object(hand.kinematics, hand.fingers_home)

        def holds_palm(yaw: float) -> bool:
            try:
                hand.home(X_WO.translation(), yaw)
            except InvalidArgumentError:
                return False
            return True

        known[key] = choose_start_contacts(
            surface,
            HandOverObject(
                constraints_at=lambda yaw: _constraints_at(scenario, yaw),
                p_OT_at=lambda yaw: p_HT @ (R_WO.T @ _turned(yaw)).T,
                azimuths=hand.azimuths,
                R_WO=R_WO,
                wrench=np.append(R_WO.T @ [0.0, 0.0, -GRAVITY * mass], np.zeros(3)),
                friction=grasp.planned_friction,
                normal_forces=np.array(
                    [np.full(len(p_HT), settings.least_force), settings.largest_force]
                ),
                yaw_range=hand.yaw_range(grasp.yaw_range),
                least_fingers=GraspSettings.least_fingers,
                holds_palm=holds_palm,
            ),
        )
    return known[key]


def _turned(yaw: float) -> FloatArray:
    return RotationMatrix.MakeZRotation(yaw).matrix()


def _constraints_at(scenario: "Scenario", yaw: float) -> RegionConstraints:
    """Returns the constraints of the contacts in O with the palm at a yaw, in radians."""
    X_WO, limits = initial_pose(scenario.motion, scenario.object), hand_planner(scenario).limits
    yaw_range = scenario.load_hand_model().yaw_range(scenario.grasp.yaw_range)
    R_WO, p_WO = X_WO.rotation().matrix(), X_WO.translation()
    R_OH = R_WO.T @ reach_frame(X_WO, yaw, yaw_range).rotation().matrix()
    return RegionConstraints(
        obstacles=Obstacles((TABLE.solid,)).moved(R_WO.T, -R_WO.T @ p_WO),
        clearance=limits.clearance,
        tip_radii=np.array(limits.tip_radii),
        tip_gap=limits.tip_gap,
        standoff=limits.standoff,
        reach=[reach and reach.moved(R_OH, np.zeros(3)) for reach in limits.reaches()],
        closed=limits.closed(),
    )
