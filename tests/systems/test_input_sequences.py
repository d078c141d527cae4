"""A few random sequences of inputs; `tests.fuzz.input_sequences` tries as many as asked."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent.parent / "fuzz"))

from input_cases import make_case
from input_sequences import outcome
from input_variants import VARIANTS

PER_VARIANT = 8
SEED = 20


@pytest.mark.parametrize("variant", VARIANTS)
def test_nothing_that_comes_breaks_the_planner(variant):
    first = VARIANTS.index(variant)
    for number in range(first, first + PER_VARIANT * len(VARIANTS), len(VARIANTS)):
        case = make_case(SEED, number)
        kind, words = outcome(case)
        assert kind == "kept", f"{case}\n{words}"
