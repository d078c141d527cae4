"""A hand's model, loaded and checked."""

import contextlib
import logging
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from pydrake.common import Parallelism
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.planning import RobotDiagramBuilder, SceneGraphCollisionChecker

from drake_pregrasp.diagrams.grasp_config import HandModelConfig
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.assignment import FREE_TURN
from drake_pregrasp.resources import resolve_path, resource_folder
from drake_pregrasp.systems.hand_kinematics import HandKinematics

HAND = "hand"
"""The model instance that a hand is, whatever its file calls it."""


def add_hand_model(
    plant: MultibodyPlant, config: HandModelConfig, yaw_range: tuple[float, float] = FREE_TURN
) -> ModelInstanceIndex:
    """Adds a hand to a plant that isn't finalized, without gravity, as if it were compensated.

    Args:
        plant: Where to add it.
        config: The hand.
        yaw_range: Of its wrist, in radians; an endless one leaves that of the model.

    Raises:
        InvalidArgumentError: If its file can't be loaded.
    """
    parser = Parser(plant)
    parser.package_map().AddPackageXml(str(resource_folder("models") / "package.xml"))
    parser.SetAutoRenaming(True)
    if not config.file:
        raise InvalidArgumentError("a hand's file is empty; it must name an SDF or URDF")
    path = resolve_path(config.file, Path.cwd())
    if not path.is_file():
        raise InvalidArgumentError(f"{path}: there is no such file")
    try:
        (hand,) = parser.AddModels(str(path))
    except (RuntimeError, ValueError) as error:
        problem = str(error).splitlines()[0]
        raise InvalidArgumentError(f"{path} is no model of a hand: {problem}") from error
    plant.RenameModelInstance(hand, HAND)
    plant.set_gravity_enabled(hand, False)
    wrist = config.carrier[-1]
    if yaw_range != FREE_TURN and plant.HasJointNamed(wrist, hand):
        joint = plant.GetMutableJointByName(wrist, hand)
        joint.set_position_limits([yaw_range[0]], [yaw_range[1]])
    return hand


class HandModel:
    """A hand by itself, for its kinematics.

    Args:
        config: The hand.
        yaw_range: Of its wrist, as for `add_hand_model`.

    Attributes:
        checker: What Drake's `DifferentialInverseKinematicsSystem` takes.
        kinematics: Of the fingertips.
        carrier: Indices of the carrier's joints among the positions.
        azimuths: Of the fingertips about the palm's axis at yaw 0 and at home, shape (n,).

    Raises:
        InvalidArgumentError: If the model and its description don't fit together.
    """

    def __init__(self, config: HandModelConfig, yaw_range: tuple[float, float] = FREE_TURN) -> None:
        builder = RobotDiagramBuilder(time_step=0.0)
        plant = builder.plant()
        hand = add_hand_model(plant, config, yaw_range)
        plant.Finalize()
        names = [plant.get_joint(index).name() for index in plant.GetJointIndices(hand)]
        for name in config.carrier:
            if name not in names:
                raise InvalidArgumentError(
                    f"{config.file} has no joint {name}; there are: {', '.join(names)}"
                )
        self._config = config
        self.carrier = [
            plant.GetJointByName(name, hand).position_start() for name in config.carrier
        ]
        nq, expected = plant.num_positions(), 4 + len(config.home) * len(config.fingertips)
        if self.carrier != list(range(4)) or nq != expected:
            raise InvalidArgumentError(
                f"{config.file} must have the carrier's joints first, then {len(config.home)} of"
                f" each of {len(config.fingertips)} fingers, {expected} in all, not {nq}"
            )
        frames = [f"{HAND}::{name}" for name in config.fingertips]
        self.kinematics = HandKinematics(plant, frames)
        with _without_chatter():
            self.checker = SceneGraphCollisionChecker(
                model=builder.Build(),
                robot_model_instances=[hand],
                edge_step_size=1.0,
                configuration_distance_function=lambda a, b: float(np.linalg.norm(a - b)),
                implicit_context_parallelism=Parallelism(parallelize=False),
            )
        p_PT = self.tips_at(self.home(np.zeros(3), 0.0))
        self.azimuths: FloatArray = np.arctan2(p_PT[:, 1], p_PT[:, 0])

    def home(self, p_WO: FloatArray, yaw: float) -> FloatArray:
        """Returns the home positions of all joints over an object, shape (nq,).

        Args:
            p_WO: Where the object is in W, shape (3,), in metres.
            yaw: Of the palm, in radians.
        """
        palm = p_WO + np.array([0.0, 0.0, self._config.palm_height])
        fingers = np.tile(self._config.home, len(self._config.fingertips))
        return np.concatenate([palm, [yaw], fingers])

    def tips_at(self, q: FloatArray) -> FloatArray:
        """Returns the fingertips' centres in W at positions q, shape (n, 3), in metres."""
        plant = self.kinematics.plant
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, q)
        return self.kinematics.tip_positions(context)


@contextlib.contextmanager
def _without_chatter() -> Iterator[None]:
    """Keeps Drake from saying how many contexts it makes."""
    logger = logging.getLogger("drake")
    before = logger.level
    logger.setLevel(logging.WARNING)
    try:
        yield
    finally:
        logger.setLevel(before)
