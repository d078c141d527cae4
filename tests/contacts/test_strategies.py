import numpy as np
import printed_equations
import pytest
from conftest import slow
from scipy.spatial.transform import Rotation
from selections import CUBE, changed_surface, selection_of, spread_contacts
from thin_cup import CUP

from drake_pregrasp import InvalidArgumentError, box_surface, mesh_surface
from drake_pregrasp.contacts.centroids import position_tracking, select_contacts
from drake_pregrasp.contacts.goal_limits import ContactLimits
from drake_pregrasp.contacts.quality_guard import guard_measure
from drake_pregrasp.contacts.strategies import READINGS, hand_margin, make_strategy
from drake_pregrasp.quality.force_closure import min_weight_margin
from drake_pregrasp.quality.grasp_quality import grasp_quality
from drake_pregrasp.quality.margin_bounds import least_norm_margin


@pytest.mark.parametrize("lost", [(), (0, 3)])
@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize(("model", "length"), [("complete", 0.0), ("complete", 0.1)])
@pytest.mark.parametrize("name", ["position", "msv", "gii", "vew"])
def test_weights_are_those_of_the_printed_equations(
    surface, p_OC, name, model, length, reading, lost
):
    h = np.zeros(len(p_OC))
    h[list(lost)] = -np.inf
    check_printed_weights(selection_of(surface, p_OC, h), name, reading, model, length)


@pytest.mark.parametrize("length", [0.0, 0.03])
@pytest.mark.parametrize("name", ["msv", "gii", "vew"])
@pytest.mark.parametrize(
    ("model", "count"), [("hard_finger", 5), ("hard_finger", 3), ("soft_finger", 2)]
)
def test_weights_of_contact_models_are_those_of_the_printed_grasp_matrix(
    surface, p_OC, name, model, count, length
):
    check_printed_weights(selection_of(surface, p_OC[:count]), name, "hand", model, length)


@pytest.mark.parametrize("name", ["msv", "gii", "vew"])
def test_frictionless_weights_are_those_of_the_printed_grasp_matrix(name):
    cup = mesh_surface(CUP, spacing=0.02)
    p_OC = spread_contacts(cup, 9, 0.02)
    check_printed_weights(selection_of(cup, p_OC), name, "hand", "frictionless", 0.0)


def check_printed_weights(chosen, name, reading, model, length):
    unit = length or (1.0 if model == "complete" else chosen.surface.longest_lever_arm)
    differ = []
    for i in np.flatnonzero(chosen.regions.sizes()):
        printed = printed_equations.weights(chosen, i, name, reading, model, unit)
        options = {"reading": reading, "contact_model": model, "length": length}
        plain, stretched = (
            np.exp(make_strategy(name, **options, stretch=stretch)(chosen, i))
            for stretch in (False, True)
        )
        if name == "position":
            np.testing.assert_allclose(plain / plain.max(), printed / printed.max(), rtol=1e-9)
            np.testing.assert_array_equal(stretched, plain)
        else:
            np.testing.assert_allclose(plain, printed, rtol=1e-9)
            np.testing.assert_allclose(stretched, plain - plain.min(), rtol=1e-9, atol=1e-12)
        differ.append(np.ptp(plain) > 1e-6 * plain.max())
    assert all(differ) or (name, reading) == ("vew", "contact")


@pytest.mark.parametrize("name", ["position", "msv", "gii", "vew"])
def test_goals_are_the_printed_centroids_on_the_surface(chosen, surface, name):
    goals = select_contacts(chosen, make_strategy(name)).p_OC
    for i in range(5):
        expected = printed_equations.centroid(chosen, i, name)[None]
        on_region = surface.project_into(expected, [chosen.regions.members(i)])[0][0]
        np.testing.assert_allclose(goals[i], on_region, atol=1e-12)


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("name", ["msv", "gii", "vew"])
def test_the_best_point_has_the_largest_measure_of_its_region(chosen, surface, name, reading):
    strategy = make_strategy(name, reading=reading)
    goals = select_contacts(chosen, strategy, best_point=True)
    for i in range(5):
        q = surface.p_OQ[chosen.regions.members(i)]
        values = printed_equations.weights(chosen, i, name, reading)
        where = np.argmin(np.linalg.norm(q - goals.p_OC[i], axis=1))
        assert values[where] == pytest.approx(np.max(values), rel=1e-9)


