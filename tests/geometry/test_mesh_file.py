"""Mesh files that claim too much, or name what is none of their business."""

import json
import os
import time

import pytest
import trimesh

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.geometry import closed_surfaces, meshes
from drake_pregrasp.geometry.meshes import read_pieces
from drake_pregrasp.geometry.shapes import load_shape


def box():
    return trimesh.creation.box(extents=[0.1, 0.2, 0.3])


def write_gltf(folder, tree_of=lambda tree: tree):
    """Writes a box as glTF with its buffers beside it, and returns the file."""
    for name, data in box().export(file_type="gltf").items():
        (folder / name).write_bytes(data)
    file = folder / "model.gltf"
    file.write_text(json.dumps(tree_of(json.loads(file.read_text()))))
    return file


@pytest.mark.parametrize("broken", ["v 0", "v", "v 0 0"])
def test_a_vertex_needs_three_coordinates(tmp_path, broken):
    lines = box().export(file_type="obj").splitlines()
    place = [index for index, line in enumerate(lines) if line.startswith("v ")][2]
    lines[place] = broken
    file = tmp_path / "box.obj"
    file.write_text("\n".join(lines))
    with pytest.raises(InvalidArgumentError, match=str(file)):
        load_shape(file)


def test_buffers_beside_a_gltf_file_are_read(tmp_path):
    assert load_shape(write_gltf(tmp_path)).mesh.is_watertight


def with_buffer(uri):
    return lambda tree: {"buffers": [{**buffer, "uri": uri} for buffer in tree["buffers"]]}


CIRCLE = [{"children": [1]}, {"children": [1], "mesh": 0}]


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (with_buffer("../secret.bin"), "is outside of"),
        (with_buffer("/etc/hostname"), "is not opened"),
        (with_buffer("link.bin"), "is outside of"),
        (with_buffer("model.gltf"), "is not opened"),
        (lambda tree: {"accessors": [{"count": 10**12}]}, "its arrays claim too many elements"),
        (lambda tree: {"accessors": [{"count": -4}]}, "or fewer than none"),
        (lambda tree: {"nodes": CIRCLE}, "nodes must be a tree"),
    ],
)
def test_a_gltf_file_opens_no_other_file_and_claims_no_more_than_it_holds(
    tmp_path, change, problem
):
    (tmp_path / "secret.bin").write_bytes(bytes(10_000))
    folder = tmp_path / "own"
    folder.mkdir()
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    with pytest.raises(InvalidArgumentError, match=problem):
        load_shape(write_gltf(folder, lambda tree: {**tree, **change(tree)}))


def test_materials_of_an_obj_file_are_not_looked_for(tmp_path, monkeypatch):
    file = tmp_path / "box.obj"
    box().export(file)
    (tmp_path / "other.mtl").write_text("newmtl a\nmap_Kd other.png\n")
    file.write_text("mtllib other.mtl\nusemtl a\n" + file.read_text())
    opened = []
    monkeypatch.setattr(meshes._Beside, "get", lambda self, key: opened.append(key))
    assert load_shape(file).mesh.is_watertight
    assert opened == []


@pytest.mark.parametrize(
    ("material", "color"),
    [
        ("Kd 1 0.5 0 9\nd 0.25 9", (1.0, 0.5, 0.0, 0.25)),
        ("d -1\nKd 0.5", (0.5, 0.5, 0.5, 0.0)),
        ("Kd nan inf 7", (0.0, 1.0, 1.0, 1.0)),
        ("Kd 1 0.5", None),
        ("d", None),
        ("Kd spectral own.rfl", None),
    ],
)
def test_colors_of_a_material_library_are_whole_or_refused(tmp_path, material, color):
    file = tmp_path / "box.obj"
    file.write_text("mtllib box.mtl\nusemtl a\n" + box().export(file_type="obj"))
    (tmp_path / "box.mtl").write_text(f"newmtl a\n{material}\n")
    if color is None:
        with pytest.raises(InvalidArgumentError, match=r"box\.obj cannot be read as a mesh"):
            read_pieces(file, colors=True)
    else:
        assert read_pieces(file, colors=True)[0].color == color


