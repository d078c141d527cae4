"""Copies of models: kept and omitted content, and early rejection of large files."""

import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh
from pydrake.geometry import Role
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from drake_pregrasp.diagrams import model_files, package_files
from drake_pregrasp.diagrams.directive_files import checked_copy
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.resources import resource_folder

HAND = resource_folder("models") / "five_finger_hand.sdf"
MJCF = """<mujoco model="hand"><compiler angle="radian" autolimits="true" meshdir="parts"/>
<default><joint armature="0.001"/></default>
<asset><mesh name="tip" file="ball.obj" scale="2 2 2"/><texture name="t" file="t.png"/></asset>
<worldbody><body name="palm"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<joint name="x" type="slide" axis="1 0 0" range="-1 1"/><geom type="box" size=".1 .1 .1"/>
<body name="finger"><joint name="j" axis="0 1 0"/><geom type="mesh" mesh="tip"/></body></body>
</worldbody><actuator><position name="x" joint="x" kp="9" kv="1"/>
<position name="j" joint="j" kp="5" kv="2" forcerange="-3 3"/></actuator></mujoco>"""

FORK = """
import multiprocessing, os, re, sys
from pathlib import Path
from drake_pregrasp.diagrams.directive_files import checked_copy

model = Path(sys.argv[1])
meshes = re.findall("[^\\"]*mesh.obj", checked_copy(model, [model.parent]).text)
child = multiprocessing.get_context("fork").Process(target=len, args=("",))
child.start()
child.join()
process = os.fork()
if not process:
    sys.exit()
os.waitpid(process, 0)
print([Path(mesh.removeprefix("file://")).is_file() for mesh in meshes], *meshes)
"""


def write(folder: Path, text: str, name: str = "own.sdf") -> Path:
    (folder / "parts").mkdir()
    trimesh.creation.icosphere(subdivisions=2, radius=0.01).export(folder / "parts" / "ball.obj")
    (folder / name).write_text(text)
    return folder / name


def load(copy):
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.01)
    Parser(plant).AddModelsFromString(copy.text, copy.kind)
    plant.Finalize()
    return plant, scene_graph.model_inspector()


def test_the_copy_of_the_shipped_hand_says_the_same():
    def tree(root):
        children = [tree(child) for child in root]
        return root.tag, sorted(root.attrib.items()), (root.text or "").strip(), children

    copy = checked_copy(HAND, [HAND.parent])
    assert tree(ElementTree.fromstring(copy.text)) == tree(ElementTree.parse(HAND).getroot())


def test_an_mjcf_is_a_hand_too(tmp_path):
    copy = checked_copy(write(tmp_path, MJCF, "own.xml"), [tmp_path])
    assert [file.name for file in copy.files] == ["own.xml", "ball.obj"]
    assert str(tmp_path) not in copy.text
    plant, inspector = load(copy)
    drives = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]
    assert [drive.get_controller_gains().p for drive in drives] == [9, 5]
    assert [drive.default_rotor_inertia() for drive in drives] == [0.001, 0.001]
    shapes = [inspector.GetShape(i) for i in inspector.GetAllGeometryIds(Role.kProximity)]
    assert [type(shape).__name__ for shape in shapes] == ["Box", "Mesh"]


@pytest.mark.parametrize("suffix", [".obj", ".stl", ".ply", ".off", ".glb"])
def test_a_mesh_keeps_its_vertices_and_its_colour(tmp_path, suffix):
    mesh = trimesh.creation.cylinder(0.0123456789, 0.05)
    if suffix in (".obj", ".glb"):
        material = trimesh.visual.material.PBRMaterial(baseColorFactor=[255, 0, 0, 255])
        mesh.visual = trimesh.visual.TextureVisuals(material=material)
    mesh.export(tmp_path / f"a{suffix}")
    (tmp_path / "own.urdf").write_text(
        f'<robot name="r"><link name="a"><visual><geometry><mesh filename="a{suffix}"/></geometry>'
        "</visual></link></robot>"
    )
    _, inspector = load(checked_copy(tmp_path / "own.urdf", [tmp_path]))
    (shape,) = (inspector.GetShape(i) for i in inspector.GetAllGeometryIds(Role.kIllustration))
    written = Path(shape.source().path())
    found = trimesh.load_mesh(written, process=False)
    read = trimesh.load_mesh(tmp_path / f"a{suffix}", process=False)
    assert {tuple(v) for v in found.vertices} == {tuple(v) for v in read.vertices}
    np.testing.assert_allclose(found.area, mesh.area, rtol=1e-5)
    library = written.with_suffix(".mtl")
    assert library.is_file() == (suffix in (".obj", ".glb"))
    if library.is_file():
        assert "Kd 1 0 0" in library.read_text()


