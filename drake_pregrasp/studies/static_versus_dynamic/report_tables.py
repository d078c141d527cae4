"""The tables of the study's report that compare: arms, measures, goals."""

import math
from collections.abc import Sequence

from drake_pregrasp.studies.markup import NONE, Cell, table
from drake_pregrasp.studies.static_versus_dynamic.arms import ARMS, TESTED_ARM
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.goals import OF, GoalResult
from drake_pregrasp.studies.static_versus_dynamic.ranking import rank
from drake_pregrasp.studies.static_versus_dynamic.results import Results, Success
from drake_pregrasp.studies.static_versus_dynamic.verdicts import Verdict
from drake_pregrasp.studies.static_versus_dynamic.words import p_in_words

WEAK_BELOW = 10
"""With fewer successes, or failures, a ranking says little."""


_MEASURES = ("q_msv", "q_gii")
_SUCCESSES: tuple[Success, ...] = ("lifted", "clean")


def overview_table(verdicts: Sequence[Verdict]) -> str:
    """Returns all conditions at a glance: against which arms the tested one is ahead, and when."""
    rivals = [arm for arm in ARMS if any(arm in verdict.against for verdict in verdicts)]
    tested = ARMS[TESTED_ARM].label
    head = [
        Cell(f"{tested} against"),
        *(Cell(ARMS[arm].label, swatch=ARMS[arm].color) for arm in rivals),
    ]
    rows = []
    for verdict in verdicts:
        cells = [Cell(CONDITIONS[verdict.condition].label, kind="name")]
        for arm in rivals:
            if arm not in verdict.against:
                cells.append(Cell(NONE))
                continue
            ahead, behind = verdict.ahead.get(arm, {}), verdict.behind.get(arm, {})
            word = " and ".join(w for w, found in (("ahead", ahead), ("behind", behind)) if found)
            shown = {**ahead, **behind} or verdict.against[arm]
            times = f"{', '.join(f'{time:g}' for time in sorted(shown))} s"
            least = p_in_words(min(comparison.p for comparison in shown.values()))
            cells.append(
                Cell(word or "open", times if word else f"least {least}", word if word else "weak")
            )
        rows.append(cells)
    return table(
        head,
        rows,
        f"Closing times at which {tested} is shown to be clean more often (ahead) or less often"
        " (behind) than another arm, by exact McNemar tests, corrected for their number (Holm);"
        " open: neither is shown.",
    )


def paired_table(results: Results, verdict: Verdict) -> str:
    """Returns the paired tests of a condition, a line for each other arm."""
    times = results.times(verdict.condition)
    tested = ARMS[TESTED_ARM].label
    head = [Cell(f"{tested} against"), *(Cell(f"closing at {time:g} s") for time in times)]
    rows = []
    for arm, comparisons in verdict.against.items():
        cells = [Cell(ARMS[arm].label, swatch=ARMS[arm].color, kind="arm")]
        for comparison in comparisons.values():
            test, p = comparison
            kind = "ahead" if comparison.ahead else "behind" if comparison.behind else ""
            beside = f"{p_in_words(test.p)}; Holm: {p_in_words(p)}"
            numbers = f"+{test.gained} −{test.lost} of {test.pairs}"
            cells.append(Cell(numbers, beside, f"beside {kind}".strip()))
        rows.append(cells)
    return table(
        head,
        rows,
        f"{CONDITIONS[verdict.condition].label}: seeds with which only {tested} is clean (+),"
        " and with which only the other arm is (−), out of those that both have; exact McNemar"
        " test, p by itself and corrected for all tests of the study (Holm). Green: shown to be"
        " clean more often, orange: less often, by the corrected p.",
    )


def ranking_table(results: Results) -> str:
    """Returns how well the measures tell successes from failures, all arms and times together."""
    head = [
        Cell("condition"),
        *(
            Cell(f"{name.upper().replace('Q_', 'Q ')} → {success}", "successes, failures")
            for success in _SUCCESSES
            for name in _MEASURES
        ),
        Cell("left out", "number without contacts"),
    ]
    groups = [
        *(
            (CONDITIONS[c].label, [o for o in results.outcomes if o.condition == c])
            for c in results.conditions
        ),
        ("all together", results.outcomes),
    ]
    rows = []
    for label, outcomes in groups:
        cells = [Cell(label, kind="name")]
        for success in _SUCCESSES:
            succeeded = [getattr(o, success) for o in outcomes]
            for name in _MEASURES:
                ranking = rank([getattr(o, name) for o in outcomes], succeeded)
                few = min(ranking.successes, ranking.failures) < WEAK_BELOW
                shown = NONE if math.isnan(ranking.auc) else f"{ranking.auc:.2f}"
                counts = f"{ranking.successes}, {ranking.failures}"
                cells.append(Cell(shown, counts, "weak" if few else ""))
        cells.append(Cell(str(sum(math.isnan(o.q_msv) for o in outcomes))))
        rows.append(cells)
    return table(
        head,
        rows,
        "Probability that the measure of a success is higher than that of a failure (AUC), all"
        " arms and closing times together: 1 tells all apart, 0.5 none. Grasps without contacts"
        f" have no measure and are left out. Grey: fewer than {WEAK_BELOW} successes or failures,"
        " so it says little.",
    )


def goal_table(judged: Sequence[GoalResult]) -> str:
    """Returns which goals are reached."""
    rows = []
    for goal, found, reached in judged:
        word = {True: "reached", False: "not reached", None: "open"}[reached]
        kind = {True: "ahead", False: "behind", None: ""}[reached]
        rows.append([Cell(goal, kind="name"), Cell(found, kind="name"), Cell(word, kind=kind)])
    return table(
        [Cell("goal"), Cell("found", kind="name"), Cell("")],
        rows,
        f"Goals as they stand in the code, for {OF} seeds; with another number they are judged by"
        " shares.",
    )
