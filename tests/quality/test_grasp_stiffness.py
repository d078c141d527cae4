"""Turns of a held object whose fingers yield as springs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from drake_pregrasp.quality.grasp_stiffness import turn_by_force

HARD, FORCE = np.zeros(4), 3.0
SEEDS = st.integers(0, 10**6)


def random_grasp(seed, n=4):
    """Contacts, normals, and compliances from 1 to 10 mm/N."""
    rng = np.random.default_rng(seed)
    p, nhat = rng.uniform(-0.05, 0.05, (n, 3)), rng.normal(size=(n, 3))
    axes = Rotation.random(n, random_state=seed).as_matrix()
    compliances = (axes * rng.uniform(1e-3, 1e-2, (n, 1, 3))) @ axes.swapaxes(1, 2)
    return p, nhat / np.linalg.norm(nhat, axis=1, keepdims=True), compliances


@given(SEEDS)
def test_an_object_turns_to_where_the_energy_of_the_springs_and_the_force_is_least(seed):
    """The second differences of a quadratic energy are its curvature."""
    p, nhat, compliances = random_grasp(seed)
    springs = np.linalg.inv(compliances + 1e-5 * np.eye(3))

    def energy(motion):
        moved = motion[3:] + np.cross(motion[:3], p)
        return np.einsum("ni,nij,nj", moved, springs, moved) / 2

    unit = np.eye(6)
    curvature = [[energy(a + b) - energy(a) - energy(b) for b in unit] for a in unit]
    turns = np.linalg.solve(curvature, FORCE * unit[:, 3:])[:3]
    assert turn_by_force(p, nhat, compliances, torsional_arms=HARD, force=FORCE) == pytest.approx(
        np.linalg.norm(turns, ord=2), rel=1e-4
    )


@given(SEEDS)
def test_turns_depend_on_no_axes_and_grow_with_force_and_compliance(seed):
    p, nhat, compliances = random_grasp(seed)

    def turn(R=np.eye(3), C=compliances, force=FORCE):  # noqa: B008
        C = R @ C @ R.T
        return turn_by_force(p @ R.T, nhat @ R.T, C, torsional_arms=HARD, force=force)

    assert turn(Rotation.random(random_state=seed).as_matrix()) == pytest.approx(turn())
    assert turn(force=2 * FORCE) == pytest.approx(2 * turn())
    # A contact has a compliance of 0.01 mm/N of its own, which then doubles as well.
    assert turn(C=2 * compliances + 1e-5 * np.eye(3)) == pytest.approx(2 * turn())


def test_contacts_around_the_centre_of_mass_do_not_turn_it_and_those_over_it_do():
    p = 0.03 * np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    nhat, C = p / 0.03, np.tile(1e-3 * np.eye(3), (4, 1, 1))

    def turn(height):
        lifted = p + height * np.eye(3)[2]
        return turn_by_force(lifted, nhat, C, torsional_arms=HARD, force=FORCE)

    assert turn(0.0) == pytest.approx(0.0, abs=1e-9)
    assert 0 < turn(0.01) < turn(0.02) < turn(0.04)


def test_soft_fingers_resist_turns_about_the_line_through_two_contacts():
    """The centre of mass is 20 mm off the line. Hard fingers do not resist; this does not count."""
    p = np.array([[0.03, 0.0, 0.02], [-0.03, 0.0, 0.02]])
    nhat, stiff = np.array([[1.0, 0, 0], [-1.0, 0, 0]]), np.zeros((2, 3, 3))

    def turn(arm):
        return turn_by_force(p, nhat, stiff, torsional_arms=np.full(2, arm), force=FORCE)

    assert turn(0.0) < turn(0.02) < turn(0.01)
    assert turn(0.01) == pytest.approx(0.02 * FORCE * 1e-5 / (2 * 0.01**2), rel=0.01)
