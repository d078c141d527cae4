"""What the numbers of a run depend on besides its scenario."""

import functools
import importlib.metadata
import platform
from pathlib import Path
from typing import Any

from drake_pregrasp.kernels import numba_is_installed
from drake_pregrasp.resources import resource_folder
from drake_pregrasp.studies.file_digest import digest_files
from drake_pregrasp.version import __version__

_FLOORS = ("planning", "robots", "systems", "diagrams", "simulation", "studies/sweep")
_LIBRARIES = ("drake", "numpy", "scipy", "trimesh")


@functools.cache
def package_digest() -> dict[str, str]:
    """Returns versions of this package and of what it computes with, and a source digest.

    Two processes whose digests are alike give the same rows.
    """
    folder = Path(__file__).parents[2]
    files = [file for floor in _FLOORS for file in sorted((folder / floor).rglob("*.py"))]
    models = sorted(file for file in resource_folder("models").rglob("*") if file.is_file())
    libraries = (*_LIBRARIES, *(["numba"] if numba_is_installed() else []))
    return {
        "drake_pregrasp": __version__,
        "source": digest_files(files + models),
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in libraries},
    }


def differences(theirs: Any, ours: dict[str, str]) -> str:
    """Returns what differs between two of them, in words; nothing if they are alike."""
    names = [name for name in {**theirs, **ours} if theirs.get(name) != ours.get(name)]
    return ", ".join(f"{name} {theirs.get(name)} instead of {ours.get(name)}" for name in names)
