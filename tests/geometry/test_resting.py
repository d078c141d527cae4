"""Resting poses against the law of the support polygon, and against Drake."""

import numpy as np
import pytest
import trimesh
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from drake_pregrasp.config.object_config import Box, Conveyor, Cylinder, Mesh
from drake_pregrasp.diagrams.object_plant import ObjectPlant
from drake_pregrasp.geometry import resting
from drake_pregrasp.geometry.resting import (
    TIPPING,
    flat_sides,
    settled_rotation,
    stable_rotation,
)
from drake_pregrasp.geometry.shapes import box_shape

CAN = trimesh.creation.cylinder(0.04, 0.11, sections=32)


def tilt(R):
    return np.degrees(np.arccos(np.clip(R[2, 2], -1, 1)))


def turned(mesh, R):
    return trimesh.Trimesh(mesh.vertices @ R.T, mesh.faces, process=False)


def random_body(seed):
    points = np.random.default_rng(seed).normal(size=(30, 3)) * [0.02, 0.03, 0.05]
    return trimesh.convex.convex_hull(points)


def inside(mesh):
    """Returns how far the vertical through the centre of mass is inside the support polygon."""
    p = mesh.vertices - mesh.center_mass
    support = p[p[:, 2] <= np.min(p[:, 2]) + 1e-6, :2]
    return -np.max(ConvexHull(support).equations[:, 2])


@pytest.mark.parametrize("seed", range(20))
def test_a_body_settles_lower_with_its_centre_of_mass_over_its_support(seed):
    mesh = random_body(seed)
    before = mesh.center_mass[2] - mesh.bounds[0, 2]
    settled = turned(mesh, settled_rotation(mesh))
    assert inside(settled) > 0
    assert settled.center_mass[2] - settled.bounds[0, 2] < before
    np.testing.assert_array_equal(settled_rotation(settled), np.eye(3))


@pytest.mark.parametrize(("angle", "goes_on"), [(0.5, False), (0.65, True), (-0.65, True)])
def test_a_tilted_box_tips_to_the_face_on_the_side_of_its_centre_of_mass(angle, goes_on):
    # A box of 40 x 60 x 60 mm that is tilted about x rests on the other face beyond 45°, and about
    # y beyond atan(40/60) = 0.588.
    box = box_shape([0.04, 0.06, 0.06]).turned(Rotation.from_euler("y", angle).as_matrix())
    after = np.sign(angle) * (np.pi / 2 if goes_on else 0.0)
    expected = Rotation.from_euler("y", after - angle).as_matrix()
    np.testing.assert_allclose(settled_rotation(box.mesh), expected, atol=1e-9)


@pytest.mark.parametrize("axis", ["x", "xy"])
def test_a_box_that_balances_on_an_edge_or_a_corner_falls(axis):
    angles = [np.pi / 4, np.arctan(np.sqrt(0.5))][: len(axis)]
    box = box_shape([0.05] * 3).turned(Rotation.from_euler(axis, angles).as_matrix())
    R = settled_rotation(box.mesh)
    assert tilt(R) > 30
    assert inside(turned(box.mesh, R)) == pytest.approx(0.025)


def test_a_narrow_face_beside_a_lower_pose_is_not_firm():
    # A box with a chamfer that is just wide enough to stand on.
    outline = np.array([[-0.03, 0.0], [0.03, 0.0], [0.03, 0.03], [0.002, 0.0581], [-0.03, 0.03]])
    for spread, rests in ((0.0002, False), (0.004, True)):
        points = outline.copy()
        points[3] = [spread, 0.0581]
        points = np.vstack([points, [-spread, 0.0581]])
        body = trimesh.convex.convex_hull([[x, y, z] for x, z in points for y in (-0.02, 0.02)])
        upside_down = turned(body, Rotation.from_euler("x", np.pi).as_matrix())
        assert inside(upside_down) == pytest.approx(spread, abs=1e-6)
        assert bool(tilt(settled_rotation(upside_down)) == 0) is rests


