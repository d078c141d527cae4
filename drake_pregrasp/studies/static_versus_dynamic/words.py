"""Verdicts in plain words: each sentence follows from the numbers it is given."""

from collections.abc import Iterable, Sequence

from drake_pregrasp.studies.static_versus_dynamic.arms import ARMS, TESTED_ARM
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.paired_test import (
    LEAST_PAIRS,
    SIGNIFICANT,
)
from drake_pregrasp.studies.static_versus_dynamic.results import Results
from drake_pregrasp.studies.static_versus_dynamic.verdicts import Tests, Verdict, survivors

_TESTED = ARMS[TESTED_ARM].label.capitalize()
_SMALL_P = 0.001
_NO_BREAK = "\u00a0"
_SHOWN = f"p < {SIGNIFICANT:g}".replace(" ", _NO_BREAK)


def p_in_words(p: float, sign: str = "=") -> str:
    """Returns a probability, as exactly as it matters, in words that no line breaks."""
    shown = f"< {_SMALL_P:g}" if p < _SMALL_P else f"{sign} {p:.2g}"
    return f"p {shown}".replace(" ", _NO_BREAK)


def tests_in_words(tests: Tests) -> str:
    """Returns the times of tests, and p, or a bound of all of them."""
    largest = max(test.p for test in tests.values())
    times = listed(f"{time:g}" for time in tests)
    return f"at {times}{_NO_BREAK}s, {p_in_words(largest, '=' if len(tests) == 1 else '≤')}"


def listed(words: Iterable[str], conjunction: str = "and") -> str:
    """Returns words as a list in a sentence."""
    *first, last = words
    return f"{', '.join(first)} {conjunction} {last}" if first else last


def overview(verdicts: Sequence[Verdict]) -> list[str]:
    """Returns sentences on all conditions together: where the tested arm helps and where not."""
    tested = [verdict for verdict in verdicts if verdict.tests]
    if not tested:
        return [f"{_TESTED} was not compared with another arm."]
    all_of = [v for v in tested if len(v.ahead) == len(v.tests) and not v.behind]
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
            f" {_labels(none)}."
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


def condition_in_words(results: Results, verdict: Verdict) -> list[str]:
    """Returns sentences on one condition."""
    condition = verdict.condition
    arms, times = results.arms(condition), results.times(condition)
    clean = {arm: [results.count(condition, arm, time) for time in times] for arm in arms}
    of = {arm: sum(len(results.cell(condition, arm, time)) for time in times) for arm in arms}
    share = {arm: sum(clean[arm]) / of[arm] for arm in arms}
    best = [arm for arm in arms if share[arm] == max(share.values())]
    at = "/".join(f"{time:g}" for time in times)
    counts = "; ".join(
        f"{_arm(arm)} {'/'.join(map(str, clean[arm]))} of {of[arm] // len(times)} seeds"
        for arm in best
    )
    sentences = [f"Clean most often, closing at {at}{_NO_BREAK}s: {counts}."]
    if not any(share.values()):
        sentences = ["No grasp is clean."]
    if len(arms) > 1:
        sentences.append(_unbeaten_in_words(verdict))
    for found, words in (
        (verdict.ahead, "clean more often than"),
        (verdict.behind, "clean less often than"),
    ):
        if found:
            details = (f"{_arm(arm)} ({tests_in_words(tests)})" for arm, tests in found.items())
            sentences.append(f"{_TESTED} is {words} {'; '.join(details)}.")
    if verdict.open:
        details = (
            f"{_arm(arm)} (least {p_in_words(min(t.p for t in tests.values()))})"
            for arm, tests in verdict.open.items()
        )
        sentences.append(f"No difference is shown between it and {listed(details)}.")
    pairs = [test.pairs for tests in verdict.tests.values() for test in tests.values()]
    if pairs and min(pairs) < LEAST_PAIRS:
        sentences.append(
            f"With {min(pairs)} common seeds no difference can be shown: {LEAST_PAIRS} are the"
            " fewest that can."
        )
    return sentences


def comparisons_in_words(verdicts: Sequence[Verdict]) -> str:
    """Returns a sentence on how many comparisons there are, and what that means."""
    p_values = [t.p for v in verdicts for tests in v.tests.values() for t in tests.values()]
    below = sum(p < SIGNIFICANT for p in p_values)
    return (
        f"Many comparisons: the tests of {_TESTED.lower()} against other arms are"
        f" {len(p_values)}, of which {below} have {_SHOWN}. If no arm were better than"
        f" another, {SIGNIFICANT * len(p_values):.1f} or fewer could be expected to. Seen as one"
        f" family (Holm), {survivors(p_values)} remain. Verdicts above are by single tests."
    )


def _unbeaten_in_words(verdict: Verdict) -> str:
    unbeaten = [_arm(arm) for arm in verdict.unbeaten]
    if len(unbeaten) == 1:
        return (
            f"Winner: {unbeaten[0]} is the only arm that no other one beats at any closing time"
            f" ({_SHOWN})."
        )
    if unbeaten:
        return (
            f"No single winner: no arm beats {listed(unbeaten, 'or')} at any closing time"
            f" ({_SHOWN})."
        )
    return f"No single winner: another beats each arm at some closing time ({_SHOWN})."


def _always(verdict: Verdict) -> str:
    everywhere = verdict.ahead == verdict.tests
    return " (at every closing time)" if everywhere else ""


def _only_against(verdict: Verdict) -> str:
    """Returns which arms it is shown against, or not, whichever are fewer."""
    shown = [_arm(arm) for arm in verdict.ahead]
    missing = [_arm(arm) for arm in verdict.tests if arm not in verdict.ahead]
    if not missing:
        return ""
    if len(shown) < len(missing):
        return f" (than {listed(shown)})"
    return f" (not than {listed(missing)})"


def _labels(verdicts: Sequence[Verdict]) -> str:
    return ", ".join(map(_label, verdicts))


def _label(verdict: Verdict) -> str:
    return CONDITIONS[verdict.condition].label


def _arm(arm: str) -> str:
    return ARMS[arm].label
