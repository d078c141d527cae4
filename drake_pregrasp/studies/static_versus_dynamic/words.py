"""Verdicts in plain words: each sentence follows from the numbers it is given."""

from collections.abc import Iterable, Sequence

from drake_pregrasp.studies.static_versus_dynamic.arms import ARMS, TESTED_ARM
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.paired_test import SIGNIFICANT, least_pairs
from drake_pregrasp.studies.static_versus_dynamic.results import Results
from drake_pregrasp.studies.static_versus_dynamic.verdicts import Comparisons, Verdict

_TESTED = ARMS[TESTED_ARM].label.capitalize()
_SMALL_P = 0.001
_NO_BREAK = "\u00a0"
_SHOWN = f"p < {SIGNIFICANT:g}".replace(" ", _NO_BREAK)


def p_in_words(p: float, sign: str = "=") -> str:
    """Returns a probability, as exactly as it matters, in words that no line breaks."""
    shown = f"< {_SMALL_P:g}" if p < _SMALL_P else f"{sign} {p:.2g}"
    return f"p {shown}".replace(" ", _NO_BREAK)


def times_in_words(shown: Comparisons, all_of_arm: Comparisons) -> str:
    """Returns at how many of the closing times something is shown, at which, and p at most."""
    largest = max(comparison.p for comparison in shown.values())
    times = listed(f"{time:g}" for time in shown)
    p = p_in_words(largest, "=" if len(shown) == 1 else "≤")
    return f"at {len(shown)} of {len(all_of_arm)} closing times: {times}{_NO_BREAK}s, {p}"


def listed(words: Iterable[str]) -> str:
    """Returns words as a list in a sentence."""
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def overview(verdicts: Sequence[Verdict]) -> list[str]:
    """Returns sentences on all conditions together: where the tested arm helps and where not."""
    tested = [verdict for verdict in verdicts if verdict.against]
    if not tested:
        return [f"{_TESTED} was not compared with another arm."]
    all_of = [v for v in tested if len(v.ahead) == len(v.against) and not v.behind]
    some = [v for v in tested if v.ahead and v not in all_of]
    none = [v for v in tested if not v.ahead]
    behind = [v for v in tested if v.behind]
    sentences = []
    if all_of:
        sentences.append(
            f"{_TESTED} is clean more often than every other arm, at one closing time at least,"
            f" under: {'; '.join(f'{_label(v)}{_always(v)}' for v in all_of)}."
        )
    if some:
        details = (f"{_label(v)}{_only_against(v)}" for v in some)
        sentences.append(
            f"{'It' if all_of else _TESTED} is clean more often than some arms and not all, or"
            f" only at some times, under: {'; '.join(details)}."
        )
    if none:
        sentences.append(
            f"{_TESTED} is not shown to be clean more often than any other arm under:"
            f" {', '.join(map(_label, none))}."
        )
    if behind:
        details = (f"{_label(v)} (than {listed(map(_arm, v.behind))})" for v in behind)
        sentences.append(
            f"{_TESTED} is clean less often than another arm, at one closing time at least,"
            f" under: {'; '.join(details)}."
        )
    else:
        sentences.append("Under no condition is it shown to be clean less often than another arm.")
    return sentences


def condition_in_words(results: Results, verdict: Verdict, num_tests: int) -> list[str]:
    """Returns sentences on one condition.

    Args:
        results: All there are.
        verdict: On the condition.
        num_tests: How many tests are corrected together.
    """
    sentences = [_most_often(results, verdict.condition)]
    for found, words in (
        (verdict.ahead, "ahead of (clean more often than)"),
        (verdict.behind, "behind (clean less often than)"),
    ):
        if found:
            details = (
                f"{_arm(arm)} ({times_in_words(shown, verdict.against[arm])})"
                for arm, shown in found.items()
            )
            sentences.append(f"{_TESTED} is {words} {'; '.join(details)}.")
    if verdict.open:
        details = (
            f"{_arm(arm)} (least {p_in_words(min(c.p for c in of_arm.values()))})"
            for arm, of_arm in verdict.open.items()
        )
        sentences.append(
            f"{_TESTED} is not shown to differ, at any closing time, from {listed(details)}."
        )
    pairs = [c.test.pairs for of_arm in verdict.against.values() for c in of_arm.values()]
    if pairs and min(pairs) < (fewest := least_pairs(num_tests)):
        sentences.append(
            f"With {min(pairs)} common seeds no difference can be shown: {fewest} are the fewest"
            f" that can if p is corrected for {num_tests} tests."
        )
    return sentences


def comparisons_in_words(verdicts: Sequence[Verdict]) -> str:
    """Returns a sentence on how many tests there are, and how they are corrected for that."""
    comparisons = [c for v in verdicts for of_arm in v.against.values() for c in of_arm.values()]
    single = sum(c.test.p < SIGNIFICANT for c in comparisons)
    shown = sum(c.ahead or c.behind for c in comparisons)
    return (
        f"Many comparisons: all verdicts rest on the {len(comparisons)} tests of"
        f" {_TESTED.lower()} against other arms, and no others. Each p is corrected for that"
        f" number (Holm), so that the probability that any difference is said to be shown and is"
        f" there by chance is below {SIGNIFICANT:g}. {single} would have"
        f" {_SHOWN} by themselves; {shown} have it so corrected."
    )


def _most_often(results: Results, condition: str) -> str:
    arms, times = results.arms(condition), results.times(condition)
    clean = {arm: [results.count(condition, arm, time) for time in times] for arm in arms}
    of = {arm: sum(len(results.cell(condition, arm, time)) for time in times) for arm in arms}
    share = {arm: sum(clean[arm]) / of[arm] for arm in arms}
    if not any(share.values()):
        return "No grasp is clean."
    at = "/".join(f"{time:g}" for time in times)
    counts = "; ".join(
        f"{_arm(arm)} {'/'.join(map(str, clean[arm]))} of {of[arm] // len(times)} seeds"
        for arm in arms
        if share[arm] == max(share.values())
    )
    return f"Largest count of clean grasps, closing at {at}{_NO_BREAK}s: {counts}."


def _always(verdict: Verdict) -> str:
    everywhere = verdict.ahead == verdict.against
    return " (at every closing time)" if everywhere else ""


def _only_against(verdict: Verdict) -> str:
    """Returns which arms it is shown against, or not, whichever are fewer."""
    shown = [_arm(arm) for arm in verdict.ahead]
    missing = [_arm(arm) for arm in verdict.against if arm not in verdict.ahead]
    if not missing:
        return ""
    if len(shown) < len(missing):
        return f" (than {listed(shown)})"
    return f" (not than {listed(missing)})"


def _label(verdict: Verdict) -> str:
    return CONDITIONS[verdict.condition].label


def _arm(arm: str) -> str:
    return ARMS[arm].label