@pytest.mark.parametrize(
    ("name", "reading", "n", "model"),
    [
        ("vew", "contact", 5, "complete"),
        ("margin", "hand", 2, "complete"),
        ("msv", "contact", 5, "soft_finger"),  # Four columns.
        ("gii", "hand", 2, "hard_finger"),  # No moment about the line through both contacts.
        ("vew", "hand", 5, "frictionless"),  # No vertical force on the side faces.
    ],
)
@pytest.mark.parametrize("stretch", [True, False])
def test_a_constant_measure_gives_the_plain_centroid(
    surface, p_OC, name, reading, n, model, stretch
):
    chosen = selection_of(surface, p_OC[:n])
    options = {"reading": reading, "contact_model": model, "stretch": stretch}
    goals = select_contacts(chosen, make_strategy(name, **options)).p_OC
    plain = select_contacts(chosen, lambda s, i: np.zeros(len(s.regions.members(i)))).p_OC
    np.testing.assert_allclose(goals, plain, atol=1e-12)


@pytest.mark.parametrize("lost", [(), (0, 3)])
def test_the_margin_strategy_weighs_by_the_bound_of_the_hand(surface, p_OC, lost):
    weights = np.zeros(5)
    weights[list(lost)] = -np.inf
    chosen = selection_of(surface, p_OC, weights)
    active = chosen.regions.sizes() > 0
    for i in np.flatnonzero(active):
        values = hand_margin(chosen, i, friction=0.5)
        for q, value in list(zip(chosen.regions.members(i), values, strict=True))[::7]:
            p, nhat = p_OC.copy(), surface.project(p_OC)[1]
            p[i], nhat[i] = surface.p_OQ[q], surface.nhat_OQ[q]
            bound = least_norm_margin(p[active], nhat[active], 0.5)
            assert value == pytest.approx(bound if bound >= 0 else bound / (1 - bound), rel=1e-7)


@pytest.mark.parametrize("seed", [0, 1, *map(slow, range(2, 40))])
@pytest.mark.parametrize("name", ["msv", "margin", "independence"])
def test_goals_depend_neither_on_axes_nor_on_handedness_nor_on_the_order(name, seed):
    """A guard of the margin moves contacts in their order; it depends on no axes either."""
    rng, n = np.random.default_rng(seed), 3 + seed % 3
    R = Rotation.random(random_state=seed).as_matrix() @ np.diag([1.0, 1, (-1) ** seed])
    other, guard = changed_surface(CUBE, R), guard_measure(["margin"], 0.5, 0.01)
    places = CUBE.p_OQ[rng.choice(len(CUBE.p_OQ), n, replace=False)]
    p_OC = CUBE.project(places + rng.normal(scale=1e-3, size=(n, 3)))[0]
    strategy = make_strategy(name, friction=0.5)
    for order, limits in [
        (rng.permutation(n), ContactLimits()),
        (np.arange(n), ContactLimits(guard=guard)),
    ]:
        goals = select_contacts(selection_of(CUBE, p_OC), strategy, limits=limits).p_OC
        changed = selection_of(other, other.project((p_OC @ R.T)[order])[0])
        changed_goals = select_contacts(changed, strategy, limits=limits).p_OC
        np.testing.assert_allclose(changed_goals, (goals @ R.T)[order], atol=1e-9)


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("friction", [0.3, 0.7])
def test_the_margin_strategy_is_of_its_friction_and_has_one_reading(chosen, friction, reading):
    b = hand_margin(chosen, 2, friction=friction)
    strategy = make_strategy("margin", friction=friction, reading=reading)
    np.testing.assert_allclose(np.exp(strategy(chosen, 2)), b - b.min(), atol=1e-12)


