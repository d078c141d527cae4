"""A hand that plans and grasps in a diagram of your own."""

import warnings
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from pydrake.geometry import GeometryId, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, ModelInstanceIndex, RigidBody
from pydrake.systems.framework import DiagramBuilder, System

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.config.hand_description import HandDescription
from drake_pregrasp.config.planner_config import PlannerConfig
from drake_pregrasp.contacts.hand_above_object import StartContacts
from drake_pregrasp.diagrams import start_grasp
from drake_pregrasp.diagrams.approaches import Approach, approaching_hands
from drake_pregrasp.diagrams.feasibility import check_torques
from drake_pregrasp.diagrams.hand_arguments import check_grasp_arguments, check_plant
from drake_pregrasp.diagrams.hand_controller import HandController
from drake_pregrasp.diagrams.hand_instances import (
    HandInstances,
    hand_ports,
    set_default_positions,
)
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.hand_parsing import read_model
from drake_pregrasp.diagrams.object_contact import (
    contact_problems,
    has_hull_and_surface,
    only_free_body,
    separate_contacts,
)
from drake_pregrasp.diagrams.object_plant import TABLE
from drake_pregrasp.diagrams.plant_match import base_pose, matching_joints
from drake_pregrasp.diagrams.pregrasp_planner import AddPregraspPlanner, PregraspPlanner
from drake_pregrasp.diagrams.wiring import connect, connect_inputs
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.fast import default_kernels
from drake_pregrasp.fast.kernels import Kernels
from drake_pregrasp.geometry.mesh_solid import MeshSolid
from drake_pregrasp.geometry.solids import SignedDistance, Solid
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.systems.sources import ContactWeights, MovingObstacles, MovingSolid


class GraspingHand(NamedTuple):
    """Systems that let a hand follow and grasp an object.

    Attributes:
        controller: Controller of the hand.
        planner: Planner of its contacts, and of its estimate of the object.
    """

    controller: HandController
    planner: PregraspPlanner


def add_grasping_hand(
    builder: DiagramBuilder,
    hand: HandModel,
    config: GraspConfig,
    planner: PlannerConfig,
    surface: ObjectSurface,
    start: StartContacts,
    *,
    object_solid: SignedDistance,
    mass: float,
    X_WO: RigidTransform,
    fixed: Sequence[Solid],
    plant_time_step: float,
    has_sampled_outputs: bool,
    weights: System,
    obstacles: System,
    kernels: Kernels,
    goals: System | None = None,
    seen_solid: MeshSolid | None = None,
) -> GraspingHand:
    """Adds a planner and a controller for a hand, and connects them to each other.

    The planner's input `X_WO_measured` or `point_cloud` must then be connected, the controller's
    inputs `close`, `hand_state` and `net_actuation`, and its output `desired_state`.

    Args:
        builder: Builder of the diagram.
        hand: Model of the hand with its approach.
        config: Configuration of the grasp.
        planner: Configuration of the planner, with the limits of the hand.
        surface: Surface of the object.
        start: Initial contacts, one for each finger, and yaw of the palm.
        object_solid: The object in O.
        mass: Mass of the object, in kg.
        X_WO: Pose of an object over which the hand starts; mostly its initial pose.
        fixed: Solids in W that fingertips avoid, such as the table.
        plant_time_step: Time step of the hand's plant, in seconds.
        has_sampled_outputs: Whether its actuation is that of its last time step.
        weights: System that emits `contact_weights`.
        obstacles: System that emits the `obstacles` of contacts, `fixed` among them.
        kernels: Implementation of what takes most of a tick, for planner and controller.
        goals: System that emits the hand's `fingertip_targets` and `contact_status`; None for the
            planner. It is added, and its input ports are connected to the output ports of the same
            names of planner, controller, `weights` and `obstacles`.
        seen_solid: The object in O, for the planner's `point_cloud`; None without.

    Raises:
        InvalidArgumentError: If no output port has the name of an input port of `goals`.
    """
    controller = builder.AddNamedSystem(
        "hand_controller",
        HandController(
            config,
            hand,
            object_solid=object_solid,
            mass=mass,
            p_OCoM=surface.p_OCoM,
            fixed=list(fixed),
            X_WO=X_WO,
            p_OC=start.p_OC,
            yaw=start.yaw,
            yaw_slack=start.yaw_slack,
            # Goals of another source do not wait for the planner's ticks.
            target_period=planner.period if goals is None else config.period,
            plant_time_step=plant_time_step,
            has_sampled_outputs=has_sampled_outputs,
            gravity=planner.estimator.gravity,
            diffusion=planner.estimator.acceleration**2,
            kernels=kernels,
        ),
    )
    planning = AddPregraspPlanner(
        builder,
        planner,
        surface,
        start.p_OC,
        fingertip_frames=hand.kinematics.tip_frames,
        finger_measures=hand.fingers.measures if planner.needs_finger_measures else None,
        object_solid=seen_solid,
        tip_radii=hand.tip_radii,
        kernels=kernels,
    )
    connect(builder, weights, "contact_weights", planning)
    connect(builder, obstacles, "obstacles", planning)
    source: System = planning
    if goals is not None:
        source = builder.AddNamedSystem("goal_source", goals)
        connect_inputs(builder, source, planning, controller, weights, obstacles)
    connect(builder, source, "fingertip_targets contact_status", controller)
    connect(builder, planning, "X_WO_estimated V_WO_estimated tracking_status", controller)
    connect(builder, planning, "p_WO_covariance camera_offset", controller)
    connect(builder, controller, "hold_contacts V_WO_held X_WU p_WT touching", planning)
    connect(builder, controller, "late_fingers", planning)
    if planner.limits.reach:
        connect(builder, controller, "X_WH", planning)
    return GraspingHand(controller, planning)


