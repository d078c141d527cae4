"""Steady-state contacts of the planner."""

import pytest
from drake_pregrasp.studies.settled_margins import margin_of, settled_margin

from drake_pregrasp import PlannerConfig
from drake_pregrasp.studies import settled_margins


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
