"""Models of hands: paths, and Drake's parser.

A failed `DRAKE_DEMAND` reaches Python as `SystemExit`, which would end the process. Files of
unknown origin must not cause that, so it is turned into an error.
"""

import contextlib
import logging
from collections.abc import Iterator
from pathlib import Path

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from drake_pregrasp.config.hand_description import Carrier, HandDescription
from drake_pregrasp.contacts.assignment import FREE_TURN
from drake_pregrasp.diagrams.hand_assembly import assemble_hand
from drake_pregrasp.diagrams.model_files import checked_model
from drake_pregrasp.errors import InvalidArgumentError, first_line
from drake_pregrasp.resources import resolve_path, resource_folder
from drake_pregrasp.robots.robot_models import ROBOTS_URL, cache_folder, robot_model


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
    plant: MultibodyPlant, description: HandDescription, yaw_range: tuple[float, float] = FREE_TURN
) -> ModelInstanceIndex:
    """Adds a hand to a plant that is not finalized, without gravity, as if it were compensated.

    Drake's parser reads the models of this package, and checked copies of all others.

    Args:
        plant: Plant to which the hand is added.
        description: Description of the hand.
        yaw_range: Smallest and largest angle of a carrier's wrist, in radians; the model keeps its
            own range by default.

    Raises:
        InvalidArgumentError: If its model cannot be loaded.
    """
    parser = Parser(plant)
    path = model_path(description.model)
    parser.SetAutoRenaming(True)
    copy = None if _is_own(path) and path.suffix != ".xml" else checked_model(path)
    try:
        with held_messages() as messages, failures_as_errors():  # An error says them in one line.
            if copy is None:
                models = parser.AddModels(str(path))
            else:
                models = parser.AddModelsFromString(copy.text, copy.kind)
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
            assemble_hand(plant, hand, description)
    except (RuntimeError, ValueError) as error:
        raise InvalidArgumentError(f"model: {path}: {first_line(error)}") from error
    plant.set_gravity_enabled(hand, False)
    if isinstance(description.base, Carrier) and yaw_range != FREE_TURN:
        wrist = description.base.joints[-1]
        if plant.HasJointNamed(wrist, hand):
            joint = plant.GetMutableJointByName(wrist, hand)
            joint.set_position_limits([yaw_range[0]], [yaw_range[1]])
    return hand


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
