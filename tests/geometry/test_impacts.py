"""Inelastic impacts of rigid bodies, against the textbook."""

import numpy as np
import pytest

from drake_pregrasp.geometry.impacts import impact

MASS, FRICTION, STEP, DEPTH = 0.5, 0.4, 1e-4, 1e-7
UP = np.array([0.0, 0.0, 1.0])


def after(points, inertia, V):
    """Returns the velocity after an impact of points that touch the ground."""
    points = np.array(points, dtype=float)
    V, M = np.array(V, dtype=float), np.diag([*inertia, MASS, MASS, MASS])
    change = impact(
        points,
        np.full(len(points), -DEPTH),
        np.tile(UP, (len(points), 1)),
        V,
        M,
        friction=FRICTION,
        time_step=STEP,
        depth=DEPTH,
    )
    assert (V + change) @ M @ (V + change) <= V @ M @ V + 1e-12
    return V + change


def test_the_end_of_a_falling_rod_stops_and_its_middle_turns_on():
    """The impulse p at the end of a rod of length 2 a gives -v + p/m + p a^2/I = 0, I = m a^2/3."""
    a, v = 0.1, 1.0
    I = MASS * a**2 / 3  # noqa: E741
    w, v_after = np.split(after([[a, 0, 0]], [1e-6, I, I], [0, 0, 0, 0, 0, -v]), 2)
    np.testing.assert_allclose(v_after, [0, 0, -0.75 * v], atol=0.02)
    np.testing.assert_allclose(w, [0, -0.75 * v / a, 0], atol=0.2)


@pytest.mark.parametrize(("along", "left"), [(1.0, 0.6), (0.3, 0.0)])
def test_friction_slows_a_sliding_block_by_its_share_of_the_fall_and_not_beyond_rest(along, left):
    """The impulse acts in the plane of the centre, at four corners in a square."""
    square = [[x, y, 0] for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
    V = after(square, [1e-3, 1e-3, 1e-3], [0, 0, 0, along, 0, -1.0])
    np.testing.assert_allclose(V, [0, 0, 0, left, 0, 0], atol=5e-3)


def test_a_body_that_leaves_or_stays_away_is_not_stopped():
    V = [0, 0, 0, 0.1, 0, 0.2]
    np.testing.assert_array_equal(after([[0.1, 0, 0]], [1e-3, 1e-3, 1e-3], V), V)
