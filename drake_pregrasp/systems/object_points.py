"""Points of the object in the pictures of depth cameras."""

import math
from typing import NamedTuple

import numpy as np
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    FrameId,
    GeometryId,
    Role,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.perception import PointCloud
from pydrake.planning import RobotDiagram
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from drake_pregrasp.arrays import SLACK, BoolArray, FloatArray, are_valid, tick_index
from drake_pregrasp.config.camera_config import DepthSensorConfig, camera_problems
from drake_pregrasp.config.validation import checked
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.estimation.fault_settings import FaultChannel, fault_generator
from drake_pregrasp.estimation.measurement_faults import drift
from drake_pregrasp.systems.ports import (
    CLOUD,
    declare_cache,
    declare_context,
    declare_output,
    points_in,
)
from drake_pregrasp.systems.pose_sensor import declare_seed

_ROUND = (Sphere, Capsule)
_EXACT = (*_ROUND, Box, Convex)
_SIMPLE = (*_ROUND, Box, Cylinder)
_MORE = 2  # Points that are compared with the hand, over those that are kept.


class _Links(NamedTuple):
    """Geometries of a hand, each inside a box with rounded edges.

    They are its collision geometries, and visual ones of simple shapes that no collision geometry
    has, such as a mast that touches nothing.

    Attributes:
        ids: Each of the k geometries G.
        X_GB: Poses of the boxes B in G.
        core: Half widths of the boxes without their rounding, shape (k, 3), in metres.
        radius: Radii of the rounding, shape (k,), in metres.
        bound: Radii of balls around the boxes, shape (k,), in metres.
        hulls: Outward normals and heights of the faces of geometries that are convex meshes, in B,
            by their index.
        is_exact: Whether a geometry counts as its box or is such a mesh, shape (k,).
    """

    ids: list[GeometryId]
    X_GB: list[RigidTransform]
    core: FloatArray
    radius: FloatArray
    bound: FloatArray
    hulls: dict[int, tuple[FloatArray, FloatArray]]
    is_exact: BoolArray

    @staticmethod
    def of(inspector: SceneGraphInspector) -> "_Links":
        """Returns the geometries of a scene."""
        ids = inspector.GetAllGeometryIds(Role.kProximity)
        known = {_place(inspector, geometry) for geometry in ids}
        seen = inspector.GetAllGeometryIds(Role.kPerception)
        seen = [id for id in seen if isinstance(inspector.GetShape(id), _SIMPLE)]
        ids += [id for id in seen if _place(inspector, id) not in known]
        shapes = [inspector.GetShape(geometry) for geometry in ids]
        boxes = [inspector.GetObbInGeometryFrame(geometry) for geometry in ids]
        X_GB = [box.pose() for box in boxes]
        radius = np.array([_rounding(shape) for shape in shapes])
        core = np.array([box.half_width() for box in boxes]).reshape(-1, 3) - radius[:, None]
        bound = np.linalg.norm(core, axis=1) + radius
        hulls = {}
        for index, shape in enumerate(shapes):
            if isinstance(shape, Convex):
                hull, R_BG = inspector.GetConvexHull(ids[index]), X_GB[index].rotation().inverse()
                faces = range(hull.num_faces())
                normals = np.array([R_BG @ hull.face_normal(face) for face in faces])
                places = [X_GB[index].inverse() @ hull.element_centroid(face) for face in faces]
                hulls[index] = normals, np.einsum("fi,fi->f", normals, np.array(places))
        exact = [id in seen or isinstance(inspector.GetShape(id), _EXACT) for id in ids]
        is_exact = np.array(exact, dtype=bool)
        return _Links(ids, X_GB, core, radius, bound, hulls, is_exact)


