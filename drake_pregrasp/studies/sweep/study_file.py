"""Sweeps from YAML files."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drake_pregrasp.errors import InvalidArgumentError, ScenarioError
from drake_pregrasp.resources import check_inside, resolve_path, resource_folder
from drake_pregrasp.simulation.scenario_file import (
    load_scenario,
    only_name,
    read_mapping,
    scenario_data,
    scenario_from_data,
)
from drake_pregrasp.simulation.schema_check import check_mapping
from drake_pregrasp.studies.sweep.field_path import set_field
from drake_pregrasp.studies.sweep.grid_axis import grid_axis, label_text
from drake_pregrasp.studies.sweep.plan import SweepPlan
from drake_pregrasp.studies.sweep.random_axis import random_axis
from drake_pregrasp.studies.sweep.study_config import StudyConfig

_ENDINGS = (".yaml", ".yml")
_ANY = "a_base"


@dataclass(frozen=True)
class Study:
    """A sweep, ready to be run.

    Attributes:
        name: Of its folder and its report.
        source: Where it is from, for messages.
        folder: Where relative paths in swept values start.
        folders: Where files may be, beside that.
        config: Its file, with defaults.
        scenario: What all runs start from, as `scenario_data` has it.
        plan: The runs.
    """

    name: str
    source: str
    folder: Path
    folders: tuple[str, ...]
    config: StudyConfig
    scenario: dict[str, Any]
    plan: SweepPlan

    @property
    def resolved(self) -> dict[str, Any]:
        """The file with every key, those of the scenario in `overrides`: a study of its own.

        As they are all there it needs no other file, whichever scenario they override.
        """
        keys = {**vars(self.config), "file": "", "overrides": self.scenario}
        return {**keys, "scenario": _ANY} if self.config.file else keys

    @property
    def settings(self) -> dict[str, Any]:
        """All of it that rows depend on, the order of what is swept included."""
        beside = ("description", "scenario", "file")
        settings = {key: value for key, value in self.resolved.items() if key not in beside}
        grid = [[axis.name, *map(label_text, axis.labels)] for axis in self.plan.grid]
        return {**settings, "order": [*grid, *(axis.name for axis in self.plan.random)]}


def shipped_studies() -> dict[str, Path]:
    """Returns the files of the shipped sweeps by their names."""
    files = sorted((resource_folder("scenarios") / "sweeps").glob("*.yaml"))
    return {file.stem: file for file in files}


def load_study(name_or_file: str, folders: Sequence[str] = ()) -> Study:
    """Loads a sweep and checks all but its values, which are checked when they are run.

    Args:
        name_or_file: Name of a shipped one, or a YAML file.
        folders: Where files that it names may be, beside its own folder.

    Raises:
        ScenarioError: If anything is wrong with it; the message names file, key and value.
    """
    file = _find(name_or_file)
    source = str(file)
    data = read_mapping(file)
    check_mapping(source, "", data, StudyConfig)
    for key in ("overrides", "grid", "random"):
        _check_plain(source, key, data.get(key))
    config = StudyConfig(**data)
    if not re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9_.-]*", file.stem):
        problem = "a study's file is named with letters, digits, '_', '-' and '.'"
        raise ScenarioError("", file.stem, problem)
    _resolve_file(config, file, folders)
    # A scenario's file in a folder below may name files beside the study.
    beside = [str(file.parent), *folders] if config.file else list(folders)
    base = scenario_data(
        load_scenario(config.scenario or None, file=config.file or None, folders=beside)
    )
    for path, value in config.overrides.items():
        set_field(base, str(path), value, f"{source}: overrides")
    base = scenario_data(
        scenario_from_data(base, source=source, folder=file.parent, folders=folders)
    )
    seeds = range(config.first_seed, config.first_seed + config.seeds)
    plan = SweepPlan(
        tuple(grid_axis(str(name), v, base, source) for name, v in config.grid.items()),
        tuple(random_axis(str(name), v, base, source) for name, v in config.random.items()),
        config.samples,
        config.sampling_seed,
        seeds,
    )
    plan.check(source)
    absolute = tuple(str(Path(folder).resolve()) for folder in folders)
    return Study(file.stem, source, file.parent.resolve(), absolute, config, base, plan)


def _check_plain(source: str, key: str, value: Any) -> None:
    """Refuses what YAML has, and no field of a scenario: dates, bytes, sets."""
    if isinstance(value, Mapping):
        for name, part in value.items():
            _check_plain(source, f"{key}.{name}", name)
            _check_plain(source, f"{key}.{name}", part)
    elif isinstance(value, list):
        for index, part in enumerate(value):
            _check_plain(source, f"{key}[{index}]", part)
    elif not isinstance(value, str | int | float | None):
        problem = f"{value!r} must be a number, a text, true, false, a list or a mapping"
        raise ScenarioError(source, key, problem)


def _find(name_or_file: str) -> Path:
    file = Path(name_or_file)
    if file.suffix in _ENDINGS:
        return file
    shipped = shipped_studies()
    if name_or_file not in shipped:
        problem = f"no such sweep; give a file that ends in .yaml, or one of: {', '.join(shipped)}"
        raise ScenarioError("", name_or_file, problem)
    return shipped[name_or_file]


def _resolve_file(config: StudyConfig, file: Path, folders: Sequence[str]) -> None:
    if config.file:
        try:
            config.file = str(resolve_path(config.file, file.parent))
            check_inside(Path(config.file), [file.parent, *map(Path, folders)])
        except InvalidArgumentError as error:
            raise ScenarioError(str(file), "file", str(error)) from error
        config.scenario = config.scenario or only_name(config.file)
    elif not config.scenario:
        raise ScenarioError(str(file), "scenario", "is not there; name the scenario to start from")
