"""Each claim's judge accepts runs that support the claim, and rejects others."""

import numpy as np
import pandas as pd
import pytest

from drake_pregrasp import load_resolved
from drake_pregrasp.studies.paper import claims
from drake_pregrasp.studies.paper.paper_cases import SPACINGS

VALUES = {"q_msv": 2.2, "q_gii": 0.99, "q_vew": 125.0}


def run(case, *, static=0.9, **others):
    """Returns the row of a run with equal best and settled values, and static ones below."""
    best = VALUES | {name: value for name, value in others.items() if name in VALUES}
    row = {f"{kind} {name}": best[name] for name in VALUES for kind in ("best", "settled")}
    row |= {f"static {name}": static * value for name, value in VALUES.items()}
    return {"case": case, "tick_ms": 3.0, "faces": 4.0, "mm_to_edge": 30.0} | row | others


def runs(cases, **others):
    """Returns the rows of cases; values of others are one for each case, or one for all."""
    return [
        run(case, **{k: v[i] if isinstance(v, tuple) else v for k, v in others.items()})
        for i, case in enumerate(cases)
    ]


SPACED = [f"spacing_{1e3 * spacing:g}_mm" for spacing in SPACINGS]
JUDGED = [
    (claims.dynamic_beats_static, "a", {}, {"static": 1.1}),
    (claims.damage_recovers, "f", {}, {"static": 1.0}),
    (claims.poor_start_recovers, "ag", {}, {"q_vew": (125.0, 120.0)}),
    (claims.strategies_are_alike, "ahij", {}, {"q_gii": (0.99, 0.99, 0.99, 0.97)}),
    (claims.activity_ranks, "ihja", {"mm_per_tick": (4, 3, 2, 1)}, {"mm_per_tick": (3, 4, 2, 1)}),
    (claims.activity_ranks, "ihja", {"mm_per_tick": (4, 3, 2, 1)}, {"mm_per_tick": (4, 3, 1, 2)}),
    (claims.position_surrounds, "aa", {}, {"faces": (4.0, 3.0)}),
    (claims.volume_goes_outwards, "aj", {"mm_to_edge": (30, 11)}, {"mm_to_edge": (30, 31)}),
    *(  # Within the range between seeds, and below.
        (
            claims.faster_is_more_isotropic,
            "bbc",
            {"q_gii": (0.99, 0.9905, 0.995)},
            {"q_gii": (0.99, 0.9905, faster)},
        )
        for faster in (0.9901, 0.98)
    ),
    *(
        (claims.size_matters, "de", {"q_gii": (0.99, 0.95), "q_vew": (125.0, 126.0)}, wrong)
        for wrong in (
            {"q_gii": (0.99, 0.995), "q_vew": (125.0, 126.0)},
            {"q_gii": (0.99, 0.95), "q_vew": (125.0, 124.0)},
        )
    ),
    (claims.position_is_fastest, "ahij", {"tick_ms": (1, 3, 3, 3)}, {"tick_ms": (9, 3, 3, 3)}),
    (claims.spacing_drops, SPACED, {"largest_drop": SPACINGS}, {"largest_drop": 0.0}),
]


@pytest.mark.parametrize(("judge", "cases", "good", "bad"), JUDGED)
def test_each_judge_says_yes_and_no(judge, cases, good, bad):
    for others, holds in ((good, True), (bad, False)):
        measured, published, found = judge(pd.DataFrame(runs(cases, **others)))
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
    monkeypatch.setattr(claims, "REFERENCE_SPACING", SPACINGS[1])
    costs = claims.discretisation_costs(load_resolved("a_base"), starts=2, ticks=2)
    assert costs.shape == (2, len(SPACINGS))
    np.testing.assert_array_equal(costs["5 mm"], 0)
    assert np.any(costs["10 mm"] > 0)
