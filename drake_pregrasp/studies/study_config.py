"""Schema of a study's file, with a default for every key."""

from dataclasses import dataclass, field
from typing import Any

from drake_pregrasp.studies.measures import DEFAULT_MEASURES
from drake_pregrasp.systems.pose_sensor import MAX_SEED

MOST_RUNS = 1_000_000
"""Largest number of runs of a study."""

_TIMES: dict[str, Any] = {"elements": {"above": 0, "at_most": 1e6}}


@dataclass
class Condition:
    """Schema of a condition: what happens to the object and the hand."""

    # Name in tables and figures; by default the condition's key.
    label: str = ""

    # One line of text for the report.
    description: str = ""

    # Name of the scenario, instead of that of the study.
    scenario: str = ""

    # Changes of the scenario, after those of the study.
    overrides: dict[str, Any] = field(default_factory=dict)

    # Random axes besides those of the study, or instead of those with the same name.
    random: dict[str, Any] = field(default_factory=dict)

    # Times at which the hand is told to close, in ascending order, in seconds, at ticks of the
    # planner. All grasps follow from one tracking run. By default, the hand closes at
    # `grasp.close_at` of the scenario.
    closing_times: list[float] = field(default_factory=list, metadata=_TIMES)


@dataclass
class Method:
    """Schema of a method: how the contacts are chosen."""

    # Name in tables and figures; by default the method's key.
    label: str = ""

    # One line of text for the report.
    description: str = ""

    # Changes of the scenario, after those of the condition and of the axes.
    overrides: dict[str, Any] = field(default_factory=dict)

    # Name of a registered source of the hand's goals; by default the planner.
    goals: str = ""


@dataclass
class PairedTest:
    """Schema of paired tests: whether one method is better than others on the same runs."""

    # Key of the tested method.
    method: str = field(metadata={"required": True})

    # Keys of the methods that it is tested against; by default all others.
    against: list[str] = field(default_factory=list)

    # Name of the compared measure. Measures of yes and no are compared by the exact McNemar test,
    # numbers by Wilcoxon's signed-rank test.
    measure: str = "held"

    # Whether one test compares all runs of all conditions; by default, each condition and closing
    # time has a test. A run has the mean of its grasps' numbers, and yes if all its grasps have.
    pooled: bool = False


@dataclass
class StudyConfig:
    """Schema of a study's file. docs/studies.md explains its use."""

    # One line of text for the report.
    description: str = ""

    # Scenario of the runs: the name of a shipped scenario, or of an entry of `file`.
    scenario: str = ""

    # YAML file of scenarios; a relative path starts at this file's folder.
    file: str = field(default="", metadata={"path": True})

    # Changes of the scenario in all runs, as nested keys or by paths.
    overrides: dict[str, Any] = field(default_factory=dict)

    # Conditions by their keys: the rows of the report's tables.
    conditions: dict[str, Any] = field(default_factory=dict)

    # Methods by their keys: the columns of the report's tables.
    methods: dict[str, Any] = field(default_factory=dict)

    # Axes whose combinations are all run, besides those of conditions and methods. An entry maps a
    # field's path to a list of values; or it maps a name to labels, and each label to paths and
    # their values, which change together.
    grid: dict[str, Any] = field(default_factory=dict)

    # Axes that each seed draws at random. An entry maps a field's path to `uniform: [a, b]`,
    # `log_uniform: [a, b]`, `integer: [a, b]`, `choice: [...]` or `random_objects: [a, b]`. With
    # `fields: [...]`, it maps a name to several fields with the same value.
    random: dict[str, Any] = field(default_factory=dict)

    # Number of seeds. A seed is the `random_seed` of the scenario, and draws the random axes. All
    # conditions, methods and points of the grid have the same seeds.
    seeds: int = field(default=1, metadata={"at_least": 1, "at_most": MOST_RUNS})

    # First seed; the others follow.
    first_seed: int = field(default=0, metadata={"at_least": 0, "at_most": MAX_SEED})

    # Closing times of conditions that have none of their own.
    closing_times: list[float] = field(default_factory=list, metadata=_TIMES)

    # Measures in each row.
    measures: list[str] = field(
        default_factory=lambda: list(DEFAULT_MEASURES), metadata={"min_length": 1}
    )

    # Those of the measures in figures and tables of the axes; by default all.
    figures: list[str] = field(default_factory=list)

    # Paired tests of the methods.
    tests: list[PairedTest] = field(default_factory=list)
