"""Statistics of the study: exact intervals and corrected paired tests."""

import math
from collections.abc import Sequence

import pandas as pd
from statsmodels.stats.contingency_tables import mcnemar
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.proportion import proportion_confint

from drake_pregrasp.studies.static_versus_dynamic.methods import METHODS, TESTED

CONFIDENCE = 0.95  # Confidence of all intervals.

SIGNIFICANT = 0.05  # Significance level of corrected p values.


def share_interval(
    successes: pd.Series, trials: pd.Series, *, confidence: float = CONFIDENCE, method: str = "beta"
) -> pd.DataFrame:
    """Returns intervals of shares, in columns `low` and `high`.

    Args:
        successes: Numbers of successes.
        trials: Numbers of trials, above zero.
        confidence: Probability that an interval covers the true share; for "beta" the least one.
        method: Name of statsmodels: "beta" for exact intervals (Clopper-Pearson), or "wilson".
    """
    low, high = proportion_confint(successes, trials, alpha=1 - confidence, method=method)
    return pd.DataFrame({"low": low, "high": high}, index=successes.index)


def paired_tests(
    rows: pd.DataFrame,
    *,
    keys: Sequence[str] = ("condition", "close_at"),
    pair: Sequence[str] = ("seed",),
    success: str = "clean",
) -> pd.DataFrame:
    """Returns exact McNemar tests of the method `TESTED` against each other method.

    All tests are one family, whose p values are corrected by Holm's method. The interval of the
    difference of shares combines two exact intervals, each with half of the error probability
    (Bonferroni), so it is conservative.

    Args:
        rows: Rows of a study, with the following columns and `method`.
        keys: Columns of the cells that have a test each.
        pair: Columns that identify a pair of trials in a cell.
        success: Column of the compared outcome.

    Returns:
        A row for each cell and baseline with common pairs. Columns `keys` and `method`; the
        number of common pairs `pairs`; the number of pairs in which only `TESTED` succeeds,
        `gained`, and only the baseline, `lost`; `p` and `p_holm`; the interval `low`, `high` of the
        difference of shares; and the `verdict`.
    """
    keys = list(keys)
    clean = rows.pivot(index=[*keys, *pair], columns="method", values=success)
    tables = []
    for baseline in METHODS:
        if baseline == TESTED or not {TESTED, baseline} <= set(clean.columns):
            continue
        both = clean[[TESTED, baseline]].dropna().astype(bool)
        gained, lost = both[TESTED] & ~both[baseline], both[baseline] & ~both[TESTED]
        counted = pd.DataFrame({"pairs": 1, "gained": gained, "lost": lost})
        tables.append(counted.groupby(level=keys).sum().reset_index().assign(method=baseline))
    columns = [*keys, "method", "pairs", "gained", "lost"]
    empty = pd.DataFrame(columns=columns)
    tests = pd.concat(tables, ignore_index=True)[columns] if tables else empty
    tests["p"] = [
        float(mcnemar([[0, gained], [lost, 0]], exact=True).pvalue)
        for gained, lost in zip(tests["gained"], tests["lost"], strict=True)
    ]
    tests["p_holm"] = multipletests(tests["p"], method="holm")[1] if len(tests) else []
    each = (1 + CONFIDENCE) / 2
    of_gained = share_interval(tests["gained"], tests["pairs"], confidence=each)
    of_lost = share_interval(tests["lost"], tests["pairs"], confidence=each)
    tests["low"] = of_gained["low"] - of_lost["high"]
    tests["high"] = of_gained["high"] - of_lost["low"]
    tests["verdict"] = ""
    shown = tests["p_holm"] < SIGNIFICANT
    tests.loc[shown & (tests["gained"] > tests["lost"]), "verdict"] = "ahead"
    tests.loc[shown & (tests["gained"] < tests["lost"]), "verdict"] = "behind"
    return tests


def least_pairs(num_tests: int) -> int:
    """Returns the least number of pairs with which one of several tests can show a difference.

    If all pairs differ in one direction, p is 2 / 2^pairs. Holm's correction multiplies the
    smallest p by the number of tests.
    """
    return math.floor(math.log2(2 * max(num_tests, 1) / SIGNIFICANT)) + 1
