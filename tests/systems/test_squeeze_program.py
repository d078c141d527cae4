"""Squeezes balance the wrench on the object with the smallest forces inside friction cones."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.grasping.grasp_state import GiveUp
from drake_pregrasp.systems.squeeze_program import (
    LOAD_CHANGE,
    PREFERRED_SHARE,
    balancing_forces,
    internal_forces,
    plan_squeeze,
)

WEIGHT = np.array([0, 0, -4.0, 0, 0, 0])
AROUND = 2 * np.pi * np.arange(5) / 5
RING = 0.05 * np.stack([np.cos(AROUND), np.sin(AROUND), 0 * AROUND], axis=1)
OUTWARD = RING / 0.05
ONE_SIDE = np.array([[0.05, 0.03, 0.0], [0.05, -0.03, 0.0], [0.05, 0.0, 0.03]])
LEVERS = np.kron(np.eye(5), 0.1 * np.eye(3)).reshape(15, 5, 3).transpose(1, 2, 0)
"""Jacobians of fingers whose three joints turn a tip at 0.1 m along x, y and z."""

few = settings(max_examples=25)
heights = st.lists(st.floats(-0.03, 0.03), min_size=5, max_size=5).map(np.array)


def squeeze(p=RING, nhat=OUTWARD, wrench=WEIGHT, *, friction=0.5, least=2.5, largest=30.0, **more):
    return plan_squeeze(
        p, nhat, wrench, friction=friction, least_normal=least, largest_normal=largest, **more
    )


def raised(z):
    return RING + z[:, None] * [0, 0, 1]


def size(planned):
    return np.sum(planned.forces**2)


def split(forces, nhat=OUTWARD):
    """Normal forces, and sizes of the forces along the surface."""
    normal = -np.sum(forces * nhat, axis=1)
    return normal, np.linalg.norm(forces + normal[:, None] * nhat, axis=1)


@few
@given(heights.map(lambda z: z / 2), st.floats(0, 5))  # Not all heights up to 30 mm have a balance.
def test_forces_balance_a_weight_from_all_sides(z, share):
    forces, residual, *_ = squeeze(raised(z), wrench=share * WEIGHT)
    net = wrench_of(raised(z), forces)
    assert residual < 1e-2
    np.testing.assert_allclose(net + share * WEIGHT, 0, atol=1e-2)


def wrench_of(p, forces):
    return np.append(forces.sum(axis=0), np.cross(p, forces).sum(axis=0))


@few
@given(heights, arrays(float, (5, 3), elements=st.floats(-5, 5)))
def test_internal_forces_exert_no_wrench_and_are_what_is_left_without_it(z, forces):
    p = raised(z)
    internal = internal_forces(p, forces)
    np.testing.assert_allclose(wrench_of(p, internal), 0, atol=1e-9)
    np.testing.assert_allclose(internal_forces(p, internal), internal, atol=1e-9)
    assert np.vdot(internal, forces - internal) == pytest.approx(0, abs=1e-9)


def test_two_fingers_of_a_gripper_press_against_each_other():
    p = np.array([[0.03, 0.0, 0.02], [-0.03, 0.0, 0.02]])
    forces = np.array([[-5.0, 0.0, 1.0], [5.0, 0.0, 1.0]])
    np.testing.assert_allclose(internal_forces(p, forces), forces * [1, 0, 0], atol=1e-9)


@few
@given(heights, st.floats(0.3, 1.0), st.floats(0, 3), st.floats(0.31, 1.5))
def test_forces_lie_in_their_cones_and_bounds_and_within_the_torques(z, friction, least, effort):
    efforts = np.full(15, effort)
    planned = squeeze(
        raised(z), friction=friction, least=least, largest=12.0, jacobians=LEVERS, efforts=efforts
    )
    normal, along = split(planned.forces)
    assert least - 1e-5 <= np.min(normal) <= np.max(normal) <= 12.0 + 1e-5
    assert np.all(along <= friction * normal + 1e-5)
    torques = np.einsum("nij,ni->j", LEVERS, planned.forces)
    assert np.max(np.abs(torques)) <= effort + 1e-5


@few
@given(st.floats(-3, 3), st.floats(-1, 1), st.floats(-3, 3))
def test_a_turned_scene_has_turned_forces(roll, pitch, yaw):
    R = Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix()
    for p in (RING, raised(np.full(5, 0.05))):
        turned = squeeze(p @ R.T, OUTWARD @ R.T, np.append(R @ WEIGHT[:3], np.zeros(3)))
        np.testing.assert_allclose(turned.forces @ R, squeeze(p).forces, atol=1e-5)


@few
@given(arrays(float, 3, elements=st.floats(-1, 1)), st.floats(0.02, 0.06), st.floats(0.4, 1))
def test_forces_stay_in_their_cones_when_the_load_changes(push, height, friction):
    """Contacts over the centre of mass also bear the moment of a push on it."""
    p = raised(np.full(5, height))
    forces = squeeze(p, friction=friction, largest=100.0, least=0.0).forces
    push *= LOAD_CHANGE * np.linalg.norm(WEIGHT) / max(1.0, float(np.linalg.norm(push)))
    normal, along = split(forces + balancing_forces(p, np.append(push, np.zeros(3))))
    assert np.all(along <= friction * normal + 1e-3)


def test_soft_pads_over_the_centre_of_mass_press_until_no_half_of_the_load_moves_them():
    p, mu, e = PADS + np.array([0, 0, 0.02]), 0.6, 3 * np.pi / 16 * 0.01
    pads = {"least": 0.5, "patch_radii": np.full(2, 0.01)}
    planned = squeeze(p, PADS / 0.03, 0.6 * WEIGHT, friction=mu, **pads)
    # Columns of G: force along each axis at both pads, and the moments about their normals, as
    # forces at the arm e. Torques are over the longest arm.
    arm = np.linalg.norm(p, axis=1).max()
    columns = [np.append(f, np.cross(q, f) / arm) for q in p for f in np.eye(3)]
    columns += [np.array([0, 0, 0, side * e / arm, 0, 0]) for side in (1, -1)]
    G = np.array(columns).T
    P = 0.5 * 2.4 * (G.T @ np.linalg.inv(G @ G.T + 0.01 * np.eye(6)))[:, :3]
    expected = (1.2 + np.linalg.norm(P[[1, 2, 6]], 2) + mu * np.linalg.norm(P[0])) / mu
    np.testing.assert_allclose(split(planned.forces, PADS / 0.03)[0], expected, rtol=1e-3)


def test_a_push_that_contacts_can_hardly_bear_is_given_up():
    """Three contacts on nearly one line over the centre of mass do not press without bound."""
    across, thumb = 1e-3 * np.array([0.0, 1e-4, 0.1, 3.0, 6.0]), []
    for y in across:
        p = np.array([[0.03, 0, 0.03], [-0.03, y, 0.03], [-0.03, -y, 0.03]])
        nhat = np.array([[1.0, 0, 0], [-1, 0, 0], [-1, 0, 0]])
        planned = squeeze(p, nhat, 0.6 * WEIGHT, friction=0.6, least=0.5, largest=16.0)
        thumb.append(split(planned.forces, nhat)[0][0])
    assert max(thumb[:3]) < 1.1 * min(thumb[:3])
    assert max(thumb) < 12


def test_room_for_changes_costs_no_balance_and_no_preferred_cone():
    p = np.array([[0.0347, 0.0046, 0.0456], [-0.0346, 0.0052, 0.0413]])
    nhat = np.array([[0.992, 0.03, 0.125], [-0.949, 0.295, 0.11]])
    pads = {"patch_radii": np.full(2, 0.004), "friction": 0.946, "least": 1.0, "largest": 16.0}
    assert squeeze(p, nhat, np.array([0, 0, -5.77, 0, 0, 0]), **pads).residual < 1e-3
    # One of three fingers bears more than the others and has no such room at its largest force.
    p = np.array([[30.5, 17.2, -4.4], [-32.7, 12.6, -1.0], [-27.8, -21.3, 4.8]]) / 1e3
    nhat = np.array([[0.871, 0.489, 0.051], [-0.933, 0.360, -0.030], [-0.794, -0.608, 0.028]])
    planned = squeeze(p, nhat, 0.75 * WEIGHT, friction=0.5, least=0.5, largest=10.0)
    normal, along = split(planned.forces, nhat)
    assert np.max(along / normal) < 0.34


def test_higher_contacts_press_harder_against_changes_of_the_load():
    sizes = [size(squeeze(raised(np.full(5, z)), least=0.0)) for z in (0.0, 0.04, 0.06, 0.08)]
    assert np.all(np.diff(sizes) > 0)


def test_fingers_that_are_alike_carry_alike_within_the_preferred_cones():
    share = 0.8  # Of the weight, in newtons.
    expected = share * np.array([0, 0, 1]) - share / (PREFERRED_SHARE * 0.5) * OUTWARD
    np.testing.assert_allclose(squeeze().forces, expected, atol=1e-3)


def test_more_friction_never_needs_more_force():
    sizes = [
        size(squeeze(wrench=4 * WEIGHT, friction=mu, least=0.0)) for mu in (0.3, 0.4, 0.8, 1.6)
    ]
    assert np.all(np.diff(sizes) < 0)


def test_forces_leave_the_preferred_cones_only_as_far_as_the_largest_force_requires():
    # Five fingers share 4 N, so each normal force of F needs a friction of 0.8/F.
    for largest in (2.5, 3.0, 4.0, 12.0):
        normal, along = split(squeeze(largest=largest).forces)
        expected = max(PREFERRED_SHARE * 0.5, 0.8 / largest)
        np.testing.assert_allclose(along / normal, expected, rtol=1e-3)


@pytest.mark.parametrize(
    ("arguments", "lack"),
    [
        ({"wrench": 10 * WEIGHT, "largest": 5.0}, GiveUp.NEEDS_FORCE),
        ({"jacobians": LEVERS, "efforts": np.full(15, 0.07), "least": 0.5}, GiveUp.NEEDS_TORQUE),
        ({"jacobians": LEVERS, "efforts": np.full(15, 0.2)}, GiveUp.NEEDS_TORQUE),
        ({"nhat": 0.8 * OUTWARD + [0, 0, 0.6]}, GiveUp.NEEDS_FRICTION),  # It gets narrower above.
        (
            {
                "p": np.array([[-32.8, 12.1, -7.7], [-34.9, -3.2, -4.6], [-33.3, -10.7, -14.4]])
                / 1e3,
                "nhat": np.array(
                    [[-0.937, 0.342, -0.078], [-1, 0.058, 0.017], [-0.855, -0.513, 0]]
                ),
                "wrench": np.array([0, 0, -4.09, 0, 0, 0]),
                "friction": 0.332,
                "least": 1.0,
                "largest": 6.0,
            },
            GiveUp.NEEDS_FRICTION,
        ),
        ({"p": ONE_SIDE, "nhat": np.tile([1.0, 0, 0], (3, 1))}, GiveUp.OUT_OF_BALANCE),
    ],
)
def test_what_nothing_balances_is_told_with_the_limit_that_prevents_it(arguments, lack):
    planned = squeeze(**arguments)
    assert planned.residual > 0.1
    assert planned.lack == lack


@pytest.mark.parametrize("share", [2, 5, 8, 20])
def test_no_load_is_so_large_that_friction_is_all_it_lacks(share):
    limits = {"jacobians": LEVERS, "efforts": np.full(15, 0.3), "largest": 12.0}
    planned = squeeze(wrench=share * WEIGHT, **limits)
    assert planned.residual > 0.1
    assert planned.lack == GiveUp.NEEDS_TORQUE


def test_bad_arguments_are_refused():
    with pytest.raises(InvalidArgumentError, match="at least one contact"):
        squeeze(np.empty((0, 3)), np.empty((0, 3)))
    with pytest.raises(InvalidArgumentError, match=r"not -1 and 30\.0 N"):
        squeeze(least=-1)
    with pytest.raises(InvalidArgumentError, match="not 5 and 4 N"):
        squeeze(least=5, largest=4)


PADS = np.array([[0.03, 0, 0], [-0.03, 0, 0]])
BESIDE = np.array([0, 0, -2.0, 0.02, 0, 0])
"""Weight 10 mm beside the line through both pads."""


def test_two_soft_fingers_hold_a_weight_beside_them_with_the_least_force():
    radius = 0.01
    planned = squeeze(PADS, PADS / 0.03, BESIDE, least=0.5, patch_radii=np.full(2, radius))
    assert planned.residual < 1e-3
    # Each pad carries half of weight and moment, on its preferred cone.
    torsion = 0.01 / (3 * np.pi / 16 * radius)
    expected = np.hypot(1.0, torsion) / (PREFERRED_SHARE * 0.5)
    normal, along = split(planned.forces, PADS / 0.03)
    np.testing.assert_allclose(normal, expected, rtol=1e-2)
    np.testing.assert_allclose(along, 1.0, atol=1e-3)


@pytest.mark.parametrize("radii", [None, np.zeros(2)])
def test_two_hard_fingers_do_not_hold_a_weight_beside_them(radii):
    planned = squeeze(PADS, PADS / 0.03, BESIDE, patch_radii=radii)
    assert planned.residual > 0.3
    assert planned.lack == GiveUp.OUT_OF_BALANCE


def test_soft_fingers_lack_force_for_a_large_moment():
    planned = squeeze(PADS, PADS / 0.03, 8 * BESIDE, largest=10.0, patch_radii=np.full(2, 0.005))
    assert planned.lack == GiveUp.NEEDS_FORCE
