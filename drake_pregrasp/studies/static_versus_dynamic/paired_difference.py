"""How much more often one arm succeeds than another, with the same seeds, at most and at least."""

from drake_pregrasp.studies.static_versus_dynamic.paired_test import PairedTest
from drake_pregrasp.studies.static_versus_dynamic.share_interval import (
    CONFIDENCE,
    Interval,
    share_interval,
)


def paired_difference(test: PairedTest, *, confidence: float = CONFIDENCE) -> Interval:
    """Returns a conservative confidence interval of the share of the first less that of the second.

    The difference is the share of pairs in which only the first succeeds, less the share of those
    in which only the second does. Each has its exact interval (Clopper and Pearson, Biometrika 26,
    1934), with half of what is left to the confidence, so that both hold together with it at least
    (Bonferroni's inequality; Dunn, Journal of the American Statistical Association 56, 1961). The
    interval covers the true difference more often than the confidence says, and never less.

    Args:
        test: The paired counts.
        confidence: Between 0 and 1.

    Raises:
        InvalidArgumentError: If the confidence isn't between 0 and 1.
    """
    each = (1 + confidence) / 2
    gained = share_interval(test.gained, test.pairs, confidence=each)
    lost = share_interval(test.lost, test.pairs, confidence=each)
    return Interval(gained.low - lost.high, gained.high - lost.low)
