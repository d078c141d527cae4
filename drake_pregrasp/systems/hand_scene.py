"""Signed distances between the links of a hand, the object, and what is around them."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import trimesh
from pydrake.geometry import (
    Box,
    Capsule,
    CollisionFilterDeclaration,
    CollisionFilterManager,
    Convex,
    Cylinder,
    Ellipsoid,
    FramePoseVector,
    GeometryFrame,
    GeometryId,
    GeometryInstance,
    GeometrySet,
    ProximityProperties,
    Role,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.planning import RobotDiagram
from pydrake.systems.framework import Context

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.fast.kernels import HandKernels
from drake_pregrasp.geometry.mesh_solid import MeshSolid
from drake_pregrasp.geometry.rotations import skew
from drake_pregrasp.geometry.sampling import split_triangles
from drake_pregrasp.geometry.solids import SignedDistance, Solid
from drake_pregrasp.grasping.clearances import INFLUENCE, Clearances, Links, NearPairs
from drake_pregrasp.grasping.forward_kinematics import HandPose
from drake_pregrasp.grasping.grasp_state import BASE
from drake_pregrasp.grasping.hand_commands import GraspCommand
from drake_pregrasp.systems.hand_kinematics import (
    HandKinematics,
    HandLink,
    hand_links,
    moving_joints,
)

_BALL_SPACING = 0.004  # Largest distance of neighbouring balls of a link, in metres.
_DEEPEST = 1e-3  # Largest depth of a link in a fixed solid at the start, in metres: it may touch.
_HUGE = 10.0  # Largest distance that counts, in metres: a half-space becomes a box.
_THIN = 1e-6  # Least edge of a box, in metres: Drake's have none of length 0.


def drake_shape(
    solid: SignedDistance, near: FloatArray | None = None
) -> tuple[Shape, RigidTransform]:
    """Returns a convex set's shape for Drake and its pose, as far as it is within 10 m of a place.

    Args:
        solid: A `Solid`, or a convex `MeshSolid`.
        near: The place in the solid's frame, shape (3,), in metres; the origin by default.
    """
    if isinstance(solid, MeshSolid):
        X_FM = RigidTransform(RotationMatrix(solid.R_FM), solid.p_FM)
        return Convex(points=solid.corners.T, label="object"), X_FM
    assert isinstance(solid, Solid)
    row = solid.rounded_box()
    axes, low, high, radius = row[3:12].reshape(3, 3), row[12:15], row[15:18], row[18]
    if np.array_equal(low, high):
        return Sphere(radius), RigidTransform(row[:3])
    if np.any(axes[:, 0]):
        R_FB = RotationMatrix.ProjectToRotationMatrix(axes)
    else:  # Of a half-space, whose row has the normal alone.
        R_FB = RotationMatrix.MakeFromOneVector(axes[:, 2], axis_index=2)
    place = R_FB.inverse() @ ((np.zeros(3) if near is None else near) - row[:3])
    low, high = np.clip([place - _HUGE, place + _HUGE], low, high)
    size = np.maximum(high - low, _THIN)
    return Box(*size), RigidTransform(R_FB, row[:3] + R_FB @ ((low + high) / 2))


def _rough(p: FloatArray) -> FloatArray:
    """Returns a place within 3 m of another; it seldom changes, and with it the shapes there."""
    return np.round(p / (_HUGE / 3)) * (_HUGE / 3)


def separate_fingers(manager: CollisionFilterManager, links: Mapping[GeometryId, HandLink]) -> None:
    """Lets links collide with those of other fingers, but not with the base or their own finger.

    Neighbouring links overlap at their joints.

    Args:
        manager: Collision filters of the SceneGraph.
        links: Collision geometries of the hand.
    """
    limbs: dict[int, list[GeometryId]] = defaultdict(list)
    for geometry, link in links.items():
        limbs[link.finger].append(geometry)
    base = GeometrySet(limbs[BASE])
    for limb in map(GeometrySet, limbs.values()):
        manager.Apply(CollisionFilterDeclaration().ExcludeWithin(limb).ExcludeBetween(limb, base))


class HandScene:
    """A hand, the object, and what is around them. The caller provides the Context.

    Fingers are kept clear of each other, but not of the base, nor a finger of itself.

    The attribute `diagram` holds the plant and its SceneGraph, `hand` the hand's kinematics, and
    `kernels` the implementation.

    Args:
        diagram: Plant with only the hand, and its SceneGraph; no Context of it exists.
        hand: Kinematics of the hand in this plant.
        kernels: Implementation of `clearances`, `next_velocities` and distances.
        tip_radii: Radii of the fingertips, shape (n,), in metres.
        object_solid: The object in O.
        fixed: Solids in W that do not move, such as the table.
    """

    def __init__(
        self,
        diagram: RobotDiagram,
        hand: HandKinematics,
        kernels: HandKernels,
        *,
        tip_radii: FloatArray,
        object_solid: SignedDistance,
        fixed: Sequence[Solid],
    ) -> None:
        self.diagram, self.hand, self.kernels = diagram, hand, kernels
        self._graph = diagram.mutable_scene_graph()
        self._query = self._graph.get_query_output_port()
        self._source = self._graph.RegisterSource("scene")
        frames = [GeometryFrame("object"), GeometryFrame("obstacles")]
        self._object_frame, self._obstacle_frame = (
            self._graph.RegisterFrame(self._source, frame) for frame in frames
        )
        hull = object_solid.hull()
        self._solid = None if hull is object_solid else kernels.solid(object_solid)
        self._object = self._graph.RegisterGeometry(
            self._source, self._object_frame, _geometry("object", *drake_shape(hull))
        )
        near = _rough(hand.pose(np.zeros(hand.num_positions)).p_WT[0])
        around = [
            self._graph.RegisterAnchoredGeometry(
                self._source, _geometry(f"fixed {index}", *drake_shape(solid, near))
            )
            for index, solid in enumerate(fixed)
        ]
        links = hand_links(hand.plant, hand.frames, tip_radii, self._graph.model_inspector())
        filters = self._graph.collision_filter_manager()
        separate_fingers(filters, links)
        filters.Apply(
            CollisionFilterDeclaration().ExcludeWithin(GeometrySet([self._object, *around]))
        )
        # Links come first, then the object; all other geometries share the last index.
        self._index = {geometry: index for index, geometry in enumerate([*links, self._object])}
        inspector, found = self._graph.model_inspector(), list(links.values())
        moves = [moving_joints(hand.plant, link.frame) for link in found]
        self._links = Links(
            finger=np.array([link.finger for link in found]),
            is_tip=np.array([link.is_tip for link in found]),
            is_last=np.array([link.is_last for link in found]),
            moves=np.vstack([*moves, np.zeros((2, hand.num_positions))]),
        )
        self._names = [link.frame.scoped_name().get_full() for link in found]
        self._fixed = {geometry: f"fixed[{index}]" for index, geometry in enumerate(around)}
        self._bodies = np.array([int(link.frame.body().index()) for link in found])
        X_BL = [inspector.GetPoseInFrame(geometry).GetAsMatrix34() for geometry in links]
        self._R_BLink, self._p_BLink = np.split(np.array(X_BL), [3], axis=2)
        self._balls = [link_balls(inspector, geometry) for geometry in links]

    def place(
        self, context: Context, q: FloatArray, X_WO: RigidTransform, obstacles: Sequence[Solid]
    ) -> None:
        """Sets the positions of the hand, and the places of the object and of obstacles.

        Args:
            context: Context of the diagram.
            q: Positions of all joints, shape (nq,).
            X_WO: Pose of the object.
            obstacles: Further solids in W.
        """
        state = self.hand.plant.GetMyMutableContextFromRoot(context)
        self.hand.plant.SetPositions(state, q)
        graph = self._graph.GetMyMutableContextFromRoot(context)
        poses = FramePoseVector()
        poses.set_value(self._object_frame, X_WO)
        poses.set_value(self._obstacle_frame, RigidTransform())
        self._graph.get_source_pose_port(self._source).FixValue(graph, poses)
        inspector = self._query.Eval(graph).inspector()
        there = inspector.NumGeometriesForFrame(self._obstacle_frame)
        if not there and not obstacles:
            return
        old = inspector.GetGeometries(self._obstacle_frame, Role.kProximity)
        names = {inspector.GetName(g): g for g in old}
        near = _rough(self.hand.frames[0].CalcPoseInWorld(state).translation())
        for index, solid in enumerate(obstacles):
            shape, X_WS = drake_shape(solid, near)
            geometry = names.pop(f"obstacle {index}", None)
            if geometry is None:
                added = _geometry(f"obstacle {index}", shape, X_WS)
                self._graph.RegisterGeometry(graph, self._source, self._obstacle_frame, added)
            elif not (
                X_WS.IsExactlyEqualTo(inspector.GetPoseInFrame(geometry))
                and repr(shape) == repr(inspector.GetShape(geometry))
            ):
                self._graph.ChangeShape(graph, self._source, geometry, shape, X_WS)
        for geometry in names.values():
            self._graph.RemoveGeometry(graph, self._source, geometry)

    def check_start(self, q: FloatArray) -> None:
        """Checks that no link that moves starts inside of a solid that does not move.

        Args:
            q: Initial positions of all joints, shape (nq,).

        Raises:
            InvalidArgumentError: If one does; the message names the deepest one.
        """
        context = self.diagram.CreateDefaultContext()
        self.place(context, q, RigidTransform(), ())
        query = self._query.Eval(self._graph.GetMyContextFromRoot(context))
        found = [
            (pair.distance, self._names[self._index[link]], self._fixed[other])
            for pair in query.ComputeSignedDistancePairwiseClosestPoints(0.0)
            for link, other in ((pair.id_A, pair.id_B), (pair.id_B, pair.id_A))
            if other in self._fixed and self._links.moves[self._index.get(link, -1)].any()
        ]
        distance, link, solid = min(found, default=(0.0, "", ""))
        if distance < -_DEEPEST:
            raise InvalidArgumentError(
                f"link {link} starts {-1e3 * distance:.3g} mm deep in {solid}, which is the table"
                " unless you pass others; move the base or the object, or pass other solids"
            )

    def clearances(
        self, context: Context, pose: HandPose, command: GraspCommand, rate: float
    ) -> Clearances:
        """Returns the constraints on the hand's velocities.

        Args:
            context: Context of the diagram after `place`.
            pose: Kinematics of the hand there.
            command: Motion of the object, and which fingertips hold it or close on it: these are
                kept clear of other fingers only.
            rate: Largest ratio of the speed at which a gap closes to the gap that is left, in 1/s.
        """
        query = self._query.Eval(self._graph.GetMyContextFromRoot(context))
        index, rest = self._index, len(self._index)
        links, found = rest - 1, []
        for pair in query.ComputeSignedDistancePairwiseClosestPoints(INFLUENCE):
            a, b = index.get(pair.id_A, rest), index.get(pair.id_B, rest)
            if a < links:
                found.append((a, b, pair.distance, pair.p_ACa, pair.nhat_BA_W))
            elif b < links:
                found.append((b, a, pair.distance, pair.p_BCb, -pair.nhat_BA_W))
        if not found:
            return Clearances(np.empty((0, len(pose.screws.T))), np.empty(0), np.empty(0, int))
        link, other, gaps, p_LinkQ, normals = (np.array(part) for part in zip(*found, strict=True))
        X_WB = pose.X_WB[self._bodies[link]]
        p_BQ = self._R_BLink[link] @ p_LinkQ[:, :, None] + self._p_BLink[link]
        p_WQ = (X_WB[:, :, :3] @ p_BQ)[:, :, 0] + X_WB[:, :, 3]
        R_WE, p_WE, (w_WE, v_WE) = command.R_WE, command.p_WE, command.V_WE
        rows = np.flatnonzero(other == links)
        if self._solid is not None and len(rows):  # Drake measures from the hull of the object.
            solid = self._solid.moved(R_WE, p_WE)
            gaps[rows], p_WQ[rows], normals[rows] = self._nearest(solid, link[rows], pose)
        V_W = np.concatenate([w_WE, v_WE + skew(p_WE) @ w_WE])  # At the origin of W.
        near = NearPairs(link, other, gaps, p_WQ, normals)
        holding = command.fingers_hold
        return self.kernels.clearances(self._links, near, pose.screws, V_W, holding, rate)

    def _nearest(
        self, solid: SignedDistance, link: IntArray, pose: HandPose
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Returns gaps of links to a solid in W, points on the way, and outward normals there.

        Args:
            solid: The solid in W.
            link: Indices of the links, shape (k,).
            pose: Kinematics of the hand.
        """
        counts = [len(self._balls[i]) for i in link]
        owner, balls = np.repeat(np.arange(len(link)), counts), [self._balls[i] for i in link]
        centers, radii = np.split(np.concatenate(balls), [3], axis=1)
        X_WB = pose.X_WB[self._bodies[link]][owner]
        p_WS = (X_WB[:, :, :3] @ centers[:, :, None])[:, :, 0] + X_WB[:, :, 3]
        distances, outward = solid.distance_and_gradient(p_WS)
        gaps = distances - radii[:, 0]
        nearest = np.lexsort((gaps, owner))[np.cumsum(counts) - counts]
        return gaps[nearest], p_WS[nearest], outward[nearest]


