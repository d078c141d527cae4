import numpy as np
import printed_equations
import pytest

from drake_pregrasp import InvalidArgumentError, box_surface
from drake_pregrasp.contacts.centroids import position_tracking, select_contacts
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import (
    READINGS,
    hand_margin,
    make_strategy,
)
from drake_pregrasp.quality.force_closure import least_norm_margin, min_weight_margin
from drake_pregrasp.quality.grasp_quality import grasp_quality
from drake_pregrasp.regions.safe_regions import compute_safe_regions


def selection(surface, p_OC, weights=None):
    weights = np.zeros(len(p_OC)) if weights is None else weights
    regions = compute_safe_regions(surface.p_OQ, p_OC, weights, surface.forbidden)
    return SelectionInput(surface, p_OC, regions, 0.04**2 * np.eye(3))


@pytest.mark.parametrize("lost", [(), (1,), (0, 3)])
@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("name", ["position", "msv", "gii", "vew"])
def test_weights_are_those_of_the_printed_equations(surface, p_OC, name, reading, lost):
    h = np.zeros(5)
    h[list(lost)] = -np.inf
    chosen = selection(surface, p_OC, h)
    strategy = make_strategy(name, reading=reading, stretch=False)
    for i in set(range(5)) - set(lost):
        b, printed = (
            np.exp(strategy(chosen, i)),
            printed_equations.weights(chosen, i, name, reading),
        )
        np.testing.assert_allclose(b / b.max(), printed / printed.max(), rtol=1e-9)
        if name != "position":
            np.testing.assert_allclose(b, printed, rtol=1e-9)


@pytest.mark.parametrize("name", ["position", "msv", "gii", "vew"])
def test_goals_are_the_printed_centroids_on_the_surface(surface, p_OC, name):
    chosen = selection(surface, p_OC)
    goals = select_contacts(chosen, make_strategy(name)).p_OC
    for i in range(5):
        expected = printed_equations.centroid(chosen, i, name)[None]
        on_region = surface.project_into(expected, [chosen.regions.members(i)])[0][0]
        np.testing.assert_allclose(goals[i], on_region, atol=1e-12)


def test_stretched_weights_start_at_zero_in_each_region(surface, p_OC):
    chosen = selection(surface, p_OC)
    for i in range(5):
        assert np.min(np.exp(make_strategy("gii")(chosen, i))) == 0


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("name", ["msv", "gii", "vew"])
def test_the_best_point_has_the_largest_measure_of_its_region(surface, p_OC, name, reading):
    chosen = selection(surface, p_OC)
    strategy = make_strategy(name, reading=reading)
    goals = select_contacts(chosen, strategy, best_point=True)
    for i in range(5):
        q = surface.p_OQ[chosen.regions.members(i)]
        values = printed_equations.weights(chosen, i, name, reading)
        where = np.argmin(np.linalg.norm(q - goals.p_OC[i], axis=1))
        assert values[where] == pytest.approx(np.max(values), rel=1e-9)


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
    for i in np.flatnonzero(active):
        values = hand_margin(chosen, i, friction=0.5)
        for q, value in list(zip(chosen.regions.members(i), values, strict=True))[::7]:
            p, nhat = p_OC.copy(), surface.project(p_OC)[1]
            p[i], nhat[i] = surface.p_OQ[q], surface.nhat_OQ[q]
            bound = least_norm_margin(p[active], nhat[active], 0.5)
            assert value == pytest.approx(bound if bound >= 0 else bound / (1 - bound), rel=1e-7)


def test_the_margin_of_two_contacts_prefers_no_place(surface, p_OC):
    chosen = selection(surface, p_OC[:2])
    assert all(np.all(hand_margin(chosen, i) <= 0) for i in range(2))
    goals = select_contacts(chosen, make_strategy("margin"))
    plain = select_contacts(chosen, lambda s, i: np.zeros(len(s.regions.members(i))))
    np.testing.assert_allclose(goals.p_OC, plain.p_OC, atol=1e-12)


def test_the_margin_has_one_reading(surface, p_OC):
    chosen = selection(surface, p_OC)
    b = [make_strategy("margin", reading=reading)(chosen, 0) for reading in READINGS]
    np.testing.assert_array_equal(b[0], b[1])


def test_the_margin_strategy_is_of_its_friction(surface, p_OC):
    chosen = selection(surface, p_OC)
    for friction in (0.3, 0.7):
        b = hand_margin(chosen, 2, friction=friction)
        strategy = make_strategy("margin", friction=friction)
        np.testing.assert_allclose(np.exp(strategy(chosen, 2)), b - b.min(), atol=1e-12)


def test_a_power_raises_the_weights(surface, p_OC):
    chosen = selection(surface, p_OC)
    b, raised = (np.exp(make_strategy("vew", power=power)(chosen, 0)) for power in (1.0, 3.0))
    np.testing.assert_allclose(raised, b**3, rtol=1e-9)


def settled(strategy, p_OC, surface, *, in_turns=False, ticks=25):
    """The contacts and their last displacement, after iterating as the planner does."""
    for _ in range(ticks):
        goals = select_contacts(selection(surface, p_OC), strategy, in_turns=in_turns)
        moved = np.max(np.linalg.norm(goals.p_OC - p_OC, axis=1))
        p_OC = goals.p_OC
    return p_OC, moved


def margin(surface, p_OC, friction=0.7):
    return min_weight_margin(p_OC - surface.p_OCoM, surface.project(p_OC)[1], friction)


@pytest.mark.slow
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


@pytest.mark.slow
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