@pytest.mark.parametrize("seed", range(5))
def test_the_most_probable_pose_rests_and_is_the_same_from_all_orientations(seed):
    pytest.importorskip("networkx")
    mesh, rng = random_body(seed), np.random.default_rng(seed)
    downs = []
    for R in (np.eye(3), *Rotation.random(3, random_state=rng).as_matrix()):
        body = turned(mesh, R)
        stable = stable_rotation(body)
        assert tilt(settled_rotation(turned(body, stable))) == 0
        downs.append((stable @ R)[2])
    np.testing.assert_allclose(downs, [downs[0]] * 4, atol=1e-6)


def test_a_plate_lies_flat_and_is_not_turned_over():
    pytest.importorskip("networkx")
    for rpy in ([0.0, 0.0, 0.3], [np.pi / 2, 0.0, 0.3]):
        plate = Box([0.1, 0.08, 0.02], rpy=rpy, rest="stable").make_shape()
        assert plate.mesh.extents[2] == pytest.approx(0.02)
    flat = box_shape([0.1, 0.08, 0.02]).mesh
    np.testing.assert_allclose(stable_rotation(flat), np.eye(3), atol=1e-9)


@pytest.mark.parametrize(("length", "lies"), [(0.01, False), (0.2, True)])
def test_the_facets_of_a_round_side_count_together(length, lies):
    pytest.importorskip("networkx")
    height = Cylinder(radius=0.03, length=length, rest="stable").make_shape().mesh.extents[2]
    assert height == pytest.approx(0.06 if lies else length, rel=0.01)


def test_hulls_with_too_many_triangles_and_a_missing_package_are_refused(monkeypatch):
    with monkeypatch.context() as without:
        without.setattr("importlib.util.find_spec", lambda name: None)
        with pytest.raises(resting.InvalidArgumentError, match=r"needs networkx; .*\[meshes\]"):
            stable_rotation(box_shape([0.1, 0.1, 0.1]).mesh)
    pytest.importorskip("networkx")
    monkeypatch.setattr(resting, "MAX_HULL_TRIANGLES", 11)
    with pytest.raises(resting.InvalidArgumentError, match="at most 11 triangles, not 12"):
        stable_rotation(box_shape([0.1, 0.1, 0.1]).mesh)


def tilts_in_drake(config, times):
    plant = ObjectPlant(config, Conveyor(0.02, 0.17), MultibodyPlantConfig(time_step=0.005))
    simulator, port = Simulator(plant), plant.GetOutputPort("X_WO")
    for time in times:
        simulator.AdvanceTo(time)
        yield tilt(port.Eval(simulator.get_context()).rotation().matrix())


@pytest.mark.slow
@pytest.mark.parametrize(
    "config",
    [
        Box([0.06, 0.08, 0.1], rpy=[0.9, 0.2, 0.0]),
        Cylinder(0.03, 0.1, rpy=[0.2, 0.1, 0.0]),
        Mesh("package://drake_pregrasp/hammer.obj", rpy=[0.5, 0.2, 0.0]),
    ],
)
def test_drake_tips_a_body_as_far_as_predicted_and_leaves_a_settled_one(config):
    predicted = tilt(settled_rotation(config.make_shape().mesh))
    *_, last = tilts_in_drake(config, [3.0])
    assert last == pytest.approx(predicted, abs=3.0)
    assert predicted > 5
    config.rest = "settled"
    assert max(tilts_in_drake(config, [0.1, 0.5, 1.0])) < 0.3


def test_simple_solids_turn_with_their_meshes():
    config = Box([0.1, 0.06, 0.03], rpy=[0.3, 0.5, 0.7])
    shape = config.make_shape()
    R = RollPitchYaw(config.rpy).ToRotationMatrix()
    corners = RigidTransform(R, np.zeros(3)) @ np.transpose([[0.05, 0.03, 0.015], [0.0, 0.0, 0.02]])
    np.testing.assert_allclose(shape.solid.distance(corners.T), [0, 0.005], atol=1e-12)
    assert shape.mesh.volume == pytest.approx(0.1 * 0.06 * 0.03)
    distances = shape.solid.distance(shape.mesh.vertices)
    np.testing.assert_allclose(distances, 0, atol=1e-12)