class LinkBalls(NamedTuple):
    """Balls inside a link of a finger or of the palm.

    Attributes:
        finger: Index of the finger, or `BASE`.
        joints: Number of the finger's own joints that carry the link.
        is_tip: Whether it is a fingertip.
        balls: Centres in W and radii, shape (k, 4), in metres.
    """

    finger: int
    joints: int
    is_tip: bool
    balls: FloatArray


BallFunction = Callable[[SceneGraphInspector, GeometryId], FloatArray]
"""Function such as `inner_balls` or `link_balls`."""


def palm_and_finger_balls(
    hand: HandKinematics,
    inspector: SceneGraphInspector,
    tip_radii: FloatArray,
    q: FloatArray,
    balls_of: BallFunction,
) -> Iterator[LinkBalls]:
    """Yields the balls of each link that moves with the palm, one by one.

    Args:
        hand: Kinematics of the hand.
        inspector: Inspector of the SceneGraph of its plant.
        tip_radii: Radii of the fingertips, shape (n,), in metres.
        q: Positions of the joints, shape (nq,).
        balls_of: Function that returns the balls of a geometry.
    """
    X_WB = hand.pose(q).X_WB
    shared = np.all([moving_joints(hand.plant, frame) for frame in hand.frames], axis=0)
    for geometry, link in hand_links(hand.plant, hand.frames, tip_radii, inspector).items():
        moved = moving_joints(hand.plant, link.frame)
        if moved[shared].all():
            centers, radii = np.split(balls_of(inspector, geometry), [3], axis=1)
            R_WB, p_WB = np.split(X_WB[int(link.frame.body().index())], [3], axis=1)
            own = 0 if link.finger == BASE else int(np.sum(moved[hand.own_joints(link.finger)]))
            balls = np.column_stack([centers @ R_WB.T + p_WB.T, radii])
            yield LinkBalls(link.finger, own, link.is_tip, balls)


