"""Which arms the tested arm is ahead of, and behind, by paired tests at each closing time."""

from collections.abc import Mapping
from typing import NamedTuple

from drake_pregrasp.studies.static_versus_dynamic.arms import TESTED_ARM
from drake_pregrasp.studies.static_versus_dynamic.holm import holm
from drake_pregrasp.studies.static_versus_dynamic.paired_test import SIGNIFICANT, PairedTest
from drake_pregrasp.studies.static_versus_dynamic.results import Results


class Comparison(NamedTuple):
    """One test, as one of all that the study makes.

    Attributes:
        test: By itself.
        p: Its probability by Holm's correction over all tests of `TESTED_ARM`.
    """

    test: PairedTest
    p: float

    @property
    def ahead(self) -> bool:
        """Whether it is shown that `TESTED_ARM` succeeds more often."""
        return self.p < SIGNIFICANT and self.test.gained > self.test.lost

    @property
    def behind(self) -> bool:
        """Whether it is shown that the other arm does."""
        return self.p < SIGNIFICANT and self.test.gained < self.test.lost


Comparisons = Mapping[float, Comparison]
"""Of `TESTED_ARM` with another arm, by closing time in seconds."""


class Verdict(NamedTuple):
    """What the tests say on one condition.

    Attributes:
        condition: Its key.
        against: `TESTED_ARM` against each other arm; empty if it has no outcomes.
    """

    condition: str
    against: Mapping[str, Comparisons]

    @property
    def ahead(self) -> dict[str, Comparisons]:
        """Returns the arms that `TESTED_ARM` is ahead of, with the comparisons that show it."""
        return _chosen(self.against, ahead=True)

    @property
    def behind(self) -> dict[str, Comparisons]:
        """Returns the arms that are ahead of it, with the comparisons that show it."""
        return _chosen(self.against, ahead=False)

    @property
    def open(self) -> dict[str, Comparisons]:
        """Returns the arms of which neither is shown, with all comparisons."""
        return {
            arm: of_arm
            for arm, of_arm in self.against.items()
            if arm not in self.ahead and arm not in self.behind
        }


def judge(results: Results) -> list[Verdict]:
    """Compares `TESTED_ARM` with each other arm, at each closing time of each condition.

    These tests, and no others, are what verdicts rest on: they are corrected together.

    Returns:
        A verdict for each condition, in the order in which they are shown.
    """
    tests = {
        (condition, rival, time): results.test(condition, TESTED_ARM, rival, time)
        for condition in results.conditions
        if TESTED_ARM in results.arms(condition)
        for rival in results.arms(condition)
        if rival != TESTED_ARM
        for time in results.times(condition)
    }
    corrected = holm([test.p for test in tests.values()])
    found: dict[str, dict[str, dict[float, Comparison]]] = {c: {} for c in results.conditions}
    for ((condition, rival, time), test), p in zip(tests.items(), corrected, strict=True):
        found[condition].setdefault(rival, {})[time] = Comparison(test, p)
    return [Verdict(condition, against) for condition, against in found.items()]


def _chosen(against: Mapping[str, Comparisons], *, ahead: bool) -> dict[str, Comparisons]:
    chosen = {
        arm: {time: c for time, c in of_arm.items() if (c.ahead if ahead else c.behind)}
        for arm, of_arm in against.items()
    }
    return {arm: of_arm for arm, of_arm in chosen.items() if of_arm}
