"""Meshes of robots keep their shapes, and their places beside each other."""

from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh

from drake_pregrasp.robots.robot_meshes import convert_meshes, cut_boxes

SIZES = {
    "arm/part.stl": 0.1,
    "hand/part.stl": 0.2,
    "hand/part.glb": 0.3,
    "hand_part.stl": 0.4,
    "arm/part.glb": 0.5,
}
COLOURED = [name for name in SIZES if name.endswith(".glb")]


def mesh_files(folder):
    for name, size in SIZES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        mesh = two_coloured(size) if name in COLOURED else trimesh.creation.box([size] * 3)
        mesh.export(folder / name)
    return folder


def two_coloured(size):
    """Returns a box of two halves, a red and a green one."""
    scene = trimesh.Scene()
    for side, color in ((-1, [255, 0, 0, 255]), (1, [0, 255, 0, 255])):
        half = trimesh.creation.box([size / 2, size, size])
        half.apply_translation([side * size / 4, 0, 0])
        material = trimesh.visual.material.PBRMaterial(baseColorFactor=color)
        half.visual = trimesh.visual.TextureVisuals(material=material)
        scene.add_geometry(half)
    return scene


def robot_of(names):
    """Returns a robot whose every link is shown by a mesh, and collides by it."""
    robot = ElementTree.Element("robot")
    for name in names:
        link = ElementTree.SubElement(robot, "link", name=name)
        for use in ("visual", "collision"):
            geometry = ElementTree.SubElement(ElementTree.SubElement(link, use), "geometry")
            ElementTree.SubElement(geometry, "mesh", filename=name)
    return robot


@pytest.fixture(scope="module")
def converted(tmp_path_factory):
    root = tmp_path_factory.mktemp("robot")
    source, folder = mesh_files(root / "source"), root / "made"
    robot = robot_of(SIZES)
    steps = []
    convert_meshes(robot, lambda name: source / name, folder, lambda *step: steps.append(step))
    assert steps == [(done, 2 * len(SIZES)) for done in range(2 * len(SIZES) + 1)]
    return robot, folder


@pytest.mark.parametrize("use", ["visual", "collision"])
def test_each_link_has_its_own_shape_with_normals_whatever_others_are_called(converted, use):
    robot, folder = converted
    for link in robot.findall("link"):
        size = SIZES[link.get("name")]
        files = [folder / mesh.get("filename") for mesh in link.iterfind(f"{use}/geometry/mesh")]
        assert all("\nvn " in file.read_text() for file in files)
        meshes = [trimesh.load_mesh(file) for file in files]
        assert sum(mesh.volume for mesh in meshes) == pytest.approx(size**3, rel=1e-3)
        corners = np.concatenate([mesh.vertices for mesh in meshes])
        np.testing.assert_allclose(
            [corners.min(axis=0), corners.max(axis=0)], [[-size / 2] * 3, [size / 2] * 3], atol=1e-5
        )


def test_a_mesh_that_is_shown_in_colours_collides_as_a_whole(converted):
    robot, _ = converted
    coloured = [link for link in robot if link.get("name") in COLOURED]
    assert len(coloured) == len(COLOURED)
    for link in coloured:
        assert len(link.findall("visual")) == 2
        assert len(link.findall("collision")) == 1
        colors = {color.get("rgba") for color in link.iterfind("visual/material/color")}
        assert colors == {"1 0 0 1", "0 1 0 1"}
    materials = [material.get("name") for material in robot.iter("material")]
    assert len(set(materials)) == len(materials)


def test_files_above_those_of_others_stay_in_the_folder(tmp_path):
    source, folder = mesh_files(tmp_path / "source"), tmp_path / "made"
    names = ["../arm/part.stl", "part.stl"]
    robot = robot_of(names)
    convert_meshes(robot, lambda name: source / "hand" / name, folder, lambda done, total: None)
    named = {mesh.get("filename") for mesh in robot.iter("mesh")}
    assert len(named) == 2 * len(names)
    made = {file.relative_to(folder).as_posix() for file in folder.rglob("*.obj")}
    assert made == named


def test_a_robot_without_meshes_needs_none(tmp_path):
    convert_meshes(robot_of([]), lambda name: tmp_path / name, tmp_path, lambda *step: None)
    assert not list(tmp_path.iterdir())


PLAIN = "0 0 0"


def box_cut_to_a_mesh(tmp_path, xyz, size, *, shown_at=PLAIN, shown_rpy=PLAIN, rpy=PLAIN):
    """Returns the bounds of a box after it is cut to a mesh of 0.2 x 0.4 x 0.6 m at a place."""
    trimesh.creation.box([0.2, 0.4, 0.6]).export(tmp_path / "link.stl")
    robot = robot_of(["link.stl"])
    link = robot.find("link")
    ElementTree.SubElement(link.find("visual"), "origin", xyz=shown_at, rpy=shown_rpy)
    collision = link.find("collision")
    collision.remove(collision.find("geometry"))
    ElementTree.SubElement(ElementTree.SubElement(collision, "geometry"), "box", size=size)
    if xyz is not None:
        ElementTree.SubElement(collision, "origin", xyz=xyz, rpy=rpy)
    cut_boxes(robot, lambda name: tmp_path / name)
    place, box = collision.find("origin"), collision.find("geometry/box")
    center = np.zeros(3) if place is None else np.array(place.get("xyz").split(), dtype=float)
    half = np.array(box.get("size").split(), dtype=float) / 2
    return np.array([center - half, center + half])


@pytest.mark.parametrize(
    ("xyz", "size", "shown_at"),
    [
        ("0 0 0.2", "0.1 0.1 0.6", PLAIN),  # Goes on beyond the mesh's end.
        ("0 0 0.2", "0.1 0.1 0.6", "0 0 0.5"),
        ("0.05 -0.1 0", "0.3 0.5 0.1", PLAIN),
        (None, "1 1 1", PLAIN),
        ("0.01 0.02 0.03", "0.1 0.1 0.1", PLAIN),  # Lies inside.
    ],
)
def test_a_collision_box_is_cut_to_what_it_shares_with_the_mesh(tmp_path, xyz, size, shown_at):
    center = np.zeros(3) if xyz is None else np.array(xyz.split(), dtype=float)
    half, at = np.array(size.split(), dtype=float) / 2, np.array(shown_at.split(), dtype=float)
    extent = np.array([0.1, 0.2, 0.3])
    low, high = np.maximum(center - half, at - extent), np.minimum(center + half, at + extent)
    bounds = box_cut_to_a_mesh(tmp_path, xyz, size, shown_at=shown_at)
    np.testing.assert_allclose(bounds, [low, high], atol=1e-6)


@pytest.mark.parametrize(
    "options", [{"rpy": "0 0 0.1"}, {"shown_rpy": "0.1 0 0"}, {"shown_at": "2 0 0"}]
)
def test_a_turned_or_distant_box_stays_whole(tmp_path, options):
    bounds = box_cut_to_a_mesh(tmp_path, "0 0 0.2", "1 1 1", **options)
    np.testing.assert_allclose(bounds, [[-0.5, -0.5, -0.3], [0.5, 0.5, 0.7]])
