"""Squeezes balance the wrench on the object with the smallest forces inside friction cones."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.grasping import squeeze as squeeze_module
from drake_pregrasp.grasping.squeeze import FRICTION_SHARES, safest_squeeze, squeeze_forces

WEIGHT = np.array([0, 0, -4.0, 0, 0, 0])
AROUND = 2 * np.pi * np.arange(5) / 5
RING = 0.05 * np.stack([np.cos(AROUND), np.sin(AROUND), 0 * AROUND], axis=1)
OUTWARD = RING / 0.05
ONE_SIDE = np.array([[0.05, 0.03, 0.0], [0.05, -0.03, 0.0], [0.05, 0.0, 0.03]])

heights = st.lists(st.floats(-0.03, 0.03), min_size=5, max_size=5).map(np.array)


def squeeze(p=RING, nhat=OUTWARD, wrench=WEIGHT, *, friction=0.5, least=2.5, largest=30.0):
    return squeeze_forces(
        p, nhat, wrench, friction=friction, least_normal=least, largest_normal=largest
    )


def raised(z):
    return RING + z[:, None] * [0, 0, 1]


def net_wrench(p, forces):
    return np.concatenate([forces.sum(axis=0), np.cross(p, forces).sum(axis=0)])


@given(heights, st.floats(0, 5))
def test_forces_balance_a_weight_from_all_sides(z, share):
    forces, residual = squeeze(raised(z), wrench=share * WEIGHT)
    assert residual < 1e-2
    np.testing.assert_allclose(net_wrench(raised(z), forces) + share * WEIGHT, 0, atol=1e-2)


@given(heights, st.floats(0.3, 1.0), st.floats(0, 3))
def test_forces_lie_in_their_cones_and_bounds(z, friction, least):
    forces, _ = squeeze(raised(z), friction=friction, least=least, largest=12.0)
    normal = -np.sum(forces * OUTWARD, axis=1)
    across = np.linalg.norm(forces + normal[:, None] * OUTWARD, axis=1)
    assert np.min(normal) >= least - 1e-3
    assert np.max(normal) <= 12.0 + 1e-3
    assert np.all(across <= friction * normal + 1e-9)


@given(st.floats(-3, 3), st.floats(-1, 1), st.floats(-3, 3))
def test_turning_the_scene_takes_no_more_force(roll, pitch, yaw):
    R = Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix()
    turned, _ = squeeze(RING @ R.T, OUTWARD @ R.T, np.append(R @ WEIGHT[:3], np.zeros(3)))
    # Pyramids turn otherwise than the scene does.
    assert np.sum(turned**2) == pytest.approx(np.sum(squeeze().forces ** 2), rel=0.03)


def test_fingers_that_are_alike_carry_alike_and_press_no_more_than_asked():
    expected = 0.8 * np.array([0, 0, 1]) - 2.5 * OUTWARD
    np.testing.assert_allclose(squeeze().forces, expected, atol=1e-3)


def test_more_friction_never_needs_more_force():
    sizes = [
        np.sum(squeeze(wrench=4 * WEIGHT, friction=mu, least=0.0).forces ** 2)
        for mu in (0.2, 0.4, 0.8, 1.6)
    ]
    assert np.all(np.diff(sizes) < 0)


def test_what_nothing_balances_is_told_and_planned_with_the_widest_cone():
    assert squeeze(wrench=10 * WEIGHT, largest=5.0).residual > 10
    assert squeeze(wrench=10 * WEIGHT, largest=50.0).residual < 0.01
    one_side = ONE_SIDE, np.tile([1.0, 0, 0], (3, 1))
    smallest = squeeze(*one_side, largest=12.0)
    assert smallest.residual > 1
    np.testing.assert_array_equal(safest(*one_side).forces, smallest.forces)


def safest(p=RING, nhat=OUTWARD, *, friction=0.5, largest=12.0):
    return safest_squeeze(
        p, nhat, WEIGHT, friction=friction, least_normal=2.5, largest_normal=largest
    )


def steepest(forces, nhat=OUTWARD):
    """The largest ratio of a force across its normal to the force along it."""
    normal = -np.sum(forces * nhat, axis=1)
    return np.max(np.linalg.norm(forces + normal[:, None] * nhat, axis=1) / normal)


@given(heights)
def test_the_safest_squeeze_balances_with_no_more_friction_than_the_smallest(z):
    smallest, safe = squeeze(raised(z), largest=12.0), safest(raised(z))
    assert safe.residual <= max(0.02, smallest.residual)
    assert steepest(safe.forces) <= steepest(smallest.forces) + 1e-6


def test_the_safest_squeeze_uses_narrower_cones_the_larger_forces_may_be():
    used = [steepest(safest(largest=largest).forces) for largest in (2.5, 3.0, 4.0, 12.0)]
    np.testing.assert_allclose(used, sorted(used, reverse=True), rtol=1e-12)
    assert used[-1] <= FRICTION_SHARES[0] * 0.5 + 1e-9 < used[0]


def test_without_a_solution_nothing_presses_and_the_whole_weight_is_left(monkeypatch):
    def fails(*arguments, **options):
        raise RuntimeError

    monkeypatch.setattr(squeeze_module, "nnls", fails)
    found = squeeze()
    np.testing.assert_array_equal(found.forces, np.zeros_like(RING))
    assert found.residual == pytest.approx(np.linalg.norm(WEIGHT))


def test_bad_arguments_are_refused():
    with pytest.raises(InvalidArgumentError, match="at least one contact"):
        squeeze(np.empty((0, 3)), np.empty((0, 3)))
    with pytest.raises(InvalidArgumentError, match=r"not -1 and 30\.0 N"):
        squeeze(least=-1)
    with pytest.raises(InvalidArgumentError, match="not 5 and 4 N"):
        squeeze(least=5, largest=4)
