"""Assignment of fingers to contacts, and initial contacts on a ring."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from thin_cup import CUP, RADIUS, WALL

from drake_pregrasp import InvalidArgumentError, box_surface
from drake_pregrasp.contacts.assignment import (
    FREE_TURN,
    assign_fingers,
    assign_fingers_round,
    ring_contacts,
    turned_within,
    wrapped,
)
from drake_pregrasp.geometry.mesh_surface import AxisArea, mesh_surface
from drake_pregrasp.geometry.shapes import ball_shape, cylinder_shape


@given(seed=st.integers(0, 10**6), n=st.integers(1, 5))
def test_all_fingers_together_travel_least(seed, n):
    tips, contacts = np.random.default_rng(seed).uniform(size=(2, n, 3))

    def travel(order):
        return np.sum(np.linalg.norm(tips - contacts[list(order)], axis=1))

    least = min(map(travel, permutations(range(n))))
    order = assign_fingers(tips, contacts)
    assert sorted(order) == list(range(n))
    assert travel(order) == pytest.approx(least, rel=1e-12)


CAN = mesh_surface(
    cylinder_shape(0.03, 0.1), spacing=0.006, no_touch=[AxisArea("+z"), AxisArea("-z")]
)
BOX = box_surface([0.1, 0.06, 0.12], spacing=0.008)


@pytest.mark.parametrize("surface", [CAN, BOX], ids=["can", "box"])
@pytest.mark.parametrize("count", [1, 2, 5, 9])
def test_a_ring_is_of_distinct_allowed_places_level_with_the_centre(surface, count):
    p_OC = ring_contacts(surface, count)
    assert len(np.unique(p_OC, axis=0)) == count
    nearest, _ = surface.project(p_OC)
    np.testing.assert_allclose(nearest, p_OC, atol=1e-9)
    np.testing.assert_allclose(p_OC[:, 2], surface.p_OCoM[2], atol=0.008)


def test_a_ring_round_a_ball_is_even():
    surface = mesh_surface(ball_shape(0.04), spacing=0.004)
    p_OC = ring_contacts(surface, 5)
    angles = np.arctan2(p_OC[:, 1], p_OC[:, 0])
    expected = 2 * np.pi * np.arange(5) / 5
    assert np.max(np.abs(np.angle(np.exp(1j * (angles - expected))))) < 0.004 / 0.04
    np.testing.assert_allclose(p_OC[:, 2], 0, atol=0.004)


def test_a_ring_stands_on_the_outside_of_a_cup():
    p_OC = ring_contacts(mesh_surface(CUP, spacing=0.006), 5)
    assert np.min(np.hypot(p_OC[:, 0], p_OC[:, 1])) > RADIUS - WALL / 2


def test_a_ring_has_at_most_as_many_contacts_as_the_allowed_surface_has_candidates():
    surface = box_surface([0.03, 0.03, 0.03], spacing=0.02)
    count = len(surface.p_OQ)
    assert len(np.unique(ring_contacts(surface, count), axis=0)) == count
    for bad in (0, count + 1):
        with pytest.raises(InvalidArgumentError, match=f"candidates for 1 to {count} contacts"):
            ring_contacts(surface, bad)


azimuths = arrays(float, 5, elements=st.floats(-3.1, 3.1), unique=True)


@given(azimuths, st.floats(-3, 3))
def test_a_turned_hand_finds_its_own_fingers(fingers, turn):
    order, yaw = assign_fingers_round(fingers, fingers + turn)
    np.testing.assert_allclose(wrapped((fingers + turn)[order] - fingers - yaw), 0, atol=1e-9)


@given(azimuths, azimuths)
def test_fingers_keep_their_order_round_the_palm(fingers, contacts):
    order, _ = assign_fingers_round(fingers, contacts)
    ranks = np.argsort(np.argsort(contacts))[order][np.argsort(fingers)]
    assert np.all((np.diff(np.append(ranks, ranks[0])) - 1) % 5 == 0)


@given(azimuths, azimuths, arrays(float, 5, elements=st.floats(0.05, 3.1)))
def test_an_assignment_is_refused_only_if_none_is_within_each_fingers_own_bound(
    fingers, contacts, allowed
):
    in_order, in_turn = np.argsort(fingers), np.argsort(contacts)
    least = np.inf
    for shift in range(5):
        turns = contacts[np.roll(in_turn, shift)] - fingers[in_order]
        yaw = np.angle(np.sum(np.exp(1j * turns)))
        least = min(least, np.max(np.abs(wrapped(turns - yaw)) - allowed[in_order]))
    try:
        order, yaw = assign_fingers_round(fingers, contacts, largest_offset=allowed)
    except InvalidArgumentError:
        assert least > -1e-9
    else:
        excess = np.abs(wrapped(contacts[order] - fingers - yaw)) - allowed
        assert np.max(excess) == pytest.approx(least, abs=1e-9)
        assert least < 1e-9


@given(azimuths, azimuths, st.floats(-3, 3), st.floats(0.0, 1.0))
def test_a_wrist_of_limited_range_stays_in_it(fingers, contacts, middle, half):
    yaw_range = (middle - half, middle + half)
    _, yaw = assign_fingers_round(fingers, contacts, yaw_range=yaw_range)
    assert yaw_range[0] <= yaw <= yaw_range[1]


@given(st.floats(-20, 20), st.floats(-20, 20), st.floats(0.0, 3.0))
def test_turning_within_a_range_goes_as_near_as_it_can(yaw, middle, half):
    yaw_range = (middle - half, middle + half)
    turned = turned_within(yaw, yaw_range)
    choices = np.linspace(*yaw_range, 200)
    assert yaw_range[0] <= turned <= yaw_range[1]
    assert abs(wrapped(turned - yaw)) <= np.min(np.abs(wrapped(choices - yaw))) + 1e-9
    assert turned_within(yaw, FREE_TURN) == yaw


def test_contacts_out_of_reach_or_too_few_are_refused():
    fingers = 2 * np.pi * np.arange(5) / 5
    crowded = np.array([0.0, 0.1, 0.2, 0.3, 3.0])
    with pytest.raises(InvalidArgumentError, match=r"no finger reaches contact \d: it is"):
        assign_fingers_round(fingers, crowded, largest_offset=0.5)
    with pytest.raises(InvalidArgumentError, match="5 fingers cannot be assigned to 4 contacts"):
        assign_fingers_round(fingers, crowded[:4])
    with pytest.raises(InvalidArgumentError, match="3 fingertips cannot be assigned to 2 contacts"):
        assign_fingers(np.zeros((3, 3)), np.zeros((2, 3)))
