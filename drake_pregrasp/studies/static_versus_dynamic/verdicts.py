"""Which arms are ahead of which, from paired tests at each closing time."""

import itertools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from drake_pregrasp.studies.static_versus_dynamic.arms import TESTED_ARM
from drake_pregrasp.studies.static_versus_dynamic.paired_test import SIGNIFICANT, PairedTest
from drake_pregrasp.studies.static_versus_dynamic.results import Results

Tests = Mapping[float, PairedTest]
"""Tests of one arm against another, by closing time in seconds."""


class Verdict(NamedTuple):
    """What the tests say on one condition.

    Attributes:
        condition: Its key.
        tests: Of `TESTED_ARM` against each other arm; empty if it has no outcomes.
        unbeaten: Arms that no other one is ahead of at any closing time.
    """

    condition: str
    tests: Mapping[str, Tests]
    unbeaten: Sequence[str]

    @property
    def ahead(self) -> dict[str, Tests]:
        """Returns the arms that `TESTED_ARM` is ahead of, with the tests that show it."""
        return _chosen(self.tests, ahead=True)

    @property
    def behind(self) -> dict[str, Tests]:
        """Returns the arms that are ahead of it, with the tests that show it."""
        return _chosen(self.tests, ahead=False)

    @property
    def open(self) -> dict[str, Tests]:
        """Returns the arms of which neither is shown, with all tests."""
        return {
            arm: tests
            for arm, tests in self.tests.items()
            if arm not in self.ahead and arm not in self.behind
        }


def judge(results: Results, condition: str) -> Verdict:
    """Compares the arms of a condition."""
    arms, times = results.arms(condition), results.times(condition)
    rivals = [arm for arm in arms if arm != TESTED_ARM] if TESTED_ARM in arms else []
    tests = {
        rival: {time: results.test(condition, TESTED_ARM, rival, time) for time in times}
        for rival in rivals
    }
    beaten = {
        second
        for first, second in itertools.permutations(arms, 2)
        if any(results.test(condition, first, second, time).ahead for time in times)
    }
    return Verdict(condition, tests, [arm for arm in arms if arm not in beaten])


def survivors(p_values: Sequence[float]) -> int:
    """Returns how many of the tests still show something if they are seen as one family.

    Holm's step-down (Scandinavian Journal of Statistics 6, 1979): with the probability of one
    test's bound, none of them is there by chance.
    """
    ordered = sorted(p_values)
    passed = itertools.takewhile(
        lambda step: step[1] * (len(ordered) - step[0]) < SIGNIFICANT, enumerate(ordered)
    )
    return sum(1 for _ in passed)


def _chosen(tests: Mapping[str, Tests], *, ahead: bool) -> dict[str, Tests]:
    chosen = {
        arm: {time: t for time, t in of_arm.items() if (t.ahead if ahead else t.behind)}
        for arm, of_arm in tests.items()
    }
    return {arm: of_arm for arm, of_arm in chosen.items() if of_arm}
