"""The visible share of an object, in scenes whose answer is known."""

import numpy as np
import pytest
import trimesh
from driven import Driven
from pydrake.common.value import AbstractValue
from pydrake.geometry import Box, HalfSpace, Sphere
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.tree import SpatialInertia
from pydrake.planning import RobotDiagramBuilder

from drake_pregrasp.systems.visible_share import VisibleShare

GREY = np.array([0.5, 0.5, 0.5, 1.0])
CAMERA = np.array([1.0, 0.0, 0.0])
CUBE = trimesh.creation.box([0.1] * 3)


def share(shape=None, X_WB=None, X_WO=None, X_FW=None):
    """Returns the visible share of a cube with a body, in a scene that X_FW moves."""
    X_FW = X_FW or RigidTransform()
    builder = RobotDiagramBuilder()
    plant = builder.plant()
    bodies = {}
    for name, solid in (("object", Box(0.1, 0.1, 0.1)), ("link", shape)):
        if solid is not None:
            inertia = SpatialInertia.SolidCubeWithDensity(1e3, 0.1)
            body = bodies[name] = plant.AddRigidBody(name, inertia)
            plant.RegisterVisualGeometry(body, RigidTransform(), solid, name, GREY)
    plant.Finalize()
    graph = builder.scene_graph()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    if shape is not None:
        pose, body = X_FW @ (X_WB or RigidTransform()), bodies["link"]
        plant.SetFreeBodyPose(plant.GetMyMutableContextFromRoot(context), body, pose)
    query = graph.get_query_output_port().Eval(graph.GetMyContextFromRoot(context))
    frame = plant.GetBodyFrameIdOrThrow(bodies["object"].index())
    system = Driven(VisibleShare(X_FW @ CAMERA, CUBE, graph.model_inspector(), frame))
    system.fix(X_WO=X_FW @ (X_WO or RigidTransform()), query_object=AbstractValue.Make(query))
    return system.array("visible_share")[0]


def test_nothing_in_the_way_hides_nothing_nor_does_the_object_itself():
    assert share() == 1.0


@pytest.mark.parametrize("x", [0.2, 0.5, 0.8])
def test_a_plate_hides_all_wherever_it_is_between_and_nothing_elsewhere(x):
    plate = Box(0.01, 0.3, 0.3)
    assert share(plate, RigidTransform([x, 0, 0])) == 0.0
    for place in ([-x, 0, 0], [1 + x, 0, 0], [x, 0.4, 0]):
        assert share(plate, RigidTransform(place)) == 1.0


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_a_plate_over_half_of_the_sight_hides_half(turn):
    X_WB = RigidTransform(RollPitchYaw(turn, 0, 0), [0.5, 0, 0]) @ RigidTransform([0, 0, 0.5])
    assert share(Box(0.01, 3.0, 1.0), X_WB) == pytest.approx(0.5, abs=0.08)


def test_a_ball_hides_its_disc_and_not_the_corners_of_its_box():
    """The shadow of a ball in the middle has twice its radius on the near side of the cube."""
    side, radius = 0.1, 0.02
    found = share(Sphere(radius), RigidTransform([0.525, 0, 0]))
    assert found == pytest.approx(1 - np.pi * (2 * radius) ** 2 / side**2, abs=0.08)


def test_an_object_that_moves_behind_a_plate_is_hidden():
    plate, X_WB = Box(0.01, 0.3, 0.3), RigidTransform([0.5, 0.3, 0])
    found = [share(plate, X_WB, RigidTransform([0, y, 0])) for y in (0.0, 0.15, 0.3, 0.6)]
    assert found[0] == 1.0
    assert found[3] == 0.0
    assert found == sorted(found, reverse=True)


def test_half_spaces_count_as_empty():
    assert share(HalfSpace(), RigidTransform([0, 0, -1])) == 1.0


@pytest.mark.parametrize("shape", [Box(0.02, 0.05, 0.3), Sphere(0.03)])
def test_a_rigid_motion_of_the_scene_changes_nothing(shape):
    rng = np.random.default_rng(5)
    for _ in range(4):
        X_FW = RigidTransform(RollPitchYaw(*rng.uniform(-3, 3, 3)), rng.normal(size=3))
        X_WB = RigidTransform(RollPitchYaw(*rng.uniform(-3, 3, 3)), [0.4, 0.02, 0.01])
        X_WO = RigidTransform(RollPitchYaw(*rng.uniform(-3, 3, 3)), [0.0, 0.01, 0.0])
        here = share(shape, X_WB, X_WO)
        assert 0.05 < here < 0.95
        assert share(shape, X_WB, X_WO, X_FW) == pytest.approx(here, abs=1e-9)


def test_what_is_behind_the_camera_hides_nothing():
    for shape in (Sphere(0.2), Box(0.2, 0.4, 0.4)):
        assert share(shape, RigidTransform([1.3, 0, 0])) == 1.0
