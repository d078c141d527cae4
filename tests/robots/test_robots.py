"""The pair as Drake sees it: arm and hand driven, level, light and possible."""

import logging
from xml.etree import ElementTree

import numpy as np
import pytest
from pydrake.geometry import Role
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import DiagramBuilder

from drake_pregrasp import HandModel, add_hand_model, load_hand
from drake_pregrasp.robots.robot_data import ROBOTS, find_robot_data
from drake_pregrasp.robots.robot_models import robot_model

TIPS = [f"link_{i}.0_tip" for i in (3, 7, 11, 15)]


def load():
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.01)
    add_hand_model(plant, load_hand("package://drake_pregrasp/allegro_panda.yaml"))
    plant.Finalize()
    return plant, scene_graph.model_inspector()


@pytest.fixture(scope="module")
def plant(allegro_panda):
    return load()[0]


def test_drake_loads_it_without_a_word_with_few_solid_collision_shapes(
    allegro_panda, capfd, caplog
):
    logger = logging.getLogger("drake")
    logger.addHandler(caplog.handler)
    try:
        _, inspector = load()
    finally:
        logger.removeHandler(caplog.handler)
    assert caplog.messages == []
    assert capfd.readouterr() == ("", "")
    geometries = inspector.GetAllGeometryIds(Role.kProximity)
    shapes = [type(inspector.GetShape(geometry)).__name__ for geometry in geometries]
    assert shapes.count("Convex") + shapes.count("Mesh") == 8  # Of the arm's links.
    assert (shapes.count("Box"), shapes.count("Sphere"), len(shapes)) == (17, 4, 29)


def test_every_joint_is_driven_within_the_limits_of_its_maker(allegro_panda):
    hand = HandModel(load_hand("package://drake_pregrasp/allegro_panda.yaml")).kinematics
    assert np.all(hand.stiffness > 0)
    np.testing.assert_array_equal(hand.efforts, [87, 87, 87, 87, 12, 12, 12] + 16 * [0.9])
    accelerations = hand.acceleration_limit
    np.testing.assert_array_equal(accelerations[:7], [15, 7.5, 10, 12.5, 15, 20, 20])


def test_the_palm_faces_down_where_the_flange_does(plant):
    context = plant.CreateDefaultContext()
    q = np.zeros(23)
    q[:7] = [0.0, 0.1, 0.0, -2.2, 0.0, 2.3, 0.0]  # The flange is straight down.
    plant.SetPositions(context, q)
    palm = plant.GetFrameByName("palm_link").CalcPoseInWorld(context)
    # Its face is along x of its frame; fingers begin along z.
    np.testing.assert_allclose(palm.rotation().matrix()[:, 0], [0, 0, -1], atol=1e-8)
    np.testing.assert_allclose(palm.rotation().matrix()[:, 2], [1, 0, 0], atol=1e-8)
    base = plant.GetFrameByName("panda_link0").CalcPoseInWorld(context)
    np.testing.assert_allclose(base.translation(), [-0.55, 0, 0])


def test_all_bodies_are_possible_and_none_is_of_the_gripper(plant):
    context = plant.CreateDefaultContext()
    indices = range(1, plant.num_bodies())
    bodies = {body.name(): body for body in map(plant.get_body, map(BodyIndex, indices))}
    assert not [name for name in bodies if "finger" in name or name.startswith("panda_hand")]
    assert set(TIPS) < set(bodies)
    for body in bodies.values():
        assert body.CalcSpatialInertiaInBodyFrame(context).IsPhysicallyValid()


def test_masses_and_moving_parts_are_those_of_the_package(allegro_panda):
    def links(file):
        root = ElementTree.parse(file).getroot()
        return {
            link.get("name"): float(link.find("inertial/mass").get("value"))
            for link in root.iter("link")
            if link.find("inertial/mass") is not None
        }

    data = find_robot_data()
    for name, file in ROBOTS.items():
        package, ours = links(data.find(file)), links(robot_model(f"robots://{name}"))
        assert ours
        assert all(package[name] == mass for name, mass in ours.items())


@pytest.mark.slow
def test_the_first_time_it_is_made_in_silence_and_wholly(tmp_path, capfd, monkeypatch):
    before = robot_model("robots://panda.urdf").read_bytes()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    made = robot_model("robots://panda.urdf")
    assert capfd.readouterr() == ("", "")
    assert made.read_bytes() == before
    files = {path for path in made.parent.rglob("*") if path.is_file()}
    meshes = ElementTree.parse(made).getroot().iter("mesh")
    assert files == {made, *(made.parent / mesh.get("filename") for mesh in meshes)}
