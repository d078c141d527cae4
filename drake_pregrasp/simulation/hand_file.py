"""Descriptions of hands from YAML files."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from drake_pregrasp.config.hand_description import HandDescription
from drake_pregrasp.config.object_config import POINT, zeros
from drake_pregrasp.config.yaml_text import parse_entries, read_text
from drake_pregrasp.diagrams.hand_parsing import is_known, read_model
from drake_pregrasp.diagrams.model_files import CheckedModel
from drake_pregrasp.errors import InvalidArgumentError, ScenarioError
from drake_pregrasp.resources import make_paths_absolute, resolve_path
from drake_pregrasp.simulation.schema_check import load_checked


@dataclass
class HandFile:
    """A simulated hand."""

    # File with the hand's description, relative to the scenario's file, or package://drake_pregrasp/
    # for a hand that is shipped. Empty: no hand, only planning.
    file: str = field(default="", metadata={"path": True})

    # Position in W of the frame B that the model calls its world, in metres. It moves the base of
    # an arm; a carrier does not have it.
    position: list[float] = field(default_factory=zeros, metadata=POINT)

    # Orientation of B in W, as roll, pitch and yaw, in radians: an arm behind the belt may stand
    # beside it, for example.
    rpy: list[float] = field(default_factory=zeros, metadata=POINT)

    @property
    def X_WB(self) -> RigidTransform | None:
        """Pose in W of the frame B that the model calls its world; None where the two coincide."""
        if not any(self.position) and not any(self.rpy):
            return None
        return RigidTransform(RollPitchYaw(self.rpy), self.position)


@dataclass
class HandFrame:
    """Frame H of a hand that is not simulated, in which the reach of the fingers is given."""

    # Position of H in metres: relative to the object's estimated origin if `follow`, else in W.
    position: list[float] = field(default_factory=zeros, metadata=POINT)

    # Constant orientation of H in W, as roll, pitch and yaw, in radians.
    rpy: list[float] = field(default_factory=zeros, metadata=POINT)

    # Whether H follows the object.
    follow: bool = True

    # Initial positions of the fingertips in H, one row each, in metres. If given, contacts are
    # assigned to the fingers for the least total distance, so that no two paths cross.
    fingertips: list[list[float]] = field(default_factory=list, metadata={"elements": POINT})

    def initial_X_WH(self, X_WO: RigidTransform) -> RigidTransform:
        """Returns the pose of H in W when the object is at X_WO."""
        p_WH = np.array(self.position) + (X_WO.translation() if self.follow else 0)
        return RigidTransform(RollPitchYaw(self.rpy), p_WH)


HandConfig = HandFile | HandFrame


def load_hand(file: str | Path, *, folders: Sequence[str | Path] | None = None) -> HandDescription:
    """Loads the description of a hand, with its keys, types and ranges checked.

    Args:
        file: Path from the working directory, or `package://drake_pregrasp/...`.
        folders: Folders that may hold the model and the files that it names, at any depth, besides
            the description's own folder; for descriptions of unknown origin. None: all folders.

    Raises:
        ScenarioError: If the description is invalid; the message names file, key and value.
    """
    return read_hand(file, folders).description


class HandSource(NamedTuple):
    """Description of a hand, and its model if it has been read as well.

    Attributes:
        description: The description.
        model: Model for `HandModel`. None if it has not been read: shipped ones, and those of other
            packages, are read where they are used, because the packages may be missing.
    """

    description: HandDescription
    model: CheckedModel | None


def read_hand(file: str | Path, folders: Sequence[str | Path] | None = None) -> HandSource:
    """Reads a description as `load_hand` does, and with allowed folders also its model."""
    try:
        path = resolve_path(str(file), Path.cwd())
    except InvalidArgumentError as error:
        raise ScenarioError(str(file), "", str(error)) from error
    data = hand_data(path)
    description = load_checked(str(path), "", data, HandDescription())
    allowed = None if folders is None else [path.parent, *map(Path, folders)]
    make_paths_absolute(description, path.parent, allowed=allowed, source=str(path))
    if allowed is None or is_known(description.model):
        return HandSource(description, None)
    try:
        return HandSource(description, read_model(description.model, allowed))
    except InvalidArgumentError as error:
        raise ScenarioError(str(path), "", str(error)) from error


def hand_data(path: Path) -> Any:
    """Returns the content of a description; the file itself is the model if it lists directives.

    Raises:
        ScenarioError: If it is not valid YAML, or exceeds a limit.
    """
    data = parse_entries(str(path), read_text(path))
    if isinstance(data, dict) and isinstance(data.get("model"), list):
        data["model"] = str(path)
    return data
