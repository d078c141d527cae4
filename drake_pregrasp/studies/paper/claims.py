"""Verdicts on the paper's claims, from published and measured values."""

from collections.abc import Callable

import numpy as np
import pandas as pd

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.centroids import position_tracking, select_contacts
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.grasp_quality import QUALITY_MEASURES, grasp_quality
from drake_pregrasp.regions.safe_regions import compute_safe_regions
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.studies.paper.paper_cases import SCENARIOS, SPACINGS, TABLE_2, TABLE_3

STRATEGY_CASES = {"gii": "i", "msv": "h", "vew": "j", "position": "a"}
"""Case of each strategy, from the most to the least active in the paper's ranking."""

REFERENCE_SPACING = 0.00125
"""Spacing of the reference surface, in metres."""

Verdict = tuple[str, str, bool]
"""Measured value, published value, and whether the claim holds."""

_SPACING_NAMES = [f"{1e3 * spacing:g} mm" for spacing in SPACINGS]


def judge_claims(runs: pd.DataFrame, costs: pd.DataFrame) -> pd.DataFrame:
    """Returns a row for each claim whose cases were run: claim, measured, published, verdict.

    Args:
        runs: Rows of `run_cases`.
        costs: Losses of quality from `discretisation_costs`.
    """
    present = [case for case in SCENARIOS if case in set(runs["case"])]
    of_cases = runs[runs["case"].isin(present)]
    verdicts = {
        claim: judge(of_cases) for needed, claim, judge in _CLAIMS if set(needed) <= set(present)
    }
    verdicts["The discretisation of Y costs quality, less if it is finer"] = spacing_costs(costs)
    verdicts["The measures drop because of the discretisation of Y"] = spacing_drops(runs)
    table = pd.DataFrame.from_dict(
        verdicts, orient="index", columns=["measured", "published", "verdict"]
    )
    table["verdict"] = table["verdict"].map({True: "holds", False: "does not hold"})
    return table.reset_index(names="claim")


def _medians(runs: pd.DataFrame, kind: str) -> pd.DataFrame:
    """Returns medians over the seeds of one kind of values, such as `best`; a row per case."""
    medians = runs.groupby("case")[[f"{kind} {name}" for name in QUALITY_MEASURES]].median()
    return medians.set_axis(list(QUALITY_MEASURES), axis=1)


def _published(cases: str, kind: str = "dynamic") -> pd.DataFrame:
    rows = {case: getattr((TABLE_2 | TABLE_3)[case], kind) for case in cases}
    return pd.DataFrame.from_dict(rows, orient="index", columns=list(QUALITY_MEASURES), dtype=float)


def _three(values: "pd.Series[float]", unit: str = "") -> str:
    """Formats the three measures as text."""
    return ", ".join(f"{name.upper()} {values[name]:.4f}{unit}" for name in QUALITY_MEASURES)


def dynamic_beats_static(runs: pd.DataFrame) -> Verdict:
    """Judges Sec. IV: the dynamic contacts are at least as good as the static ones."""
    gains = _medians(runs, "best") - _medians(runs, "static")
    cases = "".join(gains.index)
    printed = _published(cases) - _published(cases, "static")
    return (
        f"least gain {_three(gains.min())}",
        f"least gain {_three(printed.min())}",
        bool((gains >= 0).all(axis=None)),
    )


def damage_recovers(runs: pd.DataFrame) -> Verdict:
    """Judges Sec. IV.B: after the loss of two fingers, adapting beats the remaining static set."""
    gain = _medians(runs, "best").loc["f"] - _medians(runs, "static").loc["f"]
    printed = _published("f").loc["f"] - _published("f", "static").loc["f"]
    return f"gain {_three(gain)}", f"gain {_three(printed)}", bool((gain > 0).all())


def poor_start_recovers(runs: pd.DataFrame) -> Verdict:
    """Judges Sec. IV.B: a poor start reaches the quality of the base case to within 1 %."""
    best, printed = _medians(runs, "best"), _published("ag")
    ratio = best.loc["g"] / best.loc["a"]
    return _three(ratio), _three(printed.loc["g"] / printed.loc["a"]), bool((ratio > 0.99).all())


def strategies_are_alike(runs: pd.DataFrame) -> Verdict:
    """Judges Sec. IV.C: no significant difference of quality between the strategies."""

    def spread(values: pd.DataFrame) -> "pd.Series[float]":
        return 100 * (values.max() - values.min()) / values.mean()

    cases = [*STRATEGY_CASES.values()]
    best, settled = (spread(_medians(runs, kind).loc[cases]) for kind in ("best", "settled"))
    measured = f"spread {_three(best, ' %')}; settled {_three(settled, ' %')}"
    printed = f"spread {_three(spread(_published(''.join(cases))), ' %')}"
    return measured, printed, bool((best < 1).all())


def activity_ranks(runs: pd.DataFrame) -> Verdict:
    """Judges Fig. 6: GII moves most, then MSV, VEW, and position tracking."""
    moved = runs.groupby("case")["mm_per_tick"].median()[[*STRATEGY_CASES.values()]]
    shown = ", ".join(f"{n} {mm:.3g}" for n, mm in zip(STRATEGY_CASES, moved, strict=True))
    return f"{shown} mm a tick", "order of Fig. 6", bool((moved.diff()[1:] < 0).all())


def position_surrounds(runs: pd.DataFrame) -> Verdict:
    """Judges Sec. IV.C: position tracking places contacts on all four side faces."""
    faces = runs.loc[runs["case"] == "a", "faces"]
    return f"{faces.min():g} faces at least", "4 faces (Fig. 5)", bool((faces == 4).all())


