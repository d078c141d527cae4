"""Obstacles in Meshcat."""

from collections.abc import Sequence

import numpy as np
from pydrake.geometry import Box, Meshcat, Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context, EventStatus, LeafSystem

from drake_pregrasp.geometry.solids import BallSolid, BoxSolid, HalfSpace, Solid
from drake_pregrasp.regions.constraints import Obstacles
from drake_pregrasp.systems.ports import OBSTACLES

ROOT = "/drake/obstacles"
"""Meshcat path under which obstacles are drawn."""

_COLOR = Rgba(0.84, 0.37, 0.0, 0.3)
_PLATE = 0.36  # Edge of the plate that represents a half-space, in metres.
_THICKNESS = 0.004
_DEPTH = 0.004  # Depth of its middle below the plane, so that it does not hide a table, in metres.


class ObstacleVisualizer(LeafSystem):
    """Draws obstacles in Meshcat.

    .. pydrake_system::

        name: ObstacleVisualizer
        input_ports:
        - obstacles

    Port `obstacles` accepts `Obstacles` in W, with solids of the same kinds and sizes as `solids`.
    Half-spaces are drawn as plates just below their plane.

    Args:
        meshcat: Meshcat instance to draw in.
        solids: Initial obstacles, in W.
        publish_period: Seconds between frames, greater than zero.
    """

    def __init__(self, *, meshcat: Meshcat, solids: Sequence[Solid], publish_period: float) -> None:
        super().__init__()
        self._meshcat = meshcat
        self._obstacles = self.DeclareAbstractInputPort("obstacles", OBSTACLES)
        meshcat.Delete(ROOT)
        for index, solid in enumerate(solids):
            meshcat.SetObject(f"{ROOT}/{index}", _geometry(solid), _COLOR)
        self.DeclarePeriodicPublishEvent(publish_period, 0.0, self._draw)
        self.DeclareForcedPublishEvent(self._draw)

    def _draw(self, context: Context) -> EventStatus:
        obstacles: Obstacles = self._obstacles.Eval(context)
        for index, solid in enumerate(obstacles.solids):
            self._meshcat.SetTransform(f"{ROOT}/{index}", _pose(solid), context.get_time())
        return EventStatus.Succeeded()


def _geometry(solid: Solid) -> Sphere | Box:
    if isinstance(solid, BallSolid):
        return Sphere(solid.radius)
    if isinstance(solid, BoxSolid):
        return Box(*solid.size)
    return Box(_PLATE, _PLATE, _THICKNESS)


def _pose(solid: Solid) -> RigidTransform:
    if isinstance(solid, BoxSolid):
        return RigidTransform(RotationMatrix.ProjectToRotationMatrix(solid.R_FB), solid.center)
    if isinstance(solid, HalfSpace):
        R_WP = RotationMatrix.MakeFromOneVector(solid.normal, axis_index=2)
        return RigidTransform(R_WP, solid.point - _DEPTH * solid.normal)
    assert isinstance(solid, BallSolid)
    return RigidTransform(np.array(solid.center))
