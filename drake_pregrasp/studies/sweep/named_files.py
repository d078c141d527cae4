"""Digests of the files that the scenarios of a sweep name."""

import copy
import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from drake_pregrasp.diagrams.hand_parsing import model_path
from drake_pregrasp.diagrams.model_files import checked_model
from drake_pregrasp.errors import InvalidArgumentError, ScenarioError
from drake_pregrasp.estimation.recorded_poses import MAX_BYTES
from drake_pregrasp.geometry.meshes import companions
from drake_pregrasp.resources import make_paths_absolute
from drake_pregrasp.simulation.hand_file import load_hand
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.schema_check import check_mapping
from drake_pregrasp.simulation.yaml_text import load_typed
from drake_pregrasp.studies.file_digest import digest_files
from drake_pregrasp.studies.sweep.field_path import set_field
from drake_pregrasp.studies.sweep.plan import SweepPlan
from drake_pregrasp.studies.sweep.study_file import Study


def named_files(study: Study) -> dict[str, str]:
    """Returns digests of all files that rows depend on, by their absolute paths.

    Those are what the scenario and the swept values name, what a hand's description and its model
    name, and the buffers of a mesh. Shipped ones are left out: the package's digest has them. So
    are those that can't be read: a run that needs one leaves no row.
    """
    allowed = [study.folder, *map(Path, study.folders)]
    found: set[Path] = set()
    for changes in [{}, *_changes(study.plan)]:
        data = copy.deepcopy(study.scenario)
        try:
            for path, value in changes.items():
                set_field(data, path, value, study.source)
            check_mapping(study.source, "", data, Scenario)
            scenario: Scenario = load_typed(Scenario, data, Scenario())
            make_paths_absolute(scenario, study.folder, allowed=allowed, source=study.source)
        except ScenarioError:
            continue  # Its runs will say so.
        found.update(Path(text) for text in _paths(scenario))
        found.update(_hand_files(scenario.grasp.hand, allowed))
    for mesh in [path for path in found if path.suffix.lower() == ".gltf"]:
        found.update(_buffers(mesh))
    digests = {str(path): _digest(path) for path in sorted(found)}
    return {path: digest for path, digest in digests.items() if digest}


def _changes(plan: SweepPlan) -> Iterator[Mapping[str, Any]]:
    """Yields what the axes set, where that can name a file."""
    every: list[Mapping[str, Any]] = [change for axis in plan.grid for change in axis.changes]
    for axis in plan.random:
        every += [dict.fromkeys(axis.fields, value) for value in axis.arguments]
    for change in every:
        if any(isinstance(value, str | list | Mapping) for value in change.values()):
            yield change


def _paths(config: object) -> Iterator[str]:
    for f in dataclasses.fields(config) if dataclasses.is_dataclass(config) else ():
        value = getattr(config, f.name)
        if f.metadata.get("path"):
            if _is_file(value):
                yield value
        else:
            for part in value if isinstance(value, list) else [value]:
                yield from _paths(part)


def _is_file(text: str) -> bool:
    return bool(text) and "://" not in text


def _hand_files(hand: str, allowed: Sequence[Path]) -> list[Path]:
    if not _is_file(hand):
        return []
    try:
        model = load_hand(hand, folders=allowed).model
        if not _is_file(model):
            return []
        path = model_path(model)
        return list(checked_model(path, [Path(hand).parent, *allowed]).files)
    except (ScenarioError, InvalidArgumentError):
        return []


def _buffers(mesh: Path) -> list[Path]:
    try:
        return companions(mesh)
    except InvalidArgumentError:
        return []


def _digest(path: Path) -> str:
    """Returns a file's digest; nothing if it is no regular one, or larger than any may be."""
    try:
        if path.is_file() and path.stat().st_size <= MAX_BYTES:
            return digest_files([path])
    except OSError:
        pass
    return ""
