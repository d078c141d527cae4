import numpy as np
import pytest

from drake_pregrasp import InvalidArgumentError, box_surface
from drake_pregrasp.planning.contact_selection import SelectionInput, select_contacts
from drake_pregrasp.planning.grasp_quality import grasp_quality
from drake_pregrasp.planning.safe_regions import NO_REGION, compute_safe_regions
from drake_pregrasp.planning.strategies import (
    contact_gii,
    contact_msv,
    contact_vew,
    hand_gii,
    hand_msv,
    hand_vew,
    make_strategy,
    position_tracking,
    stretched,
)


def selection(surface, p_OC, weights=None):
    weights = np.zeros(len(p_OC)) if weights is None else weights
    regions = compute_safe_regions(surface.p_OQ, p_OC, weights, surface.forbidden)
    return SelectionInput(surface, p_OC, regions, 0.04**2 * np.eye(3))


def by_definition(chosen, reading):
    """The measures of Eq. 5-7, candidate by candidate, by numpy's SVD."""
    rows = []
    active = chosen.regions.sizes() > 0
    for q, label in zip(chosen.surface.p_OQ, chosen.regions.labels, strict=True):
        r = q[None]
        if reading == "hand" and label != NO_REGION:
            r = chosen.p_OC.copy()
            r[label] = q
            r = r[active]
        quality = grasp_quality(r)
        rows.append([quality.q_msv, quality.q_gii, quality.q_vew])
    return np.array(rows).T


@pytest.mark.parametrize("lost", [(), (1,), (0, 3)])
def test_hand_reading_equals_its_definition(surface, p_OC, lost):
    weights = np.zeros(5)
    weights[list(lost)] = -np.inf
    chosen = selection(surface, p_OC, weights)
    inside = chosen.regions.labels != NO_REGION
    for measure, expected in zip(
        (hand_msv, hand_gii, hand_vew), by_definition(chosen, "hand"), strict=True
    ):
        np.testing.assert_allclose(measure(chosen)[inside], expected[inside], rtol=1e-9)


def test_contact_reading_equals_its_definition(surface, p_OC):
    chosen = selection(surface, p_OC)
    for measure, expected in zip(
        (contact_msv, contact_gii, contact_vew), by_definition(chosen, "contact"), strict=True
    ):
        np.testing.assert_allclose(measure(chosen), expected, rtol=1e-9)


def test_stretched_weights_start_at_zero_in_each_region(surface, p_OC):
    chosen = selection(surface, p_OC)
    b = stretched(hand_gii(chosen), chosen)
    for contact in range(5):
        assert np.min(b[chosen.regions.members(contact)]) == 0


@pytest.mark.parametrize("reading", ["contact", "hand"])
@pytest.mark.parametrize("name", ["msv", "gii", "vew"])
def test_the_best_point_has_the_largest_measure_of_its_region(surface, p_OC, name, reading):
    chosen = selection(surface, p_OC)
    strategy = make_strategy(name, reading=reading)
    goals = select_contacts(chosen, strategy, best_point=True)
    values = by_definition(chosen, reading)[("msv", "gii", "vew").index(name)]
    for contact in range(5):
        q = chosen.regions.members(contact)
        where = np.argmin(np.linalg.norm(surface.p_OQ[q] - goals.p_OC[contact], axis=1))
        assert values[q[where]] == pytest.approx(np.max(values[q]), rel=1e-9)


def test_a_constant_measure_gives_the_plain_centroid(surface, p_OC):
    chosen = selection(surface, p_OC)
    goals = select_contacts(chosen, make_strategy("vew", reading="contact"))
    plain = [surface.p_OQ[chosen.regions.members(i)].mean(axis=0) for i in range(5)]
    np.testing.assert_allclose(goals.p_OC, surface.project(np.array(plain))[0], atol=1e-12)


def activity_and_volume(strategy, p_OC):
    surface = box_surface([0.1, 0.1, 0.1], spacing=0.005)
    moved, volume = [], []
    for _ in range(60):
        goals = select_contacts(selection(surface, p_OC), strategy)
        moved.append(np.sum(np.linalg.norm(goals.p_OC - p_OC, axis=1)))
        volume.append(grasp_quality(goals.p_OC).q_vew)
        p_OC = goals.p_OC
    return np.mean(moved), np.max(volume)


def test_the_volume_strategy_spreads_the_contacts_and_singular_values_are_restless(p_OC):
    """What the paper tells of Figures 5 and 6, for the hand's reading with the stretch."""
    position, msv, vew = (
        activity_and_volume(strategy, p_OC)
        for strategy in (position_tracking, make_strategy("msv"), make_strategy("vew"))
    )
    assert msv[0] > 5 * max(vew[0], position[0])
    assert vew[1] > 125.5 > position[1]


def test_unknown_names_are_refused():
    with pytest.raises(InvalidArgumentError, match="no strategy 'luck'; there are: position, msv"):
        make_strategy("luck")
    with pytest.raises(InvalidArgumentError, match="no reading 'palm'; there are: contact, hand"):
        make_strategy("msv", reading="palm")
