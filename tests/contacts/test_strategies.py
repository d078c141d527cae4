import numpy as np
import pytest

from drake_pregrasp import InvalidArgumentError, box_surface
from drake_pregrasp.contacts.centroids import select_contacts
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import (
    READINGS,
    contact_gii,
    contact_msv,
    contact_vew,
    hand_gii,
    hand_margin,
    hand_msv,
    hand_vew,
    make_strategy,
    position_tracking,
    stretched,
)
from drake_pregrasp.quality.force_closure import least_norm_margin, min_weight_margin
from drake_pregrasp.quality.grasp_quality import grasp_quality
from drake_pregrasp.regions.safe_regions import NO_REGION, compute_safe_regions


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


@pytest.mark.parametrize("lost", [(), (1,), (0, 3)])
def test_the_margin_strategy_weighs_by_the_bound_of_the_hand(surface, p_OC, lost):
    weights = np.zeros(5)
    weights[list(lost)] = -np.inf
    chosen = selection(surface, p_OC, weights)
    active = chosen.regions.sizes() > 0
    values = hand_margin(chosen, friction=0.5)
    for q in range(0, len(values), 7):
        label = chosen.regions.labels[q]
        if label == NO_REGION:
            continue
        p, nhat = p_OC.copy(), surface.project(p_OC)[1]
        p[label], nhat[label] = surface.p_OQ[q], surface.nhat_OQ[q]
        bound = least_norm_margin(p[active], nhat[active], 0.5)
        assert values[q] == pytest.approx(bound if bound >= 0 else bound / (1 - bound), rel=1e-7)


def test_the_margin_of_two_contacts_prefers_no_place(surface, p_OC):
    assert np.all(hand_margin(selection(surface, p_OC[:2])) <= 0)
    goals = select_contacts(selection(surface, p_OC[:2]), make_strategy("margin"))
    plain = select_contacts(
        selection(surface, p_OC[:2]), lambda chosen: np.zeros(len(chosen.surface.p_OQ))
    )
    np.testing.assert_allclose(goals.p_OC, plain.p_OC, atol=1e-12)


def test_the_margin_has_one_reading(surface, p_OC):
    chosen = selection(surface, p_OC)
    b = [make_strategy("margin", reading=reading)(chosen) for reading in READINGS]
    np.testing.assert_array_equal(b[0], b[1])


def test_the_margin_strategy_is_of_its_friction(surface, p_OC):
    chosen = selection(surface, p_OC)
    for friction in (0.3, 0.7):
        b = stretched(hand_margin(chosen, friction=friction), chosen)
        strategy = make_strategy("margin", friction=friction)
        np.testing.assert_allclose(np.exp(strategy(chosen)), np.maximum(b, 0), atol=1e-12)


def test_a_power_raises_the_weights(surface, p_OC):
    chosen = selection(surface, p_OC)
    b = np.exp(make_strategy("vew")(chosen))
    np.testing.assert_allclose(np.exp(make_strategy("vew", power=3.0)(chosen)), b**3, rtol=1e-9)


def settled(strategy, p_OC, surface, *, in_turns=False, ticks=25):
    """The contacts and their last displacement, after iterating as the planner does."""
    for _ in range(ticks):
        goals = select_contacts(selection(surface, p_OC), strategy, in_turns=in_turns)
        moved = np.max(np.linalg.norm(goals.p_OC - p_OC, axis=1))
        p_OC = goals.p_OC
    return p_OC, moved


def margin(surface, p_OC, friction=0.7):
    return min_weight_margin(p_OC - surface.p_OCoM, surface.project(p_OC)[1], friction)


@pytest.mark.parametrize("count", [3, 4, 5])
def test_the_margin_strategy_leads_any_start_to_force_closure(surface, count):
    rng = np.random.default_rng(0)
    starts = [surface.p_OQ[rng.choice(len(surface.p_OQ), count)] for _ in range(8)]
    starts.append(surface.p_OQ[:count])  # All on one face.
    assert sum(margin(surface, p_OC) < 1e-7 for p_OC in starts) >= 2
    strategy = make_strategy("margin", power=4.0)
    for p_OC in starts:
        after, moved = settled(strategy, p_OC, surface, in_turns=True)
        assert margin(surface, after) > 0.4
        assert moved < 0.005


def test_singular_values_alone_end_far_from_the_best_margin(surface):
    """Four contacts, in turns: Q_MSV is content with a grasp that hardly closes."""
    rng = np.random.default_rng(1)
    starts = [surface.p_OQ[rng.choice(len(surface.p_OQ), 4, replace=False)] for _ in range(5)]
    of_msv, of_margin = (
        np.median(
            [margin(surface, settled(strategy, p, surface, in_turns=True)[0]) for p in starts]
        )
        for strategy in (make_strategy("msv"), make_strategy("margin", power=4.0))
    )
    assert of_msv < 0.1
    assert of_margin > 0.9


def test_in_turns_the_measures_come_to_rest(surface, p_OC):
    strategy = make_strategy("msv")
    assert settled(strategy, p_OC, surface)[1] > 0.02
    assert settled(strategy, p_OC, surface, in_turns=True)[1] < 0.002


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
    with pytest.raises(InvalidArgumentError, match="power must be greater than 0, not 0"):
        make_strategy("msv", power=0)
    with pytest.raises(InvalidArgumentError, match=r"friction must be at least 0, not -0\.1"):
        make_strategy("margin", friction=-0.1)
