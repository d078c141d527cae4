"""Robots by their names, as URDF files that Drake can use as they are."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.robots.allegro_panda import write_allegro_panda
from drake_pregrasp.robots.model_cache import cached, source_digest
from drake_pregrasp.robots.robot_data import RobotData, find_robot_data

ROBOTS_URL = "robots://"
"""What names of these models start with."""

_Writer = Callable[[RobotData, Path, Callable[[int, int], None]], Path]
_WRITERS: Mapping[str, _Writer] = {"allegro_panda.urdf": write_allegro_panda}


def robot_model(url: str) -> Path:
    """Returns the URDF of a robot; the first time it is made, which takes some seconds.

    It is kept in `cache_folder()`, for the version of the package that it is made from and for the
    way it is made.

    Args:
        url: `ROBOTS_URL` and the robot's name.

    Raises:
        InvalidArgumentError: If there is no such robot, or the package isn't installed.
        OutputError: If the cache can't be written.
    """
    name = url.removeprefix(ROBOTS_URL)
    if name not in _WRITERS:
        there = ", ".join(f"{ROBOTS_URL}{robot}" for robot in _WRITERS)
        raise InvalidArgumentError(f"there is no robot {url}; there are: {there}")
    data = find_robot_data()
    version = f"{Path(name).stem}-{data.version}-{source_digest(Path(__file__).parent)}"

    def make(folder: Path) -> None:
        with _bar(f"converting meshes of {name}") as on_progress:
            _WRITERS[name](data, folder, on_progress)

    return cached(version, make) / name


@contextmanager
def _bar(text: str) -> Iterator[Callable[[int, int], None]]:
    """Shows progress on a terminal."""
    console = Console(stderr=True)
    columns = (TextColumn(text), BarColumn(), TextColumn("{task.completed} of {task.total}"))
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
