"""How much worse the tested arm may be where the plan made once does well: non-inferiority."""

import math

from drake_pregrasp.studies.static_versus_dynamic.arms import ARMS, TESTED_ARM
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.paired_difference import paired_difference
from drake_pregrasp.studies.static_versus_dynamic.results import Results
from drake_pregrasp.studies.static_versus_dynamic.share_interval import CONFIDENCE

AT_HOME = "nominal"
"""The condition in which nothing happens that a plan made once could not know."""

REFERENCE = "frozen"
"""The arm that plans once."""


def no_worse_in_words(results: Results) -> list[str]:
    """Returns a sentence for each closing time at which both arms have grasps of common seeds."""
    if not {TESTED_ARM, REFERENCE} <= set(results.arms(AT_HOME)):
        return []
    sentences = []
    for time in results.times(AT_HOME):
        test = results.test(AT_HOME, TESTED_ARM, REFERENCE, time)
        if not test.pairs:
            continue
        low, high = paired_difference(test)
        # Rounded outward, so that what is said holds.
        worse = max(0, math.ceil(-10 * test.pairs * low)) / 10
        least, most = math.floor(1000 * low) / 10, math.ceil(1000 * high) / 10
        sentences.append(
            f"{CONDITIONS[AT_HOME].label.capitalize()}, closing at {time:g} s:"
            f" {ARMS[TESTED_ARM].label} is no worse than {ARMS[REFERENCE].label} by more than"
            f" {worse:g} clean grasps of {test.pairs}, with {100 * CONFIDENCE:.0f} % confidence"
            f" (difference {test.gained - test.lost:+d} of {test.pairs}; conservative interval of"
            f" the difference of shares {least:+.1f} % to {most:+.1f} %, for this time alone)."
        )
    return sentences
