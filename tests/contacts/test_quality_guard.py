"""Guarded goals move only if no guarded measure of the grasp decreases."""

import numpy as np
import pytest
from selections import (
    CUBE,
    always_worse,
    given_regions,
    goals_towards,
    lengths,
    nearest_candidate,
    spread_contacts,
    wander,
)

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.contacts.goal_limits import ContactLimits
from drake_pregrasp.contacts.quality_guard import GUARDS, guard_measure, keep_quality
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.geometry.mesh_surface import AxisArea, mesh_surface
from drake_pregrasp.geometry.shapes import cylinder_shape
from drake_pregrasp.regions.independent_regions import slip_radii_within

CAN = mesh_surface(
    cylinder_shape(0.035, 0.12), spacing=0.008, no_touch=[AxisArea("+z"), AxisArea("-z")]
)


def qualities(surface, p_OC):
    measured = guard_measure(GUARDS, 0.7)(surface, p_OC, surface.project(p_OC)[1])
    return np.array(list(measured))


@pytest.fixture(scope="module")
def unguarded():
    """Measures of goals that nothing guards, at each tick."""
    free, p_OC = ContactLimits(max_step=0.01), spread_contacts(CAN, 4, 0.04)
    return np.array([qualities(CAN, g.p_OC) for *_, g in wander(CAN, p_OC, free, 15, seed=4)])


TIPS = np.full(4, 0.008)


@pytest.mark.parametrize(
    ("names", "tips"),
    [(("q_msv",), TIPS), (("q_gii", "q_vew"), TIPS), (("margin",), TIPS), (GUARDS, np.empty(0))],
)
def test_guarded_measures_never_fall(names, tips, unguarded):
    limits = ContactLimits(guard=guard_measure(names, 0.7), max_step=0.01)
    guarded = [GUARDS.index(name) for name in names]
    moved, p_OC = 0.0, spread_contacts(CAN, 4, 0.04)
    for _, before, goals in wander(CAN, p_OC, limits, 15, seed=4, tip_radii=tips):
        assert np.all(goals.active)
        gain = qualities(CAN, goals.p_OC) - qualities(CAN, before)
        assert np.all(gain[guarded] >= -1e-9)
        moved += np.sum(lengths(goals.p_OC - before))
    assert moved > 0.001
    assert np.min(np.diff(unguarded[:, guarded], axis=0)) < -1e-4


def test_no_step_shortens_the_slip_that_the_grasp_survives_below_the_limit():
    radius, surface = 0.02, CUBE

    def slips(p_OC):
        return slip_radii_within(surface, p_OC, surface.project(p_OC)[1], radius, 0.7)

    p_OC = 0.05 * np.array([[1, 0.2, 0], [-1, 0.4, 0.2], [-1, -0.4, -0.2], [1, -0.4, 0.2]])
    moved, fell = {}, {}
    for limit in (0.0, radius):
        limits = ContactLimits(guard=guard_measure((), 0.7, limit), max_step=0.01)
        gains, lengths_ = [], 0.0
        for _, before, goals in wander(surface, p_OC, limits, 15, seed=4):
            gains.append(np.min(slips(goals.p_OC) - slips(before)))
            lengths_ += np.sum(lengths(goals.p_OC - before))
        moved[limit], fell[limit] = lengths_, min(gains)
    assert fell[radius] >= -1e-12
    assert fell[0.0] < -0.002
    assert moved[radius] > 0.02


def test_a_reverted_step_also_reverts_steps_that_depend_on_it():
    """The measure is the product of two heights; the first contact meets a fingertip."""
    before = np.array([[0.05, -0.015, 0.005], [0.05, 0.005, -0.035], [0.05, 0.035, 0.005]])
    after = before + np.array([[0, 0.04, 0], [0, 0.04, 0], [0, 0, 0]])
    for radius, expected in ((1e-3, after), (0.01, before)):
        goals = goals_towards(
            after, before, radius, guard=lambda surface, p_OC, nhat: p_OC[:1, 1] * p_OC[1, 1]
        )
        np.testing.assert_allclose(goals, expected, atol=1e-12)


def test_a_step_that_leaves_the_grasp_as_good_is_taken():
    before = spread_contacts(CUBE, 4, 0.03)
    after = np.roll(before, 1, axis=0)
    for guard, expected in ((lambda surface, p_OC, nhat: [1.0], after), (always_worse(), before)):
        np.testing.assert_allclose(goals_towards(after, before, guard=guard), expected, atol=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_what_a_contact_that_has_to_move_leaves_of_the_grasp_is_guarded(seed):
    """Without it, the two others have no force closure that they could lose."""
    rng, angles = np.random.default_rng(seed), 2 * np.pi / 3 * np.arange(3)
    measure = guard_measure(("margin",), 0.7)

    def around(angles, height):
        around = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
        places = 0.035 * around + [0.0, 0.0, height]
        return CAN.p_OQ[[nearest_candidate(CAN, place) for place in places]]

    def margin(p_OC):
        return next(iter(measure(CAN, p_OC, CAN.project(p_OC)[1])))

    # The two others would come nearer to the first one.
    steps = np.array([0.1, -1.0, 1.0]) * rng.uniform(0.7, 1.0, 3)
    before, goals = around(angles, 0.0), around(angles + steps, 0.02)
    regions = given_regions(CAN, *([nearest_candidate(CAN, p)] for p in goals))
    selection = SelectionInput(CAN, before, regions, np.eye(3))
    after = keep_quality(selection, goals, np.arange(3) > 0, measure, [[0], [1], [2]])
    moved = np.where((np.arange(3) == 0)[:, None], goals, before)
    np.testing.assert_array_equal(after[0], goals[0])
    assert 0 < margin(moved) <= margin(after) + 1e-9
    assert margin(goals) < margin(moved)


def test_an_unknown_guard_is_refused_and_no_guard_is_none():
    with pytest.raises(InvalidArgumentError, match="no guard 'luck'; there are: q_msv, q_gii"):
        guard_measure(["luck"], 0.7)
    assert guard_measure([], 0.7) is None
