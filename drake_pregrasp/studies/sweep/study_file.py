"""Sweeps from YAML files, and digests of the files that their rows depend on."""

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
from drake_pregrasp.simulation.schema_check import check_mapping, load_checked
from drake_pregrasp.studies.package_digest import digest_files
from drake_pregrasp.studies.sweep.field_path import walk, with_fields
from drake_pregrasp.studies.sweep.measures import DEFAULT_MEASURES, MEASURES
from drake_pregrasp.studies.sweep.sweep_plan import SweepPlan, grid_axis, random_axis
from drake_pregrasp.systems.pose_sensor import MAX_SEED


@dataclass
class StudyConfig:
    """Schema of a sweep's file. docs/sweeps.md explains its use."""

    # One line of text for the report.
    description: str = ""

    # Common scenario of all runs: the name of a shipped scenario, or of an entry of `file`.
    scenario: str = ""

    # YAML file of the scenario; a relative path starts at this file's folder.
    file: str = field(default="", metadata={"path": True})

    # Changes of the scenario in all runs, as nested keys or by paths.
    overrides: dict[str, Any] = field(default_factory=dict)

    # Axes whose combinations are all run. An entry maps a field's path to a list of values; or it
    # maps a name to labels, and each label to paths and their values, which change together.
    grid: dict[str, Any] = field(default_factory=dict)

    # Axes that each sample draws at random. An entry maps a field's path to `uniform: [a, b]`,
    # `log_uniform: [a, b]`, `integer: [a, b]` or `choice: [...]`. With `fields: [...]`, it maps a
    # name to several fields with the same value.
    random: dict[str, Any] = field(default_factory=dict)

    # Number of samples for each combination of the grid; all combinations have the same samples.
    samples: int = field(default=1, metadata={"at_least": 1, "at_most": 1_000_000})

    # Seed of the samples.
    sampling_seed: int = field(default=0, metadata={"at_least": 0, "at_most": MAX_SEED})

    # Number of values of `random_seed` for each point; all points have the same seeds.
    seeds: int = field(default=1, metadata={"at_least": 1, "at_most": 1_000_000})

    # First value of `random_seed`.
    first_seed: int = field(default=0, metadata={"at_least": 0, "at_most": MAX_SEED})

    # Measures in each row, by their names in measures.py.
    measures: list[str] = field(
        default_factory=lambda: list(DEFAULT_MEASURES),
        metadata={"min_length": 1, "one_of": tuple(MEASURES)},
    )


@dataclass(frozen=True)
class Study:
    """A loaded sweep.

    Attributes:
        name: Name of the sweep's folder and report.
        source: File of the sweep, for messages.
        folder: Folder at which relative paths in swept values start.
        folders: Further folders that may hold named files.
        config: Content of the file, with defaults.
        scenario: Common scenario of all runs, as `scenario_data` returns it.
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
        """Content of an equivalent file with every key, and the whole scenario in `overrides`."""
        keys = {**vars(self.config), "file": "", "overrides": self.scenario}
        # With all keys overridden, any shipped scenario serves, and no other file is needed.
        return {**keys, "scenario": "a_base"} if self.config.file else keys

    @property
    def settings(self) -> dict[str, Any]:
        """Settings on which the rows depend, including the order of axes and labels."""
        beside = ("description", "scenario", "file")
        settings = {key: value for key, value in self.resolved.items() if key not in beside}
        grid = [[axis.name, *map(str, axis.labels)] for axis in self.plan.grid]
        return {**settings, "order": [*grid, *(axis.name for axis in self.plan.random)]}


def shipped_studies() -> dict[str, Path]:
    """Returns the files of the shipped sweeps, by their names."""
    files = sorted((resource_folder("scenarios") / "sweeps").glob("*.yaml"))
    return {file.stem: file for file in files}


def load_study(name_or_file: str, folders: Sequence[str] = ()) -> Study:
    """Loads and checks a sweep. Its swept values are checked when they are run.

    Args:
        name_or_file: Name of a shipped sweep, or path of a YAML file.
        folders: Further folders that may hold named files, besides the sweep's own folder.

    Raises:
        ScenarioError: If the sweep is invalid; the message names file, key and value.
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
    # A scenario's file in a subfolder may name files beside the study.
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
    """Rejects YAML types that no field of a scenario has: dates, bytes, sets."""
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
        raise ScenarioError(str(file), "scenario", "is missing; name the scenario to sweep")


def named_files(study: Study) -> dict[str, str]:
    """Returns digests of all files that rows depend on, by their absolute paths.

    These are the files named by the scenario, the swept values, a hand's description and its
    model, and the buffers of a mesh. Shipped files are left out, as they are part of the package's
    digest, and so are files that cannot be read, as a run that needs one has no row.
    """
    allowed = [study.folder, *map(Path, study.folders)]
    found: set[Path] = set()
    every: list[Mapping[str, Any]] = [{}, *(c for axis in study.plan.grid for c in axis.changes)]
    for axis in study.plan.random:
        every += [dict.fromkeys(axis.fields, value) for value in axis.arguments]
    for changes in every:
        # A run with invalid values or files fails with this error.
        with contextlib.suppress(ScenarioError, InvalidArgumentError):
            data = with_fields(study.scenario, changes, study.source)
            scenario = load_checked(study.source, "", data, Scenario())
            make_paths_absolute(scenario, study.folder, allowed=allowed, source=study.source)
            found.update(map(Path, _paths(scenario)))
            hand = scenario.hand_file
            model = load_hand(hand, folders=allowed).model if _is_file(hand) else ""
            if _is_file(model):
                found.update(checked_model(model_path(model), [Path(hand).parent, *allowed]).files)
    for mesh in [path for path in found if path.suffix.lower() == ".gltf"]:
        with contextlib.suppress(InvalidArgumentError):
            found.update(companions(mesh))
    digests = {}
    for path in sorted(found):
        with contextlib.suppress(OSError):
            if path.is_file() and path.stat().st_size <= MAX_BYTES:  # No valid file is larger.
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
