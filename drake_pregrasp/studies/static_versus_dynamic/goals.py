"""What the study is hoped to show, and whether it does."""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

from drake_pregrasp.studies.static_versus_dynamic.arms import ARMS, TESTED_ARM
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.results import Results, Success

OF = 30
"""How many seeds bounds are stated for; with another number they are shares."""


class Goal(NamedTuple):
    """A bound on how many grasps of an arm succeed.

    Attributes:
        condition: Key of `CONDITIONS`.
        arm: Key of `ARMS`.
        success: What counts.
        sense: Whether `bound` is the least or the most.
        bound: How many of `OF`.
        times: At which closing times, in seconds; at each of the condition's if empty.
    """

    condition: str
    arm: str
    success: Success
    sense: Literal["least", "most"]
    bound: int
    times: tuple[float, ...] = ()

    def __str__(self) -> str:
        sign = "≥" if self.sense == "least" else "≤"
        when = f"at {_list(self.times)} s" if self.times else "at each time"
        return (
            f"{ARMS[self.arm].label}, {CONDITIONS[self.condition].label}: {self.success} {sign}"
            f" {self.bound} of {OF} {when}"
        )


GOALS: Sequence[Goal] = (
    Goal("two_lost", "dynamic_reach", "lifted", "least", 29),
    Goal("turning", "dynamic_reach", "clean", "least", 27),
    Goal("turning", "frozen", "clean", "most", 3, (8.0, 12.0)),
    Goal("turning", "dynamic", "clean", "most", 3, (8.0, 12.0)),
    Goal("headline", "dynamic_reach", "clean", "least", 25),
    Goal("headline", "frozen", "clean", "most", 3),
    Goal("headline", "reassigned", "clean", "most", 12),
    Goal("headline", "still", "clean", "most", 18, (4.0,)),
    Goal("headline", "still", "clean", "most", 3, (8.0, 12.0)),
    Goal("wall", "dynamic_reach", "lifted", "least", 25, (6.0,)),
    Goal("wall", "frozen", "lifted", "most", 5, (6.0,)),
    Goal("sphere", "dynamic_reach", "lifted", "least", 26, (6.0,)),
    Goal("sphere", "frozen", "lifted", "most", 8, (6.0,)),
)
"""The goals on grasps."""

AREA_CONDITIONS = ("wall", "headline", "sphere")
"""Where goals and fingertips of `TESTED_ARM` are to keep out of a no-touch area."""

LARGEST_TIP_SHARE = 0.01
"""Share of all ticks at which its fingertips may be in the area."""


class GoalResult(NamedTuple):
    """What became of a goal.

    Attributes:
        goal: In words.
        found: The numbers, in words.
        reached: Whether they are within the bound at each of its times, or None if there are
            none for one of them.
    """

    goal: str
    found: str
    reached: bool | None


def judge_goals(results: Results, goals: Sequence[Goal] = GOALS) -> list[GoalResult]:
    """Returns what became of the goals, and of that on goals in no-touch areas."""
    return [
        *(_judge(results, goal) for goal in goals),
        *(_judge_area(results, condition, TESTED_ARM) for condition in AREA_CONDITIONS),
        *(_judge_tips(results, condition, TESTED_ARM) for condition in AREA_CONDITIONS),
        _judge_no_worse(results, "nominal", TESTED_ARM, "frozen"),
    ]


def _judge(results: Results, goal: Goal) -> GoalResult:
    times = goal.times or CONDITIONS[goal.condition].closing_times
    cells = [results.cell(goal.condition, goal.arm, time) for time in times]
    counts = [results.count(goal.condition, goal.arm, time, goal.success) for time in times]
    if not all(cells):
        return GoalResult(str(goal), "not run", None)
    sign = 1 if goal.sense == "least" else -1
    within = [
        sign * (OF * count - goal.bound * len(cell)) >= 0
        for count, cell in zip(counts, cells, strict=True)
    ]
    found = ", ".join(
        f"{count} of {len(cell)} at {time:g} s"
        for count, cell, time in zip(counts, cells, times, strict=True)
    )
    return GoalResult(str(goal), found, reached=all(within))


def _judge_no_worse(results: Results, condition: str, arm: str, other: str) -> GoalResult:
    what = f"{ARMS[arm].label}, {CONDITIONS[condition].label}"
    goal = f"{what}: clean at each time as often as {ARMS[other].label}, or more often"
    times = CONDITIONS[condition].closing_times
    counts = [
        [results.count(condition, name, time, "clean") for name in (arm, other)] for time in times
    ]
    sizes = [[len(results.cell(condition, name, time)) for name in (arm, other)] for time in times]
    if any(own == 0 or own != others for own, others in sizes):
        return GoalResult(goal, "not run", None)
    found = ", ".join(
        f"{own} against {others} of {size} at {time:g} s"
        for (own, others), (size, _), time in zip(counts, sizes, times, strict=True)
    )
    return GoalResult(goal, found, reached=all(own >= others for own, others in counts))


def _judge_area(results: Results, condition: str, arm: str) -> GoalResult:
    goal = f"{ARMS[arm].label}, {CONDITIONS[condition].label}: no goal in the area at any tick"
    shares = [
        o.goal_in_area
        for time in results.times(condition)
        for o in results.cell(condition, arm, time)
    ]
    if not shares:
        return GoalResult(goal, "not run", None)
    if unknown := sum(map(math.isnan, shares)):
        return GoalResult(goal, f"not measured in {unknown} of {len(shares)} grasps", None)
    worst = max(shares)
    return GoalResult(
        goal, f"{100 * worst:.2g} % of the ticks in the worst grasp", reached=worst == 0
    )


def _judge_tips(results: Results, condition: str, arm: str) -> GoalResult:
    bound = f"under {100 * LARGEST_TIP_SHARE:g} % of ticks"
    goal = f"{ARMS[arm].label}, {CONDITIONS[condition].label}: fingertips in the area {bound}"
    shares = [
        o.tip_in_area
        for time in results.times(condition)
        for o in results.cell(condition, arm, time)
        if not math.isnan(o.tip_in_area)
    ]
    if not shares:
        return GoalResult(goal, "not run", None)
    mean = sum(shares) / len(shares)
    found = f"{100 * mean:.2g} % on the average, {100 * max(shares):.2g} % in the worst grasp"
    return GoalResult(goal, found, reached=mean < LARGEST_TIP_SHARE)


def _list(times: Sequence[float]) -> str:
    return " and ".join(f"{time:g}" for time in times)
