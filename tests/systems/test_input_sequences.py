"""A few random sequences of inputs; `tests.fuzz.input_sequences` tries as many as asked."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent.parent / "fuzz"))

from input_cases import Case, Tick, make_case
from input_sequences import outcome, smallest
from input_variants import VARIANTS

PER_VARIANT = 30
SEED = 20


@pytest.mark.parametrize("variant", VARIANTS)
def test_nothing_that_comes_breaks_the_planner(variant):
    first = VARIANTS.index(variant)
    for number in range(first, first + PER_VARIANT * len(VARIANTS), len(VARIANTS)):
        case = make_case(SEED, number)
        kind, words = outcome(case)
        assert kind == "kept", f"{smallest(case, kind)}\n{words}"


def test_a_failing_sequence_is_made_small(monkeypatch):
    ticks = [Tick(1, {"hold_contacts": ("vector", 1.0)}), Tick(2, {}), Tick(1, {}, between=True)]

    def broken(case):
        held = any("hold_contacts" in tick.values for tick in case.ticks)
        return ("broken" if held else "kept"), ""

    monkeypatch.setattr(sys.modules["input_sequences"], "outcome", broken)
    assert smallest(Case("plain", ticks), "broken").ticks == [
        Tick(4, {"hold_contacts": ("vector", 1.0)})
    ]