def volume_goes_outwards(runs: pd.DataFrame) -> Verdict:
    """Judges Sec. IV.C: with Q_VEW, contacts move to edges. Corners are not judged."""
    mm = runs.groupby("case")["mm_to_edge"].median()
    measured = f"{mm['j']:.1f} mm from an edge, position {mm['a']:.1f} mm"
    return measured, "nearer (Fig. 5)", bool(mm["j"] < mm["a"])


def faster_is_more_isotropic(runs: pd.DataFrame) -> Verdict:
    """Judges Sec. IV.B: Q_GII of the faster object is higher by more than seeds differ."""
    q_gii = runs.groupby("case")["best q_gii"]
    gain = q_gii.median()["c"] - q_gii.median()["b"]
    between_seeds = (q_gii.max() - q_gii.min())[["b", "c"]].max()
    printed = _published("bc")["q_gii"]
    measured = f"Q_GII {gain:+.2g}, range between seeds {between_seeds:.2g}"
    return measured, f"Q_GII {printed['c'] - printed['b']:+.4f}", bool(gain > between_seeds)


def size_matters(runs: pd.DataFrame) -> Verdict:
    """Judges Sec. IV.B: the bigger object has the higher Q_VEW and the lower Q_GII."""
    best, printed = _medians(runs, "best"), _published("de")
    gain, printed_gain = best.loc["e"] - best.loc["d"], printed.loc["e"] - printed.loc["d"]
    return _three(gain), _three(printed_gain), bool(gain["q_vew"] > 0 > gain["q_gii"])


def position_is_fastest(runs: pd.DataFrame) -> Verdict:
    """Judges Sec. V.A: position tracking takes the least time to compute."""
    ms = runs.groupby("case")["tick_ms"].median()
    shown = ", ".join(f"{name} {ms[case]:.2f}" for name, case in STRATEGY_CASES.items())
    fastest = min(STRATEGY_CASES.values(), key=ms.__getitem__)
    return f"{shown} ms a tick", "position", fastest == "a"


def spacing_costs(costs: pd.DataFrame) -> Verdict:
    """Judges Sec. IV.B: the discretisation of Y costs quality.

    Args:
        costs: Losses of quality from `discretisation_costs`.
    """
    return _by_spacing("loss of Q_GII in a step", costs.mean().to_numpy())


def spacing_drops(runs: pd.DataFrame) -> Verdict:
    """Judges Sec. IV.B: the drops of the measures come from the discretisation of Y."""
    drops = runs.set_index("case")["largest_drop"]
    names = [f"spacing_{name.replace(' ', '_')}" for name in _SPACING_NAMES]
    return _by_spacing("largest drop of Q_GII", drops[names].to_numpy())


def _by_spacing(what: str, values: FloatArray) -> Verdict:
    """Returns a verdict that holds if the values decrease with the spacing."""
    pairs = zip(values, _SPACING_NAMES, strict=True)
    shown = ", ".join(f"{value:.2g} at {name}" for value, name in pairs)
    return f"{what} {shown}", "Sec. IV.B", bool(np.all(np.diff(values) < 0))


_CLAIMS: tuple[tuple[str, str, Callable[[pd.DataFrame], Verdict]], ...] = (
    ("", "Dynamic contacts are at least as good as static ones", dynamic_beats_static),
    ("f", "Adapting remedies the loss of two fingers", damage_recovers),
    ("ag", "A poor start recovers to within 1 % of the base case", poor_start_recovers),
    ("ahij", "The strategies' best quality differs by less than 1 %", strategies_are_alike),
    ("ahij", "Activity ranks GII, MSV, VEW, position tracking", activity_ranks),
    ("a", "Position tracking surrounds the cube on all four side faces", position_surrounds),
    ("aj", "VEW drifts to edges", volume_goes_outwards),
    ("bc", "A faster object has a higher Q_GII than a slower one", faster_is_more_isotropic),
    ("de", "A bigger object has a higher Q_VEW and a lower Q_GII", size_matters),
    ("ahij", "Position tracking is the fastest to compute", position_is_fastest),
)


def discretisation_costs(
    resolved: ResolvedScenario, *, starts: int = 20, ticks: int = 12
) -> pd.DataFrame:
    """Returns the largest loss of Q_GII in a step, with a row per start and a column per spacing.

    Position tracking is iterated on the reference surface without noise or physics. At each tick
    each coarser surface makes one step from the same contacts. The loss is the reference's Q_GII
    minus that of the coarser surface.

    Args:
        resolved: Object, surface and spread.
        starts: Number of random initial contact sets.
        ticks: Number of ticks from each initial set.
    """
    fine = resolved.sampled_surface(REFERENCE_SPACING)
    coarse = [resolved.sampled_surface(spacing) for spacing in SPACINGS]
    half = fine.mesh.extents / 2
    covariance = resolved.planner.position_spread**2 * np.eye(3)
    costs = np.zeros((starts, len(SPACINGS)))
    for start in range(starts):
        p_OC, _ = fine.project(np.random.default_rng(start).uniform(-half, half, (5, 3)))
        for _ in range(ticks):
            steps = [_step(surface, p_OC, covariance) for surface in (fine, *coarse)]
            q_gii = np.array([grasp_quality(step).q_gii for step in steps])
            costs[start] = np.maximum(costs[start], q_gii[0] - q_gii[1:])
            p_OC = steps[0]
    return pd.DataFrame(costs, columns=_SPACING_NAMES)


def _step(surface: ObjectSurface, p_OC: FloatArray, covariance: FloatArray) -> FloatArray:
    regions = compute_safe_regions(surface.p_OQ, p_OC, np.zeros(len(p_OC)), surface.forbidden)
    selection = SelectionInput(surface, p_OC, regions, covariance)
    return select_contacts(selection, position_tracking).p_OC
