"""Signed distances between the links of a hand, the object, and what is around them."""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import (
    Box,
    CollisionFilterDeclaration,
    CollisionFilterManager,
    FramePoseVector,
    GeometryFrame,
    GeometryId,
    GeometryInstance,
    GeometrySet,
    ProximityProperties,
    Role,
    Shape,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.planning import RobotDiagram
from pydrake.systems.framework import Context

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.geometry.solids import HalfSpace, Solid
from drake_pregrasp.grasping.grasp_state import BASE
from drake_pregrasp.systems.drawing import drawn_solid
from drake_pregrasp.systems.fingertip_sensor import HandKinematics, HandLink, hand_links

LINK_CLEARANCE = 0.005
"""Least gap of links to everything but the hand, in metres: more than the error of an estimate."""

TIP_CLEARANCE = 0.002
"""Least gap of fingertips to everything but the hand, in metres; their goals keep a larger one."""

FINGER_CLEARANCE = 0.0005
"""Least gap between different fingers, in metres: their positions are known."""

_TIP_LEAD = 0.002  # Least distance by which a fingertip is nearer to the object than its links.
_INFLUENCE = 0.025  # Distance below which motions are limited, in metres.
_RATE = 15.0  # Largest ratio of the speed of approach to the distance that is left, in 1/s.
FASTEST_APPROACH = _RATE * _INFLUENCE
"""Largest speed at which links can slow down in time, in m/s."""

_RETREAT = 0.05  # Largest speed at which a clearance that is violated is restored, in m/s.
_HUGE = 10.0  # Edge of the box that represents a half-space, in metres.


@dataclass(frozen=True, eq=False)
class Clearances:
    """Linear constraints that keep a hand clear: rows v >= least for its joint velocities v.

    Attributes:
        rows: Gradients of signed distances, shape (k, nq).
        least: Least rates of change of the distances by the hand's own motion, shape (k,), in m/s.
        fingers: Index of a finger that each row keeps clear, -1 for the base, shape (k,).
    """

    rows: FloatArray
    least: FloatArray
    fingers: IntArray


def drake_shape(solid: Solid) -> tuple[Shape, RigidTransform]:
    """Returns a solid's shape for Drake and the pose of its frame; half-spaces are large boxes."""
    if not isinstance(solid, HalfSpace):
        return drawn_solid(solid)
    R_FB = RotationMatrix.MakeFromOneVector(solid.normal, axis_index=2)
    center = solid.point - _HUGE / 2 * solid.normal
    return Box(_HUGE, _HUGE, _HUGE), RigidTransform(R_FB, center)


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

    The attribute `diagram` holds the plant and its SceneGraph, and `hand` the hand's kinematics.

    Args:
        diagram: Plant with only the hand, and its SceneGraph; no Context of it exists.
        hand: Kinematics of the hand in this plant.
        tip_radii: Radii of the fingertips, shape (n,), in metres.
        object_solid: The object in O.
        fixed: Solids in W that do not move, such as the table.
    """

    def __init__(
        self,
        diagram: RobotDiagram,
        hand: HandKinematics,
        *,
        tip_radii: FloatArray,
        object_solid: Solid,
        fixed: Sequence[Solid],
    ) -> None:
        self.diagram, self.hand = diagram, hand
        self._graph = diagram.mutable_scene_graph()
        self._source = self._graph.RegisterSource("scene")
        frames = [GeometryFrame("object"), GeometryFrame("obstacles")]
        self._object_frame, self._obstacle_frame = (
            self._graph.RegisterFrame(self._source, frame) for frame in frames
        )
        self._object = self._graph.RegisterGeometry(
            self._source, self._object_frame, _geometry("object", *drake_shape(object_solid))
        )
        for index, solid in enumerate(fixed):
            geometry = _geometry(f"fixed {index}", *drake_shape(solid))
            self._graph.RegisterAnchoredGeometry(self._source, geometry)
        self._links = hand_links(hand.plant, hand.frames, tip_radii, self._graph.model_inspector())
        separate_fingers(self._graph.collision_filter_manager(), self._links)

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
        self.hand.plant.SetPositions(self.hand.plant.GetMyMutableContextFromRoot(context), q)
        graph = self._graph.GetMyMutableContextFromRoot(context)
        poses = FramePoseVector()
        poses.set_value(self._object_frame, X_WO)
        poses.set_value(self._obstacle_frame, RigidTransform())
        self._graph.get_source_pose_port(self._source).FixValue(graph, poses)
        inspector = self._graph.get_query_output_port().Eval(graph).inspector()
        old = inspector.GetGeometries(self._obstacle_frame, Role.kProximity)
        names = {inspector.GetName(g): g for g in old}
        for index, solid in enumerate(obstacles):
            shape, X_WS = drake_shape(solid)
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

    def clearances(self, context: Context, V_WO: SpatialVelocity, holding: BoolArray) -> Clearances:
        """Returns the constraints on the hand's velocities.

        Fingertips that hold the object may touch it, but their links stay farther from it.

        Args:
            context: Context of the diagram after `place`.
            V_WO: Spatial velocity of the object's frame O in W.
            holding: Whether each fingertip holds the object or closes on it, shape (n,): only other
                fingers are kept clear of it.
        """
        query = self._graph.get_query_output_port().Eval(self._graph.GetMyContextFromRoot(context))
        motion = self._motions(context, V_WO)
        gaps: list[float] = []
        least_gaps, is_kept, fingers, lines, changes = [], [], [], [], []
        tips: dict[int, int] = {}
        last_links: list[int] = []
        for pair in query.ComputeSignedDistancePairwiseClosestPoints(_INFLUENCE):
            a, b = self._links.get(pair.id_A), self._links.get(pair.id_B)
            link, among_fingers = a or b, bool(a and b)
            if link is None:
                continue
            if self._object in (pair.id_A, pair.id_B):
                if link.is_tip:
                    tips[link.finger] = len(gaps)
                elif link.is_last and holding[link.finger]:
                    last_links.append(len(gaps))
            is_kept.append(among_fingers or not (link.is_tip and holding[link.finger]))
            alone = TIP_CLEARANCE if link.is_tip else LINK_CLEARANCE
            least_gaps.append(FINGER_CLEARANCE if among_fingers else alone)
            fingers.append(link.finger)
            gaps.append(pair.distance)
            p_WC = query.GetPoseInWorld(pair.id_A) @ pair.p_ACa
            lines.append((p_WC, pair.nhat_BA_W))
            changes.append(motion(pair.id_A, a) - motion(pair.id_B, b))
        if not gaps:
            return Clearances(np.empty((0, self.hand.num_positions)), np.empty(0), np.empty(0, int))
        points, normals = np.array(lines).swapaxes(0, 1)
        along = np.hstack([np.cross(points, normals), normals])
        rates = np.einsum("ki,kij->kj", along, np.array(changes))
        speeds = np.minimum(_RATE * (np.array(least_gaps) - gaps), _RETREAT) - rates[:, -1]
        for row in last_links:  # The fingertip on this link comes first, wherever the object is.
            if (tip := tips.get(fingers[row])) is not None:
                lead = gaps[row] - gaps[tip]
                rates[row] -= rates[tip]
                speeds[row] = min(_RATE * (_TIP_LEAD - lead), 0.0) - rates[row, -1]
        kept = np.array(is_kept)
        return Clearances(rates[kept, :-1], speeds[kept], np.array(fingers)[kept])

    def _motions(
        self, context: Context, V_WO: SpatialVelocity
    ) -> Callable[[GeometryId, HandLink | None], FloatArray]:
        """Returns a function that returns how a geometry moves, shape (6, nq + 1).

        The columns are spatial velocities in W at the origin of W: by each joint, and the last one
        by the object.
        """
        plant, nq = self.hand.plant, self.hand.num_positions
        posed, world = plant.GetMyContextFromRoot(context), plant.world_frame()
        still = np.zeros((6, nq + 1))
        query = self._graph.get_query_output_port().Eval(self._graph.GetMyContextFromRoot(context))
        p_WO = query.GetPoseInWorld(self._object).translation()
        carried = still.copy()
        carried[:, -1] = V_WO.Shift(-p_WO).get_coeffs()
        known: dict[int, FloatArray] = {}

        def motion(geometry: GeometryId, link: HandLink | None) -> FloatArray:
            if link is None:
                return carried if geometry == self._object else still
            body = int(link.frame.index())
            if body not in known:
                p_BW = link.frame.CalcPoseInWorld(posed).inverse().translation()
                known[body] = still.copy()
                known[body][:, :-1] = plant.CalcJacobianSpatialVelocity(
                    posed, JacobianWrtVariable.kV, link.frame, p_BW, world, world
                )
            return known[body]

        return motion


def _geometry(name: str, shape: Shape, X_FG: RigidTransform) -> GeometryInstance:
    geometry = GeometryInstance(X_FG, shape, name)
    geometry.set_proximity_properties(ProximityProperties())
    return geometry
