"""Studies from YAML files, and the runs that they consist of."""

import dataclasses
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drake_pregrasp.arrays import first_tick, tick_index
from drake_pregrasp.config.yaml_text import parse_yaml
from drake_pregrasp.errors import InvalidArgumentError, ScenarioError, nearest
from drake_pregrasp.resources import check_inside, resolve_path, resource_folder
from drake_pregrasp.simulation.scenario_file import (
    load_scenario,
    only_name,
    read_mapping,
    scenario_data,
    scenario_from_data,
)
from drake_pregrasp.simulation.schema_check import check_mapping
from drake_pregrasp.studies.field_path import overlap, walk, with_fields
from drake_pregrasp.studies.grasps.goal_sources import GOAL_SOURCES
from drake_pregrasp.studies.measures import MEASURES
from drake_pregrasp.studies.study_axes import (
    RANDOM_OBJECTS,
    SEED_FIELD,
    Axis,
    GridAxis,
    Label,
    RandomAxis,
    check_axes,
    grid_axis,
    random_axis,
)
from drake_pregrasp.studies.study_config import (
    MOST_RUNS,
    Condition,
    Method,
    PairedTest,
    StudyConfig,
)
from drake_pregrasp.systems.pose_sensor import MAX_SEED

STUDY_TEXT = "study text"
"""Name of the text that overrides keys of a study, for error messages."""


@dataclass(frozen=True)
class Study:
    """A loaded study.

    Attributes:
        name: Name of the study's folder and report.
        source: File of the study, for messages.
        folder: Folder at which relative paths in changed values start.
        folders: Further folders that may hold named files.
        config: Content of the file, with defaults.
        conditions: Conditions by their keys; a study without any has one with the key "".
        methods: Methods by their keys, likewise.
        bases: Scenario of each condition as `scenario_data` returns it.
        grid: Axes with listed values.
        random: Axes that each seed draws, for each condition.
        chosen: Keys of the conditions and methods to run.
    """

    name: str
    source: str
    folder: Path
    folders: tuple[str, ...]
    config: StudyConfig
    conditions: Mapping[str, Condition]
    methods: Mapping[str, Method]
    bases: Mapping[str, Mapping[str, Any]]
    grid: tuple[GridAxis, ...]
    random: Mapping[str, tuple[RandomAxis, ...]]
    chosen: tuple[tuple[str, ...], tuple[str, ...]]

    @property
    def axes(self) -> list[Axis]:
        """Axes that all conditions have, those of the grid first."""
        random = {axis.name: axis for axes in self.random.values() for axis in axes}
        return [*self.grid, *(random[name] for name in self.config.random)]

    @property
    def job_columns(self) -> list[str]:
        """Names of the columns that identify a run."""
        random = [axis.name for axes in self.random.values() for axis in axes]
        return ["condition", "method", *(axis.name for axis in self.grid), *random, "seed"]

    @property
    def seeds(self) -> range:
        """Seeds of the runs."""
        return range(self.config.first_seed, self.config.first_seed + self.config.seeds)

    def jobs(self) -> list[dict[str, Label]]:
        """Returns the first columns of each run's row: condition, method, axes and seed.

        All runs with one seed come before the next seed: half a study compares all methods.
        """
        points: list[dict[str, Label]] = [{}]
        for axis in self.grid:
            points = [p | {axis.name: label} for p in points for label in axis.changes]
        return [
            ({"condition": condition} if condition else {})
            | ({"method": method} if method else {})
            | point
            | {axis.name: axis.label(seed) for axis in self.random[condition]}
            | {"seed": seed}
            for seed in self.seeds
            for condition in self.chosen[0]
            for point in points
            for method in self.chosen[1]
        ]

    def method_of(self, job: Mapping[str, Any]) -> Method:
        """Returns the method of a job."""
        return self.methods[job.get("method", "")]

    def closing_times(self, job: Mapping[str, Any]) -> list[float]:
        """Returns the closing times of a job's hand; empty for that of the scenario."""
        own = self.conditions[job.get("condition", "")].closing_times
        return own or self.config.closing_times

    def scenario_of(self, job: Mapping[str, Any]) -> dict[str, Any]:
        """Returns the scenario of a job, one of `jobs`, as plain data.

        Raises:
            ScenarioError: If a field does not exist.
        """
        condition = job.get("condition", "")
        data: Mapping[str, Any] = self.bases[condition]
        changes = [axis.changes[job[axis.name]] for axis in self.grid]
        changes += [axis.changes(job["seed"]) for axis in self.random[condition]]
        changes += [self.method_of(job).overrides, {SEED_FIELD: job["seed"]}]
        for each in changes:
            data = with_fields(data, each, self.source)
        return dict(data)


def shipped_studies() -> dict[str, Path]:
    """Returns the files of the shipped studies, by their names."""
    files = sorted((resource_folder("scenarios") / "studies").glob("*.yaml"))
    return {file.stem: file for file in files}


