"""Shapes against closed forms, and mesh files that the tests write."""

import numpy as np
import pytest
import trimesh
from thin_cup import HEIGHT, PROFILE, RADIUS, WALL

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.geometry.shapes import (
    FACET_ERROR,
    ball_shape,
    box_shape,
    cylinder_shape,
    load_shape,
    revolved_shape,
)
from drake_pregrasp.resources import resource_folder


def assert_closed(shape):
    assert shape.mesh.is_watertight
    assert shape.mesh.is_winding_consistent
    assert len(shape.face_parts) == len(shape.mesh.faces)


def test_a_box_is_exact():
    shape = box_shape([0.1, 0.2, 0.03])
    assert_closed(shape)
    assert shape.mesh.volume == pytest.approx(0.1 * 0.2 * 0.03, rel=1e-12)
    np.testing.assert_allclose(shape.mesh.bounds, [[-0.05, -0.1, -0.015], [0.05, 0.1, 0.015]])
    np.testing.assert_allclose(shape.p_OCoM, 0, atol=1e-12)


@pytest.mark.parametrize("radius", [0.002, 0.015, 0.033, 0.2])
def test_a_cylinder_is_one_up_to_its_facets(radius):
    length = 3 * radius
    shape = cylinder_shape(radius, length)
    assert_closed(shape)
    lack = np.pi * radius**2 * length - shape.mesh.volume
    assert 0 < lack <= FACET_ERROR * 2 * np.pi * radius * length
    np.testing.assert_allclose(shape.mesh.bounds[:, 2], [-length / 2, length / 2])
    np.testing.assert_allclose(shape.p_OCoM, 0, atol=1e-12)


@pytest.mark.parametrize("radius", [0.004, 0.0199, 0.02, 0.045, 0.12])
def test_a_ball_is_one_up_to_its_facets(radius):
    shape = ball_shape(radius)
    assert_closed(shape)
    planes = np.einsum("ij,ij->i", shape.mesh.face_normals, shape.mesh.triangles[:, 0])
    assert radius - np.min(planes) <= FACET_ERROR
    np.testing.assert_allclose(np.linalg.norm(shape.mesh.vertices, axis=1), radius, rtol=1e-9)
    lack = 4 / 3 * np.pi * radius**3 - shape.mesh.volume
    assert 0 < lack <= FACET_ERROR * 4 * np.pi * radius**2
    np.testing.assert_allclose(shape.p_OCoM, 0, atol=1e-12)


def test_a_cup_has_the_volume_and_the_centre_of_its_wall():
    shape = revolved_shape(PROFILE)
    assert_closed(shape)
    solid = np.pi * RADIUS**2 * HEIGHT
    hollow = np.pi * (RADIUS - WALL) ** 2 * (HEIGHT - WALL)
    around = 4 * np.pi * RADIUS * HEIGHT  # More than the area of the outside and the inside.
    assert shape.mesh.volume == pytest.approx(solid - hollow, abs=FACET_ERROR * around)
    # All sections lie between the same circles, so the centre is that of the round cup.
    height = (solid * HEIGHT / 2 - hollow * (HEIGHT + WALL) / 2) / (solid - hollow)
    np.testing.assert_allclose(shape.p_OCoM, [0, 0, height], atol=1e-6)


def test_a_profile_off_the_axis_is_closed_into_a_ring():
    inner, outer, height = 0.02, 0.03, 0.01
    shape = revolved_shape([[inner, 0], [outer, 0], [outer, height], [inner, height]])
    assert_closed(shape)
    volume = np.pi * (outer**2 - inner**2) * height
    assert shape.mesh.volume == pytest.approx(volume, abs=FACET_ERROR * 2 * np.pi * 0.05 * height)
    assert shape.mesh.euler_number == 0  # Of a torus.


def test_a_profile_that_runs_down_the_outside_encloses_the_same():
    up, down = revolved_shape(PROFILE), revolved_shape(PROFILE[::-1])
    assert down.mesh.volume == pytest.approx(up.mesh.volume, rel=1e-12)