def test_equal_meshes_share_a_copy(tmp_path):
    model = write(tmp_path, MJCF, "own.xml")
    first = checked_copy(model).text
    assert checked_copy(model).text == first
    trimesh.creation.box([1, 1, 1]).export(tmp_path / "parts" / "ball.obj")
    assert checked_copy(model).text != first


URDF = """<robot name="hand"><link name="palm"><collision><geometry>
<mesh filename="parts/ball.obj"/></geometry></collision></link></robot>"""
SDF = """<sdf version="1.9"><model name="hand"><link name="palm"><collision name="c"><geometry>
<mesh><uri>parts/ball.obj</uri></mesh></geometry></collision></link></model></sdf>"""


@pytest.mark.parametrize(("kind", "text"), [("urdf", URDF), ("sdf", SDF), ("xml", MJCF)])
def test_folders_may_have_spaces_and_percent_signs(tmp_path, monkeypatch, kind, text):
    (copies := tmp_path / "my%20 copies").mkdir()
    (own := tmp_path / "my models").mkdir()
    monkeypatch.setattr(model_files, "copies_folder", lambda: copies)
    write(own, text, f"own.{kind}")
    directives = f"directives: [add_model: {{name: hand, file: own.{kind}}}]"
    (own / "own.dmd.yaml").write_text(directives)
    for name in (f"own.{kind}", "own.dmd.yaml"):
        assert load(checked_copy(own / name, [own]))[1].num_geometries() > 0


def test_what_is_outside_of_allowed_folders_is_not_copied(tmp_path):
    model = write(tmp_path, MJCF, "own.xml")
    with pytest.raises(InvalidArgumentError, match="is outside of"):
        checked_copy(model, [tmp_path / "parts"])


LINK = '<link name="l{}"/>'
BALL = "<geometry><sphere><radius>1</radius></sphere></geometry>"
HINT = "<drake:mesh_resolution_hint>{}</drake:mesh_resolution_hint>"
SOFT = f"<collision name='c'>{BALL}<drake:proximity_properties>{HINT}</drake:proximity_properties>"


@pytest.mark.parametrize(
    ("inside", "problem"),
    [
        ("".join(map(LINK.format, range(201))), "more than 200 links"),
        (LINK.replace("/>", ">") + "<visual/>" * 1001 + "</link>", "more than 1000 geometries"),
        ("<frame/>" * 301, "more than 300 elements <frame>"),
        ("<pose/>" * 20_001, "more than 20000 elements"),
        ("<pose>" * 64 + "</pose>" * 64, "64 levels"),
        (f"<pose>{'0 ' * 600}</pose>", "<pose> with a value of 1199 characters; at most 1000"),
        (f"<link>{SOFT.format(0.001)}</collision></link>", "of 1000000 cells; at most 1000"),
        (f"<link>{SOFT.format(-1e-300)}</collision></link>", "cells; at most 1000"),
        (f"<link>{SOFT.format('nan')}</collision></link>", "of nan cells"),
        (f"<link>{SOFT.format(1)}</collision></link>".replace(">1<", ">1e308<", 1), "at most 1000"),
    ],
)
def test_too_many_elements_are_refused(tmp_path, inside, problem):
    text = f'<sdf version="1.9" xmlns:drake="http://drake.mit.edu"><model name="m">{inside}'
    model = write(tmp_path, text + "</model></sdf>")
    with pytest.raises(InvalidArgumentError, match=problem) as error:
        checked_copy(model)
    assert "own.sdf" in str(error.value)


