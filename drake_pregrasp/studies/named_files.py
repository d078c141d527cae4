"""Digests of the files that a study's rows depend on."""

import contextlib
import dataclasses
from collections.abc import Iterator, Mapping
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
from drake_pregrasp.simulation.schema_check import load_checked
from drake_pregrasp.studies.field_path import with_fields
from drake_pregrasp.studies.package_digest import digest_files
from drake_pregrasp.studies.study_file import Study


def named_files(study: Study) -> dict[str, str]:
    """Returns digests of all files that rows depend on, by their absolute paths.

    These are the files named by the scenarios, the changed values, a hand's description and its
    model, and the buffers of a mesh. Shipped files are left out, as they are part of the package's
    digest, and so are files that cannot be read, as a run that needs one has no row.
    """
    allowed = [study.folder, *map(Path, study.folders)]
    found: set[Path] = set()
    for condition, base in study.bases.items():
        every: list[Mapping[str, Any]] = [{}, study.config.otherwise]
        every += [change for axis in study.grid for change in axis.changes.values()]
        every += [method.overrides for method in study.methods.values()]
        for axis in study.random[condition]:
            every += [dict.fromkeys(axis.fields, value) for value in axis.arguments]
        for changes in every:
            # A run with invalid values or files fails with this error.
            with contextlib.suppress(ScenarioError, InvalidArgumentError):
                data = with_fields(base, changes, study.source)
                found |= _files_of(load_checked(study.source, "", data, Scenario()), study, allowed)
    for mesh in [path for path in found if path.suffix.lower() == ".gltf"]:
        with contextlib.suppress(InvalidArgumentError):
            found.update(companions(mesh))
    digests = {}
    for path in sorted(found):
        with contextlib.suppress(OSError):
            if path.is_file() and path.stat().st_size <= MAX_BYTES:  # No valid file is larger.
                digests[str(path)] = digest_files([path])
    return digests


def _files_of(scenario: Scenario, study: Study, allowed: list[Path]) -> set[Path]:
    make_paths_absolute(scenario, study.folder, allowed=allowed, source=study.source)
    found, hand = set(map(Path, _paths(scenario))), scenario.hand_file
    if _is_file(hand):
        model = load_hand(hand, folders=allowed).model
        if _is_file(model):
            found.update(checked_model(model_path(model), [Path(hand).parent, *allowed]).files)
    return found


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
