"""Verdicts go both ways: each judge is given runs of either kind."""

import numpy as np
import pandas as pd
import pytest

from drake_pregrasp.studies.paper import claims
from drake_pregrasp.studies.paper.paper_cases import SPACINGS

VALUES = {"q_msv": 2.2, "q_gii": 0.99, "q_vew": 125.0}


def run(case, *, static=0.9, **others):
    """Returns the row of a run with equal best and settled values, and static ones below."""
    best = VALUES | {name: value for name, value in others.items() if name in VALUES}
    row = {f"{kind} {name}": best[name] for name in VALUES for kind in ("best", "settled")}
    row |= {f"static {name}": static * value for name, value in VALUES.items()}
    return {"case": case, "tick_ms": 3.0, "faces": 4.0, "mm_to_edge": 30.0} | row | others


JUDGED = [
    (claims.dynamic_beats_static, [run("a")], [run("a", static=1.1)]),
    (claims.damage_recovers, [run("f")], [run("f", static=1.0)]),
    (claims.poor_start_recovers, [run("a"), run("g")], [run("a"), run("g", q_vew=120.0)]),
    (
        claims.strategies_are_alike,
        [run(case) for case in "ahij"],
        [*(run(case) for case in "ahi"), run("j", q_gii=0.97)],
    ),
    *(
        (
            claims.activity_ranks,
            [run(case, mm_per_tick=mm) for case, mm in zip("ihja", (4, 3, 2, 1), strict=True)],
            [run(case, mm_per_tick=mm) for case, mm in zip("ihja", wrong, strict=True)],
        )
        for wrong in ((3, 4, 2, 1), (4, 3, 1, 2))
    ),
    (claims.position_surrounds, [run("a")], [run("a"), run("a", faces=3.0)]),
    (
        claims.volume_goes_outwards,
        [run("a"), run("j", mm_to_edge=11.0)],
        [run("a"), run("j", mm_to_edge=31.0)],
    ),
    *(
        (
            claims.faster_is_more_isotropic,
            [run("b"), run("b", q_gii=0.9905), run("c", q_gii=0.995)],
            [run("b"), run("b", q_gii=0.9905), run("c", q_gii=faster)],
        )
        for faster in (0.9901, 0.98)  # Within the range between seeds, and below.
    ),
    *(
        (claims.size_matters, [run("d"), run("e", q_gii=0.95, q_vew=126.0)], [run("d"), wrong])
        for wrong in (run("e", q_gii=0.995, q_vew=126.0), run("e", q_gii=0.95, q_vew=124.0))
    ),
    (
        claims.position_is_fastest,
        [run("a", tick_ms=1.0), *(run(case) for case in "hij")],
        [run("a", tick_ms=9.0), *(run(case) for case in "hij")],
    ),
    (
        claims.spacing_drops,
        [run(f"spacing_{1e3 * s:g}_mm", largest_drop=s) for s in SPACINGS],
        [run(f"spacing_{1e3 * s:g}_mm", largest_drop=0.0) for s in SPACINGS],
    ),
]


@pytest.mark.parametrize(("judge", "good", "bad"), JUDGED)
def test_each_judge_says_yes_and_no(judge, good, bad):
    for rows, holds in ((good, True), (bad, False)):
        measured, published, found = judge(pd.DataFrame(rows))
        assert found is holds
        assert measured
        assert published


@pytest.mark.parametrize(("fine", "holds"), [(0.1, True), (0.3, False)])
def test_spacing_costs(fine, holds):
    costs = pd.DataFrame([[0.4, 0.2, 0.0], [0.4, 0.2, 2 * fine]])
    measured, _, found = claims.spacing_costs(costs)
    assert found is holds
    assert measured.endswith(f"0.4 at 10 mm, 0.2 at 5 mm, {fine} at 2.5 mm")


def test_settled_values_below_the_best_are_shown():
    rows = [run("h") | {"settled q_gii": 0.9}, run("a"), run("i"), run("j")]
    measured, *_ = claims.strategies_are_alike(pd.DataFrame(rows))
    best, settled = measured.split("settled")
    assert "Q_GII 0.0000 %" in best
    assert "Q_GII 9.3023 %" in settled


def test_costs_of_the_reference_spacing_would_be_zero(monkeypatch):
    from drake_pregrasp import load_scenario

    monkeypatch.setattr(claims, "REFERENCE_SPACING", SPACINGS[1])
    costs = claims.discretisation_costs(load_scenario("a_base"), starts=2, ticks=2)
    assert costs.shape == (2, len(SPACINGS))
    np.testing.assert_array_equal(costs["5 mm"], 0)
    assert np.any(costs["10 mm"] > 0)