@pytest.mark.parametrize(
    "profile",
    [
        [[0, 0], [0.1, 0]],
        [[0, 0], [-0.1, 0], [0, 0.1]],
        [[0, 0, 0], [1, 0, 0], [0, 0, 1]],
        [[0.0, 0.0], [0.03, np.nan], [0.0, 0.1]],
        [[0.0, 0.0], [0.03, 0.0], [0.0, 0.0]],
    ],
)
def test_a_profile_that_encloses_nothing_is_refused(profile):
    with pytest.raises(InvalidArgumentError, match="profile"):
        revolved_shape(profile)


def ell():
    """A body without any symmetry, of boxes, whose faces are known."""
    corners = [[0, 0], [0.06, 0], [0.06, 0.01], [0.02, 0.01], [0.02, 0.05], [0, 0.05]]
    faces = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]
    return trimesh.creation.extrude_triangulation(np.array(corners), np.array(faces), 0.03)


ELL_VOLUME = (0.06 * 0.01 + 0.02 * 0.04) * 0.03


@pytest.mark.parametrize("suffix", ["obj", "stl", "ply", "glb"])
def test_every_format_holds_the_same_body(tmp_path, suffix):
    mesh = ell()
    path = tmp_path / f"ell.{suffix}"
    mesh.export(path)
    shape = load_shape(path)
    assert_closed(shape)
    assert shape.mesh.volume == pytest.approx(ELL_VOLUME, rel=1e-5)
    np.testing.assert_allclose(shape.p_OCoM, mesh.center_mass, atol=1e-7)
    np.testing.assert_allclose(shape.mesh.bounds, mesh.bounds, atol=1e-7)


def test_scale_turns_the_files_unit_into_metres(tmp_path):
    mesh = ell()
    mesh.apply_scale(1000)
    mesh.export(tmp_path / "ell.stl")
    shape = load_shape(tmp_path / "ell.stl", scale=0.001)
    assert shape.mesh.volume == pytest.approx(ELL_VOLUME, rel=1e-5)


def write_obj(path, mesh, parts):
    """Writes an OBJ file of one closed surface, in objects of some of its faces each."""
    lines = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in mesh.vertices]
    for name, faces in parts.items():
        lines.append(f"o {name}")
        lines += [f"f {a} {b} {c}" for a, b, c in mesh.faces[faces] + 1]
    path.write_text("\n".join(lines) + "\n")


def test_objects_of_an_obj_file_are_parts(tmp_path):
    mesh = ell()
    on_top = mesh.triangles_center[:, 2] > 0.03 - 1e-9
    parts = {"top": np.flatnonzero(on_top), "rest": np.flatnonzero(~on_top)}
    write_obj(tmp_path / "ell.obj", mesh, parts)
    shape = load_shape(tmp_path / "ell.obj")
    assert_closed(shape)
    assert set(shape.part_names) == {"top", "rest"}
    heights = shape.mesh.triangles_center[shape.face_parts == shape.part("top"), 2]
    np.testing.assert_allclose(heights, 0.03)
    assert len(heights) == np.sum(on_top)
    with pytest.raises(InvalidArgumentError, match=r"no part 'handle'; there are: .*top"):
        shape.part("handle")


def test_meshes_of_a_gltf_file_are_parts_where_their_nodes_place_them(tmp_path):
    scene = trimesh.Scene()
    for name, x in (("left", -0.03), ("right", 0.05)):
        box = trimesh.creation.box([0.02, 0.03, 0.04])
        place = trimesh.transformations.translation_matrix([x, 0, 0])
        scene.add_geometry(box, geom_name=name, node_name=name, transform=place)
    scene.export(tmp_path / "two.glb")
    shape = load_shape(tmp_path / "two.glb")
    assert shape.mesh.volume == pytest.approx(2 * 0.02 * 0.03 * 0.04, rel=1e-5)
    for name, x in (("left", -0.03), ("right", 0.05)):
        centers = shape.mesh.triangles_center[shape.face_parts == shape.part(name)]
        np.testing.assert_allclose(np.mean(centers, axis=0), [x, 0, 0], atol=1e-6)