def sides_of(mesh):
    """The flat sides of a mesh, each with what it is to be: flat, tangent, and wide enough."""
    corners, com = np.array(mesh.convex_hull.vertices), mesh.center_mass
    found, flatness = flat_sides(corners, com), 1e-3 * np.ptp(corners, axis=0).max()
    for nhat, p_OV in found:
        heights = (p_OV - com) @ nhat
        assert heights.min() > 0
        assert np.ptp(heights) < 2 * flatness
        assert np.max((corners - com) @ nhat) < heights.max() + flatness
        assert len(np.unique(p_OV, axis=0)) == len(p_OV) in (3, 4)
        spans = np.linalg.svd(p_OV - p_OV.mean(axis=0))[1]  # Along two directions of the plane.
        assert spans[1] > 0.25 * heights.max() * np.tan(TIPPING)
    return found


def random_turn(seed):
    return Rotation.random(rng=np.random.default_rng(seed)).as_matrix()


@pytest.mark.parametrize("sections", [23, 24, 32, 64])
def test_a_can_stands_on_its_ends_and_rolls_on_its_facets(sections):
    R = random_turn(sections)
    found = sides_of(turned(trimesh.creation.cylinder(0.04, 0.11, sections=sections), R))
    assert len(found) == 2
    np.testing.assert_allclose(np.abs([side.nhat @ R[:, 2] for side in found]), 1.0, atol=1e-6)
    assert not sides_of(trimesh.creation.icosphere(3, 0.04))


def test_round_shapes_of_scenarios_roll():
    can = Cylinder(radius=0.04, length=0.11).make_shape()
    assert len(sides_of(can.mesh)) == 2


@pytest.mark.parametrize(("width", "count"), [(0.03, 6), (0.02, 4)])
def test_a_box_stands_on_a_side_that_it_does_not_tip_over_at_eight_degrees(width, count):
    """Of 0.2 m, it tips over on an end of 0.03 m at 8.5 degrees, and on one of 0.02 m at 5.7."""
    assert len(sides_of(trimesh.creation.box([width, 0.1, 0.2]))) == count


@pytest.mark.slow
@pytest.mark.parametrize("digits", [7, 6, 5, 4])
def test_rounded_vertices_change_no_side(digits):
    """As in a file; a side of fine triangles is one side, too."""
    box = trimesh.creation.box([0.1, 0.08, 0.06])
    for seed in range(8):
        for mesh, count in ((box, 6), (box.subdivide().subdivide(), 6), (CAN, 2)):
            rough = turned(mesh, random_turn(seed))
            rough.vertices = rough.vertices.round(digits)
            found = sides_of(rough)
            assert len(found) == count
            normals = np.array([side.nhat for side in found])
            assert np.sum(normals @ normals.T < -0.999) == count


def test_a_tetrahedron_has_four_sides_of_three_vertices():
    found = sides_of(trimesh.convex.convex_hull(np.vstack([np.zeros(3), 0.05 * np.eye(3)])))
    assert [len(side.p_OV) for side in found] == [3] * 4


def test_a_body_stands_on_no_side_beyond_which_its_centre_of_mass_is():
    corners = np.array(trimesh.creation.box([0.1, 0.08, 0.06]).vertices)
    found = flat_sides(corners, np.array([0.0, 0.0, 0.05]))
    assert not any(side.nhat[2] > 0.9 for side in found)


@pytest.mark.parametrize("seed", range(10))
def test_a_body_settles_on_a_flat_side_if_it_is_wide(seed):
    settled = turned(mesh := random_body(seed), settled_rotation(mesh))
    height = settled.center_mass[2] - settled.bounds[0, 2]
    is_wide = inside(settled) > height * np.tan(TIPPING)
    down = [side.nhat[2] < -1 + 1e-6 for side in sides_of(settled)]
    assert any(down) == is_wide
