"""The visible share of an object's surface."""

import numpy as np
import trimesh
from pydrake.common.value import AbstractValue
from pydrake.geometry import FrameId, HalfSpace, QueryObject, Role, SceneGraphInspector, Sphere
from pydrake.systems.framework import Context, LeafSystem

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.geometry.solids import is_hidden
from drake_pregrasp.systems.ports import POSE, declare_output

_POINTS = 400  # Points on the surface, randomly chosen.


class VisibleShare(LeafSystem):
    """Computes the visible share of an object's surface.

    .. pydrake_system::

        name: VisibleShare
        input_ports:
        - X_WO
        - query_object
        output_ports:
        - visible_share

    Port `X_WO` accepts a `RigidTransform`: the pose of the object.

    Port `query_object` accepts SceneGraph's `QueryObject`.

    Port `visible_share` emits a vector of 1: of points on the surface whose normals face the
    camera, the share that no other body hides; 0 if none faces it. Bodies hide what is behind the
    balls, or the oriented bounding boxes of other geometries, with the perception role.

    Args:
        p_WK: Position of the camera K in W, shape (3,), in metres.
        mesh: Surface of the object in O.
        inspector: Inspector of the SceneGraph, with all its geometries.
        frame: Frame of the object in the SceneGraph.
    """

    def __init__(
        self,
        p_WK: FloatArray,
        mesh: trimesh.Trimesh,
        inspector: SceneGraphInspector,
        frame: FrameId,
    ) -> None:
        super().__init__()
        self._p_WK = np.asarray(p_WK)
        self._p_OQ, faces = trimesh.sample.sample_surface(mesh, _POINTS, seed=0)
        self._normals = mesh.face_normals[faces]
        self._ids, shapes = [], []
        for geometry in inspector.GetAllGeometryIds(Role.kPerception):
            shape = inspector.GetShape(geometry)
            if inspector.GetFrameId(geometry) != frame and not isinstance(shape, HalfSpace):
                self._ids.append(geometry)
                shapes.append(shape)
        boxes = [inspector.GetObbInGeometryFrame(geometry) for geometry in self._ids]
        self._X_GB = [box.pose() for box in boxes]
        self._half = np.array([box.half_width() for box in boxes]).reshape(-1, 3)
        self._radius = float(np.max(np.linalg.norm(mesh.vertices, axis=1)))
        self._is_ball = np.array([isinstance(shape, Sphere) for shape in shapes], dtype=bool)
        self._X_WO = self.DeclareAbstractInputPort("X_WO", POSE)
        model = AbstractValue.Make(QueryObject())
        self._query = self.DeclareAbstractInputPort("query_object", model)
        declare_output(self, "visible_share", 1, self._calc_share, self._X_WO, self._query)

    def _calc_share(self, context: Context) -> float:
        X_WO, query = self._X_WO.Eval(context), self._query.Eval(context)
        R_WO = X_WO.rotation().matrix()
        p_WQ = self._p_OQ @ R_WO.T + X_WO.translation()
        facing = np.einsum("ki,ki->k", self._p_WK - p_WQ, self._normals @ R_WO.T) > 0
        if not facing.any():
            return 0.0
        poses = zip(self._ids, self._X_GB, strict=True)
        X_WB = np.array([(query.GetPoseInWorld(id) @ X).GetAsMatrix34() for id, X in poses])
        near = self._near(X_WB.reshape(-1, 3, 4), X_WO.translation())
        boxes = X_WB.reshape(-1, 3, 4)[near], self._half[near], self._is_ball[near]
        hidden = is_hidden(self._p_WK, p_WQ[facing], *boxes)
        return float(np.mean(~hidden))

    def _near(self, X_WB: FloatArray, p_WO: FloatArray) -> BoolArray:
        """Returns which boxes may be between the camera and the object, by balls around them."""
        way = p_WO - self._p_WK
        share = (X_WB[:, :, 3] - self._p_WK) @ way / max(float(way @ way), 1e-12)
        nearest = self._p_WK + np.clip(share, 0.0, 1.0)[:, None] * way
        reach = np.linalg.norm(self._half, axis=1) + self._radius
        return np.asarray(np.linalg.norm(X_WB[:, :, 3] - nearest, axis=1) <= reach)
