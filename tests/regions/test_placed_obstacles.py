"""Invalid obstacles are rejected, and an obstacle that becomes invalid blocks all regions."""

import numpy as np
import pytest
from broken_values import BAD_NUMBERS, NOT_FINITE
from scipy.spatial.transform import Rotation

from drake_pregrasp import BallSolid, BoxSolid, ForbiddenPoints, HalfSpace, InvalidArgumentError
from drake_pregrasp.geometry.solids import Solid
from drake_pregrasp.regions.constraints import Limit, Obstacles, RegionConstraints
from drake_pregrasp.regions.obstacles import obstacles_at_times, place_obstacles

R = Rotation.from_rotvec([0.3, -0.4, 1.0]).as_matrix()
P = np.array([0.1, 0.2, -0.3])
POINTS = np.random.default_rng(3).normal(scale=0.1, size=(20, 3))


def some_obstacles():
    solids = (
        BallSolid(np.array([3.0, 0.0, 0.0]), 0.1),
        BoxSolid(np.array([0.0, 3.0, 0.0]), np.eye(3), np.full(3, 0.2)),
        HalfSpace(np.array([0.0, 0.0, -3.0]), np.array([0.0, 0.0, 1.0])),
    )
    points = ForbiddenPoints(np.array([[4.0, 0.0, 0.0], [0.0, 4.0, 0.0]]), np.full(2, 0.05))
    return Obstacles(solids, points, np.array([[0.1, 0, 0], [0, 0, 0], [0, 0, 0.2]]))


def limits(obstacles):
    return RegionConstraints(1, obstacles=obstacles).limits_at(0, POINTS, 0 * POINTS)


@pytest.mark.parametrize("bad", NOT_FINITE)
@pytest.mark.parametrize(
    "make",
    [
        lambda bad: BallSolid(np.array([bad, 0, 0]), 0.1),
        lambda bad: BallSolid(np.zeros(3), bad),
        lambda bad: BoxSolid(np.array([0, bad, 0]), np.eye(3), np.ones(3)),
        lambda bad: BoxSolid(np.zeros(3), bad * np.ones((3, 3)), np.ones(3)),
        lambda bad: BoxSolid(np.zeros(3), np.eye(3), np.array([1, 1, bad])),
        lambda bad: HalfSpace(np.array([0, 0, bad]), np.array([0.0, 0, 1])),
        lambda bad: HalfSpace(np.zeros(3), np.array([0.0, bad, 1])),
        lambda bad: Obstacles(points=ForbiddenPoints(np.full((1, 3), bad), np.ones(1))),
        lambda bad: Obstacles(points=ForbiddenPoints(np.zeros((1, 3)), np.array([bad]))),
        lambda bad: Obstacles((BallSolid(np.zeros(3), 1.0),), velocities=np.full((1, 3), bad)),
    ],
)
def test_numbers_that_are_not_finite_are_refused(make, bad):
    with pytest.raises(InvalidArgumentError, match=r"finite|at least 0|>= 0"):
        make(bad)


def test_sound_obstacles_are_placed_as_they_and_the_frame_move():
    obstacles = some_obstacles()
    times, R_GF, p_GF = np.array([0.0, 0.7]), np.stack([R, R.T]), np.stack([P, 2 * P])
    found = obstacles_at_times(obstacles, R_GF, p_GF, times)
    for placed, seconds, *pose in zip(found, times, R_GF, p_GF, strict=True):
        expected = obstacles.after(seconds).moved(*pose)
        for solid, other in zip(placed.solids, expected.solids, strict=True):
            np.testing.assert_allclose(solid.distance(POINTS), other.distance(POINTS), atol=1e-14)
        np.testing.assert_array_equal(placed.points.points, expected.points.points)
        assert np.all(limits(placed)[0] == Limit.NONE)


@pytest.mark.parametrize("bad", BAD_NUMBERS)
@pytest.mark.parametrize(
    ("index", "spoil"),
    [
        (0, lambda obstacles, bad: obstacles.solids[0].center.__setitem__(1, bad)),
        (1, lambda obstacles, bad: obstacles.solids[1].center.__setitem__(1, bad)),
        (2, lambda obstacles, bad: obstacles.velocities.__setitem__(2, bad)),
        (3, lambda obstacles, bad: obstacles.points.points.__setitem__(0, bad)),
        (4, lambda obstacles, bad: obstacles.points.radii.__setitem__(1, bad)),
    ],
)
def test_one_whose_place_is_lost_may_be_anywhere(index, spoil, bad):
    obstacles = some_obstacles()
    spoil(obstacles, bad)
    (placed,) = obstacles_at_times(obstacles, R[None], P[None], np.array([0.5]))
    kinds, causes = limits(placed)
    if index == 2 and np.isfinite(bad):  # It has just gone far away, or come over all.
        assert set(kinds) <= {int(Limit.NONE), int(Limit.OBSTACLE)}
        return
    np.testing.assert_array_equal(kinds, Limit.OBSTACLE)
    np.testing.assert_array_equal(causes, index)


def test_a_solid_of_ones_own_that_knows_no_distance_may_be_anywhere():
    class Senseless(Solid):
        def rounded_box(self):
            return np.full(19, np.nan)

        def moved(self, R_GF, p_GF):
            return self

    placed = place_obstacles(Obstacles((Senseless(),)), R, P)
    assert np.all(limits(placed)[0] == Limit.OBSTACLE)
    unplaced = RegionConstraints(1, obstacles=Obstacles((Senseless(),)))
    assert np.all(unplaced.limits_at(0, POINTS, 0 * POINTS)[0] == Limit.OBSTACLE)