def test_a_power_raises_the_weights(chosen):
    b, raised = (np.exp(make_strategy("vew", power=power)(chosen, 0)) for power in (1.0, 3.0))
    np.testing.assert_allclose(raised, b**3, rtol=1e-9)


def settled(strategy, p_OC, surface, *, in_turns=False, ticks=25):
    """The contacts and their last displacement, after iterating as the planner does."""
    for _ in range(ticks):
        goals = select_contacts(selection_of(surface, p_OC), strategy, in_turns=in_turns)
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

    def typical_margin(strategy):
        ends = [settled(strategy, p_OC, surface, in_turns=True)[0] for p_OC in starts]
        return np.median([margin(surface, p_OC) for p_OC in ends])

    assert typical_margin(make_strategy("msv")) < 0.1
    assert typical_margin(make_strategy("margin", power=4.0)) > 0.9


def test_in_turns_the_measures_come_to_rest(surface, p_OC):
    strategy = make_strategy("msv")
    assert settled(strategy, p_OC, surface)[1] > 0.02
    assert settled(strategy, p_OC, surface, in_turns=True)[1] < 0.002


def activity_and_volume(strategy, p_OC):
    surface = box_surface([0.1, 0.1, 0.1], spacing=0.005)
    moved, volume = [], []
    for _ in range(60):
        goals = select_contacts(selection_of(surface, p_OC), strategy)
        moved.append(np.sum(np.linalg.norm(goals.p_OC - p_OC, axis=1)))
        volume.append(grasp_quality(goals.p_OC).q_vew)
        p_OC = goals.p_OC
    return np.mean(moved), np.max(volume)


@pytest.mark.slow
def test_the_volume_strategy_spreads_the_contacts_and_singular_values_are_restless(p_OC):
    """The paper's observations on Figures 5 and 6, for the hand's reading with the stretch."""
    position, msv, vew = (
        activity_and_volume(strategy, p_OC)
        for strategy in (position_tracking, make_strategy("msv"), make_strategy("vew"))
    )
    assert msv[0] > 5 * max(vew[0], position[0])
    assert vew[1] > 125.5 > position[1]


@pytest.mark.parametrize(
    ("name", "options", "problem"),
    [
        ("luck", {}, "no strategy 'luck'; there are: position, msv"),
        ("msv", {"reading": "palm"}, "no reading 'palm'; there are: contact, hand"),
        ("msv", {"contact_model": "glue"}, "no contact model 'glue'; there are: complete"),
        ("msv", {"length": -1.0}, r"length must be at least 0 m, not -1\.0"),
        ("msv", {"power": 0}, "power must be greater than 0, not 0"),
        ("margin", {"friction": -0.1}, r"friction must be at least 0, not -0\.1"),
    ],
)
def test_invalid_settings_are_refused(name, options, problem):
    with pytest.raises(InvalidArgumentError, match=problem):
        make_strategy(name, **options)


@pytest.mark.parametrize(
    ("name", "least", "most"), [("position", 0.001, 0.006), slow("vew", 0.006, 0.02)]
)
def test_settled_goals_depend_on_the_spacing(p_OC, name, least, most):
    """docs/planner_options.md says that they do."""
    settled = []
    for spacing in (0.01, 0.005):
        surface = box_surface([0.1, 0.1, 0.1], spacing=spacing, forbidden_faces=["+z", "-z"])
        goals = p_OC
        for _ in range(40):
            goals = select_contacts(selection_of(surface, goals), make_strategy(name)).p_OC
        settled.append(goals)
    moved = np.linalg.norm(settled[1] - settled[0], axis=1)
    assert least < np.max(moved) < most
