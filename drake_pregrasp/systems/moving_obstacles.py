"""Obstacles that move through the world."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, LeafSystem

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.region_constraints import Obstacles
from drake_pregrasp.planning.solids import Solid


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
