"""Choosing all contacts anew, and where the planner's contacts settle."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_pregrasp import PlannerConfig
from drake_pregrasp.geometry.box_surface import box_surface
from drake_pregrasp.quality.grasp_quality import grasp_quality
from drake_pregrasp.studies import global_choice, settled_margins
from drake_pregrasp.studies.bench.tick_times import cube, make_scene
from drake_pregrasp.studies.global_choice import (
    PLANNERS,
    compare_choices,
    exchanged,
    greedy,
    msv_score,
)
from drake_pregrasp.studies.settled_margins import (
    margin_of,
    random_starts,
    settled_contacts,
    settled_margin,
)

Q = box_surface([0.1] * 3, spacing=0.02).p_OQ
SEEDS = st.integers(0, 2**32 - 1)


def q_msv(indices):
    return grasp_quality(Q[indices]).q_msv


@given(seed=SEEDS)
def test_the_score_is_the_measure_with_each_candidate_added(seed):
    held = np.random.default_rng(seed).choice(len(Q), 3, replace=False)
    values = msv_score(Q)(held)
    for k in (0, 7, len(Q) - 1):
        assert values[k] == pytest.approx(q_msv([*held, k]) ** 2, rel=1e-9)


@given(seed=SEEDS)
def test_each_greedy_contact_is_the_best_beside_those_before_it(seed):
    score, first = msv_score(Q), seed % len(Q)
    chosen = greedy(score, first, 5)
    assert chosen[0] == first
    for k in range(1, 5):
        assert score(chosen[:k])[chosen[k]] == np.max(score(chosen[:k]))


@given(seed=SEEDS)
def test_exchange_never_lowers_the_score_and_ends_where_no_exchange_gains(seed):
    score, start = msv_score(Q), np.random.default_rng(seed).choice(len(Q), 5, replace=False)
    chosen = exchanged(score, start)
    assert q_msv(start) <= q_msv(chosen) + 1e-12
    assert q_msv(chosen) <= np.sqrt(5) + 1e-12
    for i in range(len(chosen)):
        best = np.sqrt(np.max(score(np.delete(chosen, i))))
        assert best == pytest.approx(q_msv(chosen), rel=1e-9)


def test_all_methods_keep_out_of_forbidden_balls(monkeypatch):
    seen, own = [], global_choice._row

    def spy(method, surface, seconds, sets):
        seen.append((method, sets))
        return own(method, surface, seconds, sets)

    monkeypatch.setattr(global_choice, "_row", spy)
    rows = compare_choices(0, per_edge=8, ticks=3)
    surface, _ = make_scene(cube(8, seed=0))
    assert len(rows) == 1 + len(PLANNERS)
    for row, (method, sets) in zip(rows, seen, strict=True):
        for p_OC in sets:
            away = np.linalg.norm(p_OC[:, None] - surface.forbidden.points, axis=2)
            assert np.all(away >= surface.forbidden.radii - 1e-9), method
            np.testing.assert_allclose(surface.distance(p_OC), 0, atol=1e-9, err_msg=method)
        assert 0 <= row["margin"] <= 1
        assert 0 < row["Q_MSV"] <= np.sqrt(5)
        assert row["time [ms]"] > 0


def test_starts_repeat_and_lie_on_the_surface(surface):
    once, again = (random_starts(surface, 4, 3) for _ in range(2))
    np.testing.assert_array_equal(once, again)
    assert np.shape(once) == (3, 4, 3)
    np.testing.assert_allclose(surface.distance(np.concatenate(once)), 0, atol=1e-12)


def test_settled_contacts_are_those_of_the_last_ticks():
    found = settled_contacts(lambda p_OC: p_OC + 1, np.zeros((1, 3)), ticks=5, last=2)
    np.testing.assert_array_equal(found, [np.full((1, 3), 4.0), np.full((1, 3), 5.0)])


def test_the_margin_strategy_settles_at_a_better_margin(surface, p_OC):
    config = PlannerConfig(strategy="margin", in_turns=True)
    assert settled_margin(surface, p_OC, config, ticks=3) > margin_of(surface, p_OC)


def test_it_prints_a_line_for_each_strategy(monkeypatch, capsys):
    monkeypatch.setattr(settled_margins, "CASES", [(3, 1, (0.1, 0.1, 0.1), 0.02)])
    settled_margins.main()
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 + len(settled_margins.STRATEGIES)  # The case, the head, and these.
    assert "3 contacts" in lines[0]