def test_inverted_faces_are_mended(tmp_path):
    inverted, mixed = ell(), ell()
    inverted.invert()
    mixed.faces[::3] = mixed.faces[::3, ::-1]
    for mesh in (inverted, mixed):
        trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(tmp_path / "ell.ply")
        shape = load_shape(tmp_path / "ell.ply")
        assert shape.mesh.volume == pytest.approx(ELL_VOLUME, rel=1e-5)
        assert shape.mesh.is_winding_consistent


def test_of_several_bodies_each_is_mended_and_a_hollow_stays_one(tmp_path):
    sizes = (0.06, 0.04, 0.03, 0.02)
    outer, hollow, second, third = (trimesh.creation.box([size] * 3) for size in sizes)
    hollow.invert()
    second.apply_translation([0.1, 0, 0])
    second.invert()
    third.apply_translation([-0.1, 0, 0])
    for body in (second, third):
        body.faces[0] = body.faces[0, ::-1]
    mesh = trimesh.util.concatenate([outer, hollow, second, third])
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(tmp_path / "four.ply")
    shape = load_shape(tmp_path / "four.ply")
    assert shape.mesh.volume == pytest.approx(0.06**3 - 0.04**3 + 0.03**3 + 0.02**3, rel=1e-5)


def with_a_hole():
    mesh = ell()
    return trimesh.Trimesh(mesh.vertices, mesh.faces[1:], process=False)


def flat():
    """A square, seen from both sides."""
    corners = [[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]]
    faces = [[0, 1, 2], [0, 2, 3], [1, 0, 3], [1, 3, 2]]
    return trimesh.Trimesh(corners, faces, process=False)


def touching():
    """Two boxes with an edge in common."""
    box = trimesh.creation.box([0.02] * 3)
    other = box.copy()
    other.apply_translation([0.02, 0.02, 0])
    both = trimesh.util.concatenate([box, other])
    both.merge_vertices()
    return both


def in_millimetres():
    mesh = ell()
    mesh.apply_scale(1000)
    return mesh


def not_finite():
    mesh = ell()
    mesh.vertices[3, 1] = np.nan
    return mesh


@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (with_a_hole, "not watertight: 3 edges .* one side only, 0 have more.* close its holes"),
        (touching, "not watertight: 0 edges .*, 1 have more than two; .* part what touches"),
        (flat, "encloses no volume"),
        (in_millimetres, "60 m long; at most 3 m, .* scale: 0.001"),
        (not_finite, "a vertex that is not finite"),
    ],
)
def test_a_mesh_that_is_no_body_is_refused_in_one_line(tmp_path, make, problem):
    path = tmp_path / "part_17.ply"
    mesh = make()
    rows = [" ".join(f"{x:.9f}" for x in vertex) for vertex in mesh.vertices]
    rows += [f"3 {a} {b} {c}" for a, b, c in mesh.faces]
    header = ["ply", "format ascii 1.0", f"element vertex {len(mesh.vertices)}"]
    header += [f"property float {axis}" for axis in "xyz"]
    header += [f"element face {len(mesh.faces)}", "property list uchar int vertex_indices"]
    path.write_text("\n".join([*header, "end_header", *rows]) + "\n")
    refused(path, problem)


def refused(path, problem):
    with pytest.raises(InvalidArgumentError, match=problem) as error:
        load_shape(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        ("missing.obj", None, "no such file"),
        ("garbage.stl", "no mesh at all", "can't be read as a mesh|no triangles"),
        ("garbage.glb", "no mesh at all", "can't be read as a mesh"),
        ("unknown.xyzzy", "?", "can't be read as a mesh"),
        ("empty.obj", "", "can't be read as a mesh|no triangles"),
        ("points.obj", "v 0 0 0\nv 1 0 0\n", "can't be read as a mesh|no triangles"),
    ],
)
def test_a_file_that_is_no_mesh_is_refused_in_one_line(tmp_path, name, text, problem):
    path = tmp_path / name
    if text is not None:
        path.write_text(text)
    refused(path, problem)


@pytest.mark.parametrize(("name", "parts"), [("mug", 3), ("bracket", 2)])
def test_the_shipped_meshes_are_bodies_of_parts(name, parts):
    shape = load_shape(resource_folder("models") / f"{name}.obj")
    assert_closed(shape)
    assert len(shape.part_names) == parts
    assert set(shape.face_parts) == set(range(parts))
