"""Where the package example-robot-data keeps its models, found without importing it."""

import importlib.metadata
from dataclasses import dataclass
from pathlib import Path

from drake_pregrasp.errors import InvalidArgumentError

PACKAGE = "example-robot-data"
"""The distribution, as pip knows it."""

MODELS_URL = f"package://{PACKAGE}/"
"""What names of meshes start with in its models."""

_LANDMARK = f"{PACKAGE}/package.xml"


@dataclass(frozen=True)
class RobotData:
    """An installed collection of robots.

    Attributes:
        folder: What `MODELS_URL` stands for.
        version: Of the distribution.
    """

    folder: Path
    version: str

    def find(self, name: str) -> Path:
        """Returns the file of a name, which may start with `MODELS_URL`.

        Raises:
            InvalidArgumentError: If this version has none.
        """
        path = self.folder / name.removeprefix(MODELS_URL)
        if not path.is_file():
            raise InvalidArgumentError(
                f"{PACKAGE} {self.version} has no {path}; 6.0.0 is known to have all that is needed"
            )
        return path


def find_robot_data() -> RobotData:
    """Returns the installed collection.

    Raises:
        InvalidArgumentError: If it isn't installed.
    """
    try:
        distribution = importlib.metadata.distribution(PACKAGE)
    except importlib.metadata.PackageNotFoundError as error:
        raise InvalidArgumentError(
            f"this robot's model is in {PACKAGE}, which isn't installed;"
            " pip install 'drake_pregrasp[robots]' brings it"
        ) from error
    for file in distribution.files or ():
        if file.as_posix().endswith(_LANDMARK) and "share" in file.parts:
            return RobotData(Path(str(file.locate())).resolve().parent, distribution.version)
    raise InvalidArgumentError(f"{PACKAGE} {distribution.version} has no {_LANDMARK}; reinstall it")
