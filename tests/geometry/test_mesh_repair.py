"""Repaired meshes are accepted, and have the volumes of the bodies they were made from."""

import numpy as np
import pytest
import trimesh

from drake_pregrasp import InvalidArgumentError, load_shape
from drake_pregrasp.cli import main

pytest.importorskip("manifold3d")
pytest.importorskip("networkx")
from drake_pregrasp.geometry.mesh_repair import repair_mesh

SIZE = 0.05


def box(x=0.0, size=SIZE, y=0.0):
    return trimesh.creation.box([size] * 3).apply_translation([x, y, y])


def holed():
    mesh = trimesh.creation.icosphere(3, SIZE / 2)
    return trimesh.Trimesh(mesh.vertices, mesh.faces[3:], process=False)


def cavity():
    inner = box(size=SIZE / 2)
    inner.invert()
    return trimesh.util.concatenate([box(), inner, box(SIZE * 0.9, y=0.001)])


BALL = trimesh.creation.icosphere(3, SIZE / 2).volume


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mesh", "volume"),
    [
        (holed(), BALL),
        (trimesh.util.concatenate([box(), box(SIZE / 2, y=0.01)]), 1.68 * SIZE**3),
        (trimesh.util.concatenate([box(), box(SIZE)]), 2 * SIZE**3),
        (cavity(), (2 - 1 / 8 - 0.1 * 0.98**2) * SIZE**3),
    ],
)
@pytest.mark.parametrize("unit", [1.0, 0.001])
def test_holes_are_closed_and_surfaces_that_cross_or_touch_united(tmp_path, mesh, volume, unit):
    file = tmp_path / "broken.ply"
    mesh = mesh.copy().apply_scale(1 / unit)
    mesh.merge_vertices()
    mesh.export(file)
    with pytest.raises(InvalidArgumentError, match="`drake-pregrasp mesh repair`"):
        load_shape(file, scale=unit)
    assert main(["mesh", "repair", str(file)]) == 0
    shape = load_shape(tmp_path / "broken_repaired.obj", scale=unit)
    assert shape.mesh.volume == pytest.approx(volume, rel=0.003)
    repair = repair_mesh(file)
    assert repair.volume * unit**3 == pytest.approx(shape.mesh.volume, rel=1e-5)
    assert repair.distance * unit < 0.02 * SIZE


@pytest.mark.slow
def test_the_distance_is_that_of_the_cap_to_the_rim(tmp_path):
    # An open box: each point of its new lid is at most half an edge away from the old surface.
    mesh = box()
    lid = mesh.triangles_center[:, 2] > SIZE / 2 - 1e-9
    trimesh.Trimesh(mesh.vertices, mesh.faces[~lid], process=False).export(tmp_path / "open.ply")
    repair = repair_mesh(tmp_path / "open.ply")
    assert repair.distance == pytest.approx(SIZE / 2, rel=0.02)
    assert repair.area - repair.old_area == pytest.approx(SIZE**2, rel=1e-5)


def test_what_is_no_body_is_not_repaired(tmp_path, capsys):
    file = tmp_path / "flat.ply"
    square = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    trimesh.Trimesh(square, [[0, 1, 2], [0, 2, 3]]).export(file)
    assert main(["mesh", "repair", str(file)]) == 2
    assert "flat.ply cannot be repaired: 1 of its 1 surfaces" in capsys.readouterr().err
    assert main(["mesh", "repair", str(file), "-o", str(tmp_path / "a.stl")]) == 2
    assert "must end with .obj" in capsys.readouterr().err
    assert not np.any([path.suffix == ".obj" for path in tmp_path.iterdir()])


@pytest.mark.slow
def test_a_mesh_that_needs_no_repair_is_as_it_was(tmp_path, capsys):
    path = tmp_path / "ball.obj"
    trimesh.creation.uv_sphere(SIZE / 2, count=[40, 80]).export(
        path
    )  # Thin triangles at its poles.
    assert repair_mesh(path).distance < 1e-6 * SIZE
    assert main(["mesh", "repair", str(path), "-o", str(path)]) == 2
    assert "ball.obj is there already; name another file" in capsys.readouterr().err
    assert main(["mesh", "repair", str(tmp_path)]) == 2
