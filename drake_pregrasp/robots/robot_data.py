"""Arms and hands of the package `example-robot-data`."""

import importlib.metadata
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.resources import missing_package
from drake_pregrasp.robots import urdf_repair
from drake_pregrasp.robots.robot_meshes import convert_meshes, cut_boxes

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
        raise missing_package(PACKAGE, extra="robots", purpose="this robot's model") from error
    for file in distribution.files or ():
        if file.as_posix().endswith(_LANDMARK) and "share" in file.parts:
            return RobotData(Path(str(file.locate())).resolve().parent, distribution.version)
    raise InvalidArgumentError(f"{PACKAGE} {distribution.version} has no {_LANDMARK}; reinstall it")


ROBOTS: Mapping[str, str] = {
    "allegro_hand.urdf": "robots/allegro_hand_description/urdf/allegro_right_hand.urdf",
    "panda.urdf": "robots/panda_description/urdf/panda.urdf",
    "ur5.urdf": "robots/ur_description/urdf/ur5_robot.urdf",
    "xarm7.urdf": "robots/xarm_description/urdf/xarm7.urdf",
}
"""Files of the collection by the names of the converted models, which are not joined to the world
and have no gripper."""

_GRIPPER = "panda_hand"  # Link of the Panda's gripper, on its flange.
_FRICTION = 0.7  # Friction coefficient of rubber on most materials.
_STIFFNESS = 1e4  # Stiffness of rubber tips in N/m; harder contacts would chatter.


def write_robot(
    name: str, data: RobotData, folder: Path, on_progress: Callable[[int, int], None]
) -> Path:
    """Writes the URDF of a robot as Drake needs it, and its meshes; returns the path of the URDF.

    Args:
        name: Name of the robot in `ROBOTS`.
        data: Installed collection with the robot.
        folder: Empty folder for the files.
        on_progress: Function that is called with the numbers of meshes done and of all.

    Raises:
        InvalidArgumentError: If `data` lacks a file, or has one that cannot be read.
    """
    path = folder / name
    robot = ElementTree.parse(data.find(ROBOTS[name])).getroot()
    robot.set("name", path.stem)
    urdf_repair.drop_world(robot)
    urdf_repair.drop_from(robot, _GRIPPER)
    urdf_repair.drop_ignored(robot)
    urdf_repair.repair_inertias(robot)
    urdf_repair.set_contact(robot, _FRICTION, _STIFFNESS)
    cut_boxes(robot, data.find)
    convert_meshes(robot, data.find, path.parent, on_progress)
    ElementTree.indent(robot)
    ElementTree.ElementTree(robot).write(path, encoding="utf-8", xml_declaration=True)
    return path
