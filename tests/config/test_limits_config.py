"""Configuration of the limits of contacts."""

import numpy as np
import pytest

from drake_pregrasp.config.limits_config import BallReach, BoxReach, LimitsConfig
from drake_pregrasp.contacts.contact_pairs import Pair
from drake_pregrasp.geometry.mesh_surface import mesh_surface
from drake_pregrasp.geometry.shapes import ball_shape


def test_reaches_are_solids_of_the_hand():
    ball = BallReach(center=[0.1, 0, 0], radius=0.05).make_reach().solid
    np.testing.assert_allclose(ball.distance(np.zeros((1, 3))), [0.05])
    turned = BoxReach(size=[0.2, 0.02, 0.02], center=[0, 0, 0.1], rpy=[0, 0, np.pi / 4])
    box = turned.make_reach().solid
    diagonal = 0.09 * np.sqrt(0.5)  # Along which the box, turned, is long.
    probes = np.array([[diagonal, diagonal, 0.1], [diagonal, -diagonal, 0.1]])
    np.testing.assert_allclose(box.distance(probes), [-0.01, 0.08], atol=1e-12)
    flat = BallReach(center=[0, 0, 0], radius=1, direction=[1, 0, 0], incidence=1, elevation=0.5)
    assert (flat.make_reach().incidence, flat.make_reach().elevation) == (1, 0.5)


@pytest.mark.parametrize(
    ("keys", "max_step"),
    [
        ({}, np.inf),
        ({"max_speed": 0.02}, 0.002),
        ({"max_step": 0.003}, 0.003),
        ({"max_speed": 0.02, "max_step": 0.003}, 0.002),
        ({"max_speed": 0.02, "max_step": 0.001}, 0.001),
    ],
)
def test_the_shorter_of_speed_and_step_limits_steps(keys, max_step):
    limits = LimitsConfig(**keys).make_limits(period=0.1, friction=0.7)
    assert limits.max_step == pytest.approx(max_step)


def test_all_keys_reach_the_limits():
    pair = Pair(first=1, second=0, distance=0.03, tolerance=0.002)
    config = LimitsConfig(
        deadband=0.001,
        pairs=[pair],
        guard=["margin", "q_vew"],
        independent_radius=0.01,
        recover=True,
    )
    limits = config.make_limits(period=0.1, friction=0.7)
    assert (limits.deadband, limits.recover) == (0.001, True)
    assert limits.pairs == (pair,)
    surface = mesh_surface(ball_shape(0.03), spacing=0.008)
    p_OC = 0.03 * np.array([[1.0, 0, 0], [-0.5, 0.87, 0], [-0.5, -0.87, 0], [0, 0, 1]])
    p_OC, nhat = surface.project(p_OC)
    slippery = config.make_limits(period=0.1, friction=0.0)
    measures = [list(each.guard(surface, p_OC, nhat)) for each in (limits, slippery)]
    assert (
        measures[0][0] == measures[1][0]
    )  # Q_VEW, the radii of the four contacts, and the margin.
    assert np.all(np.array(measures[0][1:]) > measures[1][1:])
    np.testing.assert_array_equal(measures[0][1:-1], 0.01)
    assert LimitsConfig().make_limits(period=0.1, friction=0.7).guard is None