@pytest.mark.parametrize(
    ("name", "most"), [("MAX_PART_BYTES", 999), ("MAX_TRIANGLES", 319), ("MAX_MODEL_BYTES", 99)]
)
def test_too_large_files_are_refused(tmp_path, monkeypatch, name, most):
    module = package_files if hasattr(package_files, name) else model_files
    monkeypatch.setattr(module, name, most)
    with pytest.raises(InvalidArgumentError, match=r"own.xml.* (more than|at most)"):
        checked_copy(write(tmp_path, MJCF, "own.xml"))


@pytest.mark.slow
def test_copies_of_meshes_outlive_a_fork_and_end_with_their_process(tmp_path):
    command = [sys.executable, "-c", FORK, str(write(tmp_path, MJCF, "own.xml"))]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    found, mesh = done.stdout.rsplit(maxsplit=1)
    assert found == "[True]"
    assert not Path(mesh.removeprefix("file://")).parent.parent.exists()


MERGED = """<sdf version="1.9"><model name="m"><link name="palm"/>
<include merge="true"><uri>{}</uri><pose>0 0 1 0 0 0</pose></include></model></sdf>"""


def test_merged_parts_of_an_sdf_are_read_once_from_allowed_folders(tmp_path):
    folder = tmp_path / "a"
    folder.mkdir()
    (folder / "finger.urdf").write_text(
        '<robot name="f"><link name="finger"><secret/></link></robot>'
    )
    (folder / "loop.sdf").write_text(MERGED.format("loop.sdf"))
    (tmp_path / "secret.sdf").write_text("no XML, so reading it is another error")
    (model := folder / "own.sdf").write_text(MERGED.format("finger.urdf"))
    copy = checked_copy(model, [folder])
    assert set(copy.files) == {model, folder / "finger.urdf"}
    plant, _ = load(copy)
    assert plant.HasBodyNamed("finger", plant.GetModelInstanceByName("m"))
    for name, problem in (
        ("../secret.sdf", "is outside of"),
        ("loop.sdf", "twice"),
        ("https://a.b/x.sdf", "only files and packages"),
    ):
        model.write_text(MERGED.format(name))
        with pytest.raises(InvalidArgumentError, match=problem):
            checked_copy(model, [folder])


def test_parts_of_an_sdf_share_the_limit_on_cells(tmp_path):
    head = '<sdf version="1.9" xmlns:drake="http://drake.mit.edu"><model name="m">'
    soft = f"<link name='{{}}'>{SOFT.format(0.04)}</collision></link>"  # 625 cells.
    (tmp_path / "finger.sdf").write_text(head + soft.format("b") + "</model></sdf>")
    include = '<include merge="true"><uri>finger.sdf</uri></include>'
    model = write(tmp_path, head + soft.format("a") + include + "</model></sdf>")
    checked_copy(tmp_path / "finger.sdf")
    with pytest.raises(InvalidArgumentError, match=r"finger.sdf has .* of 1250 cells"):
        checked_copy(model)


@pytest.mark.parametrize("kind", ["xml", "sdf"])
def test_levels_of_included_files_add_up(tmp_path, kind):
    for i in range(20):
        name = f"part{i + 1}.{kind}"
        if kind == "xml":
            inside, around = f'<include file="{name}"/>', ("<mujoco>{}</mujoco>", "body")
        else:
            inside = f'<include merge="true"><uri>{name}</uri></include>'
            around = ('<sdf version="1.9"><model name="m">{}</model></sdf>', "link")
        text, tag = around
        nested = f"<{tag}>" * 55 + inside + f"</{tag}>" * 55
        (tmp_path / f"part{i}.{kind}").write_text(text.format(nested))
    (tmp_path / f"part20.{kind}").write_text(text.format(""))
    with pytest.raises(InvalidArgumentError, match="more than 64 levels of elements, with"):
        checked_copy(tmp_path / f"part0.{kind}")
