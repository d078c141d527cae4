"""Points that cameras see, in Meshcat."""

from pydrake.geometry import Meshcat, Rgba, Sphere
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, EventStatus, LeafSystem

from drake_pregrasp.systems.object_points import thinned
from drake_pregrasp.systems.ports import CLOUD, points_in

ROOT = "/drake/points"
"""Meshcat path under which points are drawn."""

_COLOR = Rgba(0.84, 0.1, 0.35)
_SHOWN = 80  # Largest number of points that are drawn.
_RADIUS = 0.0012  # Of a drawn point, in metres.
_AWAY = RigidTransform([0.0, 0.0, -100.0])  # Place of points that are not there.


class PointVisualizer(LeafSystem):
    """Draws the points of a cloud in Meshcat, also in a recording.

    .. pydrake_system::

        name: PointVisualizer
        input_ports:
        - point_cloud

    Port `point_cloud` accepts a `PointCloud` in W. If it has many points, a part of them is drawn,
    evenly chosen.

    Args:
        meshcat: Meshcat instance to draw in.
        publish_period: Seconds between frames, greater than zero.
    """

    def __init__(self, *, meshcat: Meshcat, publish_period: float) -> None:
        super().__init__()
        self._meshcat = meshcat
        self._cloud = self.DeclareAbstractInputPort("point_cloud", CLOUD)
        meshcat.Delete(ROOT)
        # A recording keeps the motion of objects, but no objects that come later.
        for index in range(_SHOWN):
            meshcat.SetObject(f"{ROOT}/{index}", Sphere(_RADIUS), _COLOR)
        self.DeclarePeriodicPublishEvent(publish_period, 0.0, self._draw)
        self.DeclareForcedPublishEvent(self._draw)

    def _draw(self, context: Context) -> EventStatus:
        points = thinned(points_in(self._cloud.Eval(context)), _SHOWN)
        places = [RigidTransform(p) for p in points] + [_AWAY] * (_SHOWN - len(points))
        for index, X_WQ in enumerate(places):
            self._meshcat.SetTransform(f"{ROOT}/{index}", X_WQ, context.get_time())
        return EventStatus.Succeeded()
