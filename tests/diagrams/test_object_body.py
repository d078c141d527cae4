"""The object as a body: its inertia, and how it stands on a table and is carried."""

import numpy as np
import pytest
import trimesh
from pydrake.geometry import Capsule
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    CoulombFriction,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from thin_cup import HEIGHT, PROFILE, WALL

from drake_pregrasp import ObjectPlant
from drake_pregrasp.config.object_config import Ball, Box, Conveyor, Cylinder, Mesh, Revolved
from drake_pregrasp.diagrams.object_body import add_object, resting_position
from drake_pregrasp.diagrams.object_plant import add_moving_object
from drake_pregrasp.geometry.random_objects import object_url
from drake_pregrasp.geometry.shapes import mesh_shape
from drake_pregrasp.resources import resource_folder

OBJECTS = {
    "box": Box(size=[0.05, 0.06, 0.1]),
    "cup": Revolved(profile=PROFILE, mass=0.2),
    "can": Cylinder(),
    "mug": Mesh(file=str(resource_folder("models") / "mug.obj")),
    "bracket": Mesh(file=str(resource_folder("models") / "bracket.obj"), mass=0.25),
    "ball": Ball(),
}
STANDING = ["cup", "can", "mug", "bracket"]


def spatial_inertia(config):
    plant = MultibodyPlant(0.01)
    body = add_object(plant, config.make_shape(), config.mass)
    plant.Finalize()
    return body.CalcSpatialInertiaInBodyFrame(plant.CreateDefaultContext())


@pytest.mark.parametrize("name", OBJECTS)
def test_the_body_has_the_inertia_of_its_mesh(name):
    config, M_O = OBJECTS[name], spatial_inertia(OBJECTS[name])
    mesh = config.make_shape().mesh
    assert M_O.get_mass() == pytest.approx(config.mass)
    np.testing.assert_allclose(M_O.get_com(), mesh.center_mass, atol=1e-9)
    central = M_O.Shift(M_O.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
    expected = mesh.moment_inertia * config.mass / mesh.volume
    np.testing.assert_allclose(central, expected, rtol=1e-6, atol=1e-9 * np.max(expected))


def test_a_ball_has_the_inertia_of_a_ball_up_to_its_facets():
    I_O = spatial_inertia(Ball(radius=0.04, mass=2.0)).CalcRotationalInertia()
    exact = 2.0 * UnitInertia.SolidSphere(0.04).CopyToFullMatrix3()
    np.testing.assert_allclose(I_O.CopyToFullMatrix3(), exact, atol=0.005 * exact[0, 0])


def carried(config, plant_config, v, w, times):
    plant = ObjectPlant(config, Conveyor(v, w), plant_config)
    simulator = Simulator(plant)
    for time in times:
        simulator.AdvanceTo(time)
        yield plant.GetOutputPort("X_WO").Eval(simulator.get_context())


def yaw(X_WO):
    return RollPitchYaw(X_WO.rotation()).yaw_angle()


@pytest.mark.parametrize("name", STANDING)
def test_it_stands_still_on_the_table_at_its_lowest_point(scenario, name):
    config, shape = OBJECTS[name], OBJECTS[name].make_shape()
    start = resting_position(config.make_shape())
    assert start[2] == pytest.approx(-np.min(shape.mesh.vertices[:, 2]), abs=2e-6)
    np.testing.assert_allclose((start + shape.p_OCoM)[:2], 0, atol=1e-12)
    (X_WO,) = carried(config, scenario.plant_config, 0.0, 0.0, [1.0])
    np.testing.assert_allclose(X_WO.translation(), start, atol=2e-5)
    # The bracket's weight is not over the middle of its base.
    assert np.arccos(min(X_WO.rotation().matrix()[2, 2], 1.0)) < 1e-3
    assert abs(yaw(X_WO)) < 1e-6


@pytest.mark.slow
def test_a_link_without_hydroelastic_properties_falls_into_a_cup_and_lies_on_its_bottom():
    """Drake alone would let it lie on the cup's hull."""
    builder, radius = DiagramBuilder(), 0.009

    def add_link(plant):
        M = SpatialInertia(0.05, np.zeros(3), UnitInertia.SolidSphere(radius))
        link = plant.AddRigidBody("link", plant.AddModelInstance("link"), M)
        capsule, friction = Capsule(radius, 0.02), CoulombFriction(0.7, 0.7)
        X_BG = RigidTransform(RollPitchYaw(0.0, np.pi / 2, 0.0), np.zeros(3))
        plant.RegisterCollisionGeometry(link, X_BG, capsule, "link", friction)
        plant.SetDefaultFloatingBaseBodyPose(link, RigidTransform([0.0, 0.0, HEIGHT / 2]))

    plant, *_ = add_moving_object(
        builder,
        OBJECTS["cup"].make_shape(),
        OBJECTS["cup"].mass,
        Conveyor(0.0, 0.0),
        MultibodyPlantConfig(time_step=0.002),
        add_more=add_link,
    )
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.5)
    context = plant.GetMyContextFromRoot(simulator.get_context())
    height = plant.GetBodyByName("link").EvalPoseInWorld(context).translation()[2]
    assert height == pytest.approx(WALL + radius, abs=3e-4)


