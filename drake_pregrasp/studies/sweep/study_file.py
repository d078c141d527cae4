"""Sweeps from YAML files, and the files that rows depend on."""

import contextlib
import dataclasses
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drake_pregrasp.diagrams.hand_parsing import model_path
from drake_pregrasp.diagrams.model_files import checked_model
from drake_pregrasp.errors import InvalidArgumentError, ScenarioError
from drake_pregrasp.estimation.recorded_poses import MAX_BYTES
from drake_pregrasp.geometry.meshes import companions
from drake_pregrasp.resources import (
    check_inside,
    make_paths_absolute,
    resolve_path,
    resource_folder,
)
from drake_pregrasp.simulation.hand_file import load_hand
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import (
    load_scenario,
    only_name,
    read_mapping,
    scenario_data,
    scenario_from_data,
)
from drake_pregrasp.simulation.schema_check import check_mapping
from drake_pregrasp.simulation.yaml_text import load_typed
from drake_pregrasp.studies.package_digest import digest_files
from drake_pregrasp.studies.sweep.field_path import walk, with_fields
from drake_pregrasp.studies.sweep.measures import DEFAULT_MEASURES, MEASURES
from drake_pregrasp.studies.sweep.sweep_plan import SweepPlan, grid_axis, random_axis
from drake_pregrasp.systems.pose_sensor import MAX_SEED


@dataclass
class StudyConfig:
    """The keys of a sweep's file. docs/sweeps.md shows how the parts are used together."""

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

    # Number of samples for each combination of the grid, the same samples for all.
    samples: int = field(default=1, metadata={"at_least": 1, "at_most": 1_000_000})

    # Seed of the samples.
    sampling_seed: int = field(default=0, metadata={"at_least": 0, "at_most": MAX_SEED})

    # Number of values of `random_seed` that each point is run with, the same for all points.
    seeds: int = field(default=1, metadata={"at_least": 1, "at_most": 1_000_000})

    # The first of them.
    first_seed: int = field(default=0, metadata={"at_least": 0, "at_most": MAX_SEED})

    # The numbers that a row has, by their names in measures.py.
    measures: list[str] = field(
        default_factory=lambda: list(DEFAULT_MEASURES),
        metadata={"min_length": 1, "one_of": tuple(MEASURES)},
    )


@dataclass(frozen=True)
class Study:
    """A sweep, ready to be run.

    Attributes:
        name: Name of its folder and its report.
        source: The file, for messages.
        folder: Folder at which relative paths in swept values start.
        folders: Folders that may hold files, besides that folder.
        config: Keys of the file, with defaults.
        scenario: Data of the scenario without the swept values, from `scenario_data`.
        plan: Plan of the runs.
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
        """The file with every key, those of the scenario in `overrides`: a study of its own."""
        keys = {**vars(self.config), "file": "", "overrides": self.scenario}
        # With all keys overridden, any scenario will do, and no other file is needed.
        return {**keys, "scenario": "a_base"} if self.config.file else keys

    @property
    def settings(self) -> dict[str, Any]:
        """All of the file that rows depend on, the order of axes and labels included."""
        beside = ("description", "scenario", "file")
        settings = {key: value for key, value in self.resolved.items() if key not in beside}
        grid = [[axis.name, *map(str, axis.labels)] for axis in self.plan.grid]
        return {**settings, "order": [*grid, *(axis.name for axis in self.plan.random)]}


def shipped_studies() -> dict[str, Path]:
    """Returns the files of the shipped sweeps by their names."""
    files = sorted((resource_folder("scenarios") / "sweeps").glob("*.yaml"))
    return {file.stem: file for file in files}


def load_study(name_or_file: str, folders: Sequence[str] = ()) -> Study:
    """Loads a sweep and checks all but its values, which are checked when they are run.

    Args:
        name_or_file: Name of a shipped one, or a YAML file.
        folders: Folders that may hold files which the study names, besides its own folder.

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
    changed = with_fields(base, config.overrides, f"{source}: overrides")
    base = scenario_data(
        scenario_from_data(changed, source=source, folder=file.parent, folders=folders)
    )
    plan = SweepPlan(
        tuple(grid_axis(str(name), v, base, source) for name, v in config.grid.items()),
        tuple(random_axis(str(name), v, base, source) for name, v in config.random.items()),
        config.samples,
        config.sampling_seed,
        range(config.first_seed, config.first_seed + config.seeds),
    )
    plan.check(source, ["index", "seed", "error", *MEASURES])
    absolute = tuple(str(Path(folder).resolve()) for folder in folders)
    return Study(file.stem, source, file.parent.resolve(), absolute, config, base, plan)


def _check_plain(source: str, key: str, value: Any) -> None:
    """Refuses what YAML has, and no field of a scenario: dates, bytes, sets."""
    for path, part in walk(value, key):
        for scalar in part if isinstance(part, Mapping) else [part]:
            if not isinstance(scalar, str | int | float | list | None):
                problem = f"{scalar!r} must be a number, a text, true, false, a list or a mapping"
                raise ScenarioError(source, path, problem)


def _find(name_or_file: str) -> Path:
    file = Path(name_or_file)
    if file.suffix in (".yaml", ".yml"):
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


def named_files(study: Study) -> dict[str, str]:
    """Returns digests of all files that rows depend on, by their absolute paths.

    Those are the files that the scenario and the swept values name, those that a hand's
    description and its model name, and the buffers of a mesh. Shipped ones are left out, as the
    package's digest has them, and those that cannot be read, as a run that needs one has no row.
    """
    allowed = [study.folder, *map(Path, study.folders)]
    found: set[Path] = set()
    every: list[Mapping[str, Any]] = [{}, *(c for axis in study.plan.grid for c in axis.changes)]
    for axis in study.plan.random:
        every += [dict.fromkeys(axis.fields, value) for value in axis.arguments]
    for changes in every:
        # A run that needs what cannot be used fails with this error.
        with contextlib.suppress(ScenarioError, InvalidArgumentError):
            data = with_fields(study.scenario, changes, study.source)
            check_mapping(study.source, "", data, Scenario)
            scenario: Scenario = load_typed(Scenario, data, Scenario())
            make_paths_absolute(scenario, study.folder, allowed=allowed, source=study.source)
            found.update(map(Path, _paths(scenario)))
            hand = scenario.grasp.hand
            model = load_hand(hand, folders=allowed).model if _is_file(hand) else ""
            if _is_file(model):
                found.update(checked_model(model_path(model), [Path(hand).parent, *allowed]).files)
    for mesh in [path for path in found if path.suffix.lower() == ".gltf"]:
        with contextlib.suppress(InvalidArgumentError):
            found.update(companions(mesh))
    digests = {}
    for path in sorted(found):
        with contextlib.suppress(OSError):
            if path.is_file() and path.stat().st_size <= MAX_BYTES:  # None that counts is larger.
                digests[str(path)] = digest_files([path])
    return digests


def _paths(config: object) -> Iterator[str]:
    for f in dataclasses.fields(config) if dataclasses.is_dataclass(config) else ():
        value = getattr(config, f.name)
        if f.metadata.get("path"):
            yield from filter(_is_file, [value])
        else:
            for part in value if isinstance(value, list) else [value]:
                yield from _paths(part)


def _is_file(text: str) -> bool:
    return bool(text) and "://" not in text
