"""Where the planner's contacts settle."""

import numpy as np
import pytest

from drake_pregrasp import PlannerConfig
from drake_pregrasp.studies import settled_margins
from drake_pregrasp.studies.settled_margins import margin_of, random_starts, settled_margin


def test_starts_repeat_and_lie_on_the_surface(surface):
    once, again = (random_starts(surface, 4, 3) for _ in range(2))
    np.testing.assert_array_equal(once, again)
    assert np.shape(once) == (3, 4, 3)
    np.testing.assert_allclose(surface.distance(np.concatenate(once)), 0, atol=1e-12)


def test_settled_contacts_are_those_of_the_last_ticks():
    found = settled_margins.settled_contacts(
        lambda p_OC: p_OC + 1, np.zeros((1, 3)), ticks=5, last=2
    )
    np.testing.assert_array_equal(found, [np.full((1, 3), 4.0), np.full((1, 3), 5.0)])


def test_the_margin_strategy_settles_at_a_better_margin(surface, p_OC):
    config = PlannerConfig(strategy="margin", in_turns=True)
    assert settled_margin(surface, p_OC, config, ticks=3) > margin_of(surface, p_OC)


@pytest.mark.slow
def test_it_prints_a_line_for_each_strategy(monkeypatch, capsys):
    monkeypatch.setattr(settled_margins, "CASES", [(3, 1, (0.1, 0.1, 0.1), 0.02)])
    settled_margins.main()
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 + len(settled_margins.STRATEGIES)  # The case, the head, and these.
    assert "3 contacts" in lines[0]
