"""Obstacles without a body in Meshcat."""

from collections.abc import Sequence

from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, EventStatus, LeafSystem

from drake_pregrasp.geometry.solids import Solid
from drake_pregrasp.regions.constraints import Obstacles
from drake_pregrasp.systems.ports import OBSTACLES
from drake_pregrasp.visualization.drawing import VOLUME_COLOR, drawn_solid

ROOT = "/drake/obstacles"
"""Meshcat path under which obstacles are drawn."""


class ObstacleVisualizer(LeafSystem):
    """Draws no-touch volumes in Meshcat, translucent; bodies of a plant are drawn by Drake.

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
            meshcat.SetObject(f"{ROOT}/{index}", drawn_solid(solid)[0], VOLUME_COLOR)
        self.DeclarePeriodicPublishEvent(publish_period, 0.0, self._draw)
        self.DeclareForcedPublishEvent(self._draw)

    def _draw(self, context: Context) -> EventStatus:
        obstacles: Obstacles = self._obstacles.Eval(context)
        for index, solid in enumerate(obstacles.solids):
            X_WS = drawn_solid(solid)[1]
            self._meshcat.SetTransform(f"{ROOT}/{index}", X_WS, context.get_time())
        return EventStatus.Succeeded()
