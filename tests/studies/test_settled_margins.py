import numpy as np
import pytest

from drake_pregrasp.contacts.strategies import make_strategy
from drake_pregrasp.studies import settled_margins
from drake_pregrasp.studies.settled_margins import margin_of, random_starts, settled_margin


def test_starts_repeat_and_lie_on_the_surface(surface):
    once, again = (random_starts(surface, 4, 3) for _ in range(2))
    np.testing.assert_array_equal(once, again)
    assert np.shape(once) == (3, 4, 3)
    np.testing.assert_allclose(surface.distance(np.concatenate(once)), 0, atol=1e-12)


def test_what_is_settled_is_the_mean_of_the_last_ticks(surface, p_OC):
    """At rest, one tick more is what there was; held from the start, nothing has happened yet."""
    strategy = make_strategy("margin")
    values = [
        settled_margin(surface, p_OC, strategy, in_turns=True, ticks=ticks, last=1)
        for ticks in (1, 2, 3)
    ]
    both = settled_margin(surface, p_OC, strategy, in_turns=True, ticks=3, last=2)
    assert both == pytest.approx(np.mean(values[1:]))
    assert values[0] > margin_of(surface, p_OC)


def test_it_prints_a_line_for_each_strategy(monkeypatch, capsys):
    monkeypatch.setattr(settled_margins, "CASES", [(3, 2, (0.1, 0.1, 0.1), 0.02)])
    settled_margins.main()
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 + len(settled_margins.STRATEGIES)
    assert "3 contacts" in lines[0]
