"""Which seed pictures show: one that does what most do, by a rule and not by hand."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from drake_pregrasp.studies.static_versus_dynamic.outcome import Outcome


class Representative(NamedTuple):
    """A seed, and how well it stands for the others.

    Attributes:
        seed: The seed.
        typical: For how many arms its grasp is clean or not as most of the arm's are.
        arms: How many arms there are.
        seeds: How many seeds all arms have, from which it was chosen.
    """

    seed: int
    typical: int
    arms: int
    seeds: int

    def in_words(self, time: float) -> str:
        """Returns the rule that it was chosen by, for a caption."""
        if self.typical == self.arms:
            where = "every row,"
        else:
            where = f"the most rows, {self.typical} of {self.arms},"
        return (
            f"Seed {self.seed} is the first of {self.seeds} for which, in {where} the grasp closed"
            f" at {time:g} s is clean, or is not, as most of that arm's grasps at that time."
        )


def representative_seed(
    outcomes: Iterable[Outcome], condition: str, arms: Sequence[str], time: float
) -> Representative | None:
    """Returns the first seed whose grasps are what is most frequent for the most arms.

    If as many of an arm's grasps are clean as are not, clean is its most frequent.

    Args:
        outcomes: Of a study.
        condition: Key of `CONDITIONS`.
        arms: Keys of `ARMS`; outcomes of others don't count.
        time: Of closing, in seconds.

    Returns:
        It, or None if there is no seed that all arms have.
    """
    clean: dict[str, dict[int, bool]] = {arm: {} for arm in arms}
    for outcome in outcomes:
        if (outcome.condition, outcome.close_at) == (condition, time) and outcome.arm in clean:
            clean[outcome.arm][outcome.seed] = outcome.clean
    if not clean:
        return None
    common = sorted(set.intersection(*(set(of_arm) for of_arm in clean.values())))
    if not common:
        return None
    usual = {arm: 2 * sum(of_arm.values()) >= len(of_arm) for arm, of_arm in clean.items()}
    typical = {seed: sum(clean[arm][seed] == usual[arm] for arm in clean) for seed in common}
    seed = max(common, key=lambda candidate: (typical[candidate], -candidate))
    return Representative(seed, typical[seed], len(clean), len(common))
