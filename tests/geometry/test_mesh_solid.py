"""Signed distances of bodies with any surface, and their convex hulls."""

import numpy as np
import pytest
from conftest import slow
from scipy.spatial.transform import Rotation
from thin_cup import CUP

from drake_pregrasp import BallSolid, BoxSolid, load_shape, mesh_surface
from drake_pregrasp.geometry.distance_grid import CELL, MARGIN
from drake_pregrasp.geometry.mesh_solid import MeshSolid
from drake_pregrasp.geometry.shapes import box_shape
from drake_pregrasp.resources import resource_folder

SHAPES = {
    "cup": CUP,
    "bracket": load_shape(resource_folder("models") / "bracket.obj"),
    "box": box_shape([0.05, 0.06, 0.07]),
}
TURN, SHIFT = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix(), np.array([0.3, -0.2, 0.1])


@pytest.fixture(scope="module", params=["cup", slow("box"), slow("bracket")])
def body(request):
    shape = SHAPES[request.param]
    return MeshSolid.of(shape.mesh), mesh_surface(shape, spacing=0.01)


def places(surface, low, high, count=100):
    """Points over the surface, at heights in a range."""
    generator = np.random.default_rng(0)
    chosen = generator.integers(0, len(surface.p_OQ), count)
    heights = generator.uniform(low, high, (count, 1))
    return surface.p_OQ[chosen] + heights * surface.nhat_OQ[chosen]


@pytest.mark.parametrize(("low", "high"), [(-0.001, 0.001), (0.007, 0.011), (0.0, 0.03)])
def test_distances_are_those_from_the_mesh(body, low, high):
    solid, surface = body
    p_OP = places(surface, low, high)
    errors = np.abs(solid.distance(p_OP) - surface.distance(p_OP))
    assert np.median(errors) < 5e-5
    assert np.max(errors) < CELL / 2  # Within a cell at an edge, where the gradient jumps.


def test_they_are_exact_at_the_nodes_inside_and_outside(body):
    solid, surface = body
    grid = solid.surface
    nodes = np.random.default_rng(0).integers(0, len(grid.nodes), 300)
    p_OP = grid.low + grid.cell * np.stack(np.unravel_index(nodes, grid.counts), axis=1)
    np.testing.assert_allclose(grid.nodes[nodes, 0], surface.distance(p_OP), atol=5e-5)
    assert np.any(grid.nodes[:, 0] < -CELL / 4)


def test_beyond_the_grid_they_are_never_too_small_and_at_most_a_little_too_large(body):
    solid, surface = body
    low, high = surface.mesh.bounds
    p_OP = np.random.default_rng(0).uniform(low - 0.2, high + 0.2, (300, 3))
    far = p_OP[np.any((p_OP < low - MARGIN) | (p_OP > high + MARGIN), axis=1)]
    distances = surface.distance(far)
    excess = solid.distance(far) - distances
    assert np.min(excess) > -5e-5
    assert np.max(excess / distances) < 0.05


def test_gradients_are_unit_vectors_that_lead_away(body):
    solid, surface = body
    p_OP = places(surface, 0.004, 0.025)
    _, gradients = solid.distance_and_gradient(p_OP)
    np.testing.assert_allclose(np.linalg.norm(gradients, axis=1), 1, atol=1e-9)
    step = 1e-3
    gains = (surface.distance(p_OP + step * gradients) - surface.distance(p_OP)) / step
    assert np.mean(gains > 0.9) > 0.9  # But where two walls are equally near.


def test_those_of_points_that_are_not_known_are_nan(body):
    p_OP = np.array([[0.0, np.nan, 0.0], [np.nan, 1.0, np.nan], [0.1, 0.1, 0.1]])
    distances, gradients = body[0].distance_and_gradient(p_OP)
    np.testing.assert_array_equal(np.isnan(distances), [True, True, False])
    np.testing.assert_array_equal(np.isnan(gradients).any(axis=1), [True, True, False])


def test_a_moved_body_has_moved_distances_and_its_own_highest_point(body):
    solid, surface = body
    p_OP, moved = places(surface, 0.001, 0.009), solid.moved(TURN, SHIFT)
    distances, gradients = solid.distance_and_gradient(p_OP)
    there = moved.distance_and_gradient(p_OP @ TURN.T + SHIFT)
    np.testing.assert_allclose(there[0], distances, atol=1e-12)
    np.testing.assert_allclose(there[1], gradients @ TURN.T, atol=1e-9)
    highest = np.max(surface.mesh.vertices @ TURN.T + SHIFT, axis=0)
    assert [moved.highest(axis) for axis in np.eye(3)] == pytest.approx(highest)


def test_the_hull_contains_the_body_and_is_the_body_itself_if_that_is_convex(body):
    solid, surface = body
    hull = solid.hull()
    assert (hull is solid) == surface.mesh.is_convex
    p_OP = places(surface, -0.001, 0.03)
    assert np.max(hull.distance(p_OP) - solid.distance(p_OP)) < CELL
    assert hull.hull() is hull


def test_simple_solids_have_the_same_distances_as_their_meshes():
    solid = BoxSolid(np.array([0.01, 0.0, 0.02]), TURN, np.array([0.05, 0.06, 0.07]))
    mesh = box_shape([0.05, 0.06, 0.07])
    same = MeshSolid.of(mesh.mesh).moved(TURN, np.array([0.01, 0.0, 0.02]))
    p_OP = places(mesh_surface(mesh, spacing=0.005), 0.002, 0.02) @ TURN.T + same.p_FM
    np.testing.assert_allclose(solid.distance(p_OP), same.distance(p_OP), atol=CELL / 4)
    assert [solid.highest(a) for a in np.eye(3)] == pytest.approx(
        [same.highest(a) for a in np.eye(3)]
    )
    assert BallSolid(SHIFT, 0.03).highest(TURN[0]) == pytest.approx(SHIFT @ TURN[0] + 0.03)
    assert solid.hull() is solid
