"""Drake model directives of hands, copied with checked copies of the models that they name."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from drake_pregrasp.config.yaml_text import dump_yaml, parse_yaml, read_text
from drake_pregrasp.diagrams.model_files import CheckedModel, checked_model, written_copy
from drake_pregrasp.diagrams.package_files import find_packages, located
from drake_pregrasp.errors import InvalidArgumentError, ScenarioError
from drake_pregrasp.resources import check_inside, real_path, resource_folder
from drake_pregrasp.robots.robot_models import ROBOTS_URL, cache_folder, robot_model

DIRECTIVES = ".dmd.yaml"
"""End of the names of files with model directives."""

MAX_FILES = 20
"""Largest number of files that directives name."""

_KIND = DIRECTIVES.removeprefix(".")  # As Drake's parser calls them.
_ROOT = Path("/")


def checked_copy(file: Path, folders: Sequence[Path] | None = None) -> CheckedModel:
    """Returns a checked copy of a model, or of model directives whose files are checked copies.

    Models that this package ships or has made are read as they are, except MJCF.

    Args:
        file: Path of an SDF, a URDF, an MJCF or model directives.
        folders: Folders that files may be in, as for `checked_model`.

    Raises:
        InvalidArgumentError: If a file is elsewhere, is too large, or cannot be read.
    """
    if not file.name.endswith(DIRECTIVES):
        return checked_model(file, folders)
    files: list[Path] = []
    text = _copied_directives(file, folders, files)
    return CheckedModel(text, _KIND, tuple(files))


def is_own(model: Path) -> bool:
    """Returns whether a model is shipped with this package, or was made by it."""
    own = (resource_folder("models"), cache_folder())
    return any(model.resolve().is_relative_to(folder.resolve()) for folder in own)


def _copied_directives(file: Path, folders: Sequence[Path] | None, files: list[Path]) -> str:
    """Returns directives that name copies only, and appends the files that were read."""
    packages = find_packages(file)
    allowed = [_ROOT] if folders is None else [*folders, *packages.values()]
    check_inside(file, allowed)
    if file in files or len(files) > MAX_FILES:
        raise InvalidArgumentError(f"model: {file} is named twice, or beside {MAX_FILES} others")
    files.append(file)
    try:
        data = parse_yaml(str(file), read_text(file))
    except ScenarioError as error:
        raise InvalidArgumentError(f"model: {error}") from error
    for directive in _directives(data, file):
        for kind, content in directive.items():
            if not isinstance(content, dict) or "file" not in content:
                continue
            try:
                content["file"] = _copied_file(str(content["file"]), file, packages, folders, files)
            except InvalidArgumentError as error:
                raise InvalidArgumentError(f"model: {file}: {kind}: {error}") from error
    return dump_yaml(data)


def _directives(data: Any, file: Path) -> list[dict[Any, Any]]:
    directives = data.get("directives") if isinstance(data, dict) else None
    if isinstance(directives, list) and all(isinstance(one, dict) for one in directives):
        return directives
    raise InvalidArgumentError(f"model: {file}: directives: it must be a list of mappings")


def _copied_file(
    name: str,
    source: Path,
    packages: dict[str, Path],
    folders: Sequence[Path] | None,
    files: list[Path],
) -> str:
    """Returns the URL of the copy of a file that directives name."""
    if name.startswith(ROBOTS_URL):
        return robot_model(name).as_uri()
    path = real_path(source.parent / located(name, packages))
    if is_own(path) and path.suffix in (".sdf", ".urdf"):
        return path.as_uri()
    if path.name.endswith(DIRECTIVES):
        copy = CheckedModel(_copied_directives(path, folders, files), _KIND, ())
    else:
        copy = checked_model(path, folders)
        files += [found for found in copy.files if found not in files]
    return written_copy(copy).as_uri()
