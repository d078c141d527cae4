"""An Allegro hand, alone or palm down on the flange of a Panda arm."""

import importlib.metadata
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.robots import urdf_repair
from drake_pregrasp.robots.robot_meshes import convert_meshes

PACKAGE = "example-robot-data"
"""Name of the pip distribution with the models."""

MODELS_URL = f"package://{PACKAGE}/"
"""Prefix of the names of meshes in the distribution's models."""

_LANDMARK = f"{PACKAGE}/package.xml"


@dataclass(frozen=True)
class RobotData:
    """An installed collection of robots.

    Attributes:
        folder: Folder that `MODELS_URL` refers to.
        version: Version of the distribution.
    """

    folder: Path
    version: str

    def find(self, name: str) -> Path:
        """Returns the path of a file by its name, which may start with `MODELS_URL`.

        Raises:
            InvalidArgumentError: If this version does not have the file.
        """
        path = self.folder / name.removeprefix(MODELS_URL)
        if not path.is_file():
            raise InvalidArgumentError(
                f"{PACKAGE} {self.version} has no {path}; 6.0.0 is known to have all that is needed"
            )
        return path


def find_robot_data() -> RobotData:
    """Returns the installed collection of robots.

    Raises:
        InvalidArgumentError: If it is not installed.
    """
    try:
        distribution = importlib.metadata.distribution(PACKAGE)
    except importlib.metadata.PackageNotFoundError as error:
        raise InvalidArgumentError(
            f"this robot's model is in {PACKAGE}, which is not installed;"
            " pip install 'drake_pregrasp[robots]' brings it"
        ) from error
    for file in distribution.files or ():
        if file.as_posix().endswith(_LANDMARK) and "share" in file.parts:
            return RobotData(Path(str(file.locate())).resolve().parent, distribution.version)
    raise InvalidArgumentError(f"{PACKAGE} {distribution.version} has no {_LANDMARK}; reinstall it")


_PANDA = "robots/panda_description/urdf/panda.urdf"
_ALLEGRO = "robots/allegro_hand_description/urdf/allegro_right_hand.urdf"

# Position of the arm's base in W: it stands behind the conveyor, and reaches over it.
_BASE_XYZ = (-0.55, 0.0, 0.0)

# Pose of the palm on the flange. The palm's x axis, normal to its face, is along the flange's z, so
# fingers reach forward and bend down. Hanging fingers fail: the thumb ends 0.1 m above the others.
_PALM_XYZ = (-0.02, 0.0, 0.045)
_PALM_RPY = (math.pi, -math.pi / 2, 0.0)

_FRICTION = 0.7  # Friction coefficient of rubber on most materials.
_STIFFNESS = 1e4  # Stiffness of rubber tips in N/m; harder contacts would chatter.


def write_allegro_panda(
    data: RobotData, folder: Path, on_progress: Callable[[int, int], None]
) -> Path:
    """Writes the URDF of arm and hand and their meshes, and returns the path of the URDF.

    Args:
        data: Installed collection with the arm and the hand.
        folder: Empty folder for the files.
        on_progress: Function that is called with the numbers of meshes done and of all.

    Raises:
        InvalidArgumentError: If `data` lacks a file, or has one that cannot be read.
    """
    robot = ElementTree.parse(data.find(_PANDA)).getroot()
    urdf_repair.drop_from(robot, "panda_hand")
    urdf_repair.add_robot(robot, ElementTree.parse(data.find(_ALLEGRO)).getroot())
    urdf_repair.weld(robot, "world", "panda_link0", xyz=_BASE_XYZ, rpy=(0.0, 0.0, 0.0))
    urdf_repair.weld(robot, "panda_link8", "palm_link", xyz=_PALM_XYZ, rpy=_PALM_RPY)
    return _write(robot, data, folder / "allegro_panda.urdf", on_progress)


def write_allegro_hand(
    data: RobotData, folder: Path, on_progress: Callable[[int, int], None]
) -> Path:
    """Writes the URDF of the hand alone, as `write_allegro_panda` does."""
    robot = ElementTree.parse(data.find(_ALLEGRO)).getroot()
    return _write(robot, data, folder / "allegro_hand.urdf", on_progress)


def _write(
    robot: Element, data: RobotData, path: Path, on_progress: Callable[[int, int], None]
) -> Path:
    """Writes a robot as Drake needs it."""
    robot.set("name", path.stem)
    urdf_repair.drop_ignored(robot)
    urdf_repair.repair_inertias(robot)
    urdf_repair.set_contact(robot, _FRICTION, _STIFFNESS)
    convert_meshes(robot, data.find, path.parent, on_progress)
    ElementTree.indent(robot)
    ElementTree.ElementTree(robot).write(path, encoding="utf-8", xml_declaration=True)
    return path