def AddHandController(
    builder: DiagramBuilder,
    hand: HandDescription,
    surface: ObjectSurface,
    planner: PlannerConfig,
    *,
    plant: MultibodyPlant,
    robot: ModelInstanceIndex | Sequence[ModelInstanceIndex],
    mass: float,
    X_WO: RigidTransform,
    config: GraspConfig | None = None,
    p_OC: FloatArray | None = None,
    object_solid: SignedDistance | None = None,
    fixed: Sequence[Solid] = (TABLE.solid,),
    scene_graph: SceneGraph | None = None,
    body: RigidBody | None = None,
) -> GraspingHand:
    """Adds a planner and a controller for a hand, and connects them to each other and to a plant.

    The base stands where the plant has it. The approach is chosen among those of
    `config.approaches` for which it stands so: an arm for all of them; a carrier from the side if
    `X_WB` of `add_hand_model` was that of `choose_approach(...).hand`. The default positions of the
    robot become those in which the hand starts, over the object. The planner's input
    `X_WO_measured` and the controller's input `close` must then be connected.

    Args:
        builder: Builder of the diagram, with the plant.
        hand: Description of the hand, from `load_hand`.
        surface: Surface of the object.
        planner: Configuration of the planner; limits of the hand are added.
        plant: A finalized plant with the robot; see `add_hand_model` and `complete_hand_model`.
        robot: Model instances of the hand and of what carries it, in the plant.
        mass: Mass of the object, in kg.
        X_WO: Initial pose of the object.
        config: Configuration of the grasp; None for the default.
        p_OC: Initial contacts in O, one for each finger, shape (n, 3), in metres. None: fingers,
            contacts and the palm's yaw are chosen.
        object_solid: The object in O; None for the inside of the surface's mesh.
        fixed: Solids in W that fingertips avoid, such as the table.
        scene_graph: SceneGraph of the plant, in which links of the same finger, and those of the
            base, no longer collide with each other, nor fingers with the base, and an object from
            `add_object` touches other bodies as in scenarios (`separate_contacts`). A
            `UserWarning` says if fingertips cannot hold the object. None: nothing changes.
        body: Body of the object, for its contact; None for the only free body of the plant.

    Raises:
        NoGraspError: If contacts are to be chosen, but there is no grasp, as where an arm cannot
            hold the palm at the object, or the torques of the hand's joints cannot lift the weight.
        InvalidArgumentError: If an argument has another type or is out of its range, settings do
            not go together, the hand and its model, the robot in the plant, or given contacts and
            the fingers, do not match, an arm cannot hold the palm over given contacts, or the
            object or a link starts inside of `fixed`.
    """
    config = config or GraspConfig()
    check_plant(builder, plant, scene_graph, body)
    check_grasp_arguments(
        hand, surface, planner, config, mass=mass, X_WO=X_WO, p_OC=p_OC, fixed=fixed
    )
    instances = HandInstances(plant, robot)
    for key, problem in start_grasp.settings_problems(
        config, planner, hand, mass=mass, time_step=plant.time_step()
    ):
        raise InvalidArgumentError(f"{key}: {problem}")
    solid = object_solid or MeshSolid.of(surface.mesh)
    # Whoever added the robot to the plant has seen warnings about its model.
    upright = HandModel(hand, config.yaw_range, model=read_model(hand.model))
    X_WB = base_pose(upright, instances)
    hands = approaching_hands(upright, config, surface, X_WO, fixed=fixed, X_WB=X_WB)
    model, start = start_grasp.best_start(
        hands, config, planner, surface, solid=solid, mass=mass, X_WO=X_WO, fixed=fixed, p_OC=p_OC
    )
    planner = start_grasp.hand_planner(planner, config, model.description)
    check_torques(model, config, surface, start, X_WO, mass)
    away = [(0.0, np.flatnonzero(~start.has_contact).tolist())]
    added = add_grasping_hand(
        builder,
        model,
        config,
        planner,
        surface,
        start,
        object_solid=solid,
        mass=mass,
        X_WO=X_WO,
        fixed=fixed,
        plant_time_step=plant.time_step(),
        has_sampled_outputs=plant.has_sampled_output_ports(),
        weights=builder.AddNamedSystem(
            "contact_weights", ContactWeights(np.zeros(len(start.p_OC)), away)
        ),
        obstacles=builder.AddNamedSystem(
            "obstacles", MovingObstacles([MovingSolid(solid, np.zeros(3)) for solid in fixed])
        ),
        kernels=default_kernels(),
    )
    if scene_graph is not None:
        links = model.separate_links(instances, scene_graph)
        tips = [geometry for geometry, link in links.items() if link.is_tip]
        _prepare_contact(plant, scene_graph, body, tips, surface)
    _connect_joints(builder, plant, matching_joints(model, instances), added.controller)
    return added


