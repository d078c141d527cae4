"""Models of hands: paths, and Drake's parser.

A failed `DRAKE_DEMAND` reaches Python as `SystemExit`, which would end the process. Files of
unknown origin must not cause that, so it is turned into an error.
"""

import contextlib
import logging
from collections.abc import Iterable, Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from pydrake.math import RollPitchYaw, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from drake_pregrasp.config.hand_description import Arm, Carrier, HandDescription
from drake_pregrasp.contacts.assignment import FREE_TURN
from drake_pregrasp.diagrams.hand_assembly import assemble_hand
from drake_pregrasp.diagrams.model_files import CheckedModel, checked_model
from drake_pregrasp.errors import InvalidArgumentError, first_line
from drake_pregrasp.resources import resolve_path, resource_folder
from drake_pregrasp.robots.robot_models import ROBOTS_URL, cache_folder, robot_model
from drake_pregrasp.robots.urdf_repair import DRAKE


@contextlib.contextmanager
def failures_as_errors() -> Iterator[None]:
    """Turns a failed `DRAKE_DEMAND` inside into a `RuntimeError` with its message."""
    try:
        yield
    except SystemExit as error:
        if not isinstance(error.code, str):
            raise
        raise RuntimeError(error.code) from error


@contextlib.contextmanager
def held_messages() -> Iterator[list[logging.LogRecord]]:
    """Holds back Drake's log messages, and yields their list."""
    held: list[logging.LogRecord] = []

    def is_shown(record: logging.LogRecord) -> bool:
        held.append(record)
        return False

    logger = logging.getLogger("drake")
    logger.addFilter(is_shown)
    try:
        yield held
    finally:
        logger.removeFilter(is_shown)


HAND = "hand"
"""Name of a hand's model instance in the plant, for any name in its file."""


def add_hand_model(
    plant: MultibodyPlant,
    description: HandDescription,
    yaw_range: tuple[float, float] = FREE_TURN,
    R_WA: RotationMatrix | None = None,
) -> ModelInstanceIndex:
    """Adds a hand to a plant that is not finalized, without gravity, as if it were compensated.

    Drake's parser reads the models of this package, and checked copies of all others.

    Args:
        plant: Plant to which the hand is added.
        description: Description of the hand.
        yaw_range: Smallest and largest angle of a carrier's wrist, in radians; the model keeps its
            own range by default.
        R_WA: Orientation in which a carrier stands in W, with its palm along -z of A (see
            `HandModel`); None for upright. Arms stay where they are.

    Raises:
        InvalidArgumentError: If its model cannot be loaded.
    """
    parser = Parser(plant)
    path = model_path(description.model)
    parser.SetAutoRenaming(True)
    base, copy = description.base, None
    stands = R_WA is None or R_WA.IsExactlyIdentity() or isinstance(base, Arm) or base.mount.link
    if not stands or path.suffix == ".xml" or not _is_own(path):
        copy = checked_model(path)
    try:
        with held_messages() as messages, failures_as_errors():  # An error says them in one line.
            if copy is None:
                models = parser.AddModels(str(path))
            else:
                text = copy.text if R_WA is None or stands else _turned(copy, R_WA)
                models = parser.AddModelsFromString(text, copy.kind)
    except (RuntimeError, ValueError) as error:
        problem = first_line(error)
        raise InvalidArgumentError(f"model: {path} is no model of a hand: {problem}") from error
    for message in [] if _is_own(path) else messages:
        logging.getLogger("drake").handle(message)
    if len(models) != 1:
        raise InvalidArgumentError(
            f"model: {path} must hold one model, the hand with what carries it, not {len(models)}"
        )
    (hand,) = models
    plant.RenameModelInstance(hand, HAND)
    try:
        with failures_as_errors():
            assemble_hand(plant, hand, description, R_WA)
    except (RuntimeError, ValueError) as error:
        raise InvalidArgumentError(f"model: {path}: {first_line(error)}") from error
    plant.set_gravity_enabled(hand, False)
    if isinstance(description.base, Carrier) and yaw_range != FREE_TURN:
        wrist = description.base.joints[-1]
        if plant.HasJointNamed(wrist, hand):
            joint = plant.GetMutableJointByName(wrist, hand)
            joint.set_position_limits([yaw_range[0]], [yaw_range[1]])
    return hand


def _turned(model: CheckedModel, R_WA: RotationMatrix) -> str:
    """Returns the text of a model that is turned about the origin of W."""
    ElementTree.register_namespace("drake", DRAKE)
    root, name = ElementTree.fromstring(model.text), "turned"
    if model.kind == "sdf":
        for element in root.findall("model"):
            pose = element.find("pose")
            pose = ElementTree.SubElement(element, "pose") if pose is None else pose
            *p_WM, roll, pitch, yaw = np.array((pose.text or "0 " * 6).split(), dtype=float)
            R_WM = R_WA @ RollPitchYaw(roll, pitch, yaw).ToRotationMatrix()
            pose.text = _numbers([*(R_WA @ p_WM), *RollPitchYaw(R_WM).vector()])
    elif model.kind == "urdf":
        for parent in root.findall("joint/parent[@link='world']"):
            parent.set("link", name)
        joint = ElementTree.SubElement(root, "joint", name=name, type="fixed")
        ElementTree.SubElement(joint, "origin", rpy=_numbers(RollPitchYaw(R_WA).vector()))
        ElementTree.SubElement(joint, "parent", link="world")
        ElementTree.SubElement(joint, "child", link=name)
        ElementTree.SubElement(root, "link", name=name)
    else:
        quat = _numbers(R_WA.ToQuaternion().wxyz())
        for world in root.findall("worldbody"):
            bodies = world.findall("body")
            turned = ElementTree.SubElement(world, "body", name=name, quat=quat)
            for body in bodies:
                world.remove(body)
                turned.append(body)
    return ElementTree.tostring(root, encoding="unicode")


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def _is_own(model: Path) -> bool:
    """Returns whether a model is shipped with this package, or was made by it."""
    folders = (resource_folder("models"), cache_folder())
    return any(model.resolve().is_relative_to(folder.resolve()) for folder in folders)


def model_path(model: str) -> Path:
    """Returns the path of a hand's model.

    Args:
        model: Name of the model, as in `HandDescription.model`.

    Raises:
        InvalidArgumentError: If there is no such file.
    """
    if not model:
        raise InvalidArgumentError("model: it is empty, and must name an SDF, a URDF or an MJCF")
    if model.startswith(ROBOTS_URL):
        return robot_model(model)
    path = resolve_path(model, Path.cwd())
    if not path.is_file():
        raise InvalidArgumentError(f"model: {path}: there is no such file")
    return path
