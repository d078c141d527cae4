"""Thin walls: no region has candidates on both sides, and a convex body has no walls."""

from dataclasses import replace

import numpy as np
import pytest
from selections import regions_of
from thin_cup import CUP, RADIUS, WALL

from drake_pregrasp import ForbiddenPoints, box_surface
from drake_pregrasp.geometry.mesh_surface import AxisArea, mesh_surface
from drake_pregrasp.geometry.shapes import ball_shape, box_shape
from drake_pregrasp.regions.constraints import RegionConstraints
from drake_pregrasp.regions.safe_regions import NO_REGION, compute_safe_regions, safe_region_labels
from drake_pregrasp.regions.walls import SurfaceGraph, normals_agree

BALL = mesh_surface(ball_shape(0.04), spacing=0.006)
CUBE = box_surface([0.1, 0.1, 0.1], spacing=0.01, forbidden_faces=[])
PLATE = mesh_surface(box_shape([0.1, 0.1, 0.003]), spacing=0.006)
THIN_CUP = mesh_surface(CUP, spacing=0.006, no_touch=[AxisArea("+z"), AxisArea("-z")])
ON_PLATE = np.array([[0.02, 0.02, 0.0015], [0.02, -0.02, 0.0015], [-0.02, 0.0, 0.0015]])
AROUND = np.array([[np.cos(a), np.sin(a), 0] for a in (0.3, 2.0, 4.2)])
ON_CUP = RADIUS * AROUND + [0, 0, 0.045]


def labels_of(surface, p_OC, test):
    p_OC, nhat_OC = surface.project(p_OC)
    same_side = {
        "none": lambda: None,
        "normals": lambda: normals_agree(nhat_OC, surface.nhat_OQ),
        "surface": lambda: SurfaceGraph(surface).near_over_the_surface(p_OC, nhat_OC),
    }
    return regions_of(surface, p_OC, same_side=same_side[test]()).labels


@pytest.mark.parametrize(("surface", "p_OC"), [(PLATE, ON_PLATE), (THIN_CUP, ON_CUP)])
@pytest.mark.parametrize("test", ["none", "normals", "surface"])
def test_only_without_a_test_regions_reach_through_thin_walls(surface, p_OC, test):
    labels = labels_of(surface, p_OC, test)
    if surface is PLATE:
        behind = surface.nhat_OQ[:, 2] < -0.9
    else:
        behind = np.hypot(surface.p_OQ[:, 0], surface.p_OQ[:, 1]) < RADIUS - WALL / 2
    strays = []
    for i, normal in enumerate(surface.project(p_OC)[1]):
        near = np.linalg.norm(surface.p_OQ - p_OC[i], axis=1) < 0.012
        strays.append(np.any(labels[near & behind] == i))
        # Its own side is no smaller for the test: of two sides, each has its half.
        own = near & (surface.nhat_OQ @ normal > 0.5)
        assert np.all(labels[own] == i)
    assert np.any(strays) == (test == "none")


@pytest.mark.parametrize("test", ["normals", "surface"])
def test_candidates_behind_a_wall_belong_to_the_nearest_contact_on_their_side(test):
    p_OC = np.array([[0.01, 0.0, 0.0015], [-0.01, 0.0, -0.0015]])
    labels = labels_of(PLATE, p_OC, test)
    inner = np.all(np.abs(PLATE.p_OQ[:, :2]) < 0.02, axis=1)
    for sign, contact in ((1, 0), (-1, 1)):
        side = inner & (sign * PLATE.nhat_OQ[:, 2] > 0.9)
        assert np.sum(side) > 20
        assert np.all(labels[side] == contact)


def test_by_normals_the_side_of_a_plate_without_contacts_is_in_no_region():
    labels = labels_of(PLATE, ON_PLATE, "normals")
    assert np.all(labels[PLATE.nhat_OQ[:, 2] < -0.9] == NO_REGION)
    assert np.all(labels[PLATE.nhat_OQ[:, 2] > 0.9] != NO_REGION)


