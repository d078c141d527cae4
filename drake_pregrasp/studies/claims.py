"""The paper's claims, each with a verdict computed from runs, and the numbers behind it."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.simulation.summary import MEASURES
from drake_pregrasp.studies.case_runs import CaseLog
from drake_pregrasp.studies.tables import best_values, static_values

Logs = Mapping[str, Sequence[CaseLog]]

SETTLED = 6.0
"""Seconds after which contacts have left their static places, for their activity."""

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

    def to_dict(self) -> dict[str, Any]:
        """Returns the claim with a verdict, for JSON."""
        return {**asdict(self), "verdict": "holds" if self.holds else "does not hold"}


def judge_claims(
    logs: Logs, tick_ms: Mapping[str, float], drops: Mapping[float, FloatArray]
) -> list[Claim]:
    """Judges every claim for which the cases were run.

    Args:
        logs: For each case, its runs with different seeds.
        tick_ms: For each case, the median planning tick, in ms.
        drops: From `largest_drops`.
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
    claims.append(drops_come_from_spacing(drops))
    return claims


def _best(logs: Logs, case: str) -> FloatArray:
    return np.median([best_values(log) for log in logs[case]], axis=0)


def _named(values: FloatArray) -> dict[str, float]:
    return dict(zip(MEASURES, np.asarray(values).tolist(), strict=True))


def dynamic_beats_static(logs: Logs) -> Claim:
    """Sec. IV: the dynamic contacts are at least as good as the static ones."""
    gain = {
        case: _named(_best(logs, case) - np.median([static_values(g) for g in runs], axis=0))
        for case, runs in logs.items()
    }
    worse = {m: [case for case in gain if gain[case][m] < 0] for m in MEASURES}
    lost = "; ".join(
        f"{m.upper()} is lower in {', '.join(cases)}, by {-min(gain[c][m] for c in cases):.3g}"
        " at most"
        for m, cases in worse.items()
        if cases
    )
    return Claim(
        "Dynamic contacts are at least as good as static ones in every case",
        holds=not lost,
        numbers={"gain": gain},
        remark=f"{lost}. Q_VEW measures the contacts' spread, and the static contacts, which are"
        " calibrated to the paper's values, lie nearer to edges than weighted centroids do."
        if lost
        else "",
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
    best = np.array([_best(logs, case) for case in STRATEGY_CASES.values()])
    spread = (best.max(axis=0) - best.min(axis=0)) / best.mean(axis=0)
    return Claim(
        "The strategies' quality differs by less than 1 %",
        holds=bool(np.all(spread < 0.01)),
        numbers={"relative_spread": _named(spread)},
        remark="The paper doesn't define significance; its own Table III spreads by up to 0.9 %.",
    )


def activity_ranks(logs: Logs) -> Claim:
    """Fig. 6: the activity of the strategies."""
    per_seed = np.array(
        [
            [1e3 * np.mean(log.columns["displacement"][log.after(SETTLED)]) for log in logs[case]]
            for case in STRATEGY_CASES.values()
        ]
    )
    medians = np.median(per_seed, axis=1)
    in_order = np.all(np.diff(per_seed, axis=0) < 0, axis=0)
    holds = bool(np.all(np.diff(medians) < 0))
    return Claim(
        "Activity ranks GII, MSV, VEW, position tracking",
        holds=holds,
        numbers={
            "mm_per_tick": dict(zip(STRATEGY_CASES, medians.tolist(), strict=True)),
            "seeds_in_order": f"{int(np.sum(in_order))} of {per_seed.shape[1]}",
        },
        remark="GII and MSV are alike: on a small cube Eq. 6 is nearly the square of Eq. 5. VEW and"
        " position tracking come to rest on the object, and what is left is the estimate's noise.",
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
    half = np.array(log.scenario.object.size) / 2
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
    half = np.array(log.scenario.object.size) / 2
    inside = np.sort(half - np.abs(log.p_OC(-1)), axis=1)  # The first is the contact's own face.
    return float(1e3 * np.mean(inside[:, 1]))


def faster_is_more_isotropic(logs: Logs) -> Claim:
    """Sec. IV.B: the faster object has the higher Q_GII."""
    slower, faster = _best(logs, "b")[1], _best(logs, "c")[1]
    seeds = [
        abs(best_values(one)[1] - best_values(other)[1])
        for case in "bc"
        for one, other in zip(logs[case], logs[case][1:], strict=False)
    ]
    noise = float(np.median(seeds)) if seeds else 0.0
    return Claim(
        "A faster object has a higher Q_GII than a slower one",
        holds=bool(faster - slower > noise),
        numbers={"slower": slower, "faster": faster, "typical_difference_between_seeds": noise},
        remark="Here contacts are planned in the object's frame with an estimated velocity, so that"
        " speed hardly matters; differences are those between seeds.",
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


def drops_come_from_spacing(drops: Mapping[float, FloatArray]) -> Claim:
    """Sec. IV.B: drops of the measures come from the discretisation of Y."""
    means = [float(np.mean(drops[spacing])) for spacing in sorted(drops, reverse=True)]
    return Claim(
        "Drops come from the discretisation of Y: they shrink with its spacing",
        holds=bool(np.all(np.diff(means) < 0)),
        numbers={
            "mean_largest_drop_of_q_gii": {
                f"{1e3 * spacing:g} mm": mean
                for spacing, mean in zip(sorted(drops, reverse=True), means, strict=True)
            }
        },
        remark="A drop is what one step loses against a much finer surface, from the same contacts."
        " Falls of Q_GII that the finer surface shows too, because position tracking doesn't climb"
        " Q_GII, don't count.",
    )
