"""Checked copies of hands' models, and of Drake model directives that name several of them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from drake_pregrasp.config.yaml_text import dump_yaml, parse_yaml, read_text
from drake_pregrasp.diagrams.model_files import (
    MAX_FILES,
    MAX_OTHERS,
    CheckedModel,
    Totals,
    checked_model,
    written_copy,
)
from drake_pregrasp.diagrams.package_files import find_packages, located
from drake_pregrasp.errors import InvalidArgumentError, ScenarioError
from drake_pregrasp.resources import check_inside, file_url, real_path, resource_folder
from drake_pregrasp.robots.robot_models import ROBOTS_URL, cache_folder, robot_model

YAML = (".yaml", ".yml")
"""Suffixes of files with model directives, and of descriptions of hands."""

DIRECTIVES = tuple(f".dmd{suffix}" for suffix in YAML)
"""Ends of the names of files with model directives."""

DIRECTIVES_KIND = "dmd.yaml"
"""Name of model directives' format for Drake's parser."""

_ROOT = Path("/")


def checked_copy(file: Path, folders: Sequence[Path] | None = None) -> CheckedModel:
    """Returns a checked copy of a model, or of model directives whose files are checked copies.

    Models that this package ships or has made are read by directives as they are, except MJCF.

    Args:
        file: Path of an SDF, a URDF, an MJCF or model directives, or of a hand's description whose
            `model` is a list of directives.
        folders: Folders that the file may be in, or below; None for any folder. The files that it
            names may also be in the packages of `find_packages`.

    Raises:
        InvalidArgumentError: If a file is elsewhere, is too large, or cannot be read.
    """
    allowed = [_ROOT] if folders is None else list(folders)
    check_inside(file, allowed)
    allowed += find_packages(file).values()
    totals = Totals()
    if file.suffix in YAML:
        text = _copied_directives(file, allowed, totals)
        copy = CheckedModel(text, DIRECTIVES_KIND, tuple(totals.files), tuple(totals.left_out))
    else:
        copy = checked_model(file, allowed, totals)
    for found in copy.files:
        check_inside(found, allowed)
    return copy


def is_own(model: Path) -> bool:
    """Returns whether a model is shipped with this package, or was made by it."""
    own = (resource_folder("models"), cache_folder())
    return any(model.resolve().is_relative_to(folder.resolve()) for folder in own)


def needs_copy(model: Path) -> bool:
    """Returns whether Drake's parser reads a copy of a model: not of this package's SDF or URDF."""
    return not (is_own(model) and model.suffix in (".sdf", ".urdf"))


def _copied_directives(file: Path, allowed: Sequence[Path], totals: Totals) -> str:
    """Returns directives that name copies only, and adds what they name to the totals."""
    check_inside(file, allowed)
    if file in totals.files:
        raise InvalidArgumentError(f"model: {file} is named twice")
    totals.files.append(file)
    try:
        data = parse_yaml(str(file), read_text(file))
    except ScenarioError as error:
        raise InvalidArgumentError(f"model: {error}") from error
    # A file of directives only, or the description of a hand.
    key = "directives" if file.name.endswith(DIRECTIVES) else "model"
    copies = []  # And no changes in place, because aliases share mappings.
    for directive in _directives(data, key, file):
        copies.append(dict(directive))
        for kind, content in directive.items():
            try:
                copies[-1][kind] = _copied_content(content, file, allowed, totals)
            except InvalidArgumentError as error:
                raise InvalidArgumentError(f"model: {file}: {kind}: {error}") from error
    others = data if key == "directives" else {}
    return dump_yaml({**others, "directives": copies})


def _directives(data: Any, key: str, file: Path) -> list[dict[Any, Any]]:
    directives = data.get(key) if isinstance(data, dict) else None
    if isinstance(directives, list) and all(isinstance(one, dict) for one in directives):
        return directives
    raise InvalidArgumentError(f"model: {file}: {key}: it must be a list of mappings")


def _copied_content(content: Any, file: Path, allowed: Sequence[Path], totals: Totals) -> Any:
    """Returns the content of a directive, which names a copy if it names a file."""
    totals.add("directives", MAX_OTHERS)
    if not isinstance(content, dict):
        raise InvalidArgumentError("it must be a mapping, such as {file: hand.sdf}")
    if "file" not in content:
        return content
    return {**content, "file": _copied_file(str(content["file"]), file, allowed, totals)}


def _copied_file(name: str, source: Path, allowed: Sequence[Path], totals: Totals) -> str:
    """Returns the URL of the copy of a file that directives name."""
    totals.add("files", MAX_FILES)
    if name.startswith(ROBOTS_URL):
        return file_url(robot_model(name))
    path = real_path(source.parent / located(name, find_packages(source)))
    if not needs_copy(path):
        return file_url(path)
    if path.name.endswith(DIRECTIVES):
        copy = CheckedModel(_copied_directives(path, allowed, totals), DIRECTIVES_KIND, (), ())
    else:
        copy = checked_model(path, allowed, totals)
    return file_url(written_copy(copy))
