"""Models of hands: paths, and Drake's parser.

A failed `DRAKE_DEMAND` reaches Python as `SystemExit`, which would end the process. Files of
unknown origin must not cause that, so it is turned into an error.
"""

import contextlib
import logging
from collections.abc import Iterator, Sequence
from pathlib import Path

from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from drake_pregrasp.config.hand_description import Carrier, HandDescription
from drake_pregrasp.config.yaml_text import dump_yaml
from drake_pregrasp.contacts.assignment import FREE_TURN
from drake_pregrasp.diagrams.directive_files import (
    DIRECTIVES_KIND,
    checked_copy,
    is_own,
    needs_copy,
)
from drake_pregrasp.diagrams.hand_assembly import assemble_hand
from drake_pregrasp.diagrams.hand_instances import HandInstances
from drake_pregrasp.diagrams.model_files import CheckedModel
from drake_pregrasp.diagrams.object_contact import make_compliant
from drake_pregrasp.errors import InvalidArgumentError, ProblemsError, first_line
from drake_pregrasp.resources import MODELS_URL, file_url, resolve_path
from drake_pregrasp.robots.robot_models import ROBOTS_URL, robot_model
from drake_pregrasp.systems.hand_kinematics import fingertip_geometries
from drake_pregrasp.systems.palm_frames import FROM_ABOVE


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
"""Name of a hand's model instance in the plant, for any name in its file but directives."""

_EMPTY = 2  # Number of model instances of a plant without models: of the world, and the default.


def add_hand_model(
    plant: MultibodyPlant,
    description: HandDescription,
    X_WB: RigidTransform = FROM_ABOVE,
    scene_graph: SceneGraph | None = None,
) -> list[ModelInstanceIndex]:
    """Adds a hand to a plant that is not finalized, without gravity, as if it were compensated.

    Drake's parser reads the models of this package, and checked copies of all others. Its warnings
    about others are logged, and what was left out of the copies.

    Args:
        plant: Plant to which the hand is added.
        description: Description of the hand.
        X_WB: Pose in W of the frame B that the model calls its world, in which the base stands.
        scene_graph: SceneGraph of the plant, in which fingertips without hydroelastic properties
            become compliant; None: they stay as they are.

    Returns:
        The model instances of the hand and of what carries it.

    Raises:
        InvalidArgumentError: If its model cannot be loaded, or does not match its description.
    """
    model = read_model(description.model)
    models = add_read_model(plant, model, description, X_WB=X_WB, warns=True)
    if scene_graph is not None:
        _soften(HandInstances(plant, models), description, scene_graph)
    return models


def read_model(model: str, folders: Sequence[Path] | None = None) -> CheckedModel:
    """Returns a hand's model as Drake's parser gets it.

    It is a checked copy, or a directive that names an SDF or a URDF of this package.

    Args:
        model: Name of the model, as in `HandDescription.model`.
        folders: Folders that a model may be in, or below, unless `is_known`; as for `checked_copy`.

    Raises:
        InvalidArgumentError: If a file is missing, elsewhere or too large, or cannot be read.
    """
    if needs_copy(path := model_path(model)):
        return checked_copy(path, None if is_known(model) else folders)
    directives = [{"add_model": {"name": HAND, "file": file_url(path)}}]
    return CheckedModel(dump_yaml({"directives": directives}), DIRECTIVES_KIND, (path,), ())


def is_known(model: str) -> bool:
    """Returns whether a model is named as one of this package, or of another Python package."""
    return model.startswith((MODELS_URL, ROBOTS_URL))


def add_read_model(
    plant: MultibodyPlant,
    model: CheckedModel,
    description: HandDescription,
    yaw_range: tuple[float, float] = FREE_TURN,
    X_WB: RigidTransform = FROM_ABOVE,
    *,
    pans: bool = False,
    warns: bool = False,
) -> list[ModelInstanceIndex]:
    """Adds a hand whose model has been read to a plant; see `add_hand_model`.

    Args:
        plant: As for `add_hand_model`.
        model: Model of the description, from `read_model`.
        description: As for `add_hand_model`.
        yaw_range: Smallest and largest angle of a carrier's wrist, in radians; the model keeps its
            own range by default.
        X_WB: As for `add_hand_model`.
        pans: Whether a joint turns the hand, with B, about z of W.
        warns: Whether warnings about the model are logged.
    """
    is_first = plant.num_model_instances() == _EMPTY  # No instance is renamed then.
    instances = _parse(plant, model, warns=warns)
    hand = HandInstances(plant, instances, are_named=is_first)
    _complete(hand, description, X_WB, yaw_range, pans=pans)
    return instances