class ObjectPoints(LeafSystem):
    """Keeps the points of depth pictures that may belong to the object, with noise and latency.

    .. pydrake_system::

        name: ObjectPoints
        input_ports:
        - camera_0
        - hand_state
        output_ports:
        - point_cloud
        - measurement_time

    Port `camera_0` accepts a `PointCloud` in W, as Drake's `DepthImageToPointCloud` emits it, and
    is evaluated once each period of the pictures. Further cameras have `camera_1` and so on.

    Port `hand_state` (optional) accepts a vector of 2 nq: positions and velocities of the joints of
    `hand`. Points near its geometries at these positions are left out. If a position is
    not finite, no point is kept.

    Port `point_cloud` emits a `PointCloud` in W: the points of the newest picture that has arrived,
    at most `config.points`, evenly chosen. Points of the table and of the hand are left out.

    Port `measurement_time` emits a vector of 1: the time of that picture, in seconds; -inf before
    the first one has arrived.

    The noise is a pure function of the seed and of the picture's index. The seed is the numeric
    parameter 0 of the Context.

    Args:
        config: The cameras.
        hand: Plant with only the hand, and its SceneGraph; None without a hand.
        seed: Default of the seed, an integer from 0 to 2**53.

    Raises:
        InvalidArgumentError: If the configuration or the seed is out of its range.
    """

    def __init__(
        self, config: DepthSensorConfig, *, hand: RobotDiagram | None = None, seed: int = 0
    ) -> None:
        super().__init__()
        self._config = checked(config)
        if not config.cameras:
            raise InvalidArgumentError("cameras must have one element at least")
        for key, problem in camera_problems(config):
            raise InvalidArgumentError(f"{key}: {problem}")
        self._seed, _ = declare_seed(self, seed)
        self._clouds = [
            self.DeclareAbstractInputPort(f"camera_{index}", CLOUD)
            for index in range(len(config.cameras))
        ]
        self._hand = hand
        if hand is not None:
            self._hand_state = self.DeclareVectorInputPort(
                "hand_state", 2 * hand.plant().num_positions()
            )
            self._posture = declare_context(
                self, "hand at the measured positions", hand, self._place_hand, self._hand_state
            )
            self._links = _Links.of(hand.scene_graph().model_inspector())
        # A row for each picture that may be on its way, and for the one before: time and points.
        rows = math.ceil(config.latency / config.period) + 1
        none = np.full((rows, 1 + 3 * config.points), np.nan)
        none[:, 0] = -np.inf
        self._index = index = self.DeclareDiscreteState(none.ravel())
        newest = declare_cache(
            self,
            "newest picture that has arrived",
            none[0],
            self._calc_newest,
            self.discrete_state_ticket(index),
            self.time_ticket(),
        )
        declare_output(self, "point_cloud", CLOUD, lambda c: _cloud(newest.Eval(c)[1:]), newest)
        declare_output(self, "measurement_time", 1, lambda c: newest.Eval(c)[0], newest)
        self.DeclarePeriodicDiscreteUpdateEvent(config.period, 0.0, self._take_picture)

    def _calc_newest(self, context: Context) -> FloatArray:
        rows = self._pictures(context)
        arrived = context.get_time() + SLACK * self._config.period - self._config.latency
        newest: FloatArray = rows[max(int(np.sum(rows[:, 0] <= arrived)) - 1, 0)]
        return newest

    def _pictures(self, context: Context) -> FloatArray:
        """Returns a copy of the pictures, oldest first: time and points, shape (k, 1 + 3 n).

        If the clock was set back, those of a later time do not count.
        """
        stored: FloatArray = context.get_discrete_state(self._index).value()
        pictures = stored.reshape(-1, 1 + 3 * self._config.points).copy()
        is_later = pictures[:, 0] > context.get_time()
        pictures[is_later, 0], pictures[is_later, 1:] = -np.inf, np.nan
        return pictures[np.argsort(pictures[:, 0], kind="stable")]

    def _take_picture(self, context: Context, discrete_state: DiscreteValues) -> None:
        rows, p_WQ = self._pictures(context), self._visible(context)
        rows[:-1] = rows[1:]
        rows[-1, 0], rows[-1, 1:] = context.get_time(), np.nan
        rows[-1, 1 : 1 + p_WQ.size] = p_WQ.ravel()
        discrete_state.set_value(self._index, rows.ravel())

    def _visible(self, context: Context) -> FloatArray:
        """Returns the points of all cameras that are kept, shape (N, 3), in metres."""
        config, found = self._config, []
        seed = int(context.get_numeric_parameter(self._seed)[0])
        tick = tick_index(context.get_time(), config.period)
        rng = fault_generator(seed, tick, FaultChannel.DEPTH)
        most = max(1, config.points // len(config.cameras))
        for index, (camera, port) in enumerate(zip(config.cameras, self._clouds, strict=True)):
            bias = np.array(camera.bias)
            if camera.drift_std:
                since = tick * config.period / camera.drift_time
                bias = bias + camera.drift_std * drift(since, seed, index)
            heights = np.array([config.table_margin, config.ceiling]) - bias[2]
            p_WQ = points_in(port.Eval(context), heights.tolist()) + bias
            p_WQ = thinned(p_WQ, _MORE * most)
            p_WQ = thinned(p_WQ[self._is_apart(context, p_WQ)], most)
            rays = p_WQ - np.array(camera.position)
            shifts = config.noise * rng.standard_normal(len(p_WQ)) / np.linalg.norm(rays, axis=1)
            found.append(p_WQ + shifts[:, None] * rays)
        return np.concatenate(found)[: config.points]

    def _is_apart(self, context: Context, p_WQ: FloatArray) -> BoolArray:
        """Returns which points are not near to a link of the hand, shape (N,)."""
        if self._hand is None or not self._hand_state.HasValue(context):
            return np.ones(len(p_WQ), dtype=bool)
        if not are_valid(self._hand_state.Eval(context)[: self._hand.plant().num_positions()]):
            return np.zeros(len(p_WQ), dtype=bool)
        posture, graph = self._posture.Eval(context), self._hand.scene_graph()
        query = graph.get_query_output_port().Eval(graph.GetMyContextFromRoot(posture))
        links, margin = self._links, self._config.link_margin
        X_WB = [query.GetPoseInWorld(id) @ X for id, X in zip(links.ids, links.X_GB, strict=True)]
        R_WB = np.array([X.rotation().matrix() for X in X_WB])
        p_WB = np.array([X.translation() for X in X_WB])
        # Pairs of a point and a box whose ball it is in; p_BQ² = p_WQ² - 2 p_WQ p_WB + p_WB².
        squares = [np.einsum("ki,ki->k", p, p) for p in (p_WQ, p_WB)]
        apart = squares[0][:, None] - 2 * p_WQ @ p_WB.T + squares[1]
        point, box = np.nonzero(apart < (links.bound + margin) ** 2)
        p_BQ = np.einsum("ki,kij->kj", p_WQ[point] - p_WB[box], R_WB[box])
        beyond = np.maximum(np.abs(p_BQ) - links.core[box], 0.0)
        is_near = np.einsum("ki,ki->k", beyond, beyond) < (links.radius[box] + margin) ** 2
        for index, (normals, heights) in links.hulls.items():
            inside = np.flatnonzero(is_near & (box == index))
            is_near[inside] = (p_BQ[inside] @ normals.T - heights < margin).all(axis=1)
        is_apart = np.ones(len(p_WQ), dtype=bool)
        is_apart[point[is_near & links.is_exact[box]]] = False
        for index in set(point[is_near]):
            if is_apart[index]:
                is_apart[index] = not query.ComputeSignedDistanceToPoint(p_WQ[index], margin)
        return is_apart

    def _place_hand(self, context: Context, posture: Context) -> None:
        assert self._hand is not None
        plant = self._hand.plant()
        q = self._hand_state.Eval(context)[: plant.num_positions()]
        plant.SetPositions(plant.GetMyMutableContextFromRoot(posture), q)


def _rounding(shape: Shape) -> float:
    """Returns the radius of the edges of a shape's box: of a long cylinder, as of a capsule."""
    is_round = isinstance(shape, _ROUND) or (
        isinstance(shape, Cylinder) and shape.length() >= 2 * shape.radius()
    )
    return float(shape.radius()) if is_round else 0.0


def _place(inspector: SceneGraphInspector, geometry: GeometryId) -> tuple[FrameId, bytes]:
    """Returns the frame of a geometry, and its box there to a tenth of a millimetre."""
    box = inspector.GetObbInGeometryFrame(geometry)
    X_FB = inspector.GetPoseInFrame(geometry) @ box.pose()
    numbers = np.append(X_FB.GetAsMatrix34(), box.half_width())
    return inspector.GetFrameId(geometry), (np.round(numbers, 4) + 0.0).tobytes()


def _cloud(picture: FloatArray) -> PointCloud:
    """Returns the points of a picture, which ends with NaN, as a `PointCloud`."""
    p_WQ = picture[~np.isnan(picture)].reshape(-1, 3)
    cloud = PointCloud(len(p_WQ))
    cloud.mutable_xyzs()[:] = p_WQ.T
    return cloud


def thinned(points: FloatArray, most: int) -> FloatArray:
    """Returns points, shape (N, 3), evenly chosen if there are more than `most`."""
    if len(points) <= most:
        return points
    chosen: FloatArray = points[np.linspace(0, len(points) - 1, most).astype(int)]
    return chosen
