import dataclasses

import numpy as np
import pytest

from drake_pregrasp import ForbiddenPoints, InvalidArgumentError, box_surface

SIZES = [(0.1, 0.1, 0.1), (0.07, 0.07, 0.075), (0.2, 0.2, 0.1), (0.03, 0.05, 0.11)]


@pytest.mark.parametrize("size", SIZES)
def test_candidates_lie_on_allowed_faces_with_their_normals_and_areas(size):
    surface = box_surface(size, spacing=0.006, forbidden_faces=["-z", "+x"])
    x, y, z = size
    assert np.sum(surface.areas) == pytest.approx(x * y + y * z + 2 * x * z, rel=1e-12)
    on_face = np.sum(surface.p_OQ * surface.nhat_OQ, axis=1)
    np.testing.assert_allclose(on_face, np.abs(surface.nhat_OQ) @ size / 2, atol=1e-15)
    assert np.all(np.abs(surface.p_OQ) <= np.array(size) / 2 + 1e-15)
    assert {tuple(n) for n in surface.nhat_OQ} == {(-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1)}
    nearest, normals = surface.project(surface.p_OQ)
    np.testing.assert_allclose(nearest, surface.p_OQ, atol=1e-15)
    np.testing.assert_allclose(normals, surface.nhat_OQ, atol=1e-15)


def test_candidates_are_no_further_apart_than_the_spacing():
    surface = box_surface([0.07, 0.07, 0.075], spacing=0.005)
    for p_OQ in surface.p_OQ[::37]:
        others = np.linalg.norm(surface.p_OQ - p_OQ, axis=1)
        assert np.sort(others)[1] <= 0.005 + 1e-12


def test_forbidden_points_reach_the_rims_of_forbidden_faces_only():
    forbidden = box_surface([0.1, 0.1, 0.1], spacing=0.01).forbidden.points
    np.testing.assert_allclose(np.abs(forbidden[:, 2]), 0.05)
    np.testing.assert_allclose(
        [forbidden.min(axis=0), forbidden.max(axis=0)], [[-0.05] * 3] * 1 + [[0.05] * 3]
    )


def test_unknown_and_exhausted_faces_are_refused():
    with pytest.raises(InvalidArgumentError, match="'top' is not a face"):
        box_surface([0.1] * 3, spacing=0.01, forbidden_faces=["top"])
    with pytest.raises(InvalidArgumentError, match="none is left"):
        box_surface([0.1] * 3, spacing=0.01, forbidden_faces=["+x", "-x", "+y", "-y", "+z", "-z"])


@pytest.mark.parametrize(
    ("points", "radii", "normals"),
    [
        ((2, 3), [1.0], None),
        ((2,), [0, 0], None),
        ((2, 3), [0, 0], (1, 3)),
        ((2, 3), [0.0, -1.0], None),
    ],
)
def test_forbidden_points_refuse_shapes_and_negative_radii(points, radii, normals):
    with pytest.raises(InvalidArgumentError):
        ForbiddenPoints(np.zeros(points), np.array(radii), normals and np.zeros(normals))


def test_the_longest_lever_arm_reaches_the_farthest_corner():
    box = box_surface([0.2, 0.1, 0.04], spacing=0.02)
    assert box.longest_lever_arm == pytest.approx(np.linalg.norm([0.1, 0.05, 0.02]))
    lopsided = dataclasses.replace(box, p_OCoM=np.array([0.1, 0.0, 0.0]))
    assert lopsided.longest_lever_arm == pytest.approx(np.linalg.norm([0.2, 0.05, 0.02]))
