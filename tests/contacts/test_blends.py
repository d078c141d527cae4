import numpy as np
import pytest

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.contacts.centroids import select_contacts
from drake_pregrasp.contacts.strategies import STRATEGIES, make_blend, make_strategy
from drake_pregrasp.regions.finger_measures import FINGER_MEASURES


@pytest.mark.parametrize(
    "weights", [{"position": 1, "margin": 1}, {"msv": 2.0, "vew": 0.5, "gii": 0, "position": 1}]
)
@pytest.mark.parametrize("options", [{}, {"stretch": False}, {"power": 2.0, "friction": 0.4}])
def test_it_is_the_sum_of_scaled_strategies(chosen, weights, options):
    blend = make_blend(weights, **options)
    for i in range(len(chosen.p_OC)):
        own = {name: np.exp(make_strategy(name, **options)(chosen, i)) for name in weights}
        expected = sum(
            w * own[name] / max(np.max(own[name]), 1e-300) for name, w in weights.items()
        )
        np.testing.assert_allclose(np.exp(blend(chosen, i)), expected, rtol=1e-9, atol=1e-12)


def goals(chosen, weights, **options):
    return select_contacts(chosen, make_blend(weights, **options)).p_OC


@pytest.mark.parametrize("name", sorted(set(STRATEGIES) - set(FINGER_MEASURES)))
def test_a_blend_of_one_is_that_strategy(chosen, name):
    alone = select_contacts(chosen, make_strategy(name)).p_OC
    np.testing.assert_allclose(goals(chosen, {name: 3}), alone, atol=1e-12)


def test_goals_go_from_one_strategy_to_the_other_with_the_weights(chosen):
    along = [
        goals(chosen, {"position": 1 - share, "vew": share}) for share in (0.0, 0.1, 0.5, 0.9, 1.0)
    ]
    assert np.all(np.diff([np.linalg.norm(p_OC - along[0]) for p_OC in along]) > 0)
    only_ratios_count = goals(chosen, {"position": 50, "vew": 50})
    np.testing.assert_allclose(only_ratios_count, along[2], atol=1e-12)


def test_a_constant_strategy_does_not_change_a_blend(chosen):
    """The volume of the candidate alone is constant: stretched, its weights are zero."""
    alone = goals(chosen, {"position": 1.0}, reading="contact")
    beside = goals(chosen, {"position": 1.0, "vew": 5.0}, reading="contact")
    np.testing.assert_allclose(beside, alone, atol=1e-12)


def test_invalid_weights_are_refused():
    with pytest.raises(InvalidArgumentError, match="no strategy 'luck'; there are: position"):
        make_blend({"luck": 1})
    with pytest.raises(InvalidArgumentError, match="weight of msv must be at least 0, not -1"):
        make_blend({"msv": -1, "position": 1})
    for weights in ({}, {"msv": 0.0}):
        with pytest.raises(InvalidArgumentError, match="needs a weight above 0 for one of: posi"):
            make_blend(weights)
