"""Laws of even samples, and of the surfaces that are made of them."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree
from thin_cup import CUP

from drake_pregrasp.geometry.mesh_surface import AxisArea, mesh_surface
from drake_pregrasp.geometry.sampling import choose_evenly, lifted, split_triangles
from drake_pregrasp.geometry.shapes import Shape, ball_shape, box_shape

NO_ENDS = (AxisArea("+z"), AxisArea("-z"))


def pieces(shape=CUP, edge=0.004):
    return split_triangles(np.array(shape.mesh.triangles), shape.mesh.face_normals, edge)


@pytest.mark.parametrize("edge", [0.5, 0.01, 0.003])
def test_a_split_surface_is_the_same_surface(edge):
    triangles = pieces(edge=edge)
    mesh = CUP.mesh
    edges = np.roll(triangles.corners, -1, axis=1) - triangles.corners
    assert np.max(np.linalg.norm(edges, axis=2)) <= edge * (1 + 1e-12)
    areas = np.bincount(triangles.faces, weights=triangles.areas, minlength=len(mesh.faces))
    np.testing.assert_allclose(areas, mesh.area_faces, rtol=1e-9)
    normals = np.cross(edges[:, 0], edges[:, 1])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    np.testing.assert_allclose(normals, triangles.normals, atol=1e-6)
    np.testing.assert_array_equal(triangles.normals, mesh.face_normals[triangles.faces])


@pytest.mark.parametrize("distance", [0.004, 0.02])
def test_samples_are_apart_and_none_could_be_added(distance):
    triangles = pieces()
    samples, owners = choose_evenly(triangles, distance, np.random.default_rng(0))
    points = lifted(triangles.centroids, triangles.normals, distance)
    tree = cKDTree(points[samples])
    assert np.min(tree.query(points[samples], k=2)[0][:, 1]) >= distance * (1 - 1e-9)
    nearest, _ = tree.query(points)
    assert np.max(nearest) <= distance * (1 + 1e-9)
    own = np.linalg.norm(points - points[samples[owners]], axis=1)
    np.testing.assert_allclose(own, nearest)
    np.testing.assert_array_equal(owners[samples], np.arange(len(samples)))


def test_the_same_seed_gives_the_same_bytes_and_another_one_others():
    one, again, other = (
        mesh_surface(CUP, spacing=0.008, seed=seed, no_touch=NO_ENDS) for seed in (3, 3, 4)
    )
    for name in ("p_OQ", "areas", "patches"):
        assert getattr(one, name).tobytes() == getattr(again, name).tobytes()
    assert one.forbidden.points.tobytes() == again.forbidden.points.tobytes()
    assert one.p_OQ.tobytes() != other.p_OQ.tobytes()


@pytest.fixture(scope="module")
def cup():
    return mesh_surface(CUP, spacing=0.008, no_touch=NO_ENDS)


def patch_owners(surface):
    return np.repeat(np.arange(len(surface.p_OQ)), np.diff(surface.patch_starts))


def test_patches_partition_the_allowed_surface(cup):
    allowed = np.abs(CUP.mesh.face_normals[:, 2]) < 0.5
    area = np.sum(CUP.mesh.area_faces[allowed])
    assert np.sum(cup.areas) == pytest.approx(area, rel=1e-9)
    owners = patch_owners(cup)
    areas = np.bincount(owners, weights=trimesh.triangles.area(cup.patches))
    np.testing.assert_allclose(areas, cup.areas, rtol=1e-9)
    # All triangles together have the area, and no two are the same: so they do not overlap.
    centroids = np.mean(cup.patches, axis=1)
    assert np.min(cKDTree(centroids).query(centroids, k=2)[0][:, 1]) > 1e-5
    assert np.max(np.linalg.norm(centroids - cup.p_OQ[owners], axis=1)) <= 0.75 * 0.008


def test_each_candidate_lies_on_its_own_patch_with_its_normal(cup):
    every = [np.array([q]) for q in range(len(cup.p_OQ))]
    nearest, normals = cup.project_into(cup.p_OQ, every)
    np.testing.assert_allclose(nearest, cup.p_OQ, atol=1e-12)
    np.testing.assert_allclose(normals, cup.nhat_OQ, atol=1e-9)


def nearest_by_brute_force(triangles, point):
    tiled = np.tile(point, (len(triangles), 1))
    closest = trimesh.triangles.closest_point(1e4 * triangles, 1e4 * tiled) / 1e4
    return np.min(np.linalg.norm(closest - point, axis=1))


@pytest.mark.parametrize("size", [None, 1, 2, 5, 40])
def test_projection_is_the_nearest_point_of_the_allowed_or_of_the_given_patches(cup, size):
    rng, owners = np.random.default_rng(0), patch_owners(cup)
    points = rng.uniform([-0.06, -0.06, -0.03], [0.06, 0.06, 0.12], (20, 3))
    count = len(cup.p_OQ)
    chosen = [np.sort(rng.choice(count, size or count, replace=False)) for _ in points]
    nearest, normals = cup.project_into(points, chosen) if size else cup.project(points)
    np.testing.assert_allclose(cup.distance(nearest), 0, atol=1e-9)
    for point, candidates, q, normal in zip(points, chosen, nearest, normals, strict=True):
        patches = cup.patches[np.isin(owners, candidates)]
        least = nearest_by_brute_force(patches, point)
        assert np.linalg.norm(q - point) == pytest.approx(least, abs=1e-9)
        assert nearest_by_brute_force(patches, q) < 1e-9
        assert np.linalg.norm(normal) == pytest.approx(1)
        assert np.max(cup.nhat_OQ[candidates] @ normal) > 0.9


def test_candidates_within_reach_hold_all_patches_that_near(cup):
    point = np.array([0.035, 0.0, 0.05])
    near = cup.candidates_within(point, 0.01)
    owners = patch_owners(cup)
    for candidate in range(len(cup.p_OQ)):
        if nearest_by_brute_force(cup.patches[owners == candidate], point) <= 0.01:
            assert candidate in near
    assert np.max(np.linalg.norm(cup.p_OQ[near] - point, axis=1)) < 0.03


def test_signed_distances_of_a_box_are_exact_also_from_forbidden_faces():
    surface = mesh_surface(box_shape([0.04, 0.06, 0.1]), spacing=0.02, no_touch=NO_ENDS)
    points = np.random.default_rng(2).uniform(-0.08, 0.08, (60, 3))
    beyond = np.abs(points) - [0.02, 0.03, 0.05]
    expected = np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)
    assert np.min(expected) < 0 < np.max(expected)
    np.testing.assert_allclose(surface.distance(points), expected, atol=1e-9)
    assert np.isnan(surface.distance(np.array([[np.nan, 0, 0]]))[0])


def extruded(points, faces, height):
    mesh = trimesh.creation.extrude_triangulation(points, faces, height)
    return Shape(mesh, ("body",), np.zeros(len(mesh.faces), dtype=np.int64))


def test_at_a_sharp_edge_signs_tell_in_from_out():
    """Beyond the edge of a thin wedge, points are behind the one face and before the other."""
    corners = 0.1 * np.array([[0, 0], [1, -0.1], [1, 0.1]])
    surface = mesh_surface(extruded(corners, [[0, 1, 2]], 0.1), spacing=0.02)
    points = np.random.default_rng(4).uniform([-0.01, -0.01, 0.02], [0.04, 0.01, 0.08], (200, 3))
    inside = np.abs(points[:, 1]) < 0.1 * points[:, 0]
    assert 0 < np.sum(inside) < len(points)
    np.testing.assert_array_equal(surface.distance(points) < 0, inside)


def uneven_plate():
    """A plate whose triangles are a hundred times denser on its right than on its left."""
    xs = np.concatenate([[-0.05, -0.025], np.linspace(0, 0.05, 101)])
    points = np.array([[x, y] for x in xs for y in (-0.02, 0.02)])
    cells = 2 * np.arange(len(xs) - 1)[:, None]
    faces = np.concatenate([cells + np.array([0, 2, 1]), cells + np.array([1, 2, 3])])
    return extruded(points, faces, 0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    "shape", [CUP, ball_shape(0.03), uneven_plate()], ids=["cup", "ball", "uneven plate"]
)
def test_area_weighted_sums_approach_the_integral(shape):
    """The centroid of the half of the surface with x > 0, against the mesh's own triangles."""
    fine = pieces(shape, edge=0.001)
    half = fine.centroids[:, 0] > 0
    exact = np.average(fine.centroids[half], axis=0, weights=fine.areas[half])
    spacings, errors = np.array([0.012, 0.006, 0.003]), []
    for spacing in spacings:
        surface = mesh_surface(shape, spacing=spacing)
        mine = surface.p_OQ[:, 0] > 0
        assert np.mean(mine) == pytest.approx(0.5, abs=0.12)
        centroid = np.average(surface.p_OQ[mine], axis=0, weights=surface.areas[mine])
        errors.append(np.linalg.norm(centroid - exact))
    assert errors[-1] < 0.4 * errors[0]
    assert np.all(np.array(errors) < 0.25 * spacings)
