"""What hides an object from a camera, in scenes whose answer is known."""

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


def share(shape=None, X_WB=None, X_WO=None):
    """Returns the visible share of a cube with a body in the scene."""
    builder = RobotDiagramBuilder()
    plant = builder.plant()
    for name, solid in (("object", Box(0.1, 0.1, 0.1)), ("link", shape)):
        if solid is not None:
            body = plant.AddRigidBody(name, SpatialInertia.SolidCubeWithDensity(1e3, 0.1))
            plant.RegisterVisualGeometry(body, RigidTransform(), solid, name, GREY)
    plant.Finalize()
    graph = builder.scene_graph()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    if shape is not None:
        pose = X_WB or RigidTransform()
        plant.SetFreeBodyPose(plant.GetMyMutableContextFromRoot(context), body, pose)
    query = graph.get_query_output_port().Eval(graph.GetMyContextFromRoot(context))
    system = Driven(VisibleShare(CAMERA, CUBE, graph.model_inspector()))
    system.fix(X_WO=X_WO or RigidTransform(), query_object=AbstractValue.Make(query))
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