@pytest.mark.slow
def test_the_way_over_the_surface_leads_round_edges_that_normals_do_not_pass():
    """On a cup's rim both sides are near each other; deep in the cup they are not."""
    surface = mesh_surface(CUP, spacing=0.005)
    high = surface.project(np.array([[RADIUS, 0, 0.0895]]))
    low = surface.project(np.array([[RADIUS, 0, 0.03]]))
    inside = np.hypot(surface.p_OQ[:, 0], surface.p_OQ[:, 1]) < RADIUS - WALL / 2
    graph = SurfaceGraph(surface)
    for (p_OC, nhat), expected in ((high, True), (low, False)):
        near = graph.near_over_the_surface(p_OC, nhat)[0]
        behind = inside & (np.linalg.norm(surface.p_OQ - p_OC, axis=1) < 0.006)
        assert np.any(behind)
        assert np.any(near[behind]) == expected


@pytest.mark.parametrize("surface", [BALL, CUBE], ids=["ball", "cube"])
def test_convex_bodies_have_no_walls_for_the_way_over_the_surface(surface):
    p_OC = np.random.default_rng(0).choice(surface.p_OQ, 3, replace=False)
    opposite = surface.p_OQ @ p_OC[0] < -0.5 * np.linalg.norm(p_OC[0]) ** 2
    near = SurfaceGraph(surface).near_over_the_surface(p_OC, surface.project(p_OC)[1])
    assert np.all(near[0][~opposite])


def test_a_small_hole_in_the_allowed_surface_is_no_wall():
    """A grid lacks the candidates around a contact: ways lead round the hole, on the same side."""
    x = np.arange(-5.5, 6)
    grid = np.stack([*np.meshgrid(x, x), np.zeros((12, 12))], axis=-1).reshape(-1, 3)
    grid = grid[np.linalg.norm(grid, axis=1) > 1.5]
    up = np.tile([0.0, 0.0, 1.0], (len(grid), 1))
    holed = replace(PLATE, p_OQ=1e-3 * grid, nhat_OQ=up, areas=np.full(len(grid), 1e-6))
    near = SurfaceGraph(holed).near_over_the_surface(np.zeros((1, 3)), up[:1])
    assert np.all(near)


def test_normals_agree_up_to_120_degrees_and_with_points_off_the_surface():
    angles = np.radians([0, 90, 119, 121, 180])
    normals = np.stack([np.cos(angles), np.sin(angles), np.zeros(5)], axis=1)
    agrees = normals_agree(np.array([[1.0, 0, 0]]), np.vstack([normals, np.zeros(3)]))
    np.testing.assert_array_equal(agrees, [[True, True, True, False, False, True]])


def test_forbidden_surface_behind_a_wall_does_not_fence():
    """The lower side of a plate is forbidden; its upper one is free up to the rims."""
    plate = mesh_surface(box_shape([0.1, 0.1, 0.003]), spacing=0.006, no_touch=[AxisArea("-z")])
    p_OC = np.array([[0.0, 0.0, 0.0015]])
    active_forbidden_points = normals_agree(plate.project(p_OC)[1], plate.forbidden.normals)
    top = plate.nhat_OQ[:, 2] > 0.9
    fenced, free = (
        np.mean(regions_of(plate, p_OC, active_forbidden_points=own).labels[top] == 0)
        for own in (None, active_forbidden_points)
    )
    assert fenced < 0.5
    assert free == 1


def test_forbidden_points_that_fence_are_those_of_the_printed_equations():
    rng = np.random.default_rng(4)
    p_OC = rng.choice(CUBE.p_OQ, 3) + 1e-4 * rng.normal(size=(3, 3))
    z, R = rng.uniform(-0.07, 0.07, (8, 3)), rng.uniform(0, 0.01, 8)
    active_forbidden_points = rng.uniform(size=(3, 8)) > 0.5
    limits = RegionConstraints(3, active_forbidden_points=active_forbidden_points)
    result = compute_safe_regions(CUBE.p_OQ, p_OC, np.zeros(3), ForbiddenPoints(z, R), limits)
    for i, own in enumerate(active_forbidden_points):
        printed = safe_region_labels(CUBE.p_OQ, p_OC, np.zeros(3), z[own], R[own])
        np.testing.assert_array_equal(result.labels == i, printed == i)
