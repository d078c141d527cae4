"""Places of paired contacts, and points that are opposite each other."""

import tracemalloc

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drake_pregrasp.contacts.contact_pairs import OppositePoints, Pair
from drake_pregrasp.geometry.mesh_surface import mesh_surface
from drake_pregrasp.geometry.shapes import box_shape

RNG = np.random.default_rng(0)
NORMALS = np.array([[1.0, 0.1, 0.0], [-1.0, 0.1, 0.0]]) / np.hypot(1, 0.1)
JAWS, COUPLED = Pair(first=0, second=1), Pair(first=0, second=1, distance=0.07)


@pytest.mark.parametrize("pair", [JAWS, COUPLED])
def test_at_its_place_the_second_contact_has_no_error(pair):
    for p_OC in RNG.normal(scale=0.1, size=(20, 2, 3)):
        place = pair.place(p_OC[0], NORMALS[0], p_OC[1], NORMALS[1])
        assert pair.error(np.array([p_OC[0], place]), NORMALS) == pytest.approx(0, abs=1e-12)
        to_place = np.linalg.norm(place - p_OC[1])
        assert pair.error(p_OC, NORMALS) == pytest.approx(to_place)
        R = Rotation.random(random_state=1).as_matrix()
        turned = pair.place(R @ p_OC[0], R @ NORMALS[0], R @ p_OC[1], R @ NORMALS[1])
        np.testing.assert_allclose(turned, R @ place, atol=1e-12)


def test_opposite_contacts_are_on_a_line_along_the_mean_of_their_normals():
    p_OC = np.array([[0.04, 0.0, 0.01], [-0.04, 0.003, 0.005]])
    place = JAWS.place(p_OC[0], NORMALS[0], p_OC[1], NORMALS[1])
    np.testing.assert_allclose(place, [-0.04, 0.0, 0.01], atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_jaws_have_opposite_contacts_across_their_axis(seed):
    rng = np.random.default_rng(seed)
    axis, *normals = (v / np.linalg.norm(v) for v in rng.normal(size=(3, 3)))
    p_OA, p_OB = rng.normal(scale=0.1, size=(2, 3))
    place = JAWS.place(p_OA, normals[0], p_OB, normals[1], axis)
    line = JAWS.line(*normals, axis)
    assert np.linalg.norm(line) == pytest.approx(1)
    assert [line @ axis, (place - p_OA) @ axis] == pytest.approx([0, 0], abs=1e-12)
    np.testing.assert_allclose(np.cross(place - p_OA, line), 0, atol=1e-12)
    # It is the nearest such place, and of such lines the nearest to the mean of the normals.
    assert (p_OB - place) @ line == pytest.approx(0, abs=1e-12)
    between = normals[1] - normals[0]
    assert between @ np.cross(axis, line) == pytest.approx(0, abs=1e-12)
    assert between @ line > 0
    np.testing.assert_allclose(JAWS.line(*normals[::-1], axis), -line, atol=1e-12)


def test_heights_of_jaws_are_an_error_although_their_normals_are_opposite():
    tilted = np.array([[np.cos(0.3), 0.0, np.sin(0.3)], [-np.cos(0.3), 0.0, -np.sin(0.3)]])
    p_OC = 0.04 * tilted
    assert JAWS.error(p_OC, tilted) == pytest.approx(0, abs=1e-12)
    assert JAWS.error(p_OC, tilted, np.eye(3)[2]) == pytest.approx(0.08 * np.sin(0.3))


def test_contacts_at_one_point_are_at_no_distance():
    assert COUPLED.error(np.zeros((2, 3)), NORMALS) == pytest.approx(0.07)


def test_the_least_width_across_an_axis_is_that_of_the_box():
    size = np.array([0.08, 0.05, 0.03])
    surface = mesh_surface(box_shape(size), spacing=0.008)
    for axis, least in zip(np.eye(3), [0.03, 0.03, 0.05], strict=True):
        points = OppositePoints(surface.p_OQ, surface.nhat_OQ, 0.004, axis)
        assert points.least_width(JAWS) == pytest.approx(least, abs=1e-6)


@pytest.mark.slow
def test_the_least_width_of_many_points_needs_little_memory():
    p_OQ = np.random.default_rng(0).uniform(-0.04, 0.04, (1500, 3))
    normals = np.tile([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]], (750, 1))
    tracemalloc.start()
    OppositePoints(p_OQ, normals, 0.004, np.array([0.0, 0.0, 1.0])).least_width(JAWS)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 10e6
