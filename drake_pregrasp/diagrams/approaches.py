"""Directions from which a palm may come to an object, and the choice among them."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.grasp_config import ABOVE, SIDE, GraspConfig
from drake_pregrasp.config.hand_description import Arm
from drake_pregrasp.contacts.hand_above_object import StartContacts
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.errors import InvalidArgumentError, Lack, NoGraspError
from drake_pregrasp.geometry.solids import HalfSpace, Solid
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.grasping.clearances import LINK_CLEARANCE
from drake_pregrasp.systems.palm_frames import FROM_ABOVE

_LEVEL = 1 - 1e-9  # Least z of the normal of a level plane.
# Least gap between a palm that is lowered and the object's top, in metres. It stops at
# `LINK_CLEARANCE` over the object as it is estimated, with noise.
_TOP_GAP = 2 * LINK_CLEARANCE
_YAWS = np.linspace(-np.pi, np.pi, 73)
_SIDES = np.pi / 2 * np.arange(4)  # Azimuths from which palms come from the side, in radians.


def approaching_hands(
    upright: HandModel,
    config: GraspConfig,
    surface: ObjectSurface,
    X_WO: RigidTransform,
    *,
    fixed: Sequence[Solid],
    X_WB: RigidTransform | None = None,
    incoming: FloatArray | None = None,
    pans: bool = False,
) -> Iterator[list[HandModel]]:
    """Returns models of a hand with the approaches to choose from, for each shift of the palm.

    A list of models is made only when it is asked for. Approaches from the side are along x and y
    of an upright object. A palm from the side that waits for an object faces it, along x or y of W.

    Args:
        upright: Model of the hand, from above, and not over an object.
        config: Configuration of the grasp.
        surface: Surface of the object.
        X_WO: Initial pose of the object.
        fixed: Solids in W that fingertips avoid, such as the table.
        X_WB: Pose of the base; None: as for `HandModel`.
        incoming: Displacement of an object to where the palm waits for it, in W, shape (3,), in
            metres; None for a palm that does not wait.
        pans: Whether carriers from the side turn with the object about the vertical.

    Raises:
        InvalidArgumentError: If the hand does not match its model with an approach, or its carrier
            has the orientation of none.
    """
    extent = float(np.max(np.linalg.norm(surface.p_OQ - surface.p_OCoM, axis=1)))
    R_WO, is_arm = X_WO.rotation().matrix(), isinstance(upright.description.base, Arm)

    def model(X_LA: RigidTransform, X_WB: RigidTransform | None, shift: float = 0.0) -> HandModel:
        up = X_LA.rotation().matrix()[:, 2] @ R_WO
        top = float(np.max((surface.mesh.vertices - surface.p_OCoM) @ up))
        near = extent + float(np.linalg.norm(X_LA.translation()))
        depth = upright.description.palm_height - upright.fingers.lowest_of_palm(near)
        raised = upright.description.over_object(top, shift, depth + _TOP_GAP)
        is_panning = pans and not (is_arm or X_LA.rotation().IsExactlyIdentity())
        return HandModel(
            *(raised, config.yaw_range, X_LA, X_WB, upright.model),
            extent=extent,
            pans=is_panning,
        )

    found = {ABOVE: [FROM_ABOVE]}
    if SIDE in config.approaches:
        above = model(FROM_ABOVE, X_WB if is_arm else None)
        p_WCoM = X_WO @ surface.p_OCoM - [0.0, 0.0, table_height(fixed)]
        found[SIDE] = _from_the_side(config, above, X_WO, float(p_WCoM[2]), incoming)
    approaches = [
        X_LA
        for kind in config.approaches
        for X_LA in found[kind]
        if X_WB is None or is_arm or _is_turned_so(X_WB, X_LA)
    ]
    if not approaches:
        words = (
            f"grasp.approaches: the carrier in the plant is turned for none of {config.approaches}"
        )
        raise InvalidArgumentError(f"{words}; pass X_WB to add_hand_model")
    return ([model(X_LA, X_WB, shift) for X_LA in approaches] for shift in config.palm_shifts)


def _from_the_side(
    config: GraspConfig,
    hand: HandModel,
    X_WO: RigidTransform,
    z_CoM: float,
    incoming: FloatArray | None,
) -> list[RigidTransform]:
    """Returns the approaches X_LA from the side to a centre of mass at a height over the table."""
    height = config.side_height or max(z_CoM, least_side_height(hand))
    p_LA = [0.0, 0.0, height - z_CoM]
    yaw, level = RollPitchYaw(X_WO.rotation()).yaw_angle(), RotationMatrix.MakeYRotation(np.pi / 2)
    azimuths = yaw + _SIDES
    if incoming is not None:
        nearest = np.argmax(np.cos(_SIDES) * incoming[0] + np.sin(_SIDES) * incoming[1])
        azimuths = _SIDES[[nearest]]
    turns = [RotationMatrix.MakeZRotation(azimuth) for azimuth in azimuths]
    return [RigidTransform(turn @ level, p_LA) for turn in turns]


def _is_turned_so(X_WB: RigidTransform, X_LA: RigidTransform) -> bool:
    R_BA = X_WB.rotation().InvertAndCompose(X_LA.rotation())
    return bool(R_BA.IsNearlyIdentity(1e-6))


def table_height(fixed: Sequence[Solid]) -> float:
    """Returns the height in W of the highest level half-space, such as a table, or 0, in metres."""
    planes = [solid for solid in fixed if isinstance(solid, HalfSpace)]
    return max((float(p.point[2]) for p in planes if p.normal[2] > _LEVEL), default=0.0)


def least_side_height(hand: HandModel) -> float:
    """Returns the least height over the table of a palm from the side, in metres.

    A quarter of its yaws clear the table there.
    """
    return LINK_CLEARANCE + float(np.quantile([hand.fingers.depth(yaw) for yaw in _YAWS], 0.25))


class Approach(NamedTuple):
    """Approach of a hand to an object.

    Attributes:
        hand: Model of the hand; its attribute `X_LA` is the approach.
        start: Contacts with which the hand starts.
    """

    hand: HandModel
    start: StartContacts


def best_approach(
    groups: Iterable[Sequence[HandModel]], start_of: Callable[[HandModel], StartContacts]
) -> Approach:
    """Returns the approach with the best start contacts of the first group that has any.

    Args:
        groups: Models of the hand with their approaches, in groups; at least one.
        start_of: Function that returns the start contacts of a model.

    Raises:
        InvalidArgumentError: If none has any; it is the error of the one that is nearest to it.
            Other groups are not tried if all of a group fail for more than the lack of a grasp.
    """
    problems: list[InvalidArgumentError] = []
    for hands in groups:
        found: list[Approach] = []
        lacking: list[InvalidArgumentError] = []
        for hand in hands:
            try:
                found.append(Approach(hand, start_of(hand)))
            except InvalidArgumentError as error:
                lacking.append(error)
        if found:
            return max(found, key=lambda approach: approach.start.score)
        problems += lacking
        if not any(isinstance(problem, NoGraspError) for problem in lacking):
            break
    raise min(problems, key=_shortfall)


def _shortfall(problem: InvalidArgumentError) -> tuple[int, float]:
    """Returns how much an approach lacks: the order of `Lack`, and the distance of its palm."""
    if isinstance(problem, NoGraspError):
        return -list(Lack).index(problem.lack), problem.miss
    return 1, 0.0
