import numpy as np
import pytest

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.contacts.centroids import select_contacts
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import STRATEGIES, make_blend, make_strategy
from drake_pregrasp.regions.safe_regions import compute_safe_regions


@pytest.fixture(scope="module")
def chosen(surface, p_OC):
    regions = compute_safe_regions(surface.p_OQ, p_OC, np.zeros(5), surface.forbidden)
    return SelectionInput(surface, p_OC, regions, 0.04**2 * np.eye(3))


def by_definition(chosen, weights, **options):
    """Equation by equation, for one region after another."""
    for i in range(len(chosen.p_OC)):
        own = {name: np.exp(make_strategy(name, **options)(chosen, i)) for name in weights}
        yield i, sum(w * own[name] / max(np.max(own[name]), 1e-300) for name, w in weights.items())


@pytest.mark.parametrize(
    "weights", [{"position": 1, "margin": 1}, {"msv": 2.0, "vew": 0.5, "gii": 0, "position": 1}]
)
@pytest.mark.parametrize("options", [{}, {"stretch": False}, {"power": 2.0, "friction": 0.4}])
def test_it_is_the_sum_of_scaled_strategies(chosen, weights, options):
    blend = make_blend(weights, **options)
    for i, expected in by_definition(chosen, weights, **options):
        np.testing.assert_allclose(np.exp(blend(chosen, i)), expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", STRATEGIES)
def test_a_blend_of_one_is_that_strategy(chosen, name):
    one, alone = (
        select_contacts(chosen, weigh).p_OC
        for weigh in (make_blend({name: 3}), make_strategy(name))
    )
    np.testing.assert_allclose(one, alone, atol=1e-12)


def test_only_ratios_count(chosen):
    goals = [
        select_contacts(chosen, make_blend({"vew": k, "position": 2 * k})).p_OC for k in (1, 100)
    ]
    np.testing.assert_allclose(goals[0], goals[1], atol=1e-12)


def test_goals_go_from_one_strategy_to_the_other_with_the_weights(chosen):
    ends = [select_contacts(chosen, make_strategy(name)).p_OC for name in ("position", "vew")]
    away = []
    for share in (0.0, 0.1, 0.5, 0.9, 1.0):
        blend = make_blend({"position": 1 - share, "vew": share})
        away.append(np.linalg.norm(select_contacts(chosen, blend).p_OC - ends[0]))
    assert np.all(np.diff(away) > 0)
    assert away[-1] == pytest.approx(np.linalg.norm(ends[1] - ends[0]))


def test_a_strategy_without_preference_has_no_say(chosen):
    """The volume of the candidate alone is constant: stretched, its weights are zero."""
    blends = [
        make_blend(weights, reading="contact")
        for weights in ({"position": 1.0}, {"position": 1.0, "vew": 5.0})
    ]
    alone, beside = (select_contacts(chosen, weigh).p_OC for weigh in blends)
    np.testing.assert_allclose(beside, alone, atol=1e-12)


def test_unusable_weights_are_refused():
    with pytest.raises(InvalidArgumentError, match="no strategy 'luck'; there are: position"):
        make_blend({"luck": 1})
    with pytest.raises(InvalidArgumentError, match="weight of msv must be at least 0, not -1"):
        make_blend({"msv": -1, "position": 1})
    for weights in ({}, {"msv": 0.0}):
        with pytest.raises(InvalidArgumentError, match="needs a weight above 0 for one of: posi"):
            make_blend(weights)
