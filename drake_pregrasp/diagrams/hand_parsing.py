"""A hand's model, found and added to a plant."""

from pathlib import Path

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from drake_pregrasp.diagrams.hand_description import Carrier, HandDescription
from drake_pregrasp.errors import InvalidArgumentError, first_line
from drake_pregrasp.planning.assignment import FREE_TURN
from drake_pregrasp.resources import resolve_path, resource_folder
from drake_pregrasp.robots.robot_models import ROBOTS_URL, robot_model

HAND = "hand"
"""The model instance that a hand is, whatever its file calls it."""


def add_hand_model(
    plant: MultibodyPlant,
    description: HandDescription,
    yaw_range: tuple[float, float] = FREE_TURN,
) -> ModelInstanceIndex:
    """Adds a hand to a plant that isn't finalized, without gravity, as if it were compensated.

    Args:
        plant: Where to add it.
        description: The hand.
        yaw_range: Of a carrier's wrist, in radians; an endless one leaves that of the model.

    Raises:
        InvalidArgumentError: If its model can't be loaded.
    """
    parser = Parser(plant)
    parser.package_map().AddPackageXml(str(resource_folder("models") / "package.xml"))
    parser.SetAutoRenaming(True)
    path = _model_path(description.model)
    try:
        (hand,) = parser.AddModels(str(path))
    except (RuntimeError, ValueError) as error:
        problem = first_line(error)
        raise InvalidArgumentError(f"model: {path} is no model of a hand: {problem}") from error
    plant.RenameModelInstance(hand, HAND)
    plant.set_gravity_enabled(hand, False)
    if isinstance(description.base, Carrier) and yaw_range != FREE_TURN:
        wrist = description.base.joints[-1]
        if plant.HasJointNamed(wrist, hand):
            joint = plant.GetMutableJointByName(wrist, hand)
            joint.set_position_limits([yaw_range[0]], [yaw_range[1]])
    return hand


def _model_path(model: str) -> Path:
    if not model:
        raise InvalidArgumentError("model: it is empty, and must name an SDF or URDF")
    if model.startswith(ROBOTS_URL):
        return robot_model(model)
    path = resolve_path(model, Path.cwd())
    if not path.is_file():
        raise InvalidArgumentError(f"model: {path}: there is no such file")
    return path
