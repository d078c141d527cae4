import numpy as np
import printed_equations
import pytest

from drake_pregrasp import ContactStatus
from drake_pregrasp.contacts.centroids import (
    gaussian_log_weights,
    position_tracking,
    select_contacts,
    weighted_centroid,
)
from drake_pregrasp.contacts.goal_limits import hold_contacts
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.regions.safe_regions import compute_safe_regions


def selection(surface, p_OC, std=0.04, weights=None):
    weights = np.zeros(len(p_OC)) if weights is None else weights
    regions = compute_safe_regions(surface.p_OQ, p_OC, weights, surface.forbidden)
    return SelectionInput(surface, p_OC, regions, std**2 * np.eye(3))


def test_log_weights_are_those_of_the_density():
    rng = np.random.default_rng(0)
    points, mean = rng.normal(size=(30, 3)), rng.normal(size=3)
    A = rng.normal(size=(3, 3))
    covariance = A @ A.T + np.eye(3)
    density = [printed_equations.gaussian(q, mean, covariance) for q in points]
    log_weights = gaussian_log_weights(points, mean, covariance)
    np.testing.assert_allclose(np.diff(log_weights), np.diff(np.log(density)), rtol=1e-9)


def test_a_tiny_covariance_selects_the_candidate_nearest_to_the_mean(surface):
    mean = np.array([0.012, 0.02, 0.013])
    log_weights = gaussian_log_weights(surface.p_OQ, mean, 1e-8 * np.eye(3))
    centroid = weighted_centroid(surface.p_OQ, log_weights, surface.areas)
    nearest = surface.p_OQ[np.argmin(np.linalg.norm(surface.p_OQ - mean, axis=1))]
    np.testing.assert_allclose(centroid, nearest, atol=1e-12)


def test_a_huge_covariance_gives_the_plain_centroid(surface):
    q = surface.p_OQ[:130]
    log_weights = gaussian_log_weights(q, np.zeros(3), 1e8 * np.eye(3))
    np.testing.assert_allclose(
        weighted_centroid(q, log_weights, np.ones(130)), q.mean(axis=0), atol=1e-12
    )


def test_centroid_weighs_by_area_so_that_splitting_a_sample_changes_nothing():
    points = np.array([[0.0, 0, 0], [1.0, 0, 0]])
    split = np.array([[0.0, 0, 0], [1.0, 0, 0], [1.0, 0, 0]])
    np.testing.assert_allclose(
        weighted_centroid(points, np.zeros(2), np.array([1.0, 2.0])),
        weighted_centroid(split, np.zeros(3), np.array([1.0, 1.0, 1.0])),
    )


def test_goals_lie_on_allowed_faces(surface, p_OC):
    goals = select_contacts(selection(surface, p_OC), position_tracking)
    assert np.all(goals.active)
    nearest, _ = surface.project(goals.p_OC)
    np.testing.assert_allclose(goals.p_OC, nearest, atol=1e-15)
    assert np.all(np.abs(goals.p_OC[:, 2]) < 0.05)


def test_iterating_settles(surface, p_OC):
    step = np.inf
    for _ in range(60):
        goals = select_contacts(selection(surface, p_OC), position_tracking)
        step = np.max(np.abs(goals.p_OC - p_OC))
        p_OC = goals.p_OC
    assert step < 1e-12


def test_a_contact_without_region_stays_and_is_inactive(surface, p_OC):
    p_OC = p_OC.copy()
    p_OC[1] = p_OC[0]
    goals = select_contacts(selection(surface, p_OC), position_tracking)
    np.testing.assert_array_equal(goals.p_OC[1], p_OC[1])
    assert (goals.status[1], goals.causes[1]) == (ContactStatus.CROWDED_OUT, 0)
    assert list(goals.active) == [True, False, True, True, True]


def test_a_lost_contact_says_so(surface, p_OC):
    weights = np.array([0, 0, 0, 0, -np.inf])
    goals = select_contacts(selection(surface, p_OC, weights=weights), position_tracking)
    assert goals.status[4] == ContactStatus.LOST
    assert np.sum(goals.active) == 4


def test_with_no_active_contact_nothing_moves(surface, p_OC):
    weights = np.full(5, -np.inf)
    goals = select_contacts(selection(surface, p_OC, weights=weights), position_tracking)
    np.testing.assert_array_equal(goals.p_OC, p_OC)


def test_holding_keeps_contacts_to_the_bit(surface, p_OC):
    goals = hold_contacts(selection(surface, p_OC))
    np.testing.assert_array_equal(goals.p_OC, p_OC)
    assert np.all(goals.active)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_the_planner_turns_with_the_object(surface, p_OC, turns):
    """A quarter turn maps the cube's surface onto itself, so goals must turn with the contacts."""
    c, s = round(np.cos(turns * np.pi / 2)), round(np.sin(turns * np.pi / 2))
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    here = select_contacts(selection(surface, p_OC), position_tracking).p_OC
    there = select_contacts(selection(surface, p_OC @ R.T), position_tracking).p_OC
    np.testing.assert_allclose(there, here @ R.T, atol=2e-3)  # Ties at cell borders go by index.


def test_in_turns_each_contact_sees_where_those_before_it_went(surface, p_OC):
    """A strategy that draws to the mean of all contacts, by hand one contact after another."""

    def towards_mean(chosen, i):
        q = chosen.surface.p_OQ[chosen.regions.members(i)]
        return gaussian_log_weights(q, chosen.p_OC.mean(axis=0), 0.02**2 * np.eye(3))

    chosen = selection(surface, p_OC)
    goals = select_contacts(chosen, towards_mean, in_turns=True)
    expected = p_OC.copy()
    for contact in range(5):
        q = chosen.regions.members(contact)
        log_weights = gaussian_log_weights(
            surface.p_OQ[q], expected.mean(axis=0), 0.02**2 * np.eye(3)
        )
        centroid = weighted_centroid(surface.p_OQ[q], log_weights, surface.areas[q])
        expected[contact] = surface.project(centroid[None])[0][0]
    np.testing.assert_allclose(goals.p_OC, expected, atol=1e-12)
    at_once = select_contacts(chosen, towards_mean)
    assert np.max(np.abs(at_once.p_OC[0] - goals.p_OC[0])) < 1e-12
    assert np.max(np.abs(at_once.p_OC - goals.p_OC)) > 1e-4


def test_position_tracking_takes_no_turns(surface, p_OC):
    weights = np.array([0, 0, -np.inf, 0, 0])
    goals = [
        select_contacts(selection(surface, p_OC, weights=weights), position_tracking, in_turns=k)
        for k in (False, True)
    ]
    np.testing.assert_allclose(goals[0].p_OC, goals[1].p_OC, atol=1e-15)
    np.testing.assert_array_equal(goals[1].p_OC[2], p_OC[2])
