"""Paired tests and their intervals, as laws and against scipy."""

import numpy as np
import pandas as pd
import pytest
from conftest import slow
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binomtest, multinomial, wilcoxon

from drake_pregrasp.studies import paired_tests as statistics
from drake_pregrasp.studies.paired_tests import least_pairs
from drake_pregrasp.studies.study_config import PairedTest


def rows_of(pairs, condition="nominal", close_at=4.0, baseline="fixed_plan"):
    """Rows in which the tested method and a baseline are clean or not, with one seed a pair."""
    both = [("dynamic_reach", 0), (baseline, 1)]
    return pd.DataFrame(
        [
            {"condition": condition, "method": m, "seed": s, "close_at": close_at, "clean": pair[k]}
            for s, pair in enumerate(pairs)
            for m, k in both
        ]
    )


def paired_tests(rows, measure="clean", pooled=False):
    others = [key for key in rows["method"].unique() if key != "dynamic_reach"]
    test = PairedTest("dynamic_reach", others, measure, pooled)
    cell = ["condition", "close_at"]
    return statistics.paired_tests(rows, [test], cell=cell, pair=["seed"])


def counts_to_pairs(gained, lost, equal=0):
    return [(True, False)] * gained + [(False, True)] * lost + [(True, True)] * equal


def one_test(pairs):
    (test,) = paired_tests(rows_of(pairs)).itertuples()
    return test


pairs_of_grasps = st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=40)


@pytest.mark.slow
@settings(max_examples=5)
@given(pairs_of_grasps)
def test_the_paired_test_is_a_fair_coin_on_the_pairs_that_differ(pairs):
    test, swapped = one_test(pairs), one_test([pair[::-1] for pair in pairs])
    differing = [first for first, second in pairs if first != second]
    assert test.pairs == len(pairs)
    assert (test.gained, test.lost) == (sum(differing), len(differing) - sum(differing))
    expected = binomtest(test.gained, len(differing)).pvalue if differing else 1
    assert test.p == pytest.approx(expected, rel=1e-9)
    assert (swapped.gained, swapped.lost, swapped.p) == (test.lost, test.gained, test.p)
    np.testing.assert_allclose([swapped.low, swapped.high], [-test.high, -test.low], atol=1e-12)
    assert -1 <= test.low <= (test.gained - test.lost) / len(pairs) <= test.high <= 1


def test_intervals_of_differences_cover_the_true_one_as_often_as_they_say():
    pairs = 6
    counts = [(b, c, pairs - b - c) for b in range(pairs + 1) for c in range(pairs + 1 - b)]
    rows = [rows_of(counts_to_pairs(*c), close_at=float(k)) for k, c in enumerate(counts)]
    low, high = paired_tests(pd.concat(rows))[["low", "high"]].to_numpy().T
    for gained in np.linspace(0, 1, 11):
        for lost in np.linspace(0, 1 - gained, 6):
            chances = multinomial.pmf(counts, pairs, (gained, lost, max(0.0, 1 - gained - lost)))
            inside = (low <= gained - lost + 1e-12) & (gained - lost - 1e-12 <= high)
            assert chances @ inside >= 0.95 - 1e-9


@pytest.mark.parametrize("num_tests", [2, slow(7)])
def test_as_many_pairs_as_are_needed_are_enough_and_fewer_are_not(num_tests):
    enough = least_pairs(num_tests)
    for pairs, verdict in ((enough, "ahead"), (enough - 1, "")):
        others = [rows_of([(True, True)], close_at=5.0 + k) for k in range(num_tests - 1)]
        tests = paired_tests(pd.concat([rows_of(counts_to_pairs(pairs, 0)), *others]))
        assert len(tests) == num_tests
        assert tests["verdict"].tolist() == [verdict] + [""] * (num_tests - 1)


def test_only_common_seeds_and_only_the_tested_method_are_compared():
    rows = rows_of(counts_to_pairs(20, 0))
    kept = rows[(rows["method"] != "fixed_plan") | (rows["seed"] % 2 == 1)]
    (test,) = paired_tests(kept).itertuples()
    assert (test.pairs, test.gained, test.lost) == (10, 10, 0)
    baselines = pd.concat([kept, rows_of(counts_to_pairs(20, 0), baseline="reassigned")])
    tests = paired_tests(baselines.drop_duplicates(["method", "seed"]))
    assert set(tests["against"]) == {"fixed_plan", "reassigned"}
    assert paired_tests(rows[rows["method"] == "fixed_plan"]).empty


@pytest.mark.parametrize("sign", [1, -1])
def test_numbers_are_compared_by_signed_ranks(sign):
    differences = np.array([0.5, 1.0, 1.5, 2.0, 2.5, -0.1, 3.0, 3.5, 4.0, 4.5])
    rows = rows_of([(True, True)] * 10).astype({"clean": object})
    tested = rows["method"] == "dynamic_reach"
    rows["slip"] = np.where(tested, 1 + sign * np.repeat(differences, 2), 1.0)
    (test,) = paired_tests(rows, "slip").itertuples()
    assert test.p == pytest.approx(wilcoxon(differences).pvalue)
    assert {test.gained, test.lost} == {9, 1}
    assert test.verdict == ("larger" if sign > 0 else "smaller")
    assert np.isnan(test.low)


def test_a_pair_of_equal_values_says_nothing_even_if_they_are_infinite():
    rows = rows_of([(True, True)] * 12).astype({"clean": object})
    rows["recovery"] = rows["seed"] * 0.1 + (rows["method"] == "dynamic_reach")
    tests = []
    for same in (9.0, np.inf):
        table = paired_tests(
            rows.assign(recovery=rows["recovery"].mask(rows["seed"] == 3, same)), "recovery"
        )
        tests += table.itertuples()
    finite, infinite = tests
    assert finite.p == infinite.p < 0.01
    assert (finite.pairs, finite.gained, finite.verdict) == (12, 11, "larger")


def test_conditions_with_and_without_a_closing_time_are_both_tested():
    pairs = counts_to_pairs(8, 1)
    both = [rows_of(pairs, "held"), rows_of(pairs, "free", close_at=np.nan)]
    tests = paired_tests(pd.concat(both))
    assert tests["condition"].tolist() == ["held", "free"]
    assert tests["pairs"].tolist() == [9, 9]


def test_a_pooled_test_compares_whole_runs_of_all_conditions():
    cells = [("a", 4.0), ("a", 7.0), ("b", 4.0)]
    grasps = [counts_to_pairs(2, 0, 1), counts_to_pairs(1, 1, 1), counts_to_pairs(0, 3)]
    rows = pd.concat([rows_of(p, *cell) for p, cell in zip(grasps, cells, strict=True)])
    (test,) = paired_tests(rows, pooled=True).itertuples()
    # Of run a/1, each method has one clean grasp of two: neither succeeds.
    assert (test.pairs, test.gained, test.lost) == (6, 1, 3)
    assert test.condition == test.close_at == "all"
    rows["slip"] = np.where(rows["close_at"] == 7.0, 3.0, 1.0) * (rows["method"] == "dynamic_reach")
    (test,) = paired_tests(rows.astype({"clean": object}), "slip", pooled=True).itertuples()
    assert test.p == pytest.approx(wilcoxon([2.0] * 3 + [1.0] * 3).pvalue)
