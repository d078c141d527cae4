import numpy as np
import pytest
import trimesh

from drake_pregrasp import InvalidArgumentError, load_shape
from drake_pregrasp.geometry.closed_surfaces import is_inside, orient_components


def saved(tmp_path, *pieces):
    file = tmp_path / "bodies.stl"
    trimesh.util.concatenate(pieces).export(file)
    return file


NONE, ALL, MOST, SOME = slice(0), slice(None), slice(1, None), slice(None, None, 3)


def box(size, center=(0.0, 0.0, 0.0), inverted=NONE):
    piece = trimesh.creation.box([size] * 3)
    piece.apply_translation(center)
    piece.faces[inverted] = piece.faces[inverted, ::-1]
    return piece


@pytest.mark.parametrize("first", [NONE, ALL, MOST, SOME])
@pytest.mark.parametrize("second", [NONE, ALL, MOST])
@pytest.mark.parametrize(("x", "sign"), [(0.1, 1), (0.0, -1)])
def test_a_body_beside_another_is_solid_and_one_inside_it_a_cavity(
    tmp_path, first, second, x, sign
):
    file = saved(tmp_path, box(0.06, inverted=first), box(0.03, (x, 0, 0), inverted=second))
    mesh = load_shape(file).mesh
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(0.06**3 + sign * 0.03**3)
    np.testing.assert_allclose(mesh.center_mass, [x * 0.03**3 / mesh.volume, 0, 0], atol=1e-9)


def test_and_one_inside_of_that_is_solid_again(tmp_path):
    file = saved(tmp_path, box(0.06), box(0.03), box(0.01))
    assert load_shape(file).mesh.volume == pytest.approx(0.06**3 - 0.03**3 + 0.01**3)


def test_bodies_that_cross_are_refused(tmp_path):
    file = saved(tmp_path, box(0.06), box(0.06, (0.03, 0.01, 0.02)))
    with pytest.raises(InvalidArgumentError, match=r"bodies\.stl has closed surfaces that cross"):
        load_shape(file)


def bar(x, y, z, center=(0.0, 0.0, 0.0)):
    piece = trimesh.creation.box([x, y, z])
    piece.apply_translation(center)
    return piece


@pytest.mark.parametrize("turn", [np.eye(4), trimesh.transformations.euler_matrix(0.3, 0.5, 0.7)])
@pytest.mark.parametrize(
    "pieces",
    [
        (bar(0.1, 0.02, 0.02), bar(0.02, 0.1, 0.02)),  # All their edges are in planes of the other.
        (bar(0.1, 0.02, 0.02), bar(0.02, 0.1, 0.03)),
        (bar(0.03, 0.03, 0.1), bar(0.1, 0.05, 0.04, (0, 0, 0.05))),
        (
            trimesh.creation.cylinder(radius=0.01, height=0.1),
            trimesh.creation.cylinder(radius=0.02, height=0.03),
        ),
    ],
)
def test_bodies_whose_corners_are_outside_each_other_cross(tmp_path, pieces, turn):
    pieces = [piece.copy().apply_transform(turn) for piece in pieces]
    with pytest.raises(InvalidArgumentError, match="has closed surfaces that cross"):
        load_shape(saved(tmp_path, *pieces))


@pytest.mark.parametrize("turn", [np.eye(4), trimesh.transformations.euler_matrix(0.3, 0.5, 0.7)])
@pytest.mark.parametrize(
    "second", [bar(0.1, 0.02, 0.06, (0, 0.02, 0.01)), bar(0.02, 0.02, 0.02, (0, 0, 0.02))]
)
def test_bodies_that_touch_do_not_cross(turn, second):
    pieces = [piece.copy().apply_transform(turn) for piece in (bar(0.1, 0.02, 0.02), second)]
    mesh = trimesh.util.concatenate(pieces)
    orient_components(mesh, "mesh")
    assert mesh.volume == pytest.approx(sum(piece.volume for piece in pieces))


def test_inside_is_inside_whichever_way_the_surface_is_turned():
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.08, 0.08, (400, 3))
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    distances = np.linalg.norm(points, axis=1)
    clear = np.abs(distances - 0.05) > 1e-3
    for triangles in (ball.triangles, ball.triangles[:, ::-1]):
        inside = is_inside(points, np.array(triangles))
        np.testing.assert_array_equal(inside[clear], distances[clear] < 0.05)