@pytest.mark.parametrize(
    ("name", "data", "problem"),
    [
        ("a.obj", b"v 0 0 0\nf" + b" 1 1" * 100_002, "more than 200000 triangles"),
        ("a.obj", b"v 0 0 0\n" * 600_001, "more than 600000 vertices"),
        ("a.obj", b"v 0 0 0\ro a\r" * 1001, "more than 1000 lines o"),
        ("a.obj", b"vt 0 0\n" * 1_000_000, "holds no triangles"),
        ("a.off", b"OFF\n" + b"0 " * 4_000_000, "has 4000001 words"),
        ("a.ply", b"ply\nformat ascii 1.0\n" + b"\t" * 4_000_000, "at most 4000000, simplify"),
        ("a.stl", b"solid a\nendsolid\n" * 1001, "more than 1000 solids"),
        ("a.gltf", b'{"nodes": [' + b"{}," * 300_000, "values; at most 500000"),
    ],
)
def test_what_takes_long_to_parse_is_not_parsed(tmp_path, name, data, problem):
    (tmp_path / name).write_bytes(data)
    start = time.process_time()
    with pytest.raises(InvalidArgumentError, match=problem):
        load_shape(tmp_path / name)
    assert time.process_time() - start < 5


@pytest.mark.parametrize("name", ["box.zip", "box.dae", "box.3mf", "box"])
def test_other_formats_are_not_read(tmp_path, name):
    (tmp_path / name).write_bytes(b"")
    with pytest.raises(InvalidArgumentError, match=r"its name must end with \.obj, \.stl"):
        load_shape(tmp_path / name)


def test_too_many_bytes_triangles_and_parts_are_refused(tmp_path, monkeypatch):
    file = tmp_path / "box.stl"
    box().export(file)
    for name, most, problem in (
        ("MAX_MESH_BYTES", 100, "it has more than"),
        ("MAX_FACES", 11, "it has more than 11 triangles"),
        ("MAX_PIECES", 0, "it has 1 parts"),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(meshes, name, most)
            with pytest.raises(InvalidArgumentError, match=problem):
                read_pieces(file)
    assert len(read_pieces(file)) == 1


def test_a_pipe_is_no_mesh(tmp_path):
    os.mkfifo(tmp_path / "box.stl")
    with pytest.raises(InvalidArgumentError, match=r"no such file|no regular file"):
        load_shape(tmp_path / "box.stl")


def test_a_vertex_far_away_is_refused_in_one_line(tmp_path):
    for far, problem in ((1e308, "m long; at most 3 m"), (1e6, "away from its own origin")):
        mesh = box()
        mesh.apply_translation([1e6 if far == 1e6 else 0, 0, 0])
        text = mesh.export(file_type="obj")
        if far == 1e308:
            text += "v 1e308 0 0\nv -1e308 0 0\nv 0 1 0\nf 9 10 11\n"
        (tmp_path / "far.obj").write_text(text)
        with pytest.raises(InvalidArgumentError, match=problem):
            load_shape(tmp_path / "far.obj")


def test_closed_surfaces_are_counted_before_they_are_compared(monkeypatch):
    balls = [trimesh.creation.icosphere(subdivisions=1, radius=r) for r in (0.1, 0.2)]
    mesh = trimesh.util.concatenate(balls)
    closed_surfaces.orient_components(mesh.copy(), "mesh")
    monkeypatch.setattr(closed_surfaces, "MAX_PAIRS", 100)
    with pytest.raises(InvalidArgumentError, match=r"in each other with 3360 pairs .* at most 100"):
        closed_surfaces.orient_components(mesh.copy(), "mesh")
    monkeypatch.setattr(closed_surfaces, "MAX_COMPONENTS", 1)
    with pytest.raises(InvalidArgumentError, match="has 2 closed surfaces; at most 1"):
        closed_surfaces.orient_components(mesh, "mesh")