def complete_hand_model(
    plant: MultibodyPlant,
    description: HandDescription,
    robot: ModelInstanceIndex | Sequence[ModelInstanceIndex],
    X_WB: RigidTransform | None = None,
    scene_graph: SceneGraph | None = None,
) -> None:
    """Adds the drives and frames of a description to models in a plant that is not finalized.

    Gravity no longer acts on them, as if it were compensated.

    Args:
        plant: Plant with the models.
        description: Description of the hand.
        robot: Model instances of the hand and of what carries it.
        X_WB: As for `add_hand_model`; None: the base stays where it is.
        scene_graph: As for `add_hand_model`.

    Raises:
        InvalidArgumentError: If the models do not match the description.
    """
    _complete(hand := HandInstances(plant, robot), description, X_WB)
    if scene_graph is not None:
        _soften(hand, description, scene_graph)


def _soften(hand: HandInstances, description: HandDescription, scene_graph: SceneGraph) -> None:
    """Makes fingertips compliant."""
    tips, inspector = description.fingertips, scene_graph.model_inspector()
    frames = [hand.frame(tip.frame, "fingertips") for tip in tips]
    radii = [tip.radius for tip in tips]
    geometries = fingertip_geometries(hand.plant, frames, radii, inspector)
    make_compliant(hand.plant, scene_graph, geometries)


def _complete(
    hand: HandInstances,
    description: HandDescription,
    X_WB: RigidTransform | None,
    yaw_range: tuple[float, float] = FREE_TURN,
    *,
    pans: bool = False,
) -> None:
    if hand.plant.is_finalized():
        raise InvalidArgumentError("plant: it is finalized already; complete the hand before")
    try:
        with failures_as_errors():
            assemble_hand(hand, description, X_WB, pans=pans)
    except ProblemsError:
        raise
    except (RuntimeError, ValueError) as error:
        problem = f"model: {description.model}: {first_line(error)}"
        raise InvalidArgumentError(problem) from error
    for instance in hand.instances:
        hand.plant.set_gravity_enabled(instance, False)
    if isinstance(description.base, Carrier) and yaw_range != FREE_TURN:
        joint = hand.joint(description.base.joints[-1], "base.joints")
        joint.set_position_limits([yaw_range[0]], [yaw_range[1]])


def _parse(plant: MultibodyPlant, model: CheckedModel, *, warns: bool) -> list[ModelInstanceIndex]:
    """Adds the models of a copy to a plant."""
    parser, path = Parser(plant), model.files[0]
    parser.SetAutoRenaming(True)
    try:
        with held_messages() as messages, failures_as_errors():  # An error says them in one line.
            instances = parser.AddModelsFromString(model.text, model.kind)
    except (RuntimeError, ValueError) as error:
        problem = first_line(error)
        if "pos_lower_limits" in problem:  # A condition of Drake's, which names no joint.
            problem = "the lower limit of a joint must be at most its upper one"
        if "already has joint" in problem:
            problem = (
                "a link is joined twice to another; a link named world is Drake's world, to which"
                " directives need not weld what the file of a model joins to it"
            )
        raise InvalidArgumentError(f"model: {path} is no model of a hand: {problem}") from error
    if warns and not is_own(path):
        for line in model.left_out:
            logging.getLogger(__name__).warning(line)
        for message in messages:
            logging.getLogger("drake").handle(message)
    if len(instances) == 1 and model.kind != DIRECTIVES_KIND:
        plant.RenameModelInstance(instances[0], HAND)
    return list(instances)


def model_path(model: str) -> Path:
    """Returns the path of a hand's model.

    Args:
        model: Name of the model, as in `HandDescription.model`.

    Raises:
        InvalidArgumentError: If there is no such file.
    """
    if not model:
        raise InvalidArgumentError(
            "model: it is empty, and must name an SDF, a URDF, an MJCF or model directives"
        )
    if model.startswith(ROBOTS_URL):
        return robot_model(model)
    path = resolve_path(model, Path.cwd())
    if not path.is_file():
        raise InvalidArgumentError(f"model: {path}: there is no such file")
    return path