@pytest.mark.parametrize("name", STANDING)
def test_the_conveyor_carries_it_at_its_speed(scenario, name):
    v, step = 0.02, scenario.plant_config.time_step
    places = carried(OBJECTS[name], scenario.plant_config, v, 0.0, [0.2, 1.0])
    early, late = (X_WO.translation().copy() for X_WO in places)
    np.testing.assert_allclose(late - early, [0.8 * v, 0, 0], atol=5e-5)
    # It starts from rest, and so lags by one step.
    gone = late[0] - resting_position(OBJECTS[name].make_shape())[0]
    assert gone == pytest.approx(v * (1 - step), abs=5e-5)


@pytest.mark.parametrize(
    ("size", "v", "w"),
    [
        ([0.1, 0.1, 0.1], 0.0, 0.0),
        ([0.1, 0.1, 0.1], 0.001, 0.0174),
        ([0.2, 0.2, 0.1], 0.02, -0.2),
        ([0.07, 0.07, 0.075], 0.0, 0.0),
    ],
)
def test_the_table_carries_a_box(scenario, size, v, w):
    (X_WO,) = carried(Box(size=size), scenario.plant_config, v, w, [3.0])
    step = scenario.plant_config.time_step  # The box starts from rest.
    moves = v != 0
    slip = 2 * abs(v) * step + moves * 1e-4 + 1e-8
    np.testing.assert_allclose(X_WO.translation()[:2], [3 * v, 0], atol=slip)
    assert X_WO.translation()[2] == pytest.approx(size[2] / 2, abs=1e-3)
    assert yaw(X_WO) == pytest.approx(3 * w, abs=2 * abs(w) * step + 1e-3)


def test_faces_that_are_almost_flat_make_a_body_too():
    """Drake refuses tetrahedra of a hull whose middle is beside a face of four corners."""
    pytest.importorskip("pybullet_data")
    pytest.importorskip("manifold3d")
    for index in (2, 8, 52):
        plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.01)
        body = add_object(plant, Mesh(object_url(index)).make_shape(), 0.3)
        assert len(scene_graph.model_inspector().GetAllGeometryIds()) >= 3, body.name()


@pytest.mark.parametrize("seed", [14, 33, 139, 210])
def test_thin_triangles_of_a_hull_do_not_stop_the_simulation(seed):
    # A box with more vertices, which rounding moves off its faces and edges by 4 nm.
    rng = np.random.default_rng(seed)
    corners = [[x, y, z] for x in (-0.03, 0.05) for y in (-0.05, 0.05) for z in (-0.05, 0.05)]
    on_edges = [[0.05, rng.uniform(-0.05, 0.05), 0.05] for _ in range(2)]
    on_edges += [[0.05, 0.05, rng.uniform(-0.05, 0.05)] for _ in range(2)]
    points = np.vstack([corners, on_edges]).astype(np.float32).astype(float)
    points += rng.choice([0, 4e-9, -4e-9], (12, 3)) * [0, 1, 1]
    mesh = trimesh.convex.convex_hull(points)
    assert np.min(mesh.area_faces) < 5e-11
    # The thin triangle is at x = 0.05: there it lies on the table.
    shape = mesh_shape(mesh, "box").turned(
        RollPitchYaw(0, np.pi / 2, 0).ToRotationMatrix().matrix()
    )
    config = MultibodyPlantConfig(time_step=0.01)
    plant = ObjectPlant(Box(), Conveyor(), config, shape=shape)
    simulator = Simulator(plant)
    simulator.AdvanceTo(0.05)
    z = plant.GetOutputPort("X_WO").Eval(simulator.get_context()).translation()[2]
    assert z == pytest.approx(0.05, abs=1e-5)
