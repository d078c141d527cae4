"""Paths in scenarios, made absolute, so that a run folder's scenario runs again from anywhere."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from drake_pregrasp.errors import InvalidArgumentError, ScenarioError
from drake_pregrasp.resources import check_inside, resolve_path


def make_paths_absolute(
    config: object,
    folder: Path,
    *,
    allowed: Sequence[Path] | None = None,
    source: str = "scenario",
    key: str = "",
) -> None:
    """Makes every path in a configuration absolute, in place; URLs stay.

    Args:
        config: A dataclass. Its paths are the texts whose fields have the metadata `path`.
        folder: Where relative paths start; see `resolve_path`.
        allowed: Folders that files may be in, or below. None: anywhere.
        source: Where the configuration is from, for the message.
        key: Dotted path of the configuration in it.

    Raises:
        ScenarioError: If a file is elsewhere, or a text can't be the name of one.
    """
    for f in dataclasses.fields(config) if dataclasses.is_dataclass(config) else ():
        value = getattr(config, f.name)
        path = f"{key}.{f.name}" if key else f.name
        if f.metadata.get("path"):
            if value and "://" not in value:
                setattr(config, f.name, _absolute(value, folder, allowed, source, path))
        else:
            for part in value if isinstance(value, list) else [value]:
                make_paths_absolute(part, folder, allowed=allowed, source=source, key=path)


def _absolute(
    text: str, folder: Path, allowed: Sequence[Path] | None, source: str, key: str
) -> str:
    try:
        path = resolve_path(text, folder)
        if allowed is not None:
            check_inside(path, allowed)
    except InvalidArgumentError as error:
        raise ScenarioError(source, key, str(error)) from error
    return str(path)
