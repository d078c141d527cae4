"""Limit and cause of a contact's tiny or empty region."""

import math

import numpy as np
import pytest
from selections import regions_of

from drake_pregrasp import ForbiddenPoints, box_surface
from drake_pregrasp.geometry.solids import BallSolid, HalfSpace
from drake_pregrasp.regions.constraints import NO_CAUSE, Limit, Obstacles
from drake_pregrasp.regions.finger_reach import FingerReach
from drake_pregrasp.regions.safe_regions import NO_REGION, TINY_SHARE, compute_safe_regions

CUBE = box_surface([0.1, 0.1, 0.1], spacing=0.01, forbidden_faces=[])
FOUR = np.array([[0.05, 0.01, 0.0], [-0.05, 0.0, 0.0], [0.0, 0.05, 0.0], [0.0, -0.05, 0.0]])
FAR = BallSolid(np.array([1.0, 0, 0]), 0.1)


def cause(result, contact=0):
    return Limit(result.limits[contact]), int(result.causes[contact]), result.sizes()[contact]


def of_first(center, radius):
    """The first finger reaches a ball, and the others reach everything."""
    return [FingerReach(BallSolid(np.array(center), radius)), None, None, None]


def test_nothing_limits_contacts_with_regions():
    wall = HalfSpace(np.array([0, 0, -1.0]), np.array([0.0, 0.0, 1.0]))
    far = Obstacles((FAR, wall), ForbiddenPoints(np.array([[0, 1.0, 0]]), np.array([0.1])))
    result = regions_of(CUBE, FOUR, obstacles=far, clearance=0.1)
    np.testing.assert_array_equal(result.labels, regions_of(CUBE, FOUR).labels)
    np.testing.assert_array_equal(result.limits, Limit.NONE)
    np.testing.assert_array_equal(result.causes, NO_CAUSE)


@pytest.mark.parametrize("neighbour", [1, 3])
def test_crowded_out_names_the_neighbour(neighbour):
    weights = np.zeros(4)
    weights[neighbour] = 0.1  # As if it were so much nearer everywhere.
    assert cause(regions_of(CUBE, FOUR, weights)) == (Limit.CROWDED, neighbour, 0)


def test_crowded_by_a_fingertip_names_whose_it_is():
    limited = regions_of(CUBE, FOUR[0] + [[0, 0, 0], [0, 1e-3, 0]], tip_radii=np.full(2, 0.08))
    assert cause(limited, 0) == (Limit.CROWDED, 1, 0)
    assert cause(limited, 1) == (Limit.CROWDED, 0, 0)


def test_crowded_to_a_few_candidates_names_a_neighbour():
    around = [[0, 0, 0], [0, 0.009, 0], [0, -0.009, 0], [0, 0, 0.009], [0, 0, -0.008]]
    limit, neighbour, size = cause(regions_of(CUBE, np.array([0.05, 0.005, 0.005]) + around))
    assert limit == Limit.CROWDED
    assert neighbour in {1, 2, 3, 4}
    assert 0 < size < 5


NEAR = BallSolid(np.array([0.07, 0, 0]), 0.06)
POINTS = ForbiddenPoints(np.array([[1.0, 0, 0], [0.07, 0, 0]]), np.array([0.1, 0.06]))
ALL = HalfSpace(np.zeros(3), np.array([-1.0, 0, 0]))
UPPER_HALF = of_first([0.05, 0.01, 0.1], 0.08)


@pytest.mark.parametrize(
    ("constraints", "expected"),
    [
        ({"reach": of_first([0.5, 0, 0], 0.1)}, (Limit.REACH, NO_CAUSE, 0)),
        ({"reach": of_first(FOUR[0], 0.012)}, (Limit.REACH, NO_CAUSE, 4)),
        ({"obstacles": Obstacles((FAR, NEAR))}, (Limit.OBSTACLE, 1, 0)),  # Solids count first.
        ({"obstacles": Obstacles((FAR,), POINTS)}, (Limit.OBSTACLE, 2, 0)),
        # Of several causes the one that keeps out most is named.
        ({"obstacles": Obstacles((ALL,)), "reach": UPPER_HALF}, (Limit.OBSTACLE, 0, 0)),
        ({"same_side": np.arange(4)[:, None] > np.zeros(600)}, (Limit.WALL, NO_CAUSE, 0)),
        ({"same_side": np.zeros((4, 600), dtype=bool)}, (Limit.WALL, NO_CAUSE, 0)),
    ],
)
def test_the_cause_of_a_tiny_region_is_named(constraints, expected):
    result = regions_of(CUBE, FOUR, clearance=0.01, **constraints)
    assert cause(result) == expected
    others_too = not np.any(constraints.get("same_side", True))
    np.testing.assert_array_equal(result.limits[1:], Limit.WALL if others_too else Limit.NONE)
    assert np.all(result.labels == NO_REGION) == others_too


def test_the_cause_forbidden_surface_is_named():
    z = FOUR[0] + [[0, 0.004, 0], [0, -0.004, 0], [0, 0, 0.004], [0, 0, -0.004]]
    fence = ForbiddenPoints(z, np.full(4, 0.002))
    limit, index, size = cause(compute_safe_regions(CUBE.p_OQ, FOUR, np.zeros(4), fence))
    assert (limit, index) == (Limit.FORBIDDEN, NO_CAUSE)
    assert size < 20


@pytest.mark.parametrize(("weights", "sharing"), [([0, 0, 0, 0], 4), ([0, -np.inf, 0, -np.inf], 2)])
def test_a_region_is_tiny_below_a_share_of_what_each_contact_that_is_left_would_have(
    weights, sharing
):
    p_OC = FOUR + 1e-4 * np.random.default_rng(0).normal(size=(4, 3))
    away = np.sort(np.linalg.norm(CUBE.p_OQ - p_OC[0], axis=1))
    least = math.ceil(TINY_SHARE * 600 / sharing)
    assert least in (8, 15)
    for size, limit in ((least, Limit.NONE), (least - 1, Limit.REACH)):
        reach = of_first(p_OC[0], (away[size - 1] + away[size]) / 2)
        result = regions_of(CUBE, p_OC, weights, reach=reach)
        assert cause(result) == (limit, NO_CAUSE, size)
