"""Fingertips let an object pass that comes to the palm."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drake_pregrasp.geometry.solids import BoxSolid
from drake_pregrasp.grasping.fingertip_paths import MOVING_CLEARANCE
from drake_pregrasp.grasping.passing import passing_gaps

SIZE = np.array([0.1, 0.04, 0.04])
BAR = BoxSolid(np.zeros(3), np.eye(3), SIZE)
RADII, GAPS = np.array([0.009, 0.012]), np.array([0.012, 0.02])
P_OC, NHAT = np.array([[-0.03, 0.02, 0.0], [-0.03, -0.02, 0.01]]), np.array([[0, 1, 0], [0, -1, 0]])


def least_gaps(gaps, way):
    """Returns the least gaps of fingertips to the bar on their way, on 200 places."""
    ahead = np.linspace(0, 1, 200)[:, None, None] * way
    tips = P_OC + (RADII + gaps)[:, None] * NHAT + ahead
    return np.min(BAR.distance(tips.reshape(-1, 3)).reshape(200, 2), axis=0) - RADII


def gaps_at(way):
    return passing_gaps(P_OC, NHAT.astype(float), GAPS, RADII, way, BAR)


@pytest.mark.parametrize("lean", [-0.35, -0.2, 0.2, 0.35])
def test_a_bar_that_is_turned_passes_between_fingertips_which_open_for_it(lean):
    way = 0.15 * Rotation.from_euler("z", lean).as_matrix()[:, 0]
    in_the_way = least_gaps(GAPS, way) < MOVING_CLEARANCE
    assert in_the_way.any()
    gaps = gaps_at(way)
    assert np.array_equal(gaps > GAPS, in_the_way)
    assert np.min(least_gaps(gaps, way)) > MOVING_CLEARANCE - 2e-3
    assert np.max(least_gaps(gaps, way)[in_the_way]) < MOVING_CLEARANCE + 2e-3  # Not more.


def test_fingertips_come_back_while_the_bar_passes():
    along = Rotation.from_euler("z", 0.35).as_matrix()[:, 0]
    opened = np.array([gaps_at(left * along) for left in (0.1, 0.05, 0.02, 0.0)])
    assert np.all(np.diff(opened, axis=0) <= 0)
    assert np.max(opened[0] - GAPS) > 0.005
    np.testing.assert_array_equal(opened[-1], GAPS)


def test_nothing_opens_beside_a_bar_that_comes_straight():
    np.testing.assert_array_equal(gaps_at(np.array([0.15, 0.0, 0.0])), GAPS)


def test_an_unknown_contact_opens_no_finger():
    p_OC = np.array([[np.nan] * 3, P_OC[1]])
    way = 0.15 * Rotation.from_euler("z", 0.35).as_matrix()[:, 0]
    gaps = passing_gaps(p_OC, NHAT.astype(float), GAPS, RADII, way, BAR)
    np.testing.assert_array_equal(gaps, [GAPS[0], gaps_at(way)[1]])
