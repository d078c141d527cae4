"""Shapes against closed forms, and mesh files that the tests write."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from thin_cup import PROFILE

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.geometry import shapes
from drake_pregrasp.geometry.meshes import MESH_SUFFIXES


def assert_closed(shape):
    assert shape.mesh.is_watertight
    assert shape.mesh.is_winding_consistent
    assert len(shape.face_parts) == len(shape.mesh.faces)


@pytest.mark.parametrize(
    ("shape", "half", "volume", "round_area"),
    [
        (shapes.box_shape([0.1, 0.2, 0.03]), [0.05, 0.1, 0.015], 0.1 * 0.2 * 0.03, 0),
        *(
            (shapes.cylinder_shape(r, 3 * r), [r, r, 1.5 * r], 3 * np.pi * r**3, 6 * np.pi * r**2)
            for r in (0.002, 0.015, 0.033, 0.2)
        ),
        *(
            (shapes.ball_shape(r), [r, r, r], 4 / 3 * np.pi * r**3, 4 * np.pi * r**2)
            for r in (0.004, 0.0199, 0.02, 0.045, 0.12)
        ),
    ],
)
def test_primitives_are_exact_up_to_their_facets(shape, half, volume, round_area):
    assert_closed(shape)
    assert -1e-12 < volume - shape.mesh.volume <= shapes.FACET_ERROR * round_area + 1e-12
    np.testing.assert_allclose(
        shape.mesh.bounds, [np.negative(half), half], atol=shapes.FACET_ERROR
    )
    np.testing.assert_allclose(shape.p_OCoM, 0, atol=1e-12)


RING = [[0.02, 0], [0.03, 0], [0.03, 0.01], [0.02, 0.01]]


@pytest.mark.parametrize(("profile", "euler_number"), [(PROFILE, 2), (RING, 0), (RING[::-1], 0)])
def test_solids_of_revolution_are_closed_either_way_round(profile, euler_number):
    shape = shapes.revolved_shape(profile)
    assert_closed(shape)
    assert shape.mesh.euler_number == euler_number  # Of a ball, or of a torus.
    # The volume is the sum of those of the truncated cones below the profile's edges.
    (r, z), (r_next, z_next) = np.transpose(profile), np.roll(profile, -1, axis=0).T
    volume = abs(np.pi / 3 * np.sum((z_next - z) * (r**2 + r * r_next + r_next**2)))
    area = np.pi * np.sum((r + r_next) * np.hypot(r_next - r, z_next - z))
    assert shape.mesh.volume == pytest.approx(volume, abs=shapes.FACET_ERROR * area)


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
        shapes.revolved_shape(profile)


def ell():
    """A body without any symmetry, of boxes, whose faces are known."""
    corners = [[0, 0], [0.06, 0], [0.06, 0.01], [0.02, 0.01], [0.02, 0.05], [0, 0.05]]
    faces = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]
    return trimesh.creation.extrude_triangulation(np.array(corners), np.array(faces), 0.03)


@pytest.mark.parametrize("suffix", [kind for kind in MESH_SUFFIXES if kind != ".gltf"])
def test_every_format_holds_the_same_body_at_its_scale(tmp_path, suffix):
    mesh = ell()
    path = tmp_path / f"ell{suffix}"
    mesh.copy().apply_scale(1000).export(path)
    shape = shapes.load_shape(path, scale=0.001)
    assert_closed(shape)
    assert shape.mesh.volume == pytest.approx(mesh.volume, rel=1e-5)
    np.testing.assert_allclose(shape.p_OCoM, mesh.center_mass, atol=1e-7)
    np.testing.assert_allclose(shape.mesh.bounds, mesh.bounds, atol=1e-7)


def test_objects_of_an_obj_file_are_parts(tmp_path):
    mesh = ell()
    on_top = mesh.triangles_center[:, 2] > 0.03 - 1e-9
    parts = {
        "top": mesh.submesh([on_top], append=True),
        "rest": mesh.submesh([~on_top], append=True),
    }
    trimesh.Scene(parts).export(tmp_path / "ell.obj")
    shape = shapes.load_shape(tmp_path / "ell.obj")
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
    shape = shapes.load_shape(tmp_path / "two.glb")
    assert shape.mesh.volume == pytest.approx(2 * 0.02 * 0.03 * 0.04, rel=1e-5)
    for name, x in (("left", -0.03), ("right", 0.05)):
        centers = shape.mesh.triangles_center[shape.face_parts == shape.part(name)]
        np.testing.assert_allclose(np.mean(centers, axis=0), [x, 0, 0], atol=1e-6)


def edited(scale=1.0, faces=slice(None), first=0.0, all_of_them=0.0):
    mesh = ell()
    vertices = scale * mesh.vertices + all_of_them
    vertices[3, 1] += first
    return trimesh.Trimesh(vertices, mesh.faces[faces], process=False)


def flat():
    """A square, seen from both sides."""
    corners = [[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]]
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3], [1, 0, 3], [1, 3, 2]], process=False)


def touching():
    """Two boxes with an edge in common."""
    box = trimesh.creation.box([0.02] * 3)
    both = trimesh.util.concatenate([box, box.copy().apply_translation([0.02, 0.02, 0])])
    both.merge_vertices()
    return both


def polygons(first):
    """A prism with the shape of an L, whose ends are polygons from one of their corners on."""
    level = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
    lines = [f"v {x / 20} {y / 20} {z / 20}" for z in (0, 1) for x, y in level]
    top = [7 + (k + first) % 6 for k in range(6)]
    faces = [top, [k - 6 for k in (top[0], *top[:0:-1])]]
    faces += [[k + 1, (k + 1) % 6 + 1, (k + 1) % 6 + 7, k + 7] for k in range(6)]
    return "\n".join(lines + ["f " + " ".join(map(str, face)) for face in faces]) + "\n"


def test_polygons_from_their_inner_corner_on_are_read_as_they_are(tmp_path):
    (tmp_path / "polygons.obj").write_text(polygons(3))
    mesh = shapes.load_shape(tmp_path / "polygons.obj").mesh
    assert (mesh.volume, mesh.area) == pytest.approx((3 / 20**3, 14 / 20**2))


@pytest.mark.parametrize("first", [1, 2, 4, 5])
def test_rounded_polygons_that_fold_are_refused(tmp_path, first):
    """Turned in space, with coordinates of five decimals."""
    R, lines = Rotation.from_rotvec([0.3, -0.5, 0.7]), []
    for line in polygons(first).splitlines():
        if line.startswith("v "):
            p = R.apply([float(x) for x in line.split()[1:]])
            line = "v " + " ".join(f"{x:.5f}" for x in p)
        lines.append(line)
    (tmp_path / "polygons.obj").write_text("\n".join(lines) + "\n")
    with pytest.raises(InvalidArgumentError, match="folds back on itself"):
        shapes.load_shape(tmp_path / "polygons.obj")


@pytest.mark.parametrize(
    ("content", "name", "problem"),
    [
        (polygons(5), "polygons.obj", "folds back on itself, as polygons .* save it with tri"),
        (
            edited(faces=slice(1, None)),
            "open.ply",
            "not watertight: 3 edges .* one side only, 0 have more.* repair` closes holes",
        ),
        (
            touching(),
            "two.ply",
            "not watertight: 0 edges .*, 1 have more than two; .*unites parts",
        ),
        (flat(), "flat.ply", "encloses no volume"),
        (edited(scale=1000.0), "long.ply", "60 m long; at most 3 m, .* scale: 0.001"),
        ("v 1e308 0 0\nv -1e308 0 0\nv 0 1 0\nf 1 2 3\n", "huge.obj", "m long; at most 3 m"),
        (edited(all_of_them=1e6), "far.ply", "m away from its own origin; at most 100 m"),
        (edited(first=np.nan), "nan.ply", "a vertex that is not finite"),
        *(
            (f"v 0 0 0\nv 1 0 0\n{vertex}\nf 1 2 3\n", "flat.obj", "cannot be read as a mesh")
            for vertex in ("v 0", "v", "v 0 0")
        ),
        (None, "missing.obj", "no such file"),
        ("no mesh at all", "garbage.stl", "cannot be read as a mesh|no triangles"),
        ("no mesh at all", "garbage.glb", "cannot be read as a mesh"),
        ("", "body.dae", r"cannot be read as a mesh: its name must end with \.obj, \.stl"),
        ("", "body", "its name must end with"),
        ("", "empty.obj", "cannot be read as a mesh|no triangles"),
        ("v 0 0 0\nv 1 0 0\n", "points.obj", "cannot be read as a mesh|no triangles"),
    ],
)
def test_files_without_a_mesh_of_a_body_are_refused_in_one_line(tmp_path, content, name, problem):
    path = tmp_path / name
    if isinstance(content, str):
        path.write_text(content)
    elif content is not None:
        content.export(path)
    with pytest.raises(InvalidArgumentError, match=problem) as error:
        shapes.load_shape(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("name", "parts"), [("mug", 3), ("bracket", 2)])
def test_the_shipped_meshes_are_bodies_of_parts(name, parts):
    shape = shapes.load_shape(f"package://drake_pregrasp/{name}.obj")
    assert_closed(shape)
    assert len(shape.part_names) == parts
    assert set(shape.face_parts) == set(range(parts))