def load_study(
    name_or_file: str,
    folders: Sequence[str] = (),
    *,
    text: str = "{}",
    conditions: Sequence[str] = (),
    methods: Sequence[str] = (),
    seeds: int | None = None,
    first_seed: int | None = None,
) -> Study:
    """Loads and checks a study. Values of its axes are checked when they are run.

    Args:
        name_or_file: Name of a shipped study, or path of a YAML file.
        folders: Further folders that may hold named files, besides the study's own folder.
        text: YAML that overrides keys of the study. A mapping changes only the keys that it has.
        conditions: Keys of the conditions to run; by default all.
        methods: Keys of the methods to run; by default all.
        seeds: Number of seeds, instead of that of the study.
        first_seed: First seed, instead of that of the study.

    Raises:
        ScenarioError: If the study is invalid; the message names file, key and value.
    """
    file = _find(name_or_file)
    config, source = _read_config(file, text), str(file)
    config.seeds = config.seeds if seeds is None else seeds
    config.first_seed = config.first_seed if first_seed is None else first_seed
    _check_seeds(config, source)
    _resolve_file(config, file, folders)
    all_conditions = _entries(source, "conditions", config.conditions, Condition)
    all_methods = _entries(source, "methods", config.methods, Method)
    for test in config.tests:
        test.against = test.against or [key for key in all_methods if key != test.method]
    bases, random = {}, {}
    for key, condition in all_conditions.items():
        bases[key] = _base(config, condition, file, folders)
        entries = {**config.random, **condition.random}
        own = f"conditions.{key}.random"
        random[key] = tuple(
            random_axis(n, v, bases[key], source, own if n in condition.random else "random")
            for n, v in entries.items()
        )
    first = next(iter(bases.values()))
    grid = tuple(grid_axis(str(name), v, first, source) for name, v in config.grid.items())
    chosen = (
        _chosen("conditions", conditions, all_conditions),
        _chosen("methods", methods, all_methods),
    )
    study = Study(
        name=file.stem,
        source=source,
        folder=file.parent.resolve(),
        folders=tuple(str(Path(folder).resolve()) for folder in folders),
        config=config,
        conditions=all_conditions,
        methods=all_methods,
        bases=bases,
        grid=grid,
        random=random,
        chosen=chosen,
    )
    _check(study)
    return study


def _read_config(file: Path, text: str) -> StudyConfig:
    """Returns the content of a study's file, with keys that a text overrides."""
    if not re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9_.-]*", file.stem):
        problem = "a study's file is named with letters, digits, '_', '-' and '.'"
        raise ScenarioError("", file.stem, problem)
    data, changes = read_mapping(file), parse_yaml(STUDY_TEXT, text) or {}
    for source, part in ((str(file), data), (STUDY_TEXT, changes)):
        _check_plain(source, part)
        check_mapping(source, "", part, StudyConfig)
    merged = _merged(data, changes)
    tests = [PairedTest(**test) for test in merged.get("tests", ())]
    return StudyConfig(**{**merged, "tests": tests})


