"""Mesh files that claim too much, or name what is none of their business."""

import json
import os
import time
import tracemalloc

import pytest
import trimesh

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.geometry import closed_surfaces, meshes
from drake_pregrasp.geometry.meshes import read_pieces
from drake_pregrasp.geometry.shapes import load_shape


def box():
    return trimesh.creation.box(extents=[0.1, 0.2, 0.3])


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
    file = tmp_path / "own" / "model.gltf"
    file.parent.mkdir()
    (file.parent / "link.bin").symlink_to(tmp_path / "secret.bin")
    for name, data in box().export(file_type="gltf").items():
        (file.parent / name).write_bytes(data)
    assert load_shape(file).mesh.is_watertight
    tree = json.loads(file.read_text())
    file.write_text(json.dumps(tree | change(tree)))
    with pytest.raises(InvalidArgumentError, match=problem):
        load_shape(file)


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
    file.write_text("mtllib box.mtl\nmtllib other.mtl\nusemtl a\n" + box().export(file_type="obj"))
    (tmp_path / "box.mtl").write_text(f"newmtl a\n{material}\n")
    (tmp_path / "other.mtl").write_text("newmtl a\nKd 0 1 0\n")
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
        ("a.stl", b"solid a\nendsolid\n" * 1001, "it has 1001 solids; at most 1000"),
        ("a.gltf", b'{"nodes": [{"matrix": [1e308]}]}', "a node has a matrix with numbers over"),
        ("a.gltf", b'{"nodes": [{"scale": [1, NaN]}]}', "a node has a scale with numbers over"),
        ("a.gltf", b'{"nodes": [' + b"{}," * 300_000, "values; at most 500000"),
    ],
)
def test_what_takes_long_to_parse_is_not_parsed(tmp_path, name, data, problem):
    (tmp_path / name).write_bytes(data)
    start = time.process_time()
    with pytest.raises(InvalidArgumentError, match=problem):
        load_shape(tmp_path / name)
    assert time.process_time() - start < 5


def test_lines_that_are_not_read_take_no_memory(tmp_path):
    data = b"vt 0 0\n" * 1_000_000
    (tmp_path / "a.obj").write_bytes(data)
    tracemalloc.start()
    with pytest.raises(InvalidArgumentError, match="holds no triangles"):
        load_shape(tmp_path / "a.obj")
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 10 * len(data)


@pytest.mark.parametrize(
    ("name", "most", "problem"),
    [
        ("MAX_MESH_BYTES", 100, "it has more than"),
        ("MAX_FACES", 11, "it has 12 triangles; at most 11"),
        ("MAX_PIECES", 0, "it has 1 parts"),
    ],
)
def test_too_many_bytes_triangles_and_parts_are_refused(tmp_path, monkeypatch, name, most, problem):
    box().export(tmp_path / "box.stl")
    assert len(read_pieces(tmp_path / "box.stl")) == 1
    monkeypatch.setattr(meshes, name, most)
    with pytest.raises(InvalidArgumentError, match=problem):
        read_pieces(tmp_path / "box.stl")


def test_a_pipe_is_no_mesh(tmp_path):
    os.mkfifo(tmp_path / "box.stl")
    with pytest.raises(InvalidArgumentError, match=r"no such file|no regular file"):
        load_shape(tmp_path / "box.stl")


def test_closed_surfaces_are_counted_before_they_are_compared(monkeypatch):
    balls = [trimesh.creation.icosphere(subdivisions=1, radius=r) for r in (0.1, 0.2)]
    mesh = trimesh.util.concatenate(balls)
    closed_surfaces.orient_components(mesh.copy(), "mesh")
    monkeypatch.setattr(closed_surfaces, "MAX_PAIRS", 100)
    with pytest.raises(InvalidArgumentError, match=r"in each other with 5280 pairs .* at most 100"):
        closed_surfaces.orient_components(mesh.copy(), "mesh")
    monkeypatch.setattr(closed_surfaces, "MAX_COMPONENTS", 1)
    with pytest.raises(InvalidArgumentError, match="has 2 closed surfaces; at most 1"):
        closed_surfaces.orient_components(mesh, "mesh")
