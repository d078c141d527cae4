"""Exact intervals of shares, and corrected paired tests of a study's methods."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pandas as pd
from scipy.stats import wilcoxon
from statsmodels.stats.contingency_tables import mcnemar
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.proportion import proportion_confint

from drake_pregrasp.studies.study_config import PairedTest

CONFIDENCE = 0.95
"""Confidence of all intervals."""

SIGNIFICANT = 0.05
"""Significance level of corrected p values."""

ALL = "all"
"""Value of a pooled test in the columns of the cells."""

COLUMNS = ("measure", "tested", "against", "pairs", "gained", "lost", "p", "low", "high")
"""Columns of the tests, after those of the cell."""


def share_interval(
    successes: pd.Series, trials: pd.Series, *, confidence: float = CONFIDENCE
) -> pd.DataFrame:
    """Returns exact intervals of shares (Clopper and Pearson), in columns `low` and `high`.

    Args:
        successes: Numbers of successes.
        trials: Numbers of trials, above zero.
        confidence: Least probability that an interval covers the true share.
    """
    low, high = proportion_confint(successes, trials, alpha=1 - confidence, method="beta")
    return pd.DataFrame({"low": low, "high": high}, index=successes.index)


def paired_tests(
    rows: pd.DataFrame, tests: Sequence[PairedTest], *, cell: Sequence[str], pair: Sequence[str]
) -> pd.DataFrame:
    """Returns all paired tests of a study's methods, whose p values are corrected by Holm's method.

    Measures of yes and no are compared by the exact McNemar test, numbers by Wilcoxon's signed-rank
    test. The interval of the difference of shares combines two exact intervals, each with half of
    the error probability (Bonferroni), so it is conservative.

    Args:
        rows: Rows of the study, with the following columns and `method`.
        tests: The tests of the study's file.
        cell: Columns of the cells that have a test each, unless tests are pooled.
        pair: Columns that identify a pair of runs in a cell.

    Returns:
        A row for each cell, or pooled test, and pair of methods with common runs. Columns `cell`,
        which are `ALL` in a pooled test, and `COLUMNS`; the number of common runs `pairs`; the
        number of runs in which only the tested method succeeds, or has the larger value, `gained`,
        and only the other, `lost`; `p` and `p_holm`; the interval `low`, `high` of the difference
        of shares; and the `verdict`: "ahead", "behind" or "". Of numbers, `verdict` says which
        method has larger ones: "larger" or "smaller".
    """
    found = [line for test in tests for line in _tests_of(rows, test, list(cell), list(pair))]
    table = pd.DataFrame(found, columns=[*cell, *COLUMNS])
    table["p_holm"] = multipletests(table["p"], method="holm")[1] if len(table) else []
    words = [
        _verdict(line.gained - line.lost, math.isnan(line.low)) if line.p_holm < SIGNIFICANT else ""
        for line in table.itertuples()
    ]
    return table.assign(verdict=words)


def _verdict(difference: int, is_number: bool) -> str:
    words = ("larger", "smaller") if is_number else ("ahead", "behind")
    return words[difference < 0] if difference else ""


def _tests_of(
    rows: pd.DataFrame, test: PairedTest, cell: list[str], pair: list[str]
) -> Iterator[Mapping[str, Any]]:
    rows, pooled = rows.dropna(subset=[test.measure]), {}
    if test.pooled:  # The grasps of a run are not independent: a pair is a condition and a seed.
        pooled = dict.fromkeys(cell, ALL)
        pair, cell = [*(name for name in cell if name != "close_at"), *pair], []
    wide = _one_value_each(rows, [*cell, *pair, "method"], test.measure).unstack("method")
    for other in test.against:
        if not {test.method, other} <= set(wide.columns):
            continue
        both = wide[[test.method, other]].dropna()
        if both.empty:
            continue
        groups = both.groupby(level=cell, sort=False, dropna=False) if cell else [((), both)]
        for key, common in groups:
            values = key if isinstance(key, tuple) else (key,)
            head = pooled | dict(zip(cell, values, strict=True))
            names = {"measure": test.measure, "tested": test.method, "against": other}
            yield head | names | _compared(common[test.method], common[other])


def _one_value_each(rows: pd.DataFrame, keys: list[str], measure: str) -> pd.Series:
    """Returns the mean of a number, or whether all of yes and no are yes, in rows of equal keys."""
    groups = rows.groupby(keys, sort=False, dropna=False)[measure]
    return groups.all() if is_yes_or_no(rows[measure]) else groups.mean()


def _compared(tested: pd.Series, other: pd.Series) -> dict[str, Any]:
    """Returns the result of one test of the values of two methods on the same runs."""
    difference = tested.astype(float) - other.astype(float)
    difference = difference.mask(tested == other, 0.0)  # Both may be infinite.
    pairs, gained, lost = len(difference), int((difference > 0).sum()), int((difference < 0).sum())
    counts = {"pairs": pairs, "gained": gained, "lost": lost}
    if not is_yes_or_no(pd.concat([tested, other])):
        p = float(wilcoxon(difference).pvalue) if gained or lost else 1.0
        return counts | {"p": p, "low": math.nan, "high": math.nan}
    p = float(mcnemar([[0, gained], [lost, 0]], exact=True).pvalue)
    each = (1 + CONFIDENCE) / 2
    ends = share_interval(pd.Series([gained, lost]), pd.Series([pairs] * 2), confidence=each)
    low = ends["low"][0] - ends["high"][1]
    return counts | {"p": p, "low": low, "high": ends["high"][0] - ends["low"][1]}


def is_yes_or_no(values: pd.Series) -> bool:
    """Returns whether all values that are there are booleans, and there is any."""
    known = values.dropna()
    return bool(len(known)) and all(isinstance(value, bool) for value in known.tolist())


def least_pairs(num_tests: int) -> int:
    """Returns the least number of pairs with which one of several tests can show a difference.

    If all pairs differ in one direction, p is 2 / 2^pairs. Holm's correction multiplies the
    smallest p by the number of tests.
    """
    return math.floor(math.log2(2 * max(num_tests, 1) / SIGNIFICANT)) + 1
