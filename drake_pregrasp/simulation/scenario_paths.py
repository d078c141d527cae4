"""Paths in scenarios, made absolute, so that a run folder's scenario runs again from anywhere."""

import dataclasses
from pathlib import Path

from drake_pregrasp.resources import resolve_path


def make_paths_absolute(config: object, folder: Path) -> None:
    """Makes every path in a configuration absolute, in place; URLs stay.

    Args:
        config: A dataclass. Its paths are the texts whose fields have the metadata `path`.
        folder: Where relative paths start; see `resolve_path`.
    """
    for f in dataclasses.fields(config) if dataclasses.is_dataclass(config) else ():
        value = getattr(config, f.name)
        if f.metadata.get("path"):
            if value and "://" not in value:
                setattr(config, f.name, str(resolve_path(value, folder)))
        else:
            for part in value if isinstance(value, list) else [value]:
                make_paths_absolute(part, folder)
