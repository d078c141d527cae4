"""An object in a plant of one's own has the contact of scenarios, or a warning says why not."""

import warnings

import numpy as np
import pytest
from plants.own_plants import see_and_close
from pydrake.common import MemoryFile
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddRigidHydroelasticProperties,
    Capsule,
    InMemoryMesh,
    ProximityProperties,
    Sphere,
)
from pydrake.geometry import Mesh as MeshGeometry
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    CoulombFriction,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from thin_cup import PROFILE

import drake_pregrasp as dp
from drake_pregrasp.diagrams.object_contact import contact_problems
from drake_pregrasp.geometry.mesh_surface import PartArea
from drake_pregrasp.resources import resource_folder

CUP = dp.Revolved(profile=PROFILE, mass=0.2)
RADIUS = 0.009
BUILDERS = []


def plant_with(add_body, link=None, tip_is_hydroelastic=True, **config):
    """A plant with an object and a ball or another link over it."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(MultibodyPlantConfig(time_step=0.01, **config), builder)
    body = add_body(plant)
    instance = plant.AddModelInstance("link")
    finger = plant.AddRigidBody("link", instance, SpatialInertia.SolidSphereWithMass(0.05, RADIUS))
    properties = ProximityProperties()
    properties.AddProperty("material", "coulomb_friction", CoulombFriction(0.7, 0.7))
    if tip_is_hydroelastic:
        AddCompliantHydroelasticProperties(0.003, 1e8, properties)
    shape = link or Sphere(RADIUS)
    tip = plant.RegisterCollisionGeometry(finger, RigidTransform(), shape, "tip", properties)
    plant.Finalize()
    BUILDERS.append(builder)  # Which owns the plant.
    return plant, scene_graph, body, tip


def own_mesh(add_hydroelastic_properties=None):
    """Adds the cup as other people would."""

    def add_body(plant):
        mesh = CUP.make_shape().mesh
        body = plant.AddRigidBody(
            "cup", plant.AddModelInstance("cup"), SpatialInertia.SolidSphereWithMass(0.2, 0.03)
        )
        file = MemoryFile(mesh.export(file_type="obj"), ".obj", "cup")
        properties = ProximityProperties()
        if add_hydroelastic_properties:
            add_hydroelastic_properties(properties)
        shape = MeshGeometry(mesh_data=InMemoryMesh(mesh_file=file))
        plant.RegisterCollisionGeometry(body, RigidTransform(), shape, "mesh", properties)
        return body

    return add_body


def problems_of(plant, scene_graph, body, tip):
    inspector, volume = scene_graph.model_inspector(), CUP.make_shape().mesh.volume
    return list(contact_problems(plant, inspector, body, [tip], volume))


def added(plant):
    return dp.add_object(plant, CUP.make_shape(), CUP.mass)


@pytest.mark.parametrize(
    ("link", "is_hydroelastic"),
    [(None, True), (None, False), (Capsule(RADIUS, 0.02), True), (Capsule(RADIUS, 0.02), False)],
)
def test_an_object_that_is_added_has_no_problem(link, is_hydroelastic):
    plant, scene_graph, body, tip = plant_with(added, link, is_hydroelastic)
    for _ in range(2):  # The second call changes nothing.
        dp.separate_contacts(plant, scene_graph, body, is_convex=False)
        hull, surface = plant.GetCollisionGeometriesForBody(body)
        inspector = scene_graph.model_inspector()
        assert inspector.CollisionFiltered(tip, hull)
        assert not inspector.CollisionFiltered(tip, surface)
        assert problems_of(plant, scene_graph, body, tip) == []


def rigid(properties):
    AddRigidHydroelasticProperties(properties)


def compliant(properties):
    AddCompliantHydroelasticProperties(0.01, 1e7, properties)


@pytest.mark.parametrize(
    ("properties", "tip_is_hydroelastic", "expected"),
    [
        (rigid, True, []),
        (rigid, False, ["meet the convex hull"]),
        (compliant, True, ["meet the convex hull"]),
        (None, True, ["has no hydroelastic properties", "meet the convex hull"]),
    ],
)
def test_a_mesh_whose_hollow_is_filled_is_warned_of(properties, tip_is_hydroelastic, expected):
    there = plant_with(own_mesh(properties), tip_is_hydroelastic=tip_is_hydroelastic)
    found = problems_of(*there)
    assert len(found) == len(expected)
    assert all(words in problem for words, problem in zip(expected, found, strict=True))


@pytest.mark.parametrize("completes", [False, True])
def test_fingertips_that_are_added_are_compliant(completes):
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(MultibodyPlantConfig(time_step=0.01), builder)
    cup = own_mesh(rigid)(plant)
    hand = dp.load_hand("package://drake_pregrasp/five_finger_hand.yaml")
    if completes:
        dp.complete_hand_model(plant, hand, dp.add_hand_model(plant, hand), scene_graph=scene_graph)
    else:
        dp.add_hand_model(plant, hand, scene_graph=scene_graph)
    plant.Finalize()
    inspector = scene_graph.model_inspector()
    links = {
        geometry: inspector.GetProximityProperties(geometry)
        for index in plant.GetBodyIndices(plant.GetModelInstanceByName("hand"))
        for geometry in plant.GetCollisionGeometriesForBody(plant.get_body(index))
    }
    tips = [g for g, own in links.items() if own.HasProperty("hydroelastic", "compliance_type")]
    moduli = [links[g].GetProperty("hydroelastic", "hydroelastic_modulus") for g in tips]
    frictions = [links[g].GetProperty("material", "coulomb_friction") for g in tips]
    assert moduli == [1e8] * 5
    assert min(friction.static_friction() for friction in frictions) > 0
    radii = [inspector.GetShape(geometry).radius() for geometry in tips]
    np.testing.assert_allclose(radii, [tip.radius for tip in hand.fingertips])
    assert list(contact_problems(plant, inspector, cup, tips, CUP.make_shape().mesh.volume)) == []


def test_points_of_contact_are_warned_of():
    (problem,) = problems_of(*plant_with(added, contact_model="point"))
    assert "contact_model is point" in problem


def test_a_body_of_another_kind_is_not_separated():
    plant, scene_graph, body, _ = plant_with(own_mesh(rigid))
    with pytest.raises(dp.InvalidArgumentError, match="cup must be a body from add_object"):
        dp.separate_contacts(plant, scene_graph, body, is_convex=False)


def test_objects_that_cannot_be_added_are_refused():
    plant, shape = MultibodyPlant(0.01), CUP.make_shape()
    dp.add_object(plant, shape, 0.2, name="cup")
    for arguments, problem in (
        ({"mass": 0.2, "name": "cup"}, "model instance cup already"),
        ({"mass": 0.0}, "mass must be greater than 0"),
    ):
        with pytest.raises(dp.InvalidArgumentError, match=problem):
            dp.add_object(plant, shape, **arguments)
    plant.Finalize()
    with pytest.raises(dp.InvalidArgumentError, match="before the plant is finalized"):
        dp.add_object(plant, shape, 0.2)


MUG = dp.Mesh(file=str(resource_folder("models") / "mug.obj"), mass=0.3)


def hand_over_mug(add_mug):
    """Adds a hand over a mug on a table, and returns the diagram, the plant and the controller."""
    shape, builder = MUG.make_shape(), DiagramBuilder()
    settings = MultibodyPlantConfig(time_step=0.01, use_sampled_output_ports=False)
    plant, scene_graph = AddMultibodyPlant(settings, builder)
    parser = Parser(plant)
    dp.add_to_package_map(parser)
    parser.AddModelsFromUrl("package://drake_pregrasp/table.sdf")
    mug = add_mug(plant, shape)
    hand = dp.load_hand("package://drake_pregrasp/five_finger_hand.yaml")
    robot = dp.add_hand_model(plant, hand)
    plant.Finalize()
    height = -float(np.min(shape.mesh.vertices[:, 2]))
    X_WO = RigidTransform([*-shape.p_OCoM[:2], height])
    plant.SetDefaultFloatingBaseBodyPose(mug, X_WO)
    tip = dp.GraspConfig().tip_size(hand.fingertips)
    areas = [PartArea(shape.part(name)) for name in ("inside", "handle")]
    controller, planner = dp.AddHandController(
        builder,
        hand,
        dp.mesh_surface(shape, spacing=0.006, no_touch=areas, tip=tip),
        dp.PlannerConfig(static_duration=0.0),
        plant=plant,
        robot=robot,
        mass=MUG.mass,
        X_WO=X_WO,
        scene_graph=scene_graph,
    )
    see_and_close(builder, plant, mug, planner, controller)
    return builder.Build(), plant, controller


@pytest.mark.slow
def test_a_mug_in_a_plant_of_ones_own_is_held():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        diagram, plant, controller = hand_over_mug(
            lambda plant, shape: dp.add_object(plant, shape, MUG.mass, friction=0.7, name="mug")
        )
    simulator = Simulator(diagram)
    simulator.AdvanceTo(5.5)
    context = simulator.get_context()
    report = controller.GetOutputPort("grasp_report").Eval(controller.GetMyContextFromRoot(context))
    assert dp.GraspPhase(int(report[0])) == dp.GraspPhase.HOLD
    mug = plant.GetBodyByName("mug")
    X_WO = plant.EvalBodyPoseInWorld(plant.GetMyContextFromRoot(context), mug)
    assert X_WO.translation()[2] > 0.09
    assert X_WO.rotation().matrix()[2, 2] > 0.99


@pytest.mark.slow
def test_a_mug_that_fingertips_would_miss_is_warned_of():
    def add_mug(plant, shape):
        M = SpatialInertia.SolidSphereWithMass(0.3, 0.04)
        body = plant.AddRigidBody("mug", plant.AddModelInstance("mug"), M)
        file = MemoryFile(shape.mesh.export(file_type="obj"), ".obj", "mug")
        mesh, friction = (
            MeshGeometry(mesh_data=InMemoryMesh(mesh_file=file)),
            CoulombFriction(0.7, 0.7),
        )
        plant.RegisterCollisionGeometry(body, RigidTransform(), mesh, "mesh", friction)
        return body

    with pytest.warns(
        UserWarning, match="contact: mug has no hydro.* 5 of 5 fingertips meet the convex"
    ):
        hand_over_mug(add_mug)
