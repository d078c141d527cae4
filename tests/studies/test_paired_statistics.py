"""Intervals, paired tests and rankings: laws, and what scipy says."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.stats import binom, binomtest, mannwhitneyu, multinomial

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.studies.static_versus_dynamic.holm import holm
from drake_pregrasp.studies.static_versus_dynamic.paired_difference import paired_difference
from drake_pregrasp.studies.static_versus_dynamic.paired_test import (
    SIGNIFICANT,
    PairedTest,
    least_pairs,
    paired_test,
)
from drake_pregrasp.studies.static_versus_dynamic.ranking import rank
from drake_pregrasp.studies.static_versus_dynamic.share_interval import share_interval

counts = st.integers(0, 60).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


@given(counts, st.sampled_from((0.5, 0.9, 0.95, 0.99)))
def test_intervals_are_those_of_scipy(count, confidence):
    k, n = count
    assume(n > 0)
    exact = binomtest(k, n).proportion_ci(confidence, method="exact")
    np.testing.assert_allclose(
        share_interval(k, n, confidence=confidence), (exact.low, exact.high), atol=1e-12
    )


@pytest.mark.parametrize("n", [1, 5, 30])
def test_intervals_cover_the_true_share_as_often_as_they_say(n):
    intervals = [share_interval(k, n) for k in range(n + 1)]
    for share in np.linspace(0, 1, 201):
        covered = [low <= share <= high for low, high in intervals]
        assert binom.pmf(np.arange(n + 1), n, share) @ covered >= 0.95 - 1e-12


@given(counts)
def test_intervals_move_with_the_successes_and_mirror(count):
    k, n = count
    low, high = share_interval(k, n)
    assert 0 <= low <= high <= 1
    if n:
        assert low <= k / n <= high
    np.testing.assert_allclose(share_interval(n - k, n), (1 - high, 1 - low), atol=1e-12)
    if k < n:
        more = share_interval(k + 1, n)
        assert more.low > low or k == n
        assert more.high > high or more.high == 1
    wider = share_interval(k, n, confidence=0.99)
    assert wider.low <= low
    assert wider.high >= high


def test_of_no_trials_nothing_is_known():
    assert share_interval(0, 0) == (0, 1)


@pytest.mark.parametrize(("k", "n"), [(3, 2), (-1, 2)])
def test_impossible_counts_are_refused(k, n):
    with pytest.raises(InvalidArgumentError, match=f"successes: {k} must be from 0 to trials, {n}"):
        share_interval(k, n)
    with pytest.raises(InvalidArgumentError, match="confidence: 1 must be between"):
        share_interval(1, 2, confidence=1)


pairs = st.lists(st.tuples(st.booleans(), st.booleans()), max_size=40)


@given(pairs)
def test_the_paired_test_is_a_fair_coin_on_the_pairs_that_differ(pairs):
    test = paired_test(pairs)
    differing = [first for first, second in pairs if first != second]
    assert test.pairs == len(pairs)
    assert (test.gained, test.lost) == (sum(differing), len(differing) - sum(differing))
    if differing:
        assert test.p == pytest.approx(binomtest(test.gained, len(differing)).pvalue, rel=1e-9)
    else:
        assert test.p == 1


@given(pairs, st.randoms(use_true_random=False))
def test_exchanged_arms_exchange_the_result(pairs, random):
    test = paired_test(pairs)
    other_way = paired_test([(second, first) for first, second in pairs])
    assert other_way == PairedTest(test.pairs, test.lost, test.gained, test.p)
    np.testing.assert_allclose(
        paired_difference(other_way), -np.flip(paired_difference(test)), atol=1e-12
    )
    random.shuffle(pairs)
    assert paired_test(pairs) == test
    assert paired_test([*pairs, (True, True), (False, False)])[1:] == test[1:]


@given(st.integers(0, 30), st.integers(0, 30))
def test_a_clearer_lead_is_less_likely_by_chance(gained, lost):
    assume(gained > lost)
    base = [(True, False)] * gained + [(False, True)] * lost
    assert paired_test([*base, (True, False)]).p < paired_test(base).p


@pytest.mark.parametrize("num_tests", [1, 2, 7, 120])
def test_as_many_pairs_as_are_needed_are_enough_and_fewer_are_not(num_tests):
    enough = least_pairs(num_tests)
    others = [1.0] * (num_tests - 1)
    assert holm([paired_test([(True, False)] * enough).p, *others])[0] < SIGNIFICANT
    fewer = [paired_test([(True, False)] * (enough - 1)).p] * num_tests
    assert min(holm(fewer)) >= SIGNIFICANT


probabilities = st.lists(st.floats(0, 1), max_size=12)


@given(probabilities, st.randoms(use_true_random=False))
def test_holm_rejects_what_his_step_down_does(p_values, random):
    corrected = holm(p_values)
    remaining, shown = len(p_values), set()
    for index in sorted(range(len(p_values)), key=p_values.__getitem__):
        if p_values[index] * remaining >= SIGNIFICANT:
            break
        shown.add(index)
        remaining -= 1
    assert {k for k, p in enumerate(corrected) if p < SIGNIFICANT} == shown
    assert all(
        p <= q <= min(1, len(p_values) * p) for p, q in zip(p_values, corrected, strict=True)
    )
    order = random.sample(range(len(p_values)), len(p_values))
    assert holm([p_values[k] for k in order]) == [corrected[k] for k in order]


@given(probabilities, st.floats(0, 1))
def test_one_test_more_shows_no_other_more(p_values, another):
    with_it = holm([*p_values, another])
    assert all(p <= q for p, q in zip(holm(p_values), with_it, strict=False))


@pytest.mark.parametrize("pairs", [3, 12])
def test_intervals_of_differences_cover_the_true_one_as_often_as_they_say(pairs):
    counts = [(b, c) for b in range(pairs + 1) for c in range(pairs + 1 - b)]
    intervals = np.array([paired_difference(PairedTest(pairs, b, c, 1.0)) for b, c in counts])
    outcomes = [(b, c, pairs - b - c) for b, c in counts]
    for gained in np.linspace(0, 1, 21):
        for lost in np.linspace(0, 1 - gained, 11):
            shares = (gained, lost, max(0.0, 1 - gained - lost))
            chances = multinomial.pmf(outcomes, pairs, shares)
            inside = (intervals[:, 0] <= gained - lost + 1e-12) & (
                gained - lost - 1e-12 <= intervals[:, 1]
            )
            assert chances @ inside >= 0.95 - 1e-9


@given(pairs)
def test_intervals_of_differences_hold_what_was_found_and_shrink_with_more(pairs):
    test = paired_test(pairs)
    low, high = paired_difference(test)
    assert -1 <= low <= high <= 1
    if pairs:
        assert low <= (test.gained - test.lost) / len(pairs) <= high
        twice = paired_difference(paired_test(pairs * 2))
        assert twice.high - twice.low < high - low
    wider = paired_difference(test, confidence=0.99)
    assert wider.low <= low <= high <= wider.high


scored = st.lists(
    st.tuples(st.integers(0, 6).map(float) | st.just(math.nan), st.booleans()), max_size=25
)


@given(scored)
def test_ranking_counts_all_pairs(scored):
    ranking = rank([v for v, _ in scored], [s for _, s in scored])
    good = [v for v, s in scored if s and not math.isnan(v)]
    bad = [v for v, s in scored if not s and not math.isnan(v)]
    assert ranking[1:] == (len(good), len(bad), len(scored) - len(good) - len(bad))
    if not good or not bad:
        assert math.isnan(ranking.auc)
        return
    wins = [(g > b) + 0.5 * (g == b) for g, b in itertools.product(good, bad)]
    assert ranking.auc == pytest.approx(sum(wins) / len(wins))
    u = mannwhitneyu(good, bad).statistic
    assert ranking.auc == pytest.approx(u / (len(good) * len(bad)))


@given(scored)
def test_ranking_sees_the_order_alone(scored):
    v = np.array([value for value, _ in scored])
    s = np.array([success for _, success in scored], dtype=bool)
    auc = rank(v, s).auc
    np.testing.assert_allclose(rank(np.exp(v), s).auc, auc)
    np.testing.assert_allclose(rank(-v, s).auc, 1 - auc)
    np.testing.assert_allclose(rank(v, ~s).auc, 1 - auc)


def test_ranking_refuses_lists_of_different_lengths():
    with pytest.raises(InvalidArgumentError, match="lists of one length"):
        rank([1.0, 2.0], [True])