def _merged(data: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Returns nested mappings with changed keys."""
    merged = dict(data)
    for key, value in changes.items():
        both = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
        merged[key] = _merged(merged[key], value) if both else value
    return merged


def _entries(source: str, key: str, data: Mapping[str, Any], schema: Any) -> dict[str, Any]:
    """Returns the conditions or methods of a study; one with the key "" if there are none."""
    for name, entry in data.items():
        if not isinstance(name, str) or not name:
            raise ScenarioError(source, f"{key}.{name}", "is not a name; quote it if it is one")
        check_mapping(source, f"{key}.{name}", entry, schema)
    found = {name: schema(**entry) for name, entry in data.items()}
    for name, entry in found.items():
        entry.label = entry.label or name
    return found or {"": schema()}


def _base(
    config: StudyConfig, condition: Condition, file: Path, folders: Sequence[str]
) -> dict[str, Any]:
    """Returns the scenario of a condition as plain data, after a check of all its values."""
    source, name = str(file), condition.scenario or config.scenario
    if not name:
        raise ScenarioError(source, "scenario", "is missing; name a scenario")
    # A scenario's file in a subfolder may name files beside the study.
    beside = [str(file.parent), *folders] if config.file else list(folders)
    data = scenario_data(load_scenario(name, file=config.file or None, folders=beside))
    for changes in (config.overrides, condition.overrides):
        data = with_fields(data, changes, f"{source}: overrides")
    return scenario_data(
        scenario_from_data(data, source=source, folder=file.parent, folders=folders).scenario
    )


def _chosen(option: str, wanted: Sequence[str], known: Mapping[str, Any]) -> tuple[str, ...]:
    for key in wanted:
        if key not in known or not key:
            hint = nearest(key, list(filter(None, known)) or ["none"])
            raise ScenarioError(f"--{option}", key, f"there is none with this key; {hint}")
    return tuple(key for key in known if key in wanted or not wanted)


def _check(study: Study) -> None:
    """Checks what keys of a study say of each other."""
    config, source = study.config, study.source
    for key, condition in study.conditions.items():
        check_axes(
            [*study.grid, *study.random[key]],
            source,
            ["condition", "method", "seed", "error", *MEASURES],
        )
        _check_closing_times(study, key, condition)
        kinds = {axis.kind for axis in study.random[key]}
        if RANDOM_OBJECTS in kinds and "held" not in config.measures:
            problem = f"lack held, which a study of {RANDOM_OBJECTS} needs"
            raise ScenarioError(source, "measures", problem)
    for key, method in study.methods.items():
        if method.goals and method.goals not in GOAL_SOURCES:
            hint = f"{nearest(method.goals, GOAL_SOURCES)}; --import loads a module of your own"
            problem = f"{method.goals}: no such source of goals; {hint}"
            raise ScenarioError(source, f"methods.{key}.goals", problem)
        for base in study.bases.values():
            with_fields(base, method.overrides, f"{source}: methods.{key}.overrides")
    known = {"measures": MEASURES, "figures": config.measures}
    for key, names in known.items():
        for name in getattr(config, key):
            if name not in names:
                raise ScenarioError(source, key, f"{name}: {nearest(name, names)}")
    for test in config.tests:
        for name in (test.method, *test.against):
            if name not in study.methods:
                raise ScenarioError(source, "tests", f"{name}: {nearest(name, study.methods)}")
        if test.measure not in config.measures:
            raise ScenarioError(source, "tests", f"{test.measure} is not in measures")
    points = len(study.chosen[0]) * len(study.chosen[1]) * config.seeds
    for axis in study.grid:
        points *= len(axis.changes)
    if points > MOST_RUNS:
        problem = f"{points} runs are too many; at most {MOST_RUNS} can be made"
        raise ScenarioError(source, "", problem)


def _check_seeds(config: StudyConfig, source: str) -> None:
    seeds, first = config.seeds, config.first_seed
    check_mapping(source, "", {"seeds": seeds, "first_seed": first}, StudyConfig)
    if (last := first + seeds - 1) > MAX_SEED:
        problem = f"{first} is too large: the last of {seeds} seeds would be {last}, not at most"
        raise ScenarioError(source, "first_seed", f"{problem} {MAX_SEED}")


def _check_closing_times(study: Study, key: str, condition: Condition) -> None:
    """Checks the closing times of a condition, with its scenario where nothing changes it."""
    source, base = study.source, study.bases[key]
    own, shared = condition.closing_times, study.config.closing_times
    where = f"conditions.{key}.closing_times" if own else "closing_times"
    if not (times := own or shared):
        return
    if times != sorted(times):
        raise ScenarioError(source, where, f"{times}: sort them")
    if "held" not in study.config.measures:
        raise ScenarioError(source, "measures", "lack held, which a study with closing times needs")
    axes: list[Axis] = [*study.grid, *study.random[key]]
    changed = [field for axis in axes for field in axis.fields]
    for method in study.methods.values():
        changed += [f for f, value in walk(method.overrides) if not isinstance(value, Mapping)]
    if not base["hand"].get("file") and not any(overlap(field, "hand.file") for field in changed):
        name = condition.scenario or study.config.scenario
        raise ScenarioError(source, where, f"{times}: the scenario {name} has no hand that closes")
    if not any(overlap(field, "planner.period") for field in changed):
        check_at_ticks(times, base["planner"]["period"], source, where)


def check_at_ticks(times: Sequence[float], period: float, source: str, key: str) -> None:
    """Checks that closing times are ticks of the planner.

    Args:
        times: Closing times in seconds.
        period: Period of the planner in seconds.
        source: File of the study, for the message.
        key: Key of the times, for the message.

    Raises:
        ScenarioError: If a time is between two ticks.
    """
    for time in times:
        if tick_index(time, period) != first_tick(time, period):
            problem = f"{time} s is between two ticks of the planner; take a multiple of its period"
            raise ScenarioError(source, key, f"{problem}, {period} s")


def _check_plain(source: str, data: Any) -> None:
    """Rejects YAML types that no field of a scenario has: dates, bytes, sets."""
    for path, part in walk(data):
        for scalar in part if isinstance(part, Mapping) else [part]:
            if not isinstance(scalar, str | int | float | list | None):
                problem = f"{scalar!r} must be a number, a text, true, false, a list or a mapping"
                raise ScenarioError(source, path, problem)


def _find(name_or_file: str) -> Path:
    file, shipped = Path(name_or_file), shipped_studies()
    if file.suffix in (".yaml", ".yml"):
        return file
    if name_or_file not in shipped:
        hint = nearest(name_or_file, shipped, "give a file that ends in .yaml, or one of")
        raise ScenarioError("", name_or_file, f"no such study; {hint}")
    return shipped[name_or_file]


def _resolve_file(config: StudyConfig, file: Path, folders: Sequence[str]) -> None:
    if config.file:
        try:
            config.file = str(resolve_path(config.file, file.parent))
            check_inside(Path(config.file), [file.parent, *map(Path, folders)])
        except InvalidArgumentError as error:
            raise ScenarioError(str(file), "file", str(error)) from error
        config.scenario = config.scenario or only_name(config.file)


def study_data(config: StudyConfig) -> dict[str, Any]:
    """Returns the content of a study's file with every key, the inverse of loading it."""
    return dataclasses.asdict(config)
