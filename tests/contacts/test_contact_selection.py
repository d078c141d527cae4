from dataclasses import replace

import numpy as np
import printed_equations
import pytest
from selections import nearest_candidate, selection_of

from drake_pregrasp import ContactStatus
from drake_pregrasp.contacts.centroids import (
    gaussian_log_weights,
    position_tracking,
    select_contacts,
    verify_contacts,
    weighted_centroid,
)
from drake_pregrasp.contacts.goal_limits import hold_contacts
from drake_pregrasp.contacts.selection_input import ContactGoals
from drake_pregrasp.errors import ContactError


def test_log_weights_are_those_of_the_density():
    rng = np.random.default_rng(0)
    points, mean = rng.normal(size=(30, 3)), rng.normal(size=3)
    A = rng.normal(size=(3, 3))
    covariance = A @ A.T + np.eye(3)
    density = [printed_equations.gaussian(q, mean, covariance) for q in points]
    log_weights = gaussian_log_weights(points, mean, covariance)
    np.testing.assert_allclose(np.diff(log_weights), np.diff(np.log(density)), rtol=1e-9)


def test_the_covariance_leads_from_the_nearest_candidate_to_the_plain_centroid(surface):
    mean, q = np.array([0.012, 0.02, 0.013]), surface.p_OQ
    nearest = q[nearest_candidate(surface, mean)]
    for variance, expected in ((1e-8, nearest), (1e8, q.mean(axis=0))):
        log_weights = gaussian_log_weights(q, mean, variance * np.eye(3))
        centroid = weighted_centroid(q, log_weights, np.ones(len(q)))
        np.testing.assert_allclose(centroid, expected, atol=1e-12)


def test_centroid_weighs_by_area_so_that_splitting_a_sample_changes_nothing():
    points = np.array([[0.0, 0, 0], [1.0, 0, 0]])
    split = np.array([[0.0, 0, 0], [1.0, 0, 0], [1.0, 0, 0]])
    np.testing.assert_allclose(
        weighted_centroid(points, np.zeros(2), np.array([1.0, 2.0])),
        weighted_centroid(split, np.zeros(3), np.array([1.0, 1.0, 1.0])),
    )


def test_goals_lie_on_allowed_faces_and_holding_keeps_contacts_to_the_bit(chosen, surface, p_OC):
    held, goals = hold_contacts(chosen), select_contacts(chosen, position_tracking)
    np.testing.assert_array_equal(held.p_OC, p_OC)
    np.testing.assert_allclose(goals.p_OC, surface.project(goals.p_OC)[0], atol=1e-15)
    assert np.all(np.abs(goals.p_OC[:, 2]) < 0.05)
    assert np.all(goals.active & held.active)


def test_iterating_settles(surface, p_OC):
    for _ in range(60):
        before, p_OC = p_OC, select_contacts(selection_of(surface, p_OC), position_tracking).p_OC
    np.testing.assert_allclose(p_OC, before, atol=1e-12)


def test_contacts_without_a_region_stay_and_say_why(surface, p_OC):
    p_OC = p_OC[[0, 0, 2, 3, 4]]
    chosen = selection_of(surface, p_OC, [0, 0, 0, 0, -np.inf])
    goals = select_contacts(chosen, position_tracking)
    np.testing.assert_array_equal(goals.p_OC[[1, 4]], p_OC[[1, 4]])
    assert (goals.status[1], goals.causes[1]) == (ContactStatus.CROWDED_OUT, 0)
    assert goals.status[4] == ContactStatus.LOST
    assert list(goals.active) == [True, False, True, True, False]
    nobody = select_contacts(selection_of(surface, p_OC, np.full(5, -np.inf)), position_tracking)
    np.testing.assert_array_equal(nobody.p_OC, p_OC)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_the_planner_turns_with_the_object(surface, p_OC, turns):
    """A quarter turn maps the cube's surface onto itself, so goals must turn with the contacts."""
    c, s = round(np.cos(turns * np.pi / 2)), round(np.sin(turns * np.pi / 2))
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    here = select_contacts(selection_of(surface, p_OC), position_tracking).p_OC
    there = select_contacts(selection_of(surface, p_OC @ R.T), position_tracking).p_OC
    np.testing.assert_allclose(there, here @ R.T, atol=2e-3)  # Ties at cell borders go by index.


def test_in_turns_each_contact_sees_where_those_before_it_went(chosen, surface, p_OC):
    """A strategy that draws to the mean of all contacts, by hand one contact after another."""

    def towards_mean(chosen, i):
        q = chosen.surface.p_OQ[chosen.regions.members(i)]
        return gaussian_log_weights(q, chosen.p_OC.mean(axis=0), 0.02**2 * np.eye(3))

    expected = p_OC.copy()
    for i in range(5):
        q = chosen.regions.members(i)
        log_weights = towards_mean(replace(chosen, p_OC=expected), i)
        centroid = weighted_centroid(surface.p_OQ[q], log_weights, surface.areas[q])
        expected[i] = surface.project(centroid[None])[0][0]
    goals = select_contacts(chosen, towards_mean, in_turns=True).p_OC
    np.testing.assert_allclose(goals, expected, atol=1e-12)
    at_once = select_contacts(chosen, towards_mean).p_OC
    np.testing.assert_allclose(at_once[0], goals[0], atol=1e-12)
    assert np.max(np.abs(at_once - goals)) > 1e-4


def test_position_tracking_takes_no_turns(surface, p_OC):
    chosen = selection_of(surface, p_OC, [0, 0, -np.inf, 0, 0])
    at_once, in_turns = (
        select_contacts(chosen, position_tracking, in_turns=k).p_OC for k in (False, True)
    )
    np.testing.assert_allclose(at_once, in_turns, atol=1e-15)


def verify(surface, p_OC, inactive=()):
    status = np.where(np.isin(np.arange(len(p_OC)), inactive), 0.0, 1.0)
    verify_contacts(surface, ContactGoals(p_OC, status, np.full(len(p_OC), -1.0)))


@pytest.mark.parametrize(("height", "side"), [(2e-4, "off"), (-2e-4, "inside")])
def test_an_active_goal_off_the_object_is_found(chosen, surface, height, side):
    p_OC = select_contacts(chosen, position_tracking).p_OC
    verify(surface, p_OC)
    normal = surface.project(p_OC)[1][2]
    p_OC[2] += height * normal
    with pytest.raises(ContactError, match=f"contact 2 is 0.2 mm {side} the object"):
        verify(surface, p_OC)
    verify(surface, p_OC, inactive=[2])
    p_OC[2] -= 0.75 * height * normal
    verify(surface, p_OC)


def test_verification_finds_goals_on_forbidden_surface_and_goals_that_are_not_finite(surface):
    verify(surface, np.empty((0, 3)))
    with pytest.raises(ContactError, match="contact 0 is 40 mm off the allowed surface"):
        verify(surface, np.array([[0.01, 0.0, 0.05]]))
    with pytest.raises((ContactError, ValueError)):
        verify(surface, np.full((1, 3), np.nan))
