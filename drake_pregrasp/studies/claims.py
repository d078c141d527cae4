"""The paper's claims, each with a verdict computed from runs, and the numbers behind it."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.simulation.summary import MEASURES
from drake_pregrasp.studies.case_runs import CaseLog
from drake_pregrasp.studies.published import TABLE_3
from drake_pregrasp.studies.tables import best_values, settled_values, static_values

Logs = Mapping[str, Sequence[CaseLog]]

STRATEGY_CASES = {"gii": "i", "msv": "h", "vew": "j", "position": "a"}
"""Cases of the four strategies, from the most active to the least, as the paper ranks them."""


@dataclass(frozen=True)
class Claim:
    """A claim of the paper and what the runs say.

    Attributes:
        claim: What the paper says.
        holds: Whether the runs agree.
        numbers: What that was decided by.
        remark: Why, where they disagree or the comparison has a limit.
    """

    claim: str
    holds: bool
    numbers: dict[str, Any]
    remark: str = ""

    @property
    def verdict(self) -> str:
        """`holds`, or `does not hold`."""
        return "holds" if self.holds else "does not hold"

    def to_dict(self) -> dict[str, Any]:
        """Returns the claim with its verdict, for JSON."""
        return {**asdict(self), "verdict": self.verdict}


def judge_claims(logs: Logs, tick_ms: Mapping[str, float]) -> list[Claim]:
    """Judges the claims about the cases, those for which all cases needed were run.

    Args:
        logs: For each case, its runs with different seeds.
        tick_ms: For each case, the median planning tick, in ms.
    """
    judged = [
        (logs, dynamic_beats_static),
        ("f", damage_recovers),
        ("ag", poor_start_recovers),
        ("ahij", strategies_are_alike),
        ("ahij", activity_ranks),
        ("a", position_surrounds),
        ("aj", volume_goes_outwards),
        ("bc", faster_is_more_isotropic),
        ("de", size_matters),
    ]
    claims = [judge(logs) for needed, judge in judged if all(case in logs for case in needed)]
    if all(case in tick_ms for case in STRATEGY_CASES.values()):
        claims.append(position_is_fastest(tick_ms))
    return claims


def _best(logs: Logs, case: str) -> FloatArray:
    return np.median([best_values(log) for log in logs[case]], axis=0)


def _settled(logs: Logs, case: str) -> FloatArray:
    return np.median([settled_values(log) for log in logs[case]], axis=0)


def _named(values: FloatArray) -> dict[str, float]:
    return dict(zip(MEASURES, np.asarray(values).tolist(), strict=True))


def dynamic_beats_static(logs: Logs) -> Claim:
    """Sec. IV: the dynamic contacts are at least as good as the static ones."""
    gains: dict[str, dict[str, dict[str, float]]] = {"best": {}, "settled": {}}
    for case, runs in logs.items():
        static = np.median([static_values(log) for log in runs], axis=0)
        gains["best"][case] = _named(_best(logs, case) - static)
        gains["settled"][case] = _named(_settled(logs, case) - static)
    lower = {
        kind: {m: [case for case in gain if gain[case][m] < 0] for m in MEASURES}
        for kind, gain in gains.items()
    }
    losses = [
        f"{m.upper()} is lower in {', '.join(cases)} ({kind} values),"
        f" by {-min(gains[kind][case][m] for case in cases):.3g} at most"
        for kind, of_measure in lower.items()
        for m, cases in of_measure.items()
        if cases
    ]
    remark = ""
    if losses:
        remark = "; ".join(losses) + ". Q_VEW measures how far the contacts are spread."
    return Claim(
        f"Dynamic contacts are at least as good as static ones, in {', '.join(logs)}",
        holds=not any(lower["best"].values()),
        numbers={"gain": gains},
        remark=remark,
    )


def damage_recovers(logs: Logs) -> Claim:
    """Sec. IV.B: after two fingers are lost, adapting beats what is left of the static set."""
    static, best = static_values(logs["f"][0]), _best(logs, "f")
    return Claim(
        "Adapting remedies the loss of two fingers",
        holds=bool(np.all(best > static)),
        numbers={"static": _named(np.array(static)), "dynamic": _named(best)},
    )


def poor_start_recovers(logs: Logs) -> Claim:
    """Sec. IV.B: a poor start ends as well as the other cases."""
    ratio = _best(logs, "g") / _best(logs, "a")
    return Claim(
        "A poor start recovers to within 1 % of the base case",
        holds=bool(np.all(ratio > 0.99)),
        numbers={"share_of_base": _named(ratio)},
    )


def strategies_are_alike(logs: Logs) -> Claim:
    """Sec. IV.C: no significant difference in quality between the strategies."""
    spreads = {
        name: _relative_spread(np.array(values))
        for name, values in (
            ("best", [_best(logs, case) for case in STRATEGY_CASES.values()]),
            ("settled", [_settled(logs, case) for case in STRATEGY_CASES.values()]),
            ("published", [row.dynamic for row in TABLE_3.values()]),
        )
    }
    return Claim(
        "The strategies' best quality differs by less than 1 %",
        holds=bool(np.all(spreads["best"] < 0.01)),
        numbers={"relative_spread": {name: _named(spread) for name, spread in spreads.items()}},
        remark="The paper doesn't define significance; its own Table III spreads by"
        f" {100 * np.max(spreads['published']):.2f} %, ours by"
        f" {100 * np.max(spreads['best']):.2f} %, and by {100 * np.max(spreads['settled']):.2f} %"
        " once settled: MSV and GII end in a cycle with worse values than they have passed.",
    )


def _relative_spread(values: FloatArray) -> FloatArray:
    spread: FloatArray = (values.max(axis=0) - values.min(axis=0)) / values.mean(axis=0)
    return spread


def activity_ranks(logs: Logs) -> Claim:
    """Fig. 6: the activity of the strategies."""
    moved = np.array(
        [
            [1e3 * np.mean(log.columns["displacement"][log.settled]) for log in logs[case]]
            for case in STRATEGY_CASES.values()
        ]
    )
    names = list(STRATEGY_CASES)
    in_order = {
        f"{more} > {less}": f"{int(np.sum(moved[k] > moved[k + 1]))} of {moved.shape[1]} seeds"
        for k, (more, less) in enumerate(itertools.pairwise(names))
    }
    medians = np.median(moved, axis=1)
    return Claim(
        "Activity ranks GII, MSV, VEW, position tracking",
        holds=bool(np.all(np.diff(medians) < 0)),
        numbers={
            "mm_per_tick": dict(zip(names, medians.tolist(), strict=True)),
            "in_order": in_order,
        },
        remark="; ".join(f"{pair} in {count}" for pair, count in in_order.items())
        + f". MSV and GII move {medians[1] / medians[2]:.0f} times as far as VEW; VEW and position"
        " tracking rest on the object, and what is left of their motion is the estimate's.",
    )


def position_surrounds(logs: Logs) -> Claim:
    """Sec. IV.C: position tracking places contacts on all four side faces."""
    faces = [_faces(log) for log in logs["a"]]
    return Claim(
        "Position tracking surrounds the cube on all four side faces",
        holds=all(len(found) == 4 for found in faces),
        numbers={"faces": sorted(faces[0])},
    )


def _faces(log: CaseLog) -> set[str]:
    half = log.scenario.object.make_shape().mesh.extents / 2
    relative = log.p_OC(-1) / half
    axes = np.argmax(np.abs(relative), axis=1)
    return {
        ("+" if p[axis] > 0 else "-") + "xyz"[axis] for p, axis in zip(relative, axes, strict=True)
    }


def volume_goes_outwards(logs: Logs) -> Claim:
    """Sec. IV.C: with Q_VEW, contacts move to edges and corners."""
    distance = {
        name: float(np.median([_edge_distance(log) for log in logs[case]]))
        for name, case in (("position", "a"), ("vew", "j"))
    }
    return Claim(
        "VEW drifts to edges and corners",
        holds=distance["vew"] < distance["position"],
        numbers={"mean_mm_to_the_nearest_edge": distance},
    )


def _edge_distance(log: CaseLog) -> float:
    half = log.scenario.object.make_shape().mesh.extents / 2
    inside = np.sort(half - np.abs(log.p_OC(-1)), axis=1)  # The first is the contact's own face.
    return float(1e3 * np.mean(inside[:, 1]))


def faster_is_more_isotropic(logs: Logs) -> Claim:
    """Sec. IV.B: the faster object has the higher Q_GII."""
    slower, faster = (
        np.array([best_values(log)[MEASURES.index("q_gii")] for log in logs[case]]) for case in "bc"
    )
    difference = float(np.median(faster) - np.median(slower))
    between_seeds = float(max(np.ptp(slower), np.ptp(faster)))
    holds = difference > between_seeds
    return Claim(
        "A faster object has a higher Q_GII than a slower one",
        holds=holds,
        numbers={
            "slower": float(np.median(slower)),
            "faster": float(np.median(faster)),
            "range_between_seeds": between_seeds,
        },
        remark=""
        if holds
        else f"The difference, {difference:.1g}, is within the range between seeds,"
        f" {between_seeds:.1g}: goals are planned in the object's frame and follow its estimated"
        " velocity, so speed hardly matters.",
    )


def size_matters(logs: Logs) -> Claim:
    """Sec. IV.B: the bigger object has the higher Q_VEW and the lower Q_GII."""
    smaller, bigger = _best(logs, "d"), _best(logs, "e")
    return Claim(
        "A bigger object has a higher Q_VEW and a lower Q_GII",
        holds=bool(bigger[2] > smaller[2] and bigger[1] < smaller[1]),
        numbers={"smaller": _named(smaller), "bigger": _named(bigger)},
    )


def position_is_fastest(tick_ms: Mapping[str, float]) -> Claim:
    """Sec. V.A: position tracking is the fastest to compute."""
    times = {name: tick_ms[case] for name, case in STRATEGY_CASES.items()}
    return Claim(
        "Position tracking is the fastest to compute",
        holds=min(times, key=times.__getitem__) == "position",
        numbers={"median_tick_ms": times},
    )
