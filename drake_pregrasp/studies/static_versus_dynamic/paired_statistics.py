"""Statistics of the study: exact intervals and corrected paired tests."""

import math

import pandas as pd
from statsmodels.stats.contingency_tables import mcnemar
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.proportion import proportion_confint

from drake_pregrasp.studies.static_versus_dynamic.methods import METHODS, TESTED

CONFIDENCE = 0.95  # Confidence of all intervals.

SIGNIFICANT = 0.05  # Significance level of corrected p values.


def exact_interval(
    successes: pd.Series, trials: pd.Series, *, confidence: float = CONFIDENCE
) -> pd.DataFrame:
    """Returns exact intervals of shares (Clopper-Pearson), in columns `low` and `high`.

    Args:
        successes: Numbers of successes.
        trials: Numbers of trials, above zero.
        confidence: Least probability that an interval covers the true share.
    """
    low, high = proportion_confint(successes, trials, alpha=1 - confidence, method="beta")
    return pd.DataFrame({"low": low, "high": high}, index=successes.index)


def paired_tests(rows: pd.DataFrame) -> pd.DataFrame:
    """Returns exact McNemar tests of the method `TESTED` against each other method.

    All tests are one family, whose p values are corrected by Holm's method. The interval of the
    difference of clean shares combines two exact intervals, each with half of the error
    probability (Bonferroni), so it is conservative.

    Args:
        rows: Rows of the study, with columns `condition`, `method`, `seed`, `close_at`, `clean`.

    Returns:
        A row for each condition, rival method and closing time with common seeds. Columns
        `condition`, `method`, `close_at`; the number of common seeds `pairs`; the number of seeds
        with which only `TESTED` is clean, `gained`, and only the rival is clean, `lost`; `p` and
        `p_holm`; the interval `low`, `high` of the difference of shares; and the `verdict`.
    """
    keys = ["condition", "close_at"]
    clean = rows.pivot(index=[*keys, "seed"], columns="method", values="clean")
    tables = []
    for rival in METHODS:
        if rival == TESTED or not {TESTED, rival} <= set(clean.columns):
            continue
        both = clean[[TESTED, rival]].dropna().astype(bool)
        gained, lost = both[TESTED] & ~both[rival], both[rival] & ~both[TESTED]
        counted = pd.DataFrame({"pairs": 1, "gained": gained, "lost": lost})
        tables.append(counted.groupby(level=keys).sum().reset_index().assign(method=rival))
    columns = [*keys, "method", "pairs", "gained", "lost"]
    empty = pd.DataFrame(columns=columns)
    tests = pd.concat(tables, ignore_index=True)[columns] if tables else empty
    tests["p"] = [
        float(mcnemar([[0, gained], [lost, 0]], exact=True).pvalue)
        for gained, lost in zip(tests["gained"], tests["lost"], strict=True)
    ]
    tests["p_holm"] = multipletests(tests["p"], method="holm")[1] if len(tests) else []
    each = (1 + CONFIDENCE) / 2
    of_gained = exact_interval(tests["gained"], tests["pairs"], confidence=each)
    of_lost = exact_interval(tests["lost"], tests["pairs"], confidence=each)
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
