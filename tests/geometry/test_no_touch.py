"""No-touch areas hold no part of the allowed surface."""

import numpy as np
import pytest

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.errors import NoSurfaceError
from drake_pregrasp.geometry.mesh_surface import (
    AxisArea,
    FacingArea,
    PartArea,
    is_forbidden,
    mesh_surface,
)
from drake_pregrasp.geometry.sampling import split_triangles
from drake_pregrasp.geometry.shapes import box_shape, cylinder_shape, load_shape
from drake_pregrasp.geometry.solids import BallSolid, BoxSolid, HalfSpace
from drake_pregrasp.resources import resource_folder

CAN = cylinder_shape(0.03, 0.1)
TILT = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
SOLIDS = {
    "ball": BallSolid(np.array([0.03, 0.0, 0.02]), 0.02),
    "box": BoxSolid(np.array([0.0, 0.03, 0.0]), TILT, np.array([0.03, 0.05, 0.02])),
    "half-space": HalfSpace(np.array([0.0, 0.0, -0.02]), np.array([0.2, 0.0, 1.0])),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_no_point_of_an_allowed_patch_lies_in_a_forbidden_solid(name):
    solid = SOLIDS[name]
    surface = mesh_surface(CAN, spacing=0.008, no_touch=[solid])
    inside = np.random.default_rng(0).dirichlet(np.ones(3), 20)
    points = np.vstack([np.eye(3), inside]) @ surface.patches  # Corners, and points between them.
    assert np.min(solid.distance(points.reshape(-1, 3))) >= -1e-12
    # Nor is more forbidden than triangles that reach into it: half a spacing at the most.
    everywhere = split_triangles(np.array(CAN.mesh.triangles), CAN.mesh.face_normals, 0.004)
    clear = solid.distance(everywhere.centroids) > 0.004
    assert np.sum(everywhere.areas[clear]) <= np.sum(surface.areas) < CAN.mesh.area
    assert len(surface.forbidden) > 0
    assert np.max(solid.distance(surface.forbidden.points)) <= 0.004


@pytest.mark.parametrize("angle", [0.3, 1.0])
def test_a_facing_area_forbids_a_cone_of_normals(angle):
    direction = [3, 4, 0]
    surface = mesh_surface(CAN, spacing=0.006, no_touch=[FacingArea(direction, angle)])
    cosines = surface.nhat_OQ @ direction / 5
    assert np.max(cosines) < np.cos(angle)
    assert np.max(cosines) > np.cos(angle + 0.2)
    assert np.min(surface.forbidden.normals @ direction / 5) >= np.cos(angle) - 1e-9


@pytest.mark.parametrize("face", ["+x", "-x", "+y", "-y", "+z", "-z"])
def test_an_axis_area_forbids_one_face_of_a_box(face):
    size = np.array([0.04, 0.06, 0.08])
    surface = mesh_surface(box_shape(size), spacing=0.01, no_touch=[AxisArea(face)])
    axis, sign = "xyz".index(face[1]), {"+": 1, "-": -1}[face[0]]
    area = np.prod(np.delete(size, axis))
    whole = 2 * sum(np.prod(np.delete(size, k)) for k in range(3))
    assert np.sum(surface.areas) == pytest.approx(whole - area)
    np.testing.assert_allclose(surface.forbidden.points[:, axis], sign * size[axis] / 2)
    np.testing.assert_allclose(surface.forbidden.normals[:, axis], sign)


def test_a_named_part_is_forbidden_as_a_whole():
    mug = load_shape(resource_folder("models") / "mug.obj")
    part = mug.part("handle")
    surface = mesh_surface(mug, spacing=0.008, no_touch=[PartArea(part)])
    is_part = mug.face_parts == part
    assert np.sum(surface.areas) == pytest.approx(np.sum(mug.mesh.area_faces[~is_part]), rel=1e-6)
    triangles = split_triangles(np.array(mug.mesh.triangles), mug.mesh.face_normals, 0.004)
    forbidden = is_forbidden(triangles, mug.face_parts, [PartArea(part)])
    np.testing.assert_array_equal(forbidden, is_part[triangles.faces])


def test_areas_add_up():
    areas = [*SOLIDS.values(), AxisArea("+z"), FacingArea(np.array([-1.0, 0, 0]), 0.2), PartArea(1)]
    parts = (CAN.mesh.face_normals[:, 1] > 0.9).astype(np.int64)
    triangles = split_triangles(np.array(CAN.mesh.triangles), CAN.mesh.face_normals, 0.004)
    each = [is_forbidden(triangles, parts, [area]) for area in areas]
    assert all(np.any(mask) for mask in each)
    for k in range(len(areas)):
        together = is_forbidden(triangles, parts, areas[k:] + areas[:k])
        np.testing.assert_array_equal(together, np.any(each, axis=0))
    assert not np.any(is_forbidden(triangles, CAN.face_parts, []))


def test_forbidden_points_are_spread_over_their_area():
    surface = mesh_surface(CAN, spacing=0.006, no_touch=[AxisArea("+z")], forbidden_spacing=0.01)
    forbidden = surface.forbidden
    np.testing.assert_allclose(forbidden.radii, 0.005)
    rng = np.random.default_rng(1)
    radii, angles = 0.0299 * np.sqrt(rng.uniform(size=200)), rng.uniform(0, 2 * np.pi, 200)
    lid = np.stack([radii * np.cos(angles), radii * np.sin(angles), np.full(200, 0.05)], axis=1)
    away = np.linalg.norm(lid[:, None] - forbidden.points, axis=2)
    assert np.max(np.min(away, axis=1)) < 0.75 * 0.01 + 0.003


def test_candidates_in_the_balls_round_forbidden_points_are_known():
    surface = mesh_surface(CAN, spacing=0.004, no_touch=[AxisArea("+z")])
    gaps = np.linalg.norm(surface.p_OQ[:, None] - surface.forbidden.points, axis=2)
    clear = np.all(gaps > surface.forbidden.radii, axis=1)
    assert 0 < np.sum(~clear) < len(clear)
    np.testing.assert_array_equal(surface.is_clear_of_forbidden_points, clear)


@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (lambda: mesh_surface(CAN, spacing=0.0), "spacings must be above 0 m"),
        (lambda: mesh_surface(CAN, spacing=0.1, forbidden_spacing=-1), "above 0 m"),
        (lambda: mesh_surface(CAN, spacing=1e-5), "choose a larger spacing"),
        (lambda: FacingArea(np.zeros(3), 0.5), "must not be zero"),
    ],
)
def test_settings_without_sense_are_refused(make, problem):
    with pytest.raises(InvalidArgumentError, match=problem):
        make()


def test_with_all_surface_forbidden_none_is_left():
    with pytest.raises(NoSurfaceError, match="make the forbidden areas smaller"):
        mesh_surface(CAN, spacing=0.01, no_touch=[BallSolid(np.zeros(3), 1.0)])
