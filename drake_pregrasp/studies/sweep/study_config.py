"""The schema of a sweep's file."""

from dataclasses import dataclass, field
from typing import Any

from drake_pregrasp.studies.sweep.measures import DEFAULT_MEASURES, MEASURES
from drake_pregrasp.systems.pose_sensor import MAX_SEED


@dataclass
class StudyConfig:
    """What is swept. docs/sweeps.md shows how the parts are used together."""

    # One line for the report.
    description: str = ""

    # The scenario that all runs start from: a shipped one, or an entry of `file`.
    scenario: str = ""

    # Its YAML file; a relative path starts at this file's folder.
    file: str = field(default="", metadata={"path": True})

    # Keys of the scenario that all runs have in common, as in an overriding text, or by paths.
    overrides: dict[str, Any] = field(default_factory=dict)

    # All combinations of these are run: from a field's path to a list of values; or from a name to
    # a mapping from labels to mappings from paths to values, which change together.
    grid: dict[str, Any] = field(default_factory=dict)

    # Each sample draws these anew: from a field's path to `uniform: [a, b]`, `log_uniform: [a, b]`,
    # `integer: [a, b]` or `choice: [...]`; with `fields: [...]` from a name to several fields.
    random: dict[str, Any] = field(default_factory=dict)

    # How many samples each combination of the grid is run with; they are the same ones for all.
    samples: int = field(default=1, metadata={"at_least": 1, "at_most": 1_000_000})

    # What samples follow from.
    sampling_seed: int = field(default=0, metadata={"at_least": 0, "at_most": MAX_SEED})

    # How many values of `random_seed` each point is run with, the same for all points.
    seeds: int = field(default=1, metadata={"at_least": 1, "at_most": 1_000_000})

    # The first of them.
    first_seed: int = field(default=0, metadata={"at_least": 0, "at_most": MAX_SEED})

    # The numbers that a row has, by their names in measures.py.
    measures: list[str] = field(
        default_factory=lambda: list(DEFAULT_MEASURES),
        metadata={"min_length": 1, "one_of": tuple(MEASURES)},
    )
