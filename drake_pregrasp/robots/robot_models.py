"""URDF files of robots by their names, converted for Drake and cached."""

import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from drake_pregrasp.errors import InvalidArgumentError, OutputError
from drake_pregrasp.robots.robot_data import ROBOTS, find_robot_data, write_robot

_PARTIAL = ".partial-"
_ABANDONED = 3600.0  # Seconds after which an unfinished folder is removed.


def cache_folder() -> Path:
    """Returns the cache of robots, by the XDG Base Directory Specification: `$XDG_CACHE_HOME`."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    root = Path(base) if Path(base).is_absolute() else Path.home() / ".cache"
    return root / "drake_pregrasp" / "robots"


def cached(name: str, make: Callable[[Path], object]) -> Path:
    """Returns the cached folder of a model, and makes it if it does not exist.

    The folder is made atomically, under another name, and renamed at the end. If several processes
    make it at the same time, the first one wins, and all of them return its folder.

    Args:
        name: Name of the model and its version.
        make: Function that fills an empty folder.

    Raises:
        OutputError: If the folder cannot be written.
    """
    parent = cache_folder()
    final = parent / name
    if final.is_dir():
        return final
    try:
        parent.mkdir(parents=True, exist_ok=True)
        _sweep(parent)
        partial = Path(tempfile.mkdtemp(prefix=f"{_PARTIAL}{name}-", dir=parent))
    except OSError as error:
        raise OutputError(f"{parent} cannot be written: {error.strerror}") from error
    try:
        make(partial)
        os.replace(partial, final)
    except OSError as error:
        if not final.is_dir():  # Else another process has been quicker.
            raise OutputError(f"{final} cannot be written: {error.strerror}") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return final


def source_digest(folder: Path) -> str:
    """Returns a short digest of the Python source in a folder."""
    digest = hashlib.sha256()
    for file in sorted(folder.glob("*.py")):
        digest.update(file.name.encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()[:12]


def _sweep(parent: Path) -> None:
    """Removes unfinished folders of killed processes."""
    for partial in parent.glob(f"{_PARTIAL}*"):
        try:
            abandoned = time.time() - partial.stat().st_mtime > _ABANDONED
        except OSError:  # Another process has removed it.
            continue
        if abandoned:
            shutil.rmtree(partial, ignore_errors=True)


ROBOTS_URL = "robots://"
"""Prefix of the names of the robots' models."""


def robot_model(url: str) -> Path:
    """Returns the path of a robot's URDF. The first call converts it, which takes some seconds.

    The URDF is stored in `cache_folder()`, by the version of its package and by a digest of the
    converting code.

    Args:
        url: Name of the robot, after the prefix `ROBOTS_URL`.

    Raises:
        InvalidArgumentError: If there is no such robot, or the package is not installed.
        OutputError: If the cache cannot be written.
    """
    name = url.removeprefix(ROBOTS_URL)
    if name not in ROBOTS:
        there = ", ".join(f"{ROBOTS_URL}{robot}" for robot in ROBOTS)
        raise InvalidArgumentError(f"there is no robot {url}; there are: {there}")
    data = find_robot_data()
    version = f"{Path(name).stem}-{data.version}-{source_digest(Path(__file__).parent)}"

    def make(folder: Path) -> None:
        with _bar(f"converting meshes of {name}") as on_progress:
            write_robot(name, data, folder, on_progress)

    return cached(version, make) / name


@contextmanager
def _bar(text: str) -> Iterator[Callable[[int, int], None]]:
    """Shows a progress bar on a terminal."""
    # Not needed for models that are in the cache.
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    console = Console(stderr=True)
    columns = (TextColumn(text), BarColumn(), TextColumn("{task.completed} of {task.total}"))
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