def inner_balls(inspector: SceneGraphInspector, geometry: GeometryId) -> FloatArray:
    """Returns balls along the longest axis of a convex geometry, and its corners, shape (k, 4).

    The rows are those of `link_balls`; together they are fewer.

    Args:
        inspector: Inspector of the SceneGraph.
        geometry: Collision geometry of a link.
    """
    balls = link_balls(inspector, geometry)
    if balls[0, 3] > 0:
        return balls
    points = balls[:, :3]
    axes = np.linalg.svd(points - np.mean(points, axis=0), full_matrices=False)[2]
    along = points @ axes.T
    low, high = np.min(along, axis=0), np.max(along, axis=0)
    centers = (low + high)[None] / 2
    radius = float(np.min(np.linalg.norm(along - centers, axis=1)))
    if (most := float(high[0] - low[0]) / 2 - radius) > 0:
        shifts = np.linspace(-most, most, 2 + int(2 * most / radius))
        centers = centers + shifts[:, None] * [1.0, 0.0, 0.0]
    radii = np.min(np.linalg.norm(along - centers[:, None], axis=2), axis=1)
    corners = link_balls(inspector, geometry, np.inf)
    return np.concatenate([np.column_stack([centers @ axes, radii]), corners])


def link_balls(
    inspector: SceneGraphInspector, geometry: GeometryId, spacing: float = _BALL_SPACING
) -> FloatArray:
    """Returns balls inside a convex geometry that touch its surface all over, shape (k, 4).

    The rows hold the centre in the frame of the body and the radius, in metres. The balls of a
    sphere or a capsule have its radius, and those of other shapes are points of the surface.

    Args:
        inspector: Inspector of the SceneGraph.
        geometry: Collision geometry of a link.
        spacing: Largest distance of neighbouring balls, in metres.
    """
    shape, radius = inspector.GetShape(geometry), 0.0
    if isinstance(shape, Sphere):
        centers, radius = np.zeros((1, 3)), shape.radius()
    elif isinstance(shape, Capsule):
        z = np.linspace(-0.5, 0.5, 2 + int(shape.length() / spacing)) * shape.length()
        centers, radius = z[:, None] * [0.0, 0.0, 1.0], shape.radius()
    else:
        if isinstance(shape, Box):
            mesh = trimesh.creation.box(shape.size())
        elif isinstance(shape, Cylinder):
            mesh = trimesh.creation.cylinder(shape.radius(), shape.length())
        elif isinstance(shape, Ellipsoid):
            mesh = trimesh.creation.icosphere()
            mesh.apply_scale([shape.a(), shape.b(), shape.c()])
        else:
            hull = inspector.GetConvexHull(geometry)
            corners = [hull.vertex(index) for index in range(hull.num_vertices())]
            mesh = trimesh.convex.convex_hull(np.array(corners))
        parts = split_triangles(mesh.triangles, mesh.face_normals, spacing)
        centers = np.unique(parts.corners.reshape(-1, 3), axis=0)
    p_BS = (inspector.GetPoseInFrame(geometry) @ centers.T).T
    return np.column_stack([p_BS, np.full(len(p_BS), radius)])


def _geometry(name: str, shape: Shape, X_FG: RigidTransform) -> GeometryInstance:
    geometry = GeometryInstance(X_FG, shape, name)
    geometry.set_proximity_properties(ProximityProperties())
    return geometry
