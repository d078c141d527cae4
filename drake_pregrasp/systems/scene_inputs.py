"""Sources of the planner's inputs: contact weights, the hand's pose, and moving obstacles."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.solids import Solid
from drake_pregrasp.regions.constraints import Obstacles


class ContactWeights(LeafSystem):
    """Emits the weights h_i of Eq. 1, and from stated times on -inf for fingers that are lost.

    .. pydrake_system::

        name: ContactWeights
        output_ports:
        - contact_weights

    Port `contact_weights` emits a vector of n, in m²; -inf says that the finger is lost.

    Args:
        weights: h_i, shape (n,), in m².
        losses: Pairs of a time in seconds and the indices of the contacts that are lost from it on.

    Raises:
        InvalidArgumentError: If a contact isn't there.
    """

    def __init__(
        self, weights: FloatArray, losses: Sequence[tuple[float, Sequence[int]]] = ()
    ) -> None:
        super().__init__()
        self._weights = np.array(weights, dtype=float)
        self._losses = [(time, list(contacts)) for time, contacts in losses]
        for _, contacts in self._losses:
            for contact in contacts:
                if not 0 <= contact < len(self._weights):
                    raise InvalidArgumentError(
                        f"there is no contact {contact}; there are 0 to {len(self._weights) - 1}"
                    )
        self.DeclareVectorOutputPort(
            "contact_weights", len(self._weights), self._calc_weights, {self.time_ticket()}
        )

    def _calc_weights(self, context: Context, output: BasicVector) -> None:
        weights = self._weights.copy()
        for time, contacts in self._losses:
            if context.get_time() >= time - 1e-9:  # A tick's time may be rounded to just before.
                weights[contacts] = -np.inf
        output.SetFromVector(weights)


class HandPose(LeafSystem):
    """Carries a hand's frame along with an object, without turning it.

    .. pydrake_system::

        name: HandPose
        input_ports:
        - X_WO_estimated
        output_ports:
        - X_WH

    Port `X_WO_estimated` accepts a `RigidTransform`: where the object O is believed to be in W.

    Port `X_WH` emits a `RigidTransform`: the hand H in W. Its orientation is constant; so is its
    place relative to the object's origin if it follows, else its place in W.

    Args:
        X_WH: The constant orientation, and the place in W of a hand that stays, or relative to the
            object's origin of one that follows.
        follow: Whether the hand follows.
    """

    def __init__(self, X_WH: RigidTransform, *, follow: bool = True) -> None:
        super().__init__()
        self._X = X_WH
        self._follow = follow
        self._X_WO_estimated = self.DeclareAbstractInputPort(
            "X_WO_estimated", AbstractValue.Make(RigidTransform())
        )
        self.DeclareAbstractOutputPort(
            "X_WH",
            lambda: AbstractValue.Make(RigidTransform()),
            self._calc_pose,
            {self._X_WO_estimated.ticket()},
        )

    def _calc_pose(self, context: Context, output: AbstractValue) -> None:
        p_WH = self._X.translation()
        if self._follow:
            p_WH = p_WH + self._X_WO_estimated.Eval(context).translation()
        output.set_value(RigidTransform(self._X.rotation(), p_WH))


@dataclass(frozen=True, eq=False)
class MovingSolid:
    """A solid with a constant velocity.

    Attributes:
        solid: At time zero, in W.
        velocity: In W, shape (3,), in m/s.
    """

    solid: Solid
    velocity: FloatArray


class MovingObstacles(LeafSystem):
    """Emits obstacles that move steadily.

    .. pydrake_system::

        name: MovingObstacles
        output_ports:
        - obstacles

    Port `obstacles` emits `Obstacles` in W, where they are `lookahead` after the Context's time,
    with their velocities.

    Args:
        obstacles: The solids, in the order of their indices.
        lookahead: In seconds: that of the goals that are to stay clear of them.
    """

    def __init__(self, obstacles: Sequence[MovingSolid], *, lookahead: float = 0.0) -> None:
        super().__init__()
        self._lookahead = lookahead
        self._moving = tuple(obstacles)
        self.DeclareAbstractOutputPort(
            "obstacles",
            lambda: AbstractValue.Make(Obstacles()),
            self._calc_obstacles,
            {self.time_ticket()},
        )

    def _calc_obstacles(self, context: Context, output: AbstractValue) -> None:
        time = context.get_time() + self._lookahead
        solids = tuple(m.solid.moved(np.eye(3), time * m.velocity) for m in self._moving)
        velocities = np.array([m.velocity for m in self._moving]).reshape(-1, 3)
        output.set_value(Obstacles(solids, velocities=velocities))
