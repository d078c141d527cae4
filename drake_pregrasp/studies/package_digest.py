"""Versions and a digest of the source code, which identify the code that made a study's rows."""

import hashlib
import importlib
import importlib.metadata
import platform
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from drake_pregrasp.resources import resource_folder
from drake_pregrasp.version import __version__

_PACKAGE = Path(__file__).parents[1]
_LEFT_OUT = ("cli", "studies")  # Of the studies, only the given modules count.
_LIBRARIES = ("drake", "numpy", "scipy", "trimesh", "numba")


def digest_files(files: Iterable[Path]) -> str:
    """Returns a digest of the contents of files in the given order."""
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def package_digest(*modules: str) -> dict[str, str]:
    """Returns the versions of this package and its libraries, and a digest of the source.

    Two processes whose digests are equal compute the same rows.

    Args:
        modules: Names of the studies' modules that the rows depend on.
    """
    files = [
        file
        for file in sorted(_PACKAGE.rglob("*.py"))
        if file.relative_to(_PACKAGE).parts[0] not in _LEFT_OUT
    ]
    files += [Path(str(importlib.import_module(name).__file__)) for name in sorted(set(modules))]
    # Modules read data files beside them.
    files += sorted({data for file in files for data in file.parent.glob("*.yaml")})
    files += sorted(file for file in resource_folder("models").rglob("*") if file.is_file())
    versions = {}
    for library in _LIBRARIES:
        try:
            versions[library] = importlib.metadata.version(library)
        except importlib.metadata.PackageNotFoundError:
            continue  # Optional library.
    return {
        "drake_pregrasp": __version__,
        "source": digest_files(files),
        "python": platform.python_version(),
        **versions,
    }


def differing_names(theirs: Mapping[str, Any], ours: Mapping[str, Any]) -> list[str]:
    """Returns the names, in their order, whose values differ or that only one mapping has."""
    return [name for name in sorted({*theirs, *ours}) if theirs.get(name) != ours.get(name)]


def differences(theirs: Any, ours: Mapping[str, str]) -> str:
    """Describes the differences of two package digests; empty if they are equal."""
    return ", ".join(
        f"{name} {theirs.get(name)} instead of {ours.get(name)}"
        for name in differing_names(theirs, ours)
    )
