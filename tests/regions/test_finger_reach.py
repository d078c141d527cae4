"""Reach of a finger."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.box_surface import box_surface
from drake_pregrasp.geometry.mesh_surface import AxisArea
from drake_pregrasp.geometry.solids import BallSolid
from drake_pregrasp.regions.constraints import Limit, RegionConstraints
from drake_pregrasp.regions.finger_reach import FingerReach

CUBE = box_surface([0.1, 0.1, 0.1], spacing=0.005, forbidden_faces=["+z", "-z"])
TIPS = CUBE.p_OQ + 0.029 * CUBE.nhat_OQ


def permitted(reach):
    return reach.permits(CUBE.p_OQ, CUBE.nhat_OQ, TIPS)


@pytest.mark.parametrize("azimuth", [0.0, 0.5, 3.0])
@pytest.mark.parametrize("half_angle", [0.2, 0.9, 2.0])
def test_a_sector_has_the_tips_whose_azimuth_is_near_the_fingers(azimuth, half_angle):
    reach = FingerReach(
        direction=np.array([np.cos(azimuth), np.sin(azimuth), 0.0]), half_angle=half_angle
    )
    aside = np.angle(np.exp(1j * (np.arctan2(TIPS[:, 1], TIPS[:, 0]) - azimuth)))
    assert np.array_equal(permitted(reach), np.abs(aside) <= half_angle)


def test_incidence_is_the_angle_between_normal_and_finger():
    reach = FingerReach(direction=np.array([1.0, 0.5, 0.0]), incidence=1.0)
    angle = {"+x": np.arctan(0.5), "+y": np.pi / 2 - np.arctan(0.5)}
    for face, area in ((f, AxisArea(f).holds(CUBE.nhat_OQ)) for f in ("+x", "+y", "-x", "-y")):
        assert np.all(permitted(reach)[area] == (angle.get(face, np.pi) <= 1.0))


@pytest.mark.parametrize("lean", [0.0, 0.4, 0.8])
def test_elevation_is_the_angle_between_normal_and_the_plane_across_the_axis(lean):
    axis = np.array([np.sin(lean), 0.0, np.cos(lean)])
    reach = FingerReach(direction=np.array([1.0, 0.5, 0.0]), elevation=0.6, axis=axis)
    for face in ("+x", "-x", "+y", "-y"):
        angle = lean if face[1] == "x" else 0.0
        assert np.all(permitted(reach)[AxisArea(face).holds(CUBE.nhat_OQ)] == (angle <= 0.6))


def test_every_test_has_to_be_passed():
    direction = np.array([1.0, 0.3, 0.0])
    solid = BallSolid(np.array([0.05, 0.0, 0.0]), 0.04)
    parts = [
        FingerReach(solid),
        FingerReach(direction=direction, half_angle=0.5),
        FingerReach(direction=direction, incidence=1.2),
    ]
    both = FingerReach(solid, direction=direction, half_angle=0.5, incidence=1.2)
    expected = np.all([permitted(part) for part in parts], axis=0)
    assert 0 < np.sum(expected) < len(expected)
    assert np.array_equal(permitted(both), expected)


def test_reach_is_the_same_in_every_frame():
    R_GF, p_GF = Rotation.from_rotvec([0.3, -1.2, 0.7]).as_matrix(), np.array([0.4, -0.2, 1.0])
    reach = FingerReach(
        BallSolid(np.array([0.04, 0.0, 0.01]), 0.06),
        direction=np.array([1.0, 0.4, 0.2]),
        half_angle=0.8,
        incidence=1.1,
        elevation=0.5,
        axis=np.array([0.28, 0.0, 0.96]),
    )
    moved = reach.moved(R_GF, p_GF).permits(
        CUBE.p_OQ @ R_GF.T + p_GF, CUBE.nhat_OQ @ R_GF.T, TIPS @ R_GF.T + p_GF
    )
    assert np.array_equal(moved, permitted(reach))


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ({"half_angle": 1.0}, "needs a direction"),
        ({"incidence": 1.0}, "needs a direction"),
        ({"elevation": 1.0}, "needs a direction"),
        ({"direction": np.zeros(3)}, "must not be zero"),
        ({"direction": np.array([0.0, 0.0, 1.0]), "half_angle": 1.0}, "along the hand's axis"),
    ],
)
def test_a_reach_that_means_nothing_is_refused(arguments, problem):
    with pytest.raises(InvalidArgumentError, match=problem):
        FingerReach(**arguments)


def test_a_closed_face_is_closed_to_its_finger_alone():
    limits = RegionConstraints(2, closed=[[AxisArea("+x")], []])
    first, second = (limits.limits_at(i, CUBE.p_OQ, CUBE.nhat_OQ)[0] for i in range(2))
    assert np.array_equal(first == Limit.FORBIDDEN, AxisArea("+x").holds(CUBE.nhat_OQ))
    assert np.all(second == Limit.NONE)