def _connect_joints(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    joints: Sequence[Joint],
    controller: HandController,
) -> None:
    """Starts a hand at the initial positions of its controller, and connects the two."""
    set_default_positions(joints, controller.initial)
    desired, state, actuation = hand_ports(builder, plant, joints)
    builder.Connect(controller.GetOutputPort("desired_state"), desired)
    builder.Connect(state, controller.GetInputPort("hand_state"))
    builder.Connect(actuation, controller.GetInputPort("net_actuation"))


def _prepare_contact(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    body: RigidBody | None,
    fingertips: Sequence[GeometryId],
    surface: ObjectSurface,
) -> None:
    """Separates the contacts of an object, and warns if fingertips cannot hold it."""
    if (body := body or only_free_body(plant)) is None:
        if not plant.GetFloatingBaseBodies():
            problem = "no body is free, so the hand would close on nothing"
            warnings.warn(f"plant: {problem}; see add_object, or pass body", stacklevel=3)
        return
    inspector, mesh = scene_graph.model_inspector(), surface.mesh
    if has_hull_and_surface(plant, inspector, body):
        separate_contacts(plant, scene_graph, body, is_convex=mesh.is_convex)
    problems = list(contact_problems(plant, inspector, body, fingertips, mesh.volume))
    if problems:
        warnings.warn(f"contact: {'; '.join(problems)}", stacklevel=3)


def choose_approach(
    hand: HandDescription,
    surface: ObjectSurface,
    planner: PlannerConfig,
    *,
    mass: float,
    X_WO: RigidTransform,
    config: GraspConfig | None = None,
    p_OC: FloatArray | None = None,
    object_solid: SignedDistance | None = None,
    fixed: Sequence[Solid] = (TABLE.solid,),
    X_WB: RigidTransform | None = None,
) -> Approach:
    """Returns the approach of `config.approaches` with the best start contacts.

    The arguments are those of `AddHandController`.

    Args:
        hand: Description of the hand.
        surface: Surface of the object.
        planner: Configuration of the planner.
        mass: Mass of the object, in kg.
        X_WO: Initial pose of the object.
        config: Configuration of the grasp; None for the default.
        p_OC: Initial contacts in O, shape (n, 3), in metres; None to choose them.
        object_solid: The object in O; None for the inside of the surface's mesh.
        fixed: Solids in W that fingertips avoid, such as the table.
        X_WB: Pose of the base, as for `add_hand_model`; None: the origin of W, and for a carrier
            the orientation of the approach.

    Raises:
        NoGraspError: If contacts are to be chosen, but there is no grasp.
        InvalidArgumentError: If the hand and its model, or given contacts and the fingers, do not
            match, or the hand has the orientation of none of the approaches.
    """
    config = config or GraspConfig()
    check_grasp_arguments(
        hand, surface, planner, config, mass=mass, X_WO=X_WO, p_OC=p_OC, fixed=fixed
    )
    upright, solid = HandModel(hand, config.yaw_range), object_solid or MeshSolid.of(surface.mesh)
    hands = approaching_hands(upright, config, surface, X_WO, fixed=fixed, X_WB=X_WB)
    return start_grasp.best_start(
        hands, config, planner, surface, solid=solid, mass=mass, X_WO=X_WO, fixed=fixed, p_OC=p_OC
    )
