"""Safe regions, contact goals, the covariance and the meeting of hand and object in Meshcat."""

import numpy as np
from pydrake.geometry import Meshcat, Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context, EventStatus, LeafSystem
from scipy.spatial import cKDTree

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.contacts.selection_input import is_active
from drake_pregrasp.geometry.sampling import lifted, unit_normals
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.grasping.catch_limits import CatchLimit
from drake_pregrasp.regions.safe_regions import NO_REGION, SafeRegions
from drake_pregrasp.systems.ports import POSE, REGIONS
from drake_pregrasp.visualization.drawing import contact_color, linear_rgb, region_color

ROOT = "/drake/pregrasp"
"""Meshcat path under which everything is drawn."""

_GHOST = f"{ROOT}/estimate"

_REGION_LIFT = 8e-4
"""Distance of tiles from the surface, in metres; the object hides tiles with a larger error."""

_MARKER_RADIUS = 0.006  # Radius of the marker of a goal, in metres.
_TRAIL_LENGTH = 20  # Number of dots that mark the path of each goal over the object.
_TRAIL_STEP = 0.003  # Distance between two dots of a trail on the object, in metres.
_MAGNIFICATION = 10.0  # Magnification of the ellipsoid of the covariance.
_SEEN_THROUGH = 0.4  # Opacity of goals behind the object.
_ELLIPSOID_COLOR = Rgba(0.35, 0.37, 0.40, 0.6)
_MEETING_COLOR = Rgba(0.9, 0.45, 0.1, 0.6)
GHOST_COLOR = Rgba(0.15, 0.2, 0.35, 0.15)
"""Colour of the object at the estimated pose."""

_GHOST_GAP = 0.002  # Distance of the estimate from the object at which it is drawn, in metres.
_GHOST_TURN = 0.03  # Angle between the two from which it is drawn, in radians.


class PregraspVisualizer(LeafSystem):
    """Draws regions, goals and uncertainty of the planner, live and in recordings.

    .. pydrake_system::

        name: PregraspVisualizer
        input_ports:
        - X_WO_estimated
        - p_WC
        - contact_status
        - safe_regions
        - p_WO_covariance
        - X_WO
        - catch_certificate

    Port `X_WO_estimated` accepts a `RigidTransform`: the pose to which goals and covariance belong.

    Port `p_WC` accepts a vector of 3n: the contact goals in W, in metres.

    Port `contact_status` accepts a vector of n `ContactStatus` values: only active goals are drawn.
    Goals behind the object are pale.

    Port `safe_regions` accepts the `SafeRegions` over the surface's candidates.

    Port `p_WO_covariance` accepts a vector of 9, in m². It is drawn over the object as an ellipsoid
    of three standard deviations, magnified ten times. Its half axes are at most a third of the
    object's length, so that it does not hide the object.

    Port `X_WO` accepts a `RigidTransform`: the true pose of the object, at which regions and trails
    are drawn. It is optional. At the estimated pose, which replaces it, the object hides regions.
    If both differ visibly, a translucent object at the estimated pose shows where goals belong.

    Port `catch_certificate` (optional) accepts the output of `InterceptionPlanner`, a vector of 5.
    Until a planned meeting, the ellipsoid of the covariance is also drawn, in orange, at the place
    where the hand will meet the object.

    A recording keeps only transforms and properties. All objects are therefore created once, by the
    constructor, and each publish event sets only what has changed.

    Args:
        meshcat: Meshcat instance to draw in.
        surface: The object's surface, over which the regions are.
        tile_surface: The same surface with another spacing, for the tiles that draw the regions. A
            tile has the colour of the closest candidate. By default, `surface`.
        num_contacts: Number of contacts n.
        publish_period: Seconds between frames, greater than zero.
        record: Whether the regions' colours are recorded too. `Meshcat.StartRecording` controls
            everything else.
        continues: An equal visualizer whose drawings in Meshcat this one takes over.
    """

    def __init__(
        self,
        *,
        meshcat: Meshcat,
        surface: ObjectSurface,
        tile_surface: ObjectSurface | None = None,
        num_contacts: int,
        publish_period: float,
        record: bool = True,
        continues: "PregraspVisualizer | None" = None,
    ) -> None:
        super().__init__()
        self._meshcat = meshcat
        self._surface = surface
        self._tile_surface = tile_surface or surface
        self._tile_candidates = _nearest_candidates(surface, self._tile_surface)
        self._num_contacts, self._record = num_contacts, record
        self._hover = 0.045 + float(np.max(surface.p_OQ[:, 2]))
        self._forget()
        self._colors = {i: region_color(i) for i in (NO_REGION, *range(num_contacts))}

        self._X_WO_estimated = self.DeclareAbstractInputPort("X_WO_estimated", POSE)
        self._p_WC = self.DeclareVectorInputPort("p_WC", 3 * num_contacts)
        self._contact_status = self.DeclareVectorInputPort("contact_status", num_contacts)
        self._safe_regions = self.DeclareAbstractInputPort("safe_regions", REGIONS)
        self._p_WO_covariance = self.DeclareVectorInputPort("p_WO_covariance", 9)
        self._X_WO = self.DeclareAbstractInputPort("X_WO", POSE)
        self._certificate = self.DeclareVectorInputPort("catch_certificate", 5)
        if continues is None:
            self._make_objects()
        else:
            self._take_over(continues)
        self.DeclareInitializationPublishEvent(self._restart)
        self.DeclarePeriodicPublishEvent(publish_period, 0.0, self._draw)
        self.DeclareForcedPublishEvent(self._draw)

    def _make_objects(self) -> None:
        self._meshcat.Delete(ROOT)
        for tile in range(len(self._tile_surface.p_OQ)):
            vertices, triangles = _tile_mesh(self._tile_surface, tile)
            color = self._colors[NO_REGION]
            self._meshcat.SetTriangleMesh(_tile_path(tile), vertices, triangles, color)
        for i in range(self._num_contacts):
            color = contact_color(i)
            self._meshcat.SetObject(_goal_path(i), Sphere(_MARKER_RADIUS), color)
            # A pale marker is in front of everything, and so shows goals behind the object.
            pale = Rgba(color.r(), color.g(), color.b(), _SEEN_THROUGH)
            through = f"{_goal_path(i)}/through"
            self._meshcat.SetObject(through, Sphere(_MARKER_RADIUS), pale)
            self._meshcat.SetProperty(f"{through}/<object>", "material.depthTest", False)
            for slot in range(_TRAIL_LENGTH):
                path = _trail_path(i, slot)
                self._meshcat.SetObject(path, Sphere(0.25 * _MARKER_RADIUS), color)
        mesh = self._surface.mesh
        self._meshcat.SetTriangleMesh(_GHOST, mesh.vertices.T, mesh.faces.T, GHOST_COLOR)
        self._meshcat.SetObject(f"{ROOT}/covariance/axes", Sphere(1.0), _ELLIPSOID_COLOR)
        self._meshcat.SetObject(f"{ROOT}/meeting/axes", Sphere(1.0), _MEETING_COLOR)

    def _forget(self) -> None:
        # Cache of what Meshcat shows; it is no part of the simulated state.
        self._shown: dict[tuple[str, str], bool | list[float]] = {}
        self._shown_labels = np.full(len(self._tile_candidates), NO_REGION - 1)
        self._trail_heads: list[tuple[int, FloatArray] | None] = [None] * self._num_contacts

    def _take_over(self, other: "PregraspVisualizer") -> None:
        self._shown, self._shown_labels = other._shown, other._shown_labels
        self._trail_heads = other._trail_heads

    def _restart(self, context: Context) -> EventStatus:
        if context.get_time() == 0:
            self._forget()
        return EventStatus.Succeeded()

    def _draw(self, context: Context) -> EventStatus:
        time = context.get_time()
        X_WO: RigidTransform = self._X_WO_estimated.Eval(context)
        X_WO_drawn = self._X_WO.Eval(context) if self._X_WO.HasValue(context) else X_WO
        regions: SafeRegions = self._safe_regions.Eval(context)
        covariance: FloatArray = self._p_WO_covariance.Eval(context).reshape(3, 3)
        p_WC: FloatArray = self._p_WC.Eval(context).reshape(-1, 3)
        p_OC = (X_WO.inverse() @ p_WC.T).T
        active = is_active(self._contact_status.Eval(context))
        self._meshcat.SetTransform(f"{ROOT}/object", X_WO_drawn, time)
        self._meshcat.SetTransform(_GHOST, X_WO, time)
        self._set(_GHOST, "visible", are_apart(X_WO, X_WO_drawn), time)
        self._color_tiles(regions.labels[self._tile_candidates], time)
        # Balls touch the surface from outside: centred on a thin wall, they show on both sides.
        p_OB = p_OC + _MARKER_RADIUS * self._surface.project(p_OC)[1]
        self._draw_goals((X_WO @ p_OB.T).T, active, time)
        self._draw_trails(p_OC, active, time)
        p_WE = X_WO @ self._surface.p_OCoM + [0.0, 0.0, self._hover]
        self._draw_covariance("covariance", p_WE, covariance, time)
        is_planned = False
        if self._certificate.HasValue(context):
            limit, meeting_time, *p_WM = self._certificate.Eval(context)
            is_planned = bool(limit == CatchLimit.NONE and time < meeting_time)
        self._set(f"{ROOT}/meeting", "visible", is_planned, time)
        if is_planned:
            self._draw_covariance("meeting", np.array(p_WM), covariance, time)
        return EventStatus.Succeeded()

    def _color_tiles(self, labels: IntArray, time: float) -> None:
        changed = np.flatnonzero(labels != self._shown_labels)
        animation = self._meshcat.get_mutable_recording()
        frame = animation.frame(time)
        for tile in changed.tolist():
            color, before = self._colors[labels[tile]], self._colors.get(self._shown_labels[tile])
            # Like an animated colour, this one is linear; that of `SetObject` is sRGB.
            live = [*linear_rgb(color), color.a()]
            self._meshcat.SetProperty(_tile_path(tile), "color", live)
            if self._record:
                # A recording interpolates, so a key one frame earlier holds the old colour.
                target = f"{_tile_path(tile)}/<object>", "material.color"
                if before is not None:
                    animation.SetProperty(frame - 1, *target, linear_rgb(before))
                animation.SetProperty(frame, *target, linear_rgb(color))
        self._shown_labels = labels

    def _draw_goals(self, p_WB: FloatArray, active: BoolArray, time: float) -> None:
        for i in range(self._num_contacts):
            self._meshcat.SetTransform(_goal_path(i), RigidTransform(p_WB[i]), time)
            self._set(_goal_path(i), "visible", bool(active[i]), time)

    def _draw_trails(self, p_OC: FloatArray, active: BoolArray, time: float) -> None:
        for i, head in enumerate(self._trail_heads):
            if head is None:
                for slot in range(_TRAIL_LENGTH):
                    self._set(_trail_path(i, slot), "visible", False, time)
            elif np.linalg.norm(p_OC[i] - head[1]) < _TRAIL_STEP or not active[i]:
                continue
            count = 0 if head is None else head[0] + 1
            path = _trail_path(i, count % _TRAIL_LENGTH)
            self._meshcat.SetTransform(path, RigidTransform(p_OC[i]), time)
            self._set(path, "visible", True, time)
            self._trail_heads[i] = count, p_OC[i]

    def _draw_covariance(
        self, name: str, p_WE: FloatArray, covariance: FloatArray, time: float
    ) -> None:
        variances, axes = np.linalg.eigh(covariance)
        axes *= np.sign(np.linalg.det(axes))
        X_WE = RigidTransform(RotationMatrix.ProjectToRotationMatrix(axes), p_WE)
        largest = float(self._surface.mesh.extents.max()) / 3
        radii = np.minimum(3 * _MAGNIFICATION * np.sqrt(np.maximum(variances, 0)), largest)
        self._meshcat.SetTransform(f"{ROOT}/{name}", X_WE, time)
        self._set(f"{ROOT}/{name}/axes", "scale", [float(r) for r in radii], time)

    def _set(self, path: str, name: str, value: bool | list[float], time: float) -> None:
        """Sets a property if its value has changed."""
        if self._shown.get((path, name)) != value:
            self._meshcat.SetProperty(path, name, value, time)
            self._shown[path, name] = value


def are_apart(X_WA: RigidTransform, X_WB: RigidTransform) -> bool:
    """Returns whether two poses of an object differ visibly."""
    X_AB = X_WA.InvertAndCompose(X_WB)
    turn = X_AB.rotation().ToAngleAxis().angle()
    return bool(np.linalg.norm(X_AB.translation()) > _GHOST_GAP or turn > _GHOST_TURN)


def _tile_path(tile: int) -> str:
    return f"{ROOT}/object/tiles/{tile}"


def _goal_path(contact: int) -> str:
    return f"{ROOT}/goals/{contact}"


def _trail_path(contact: int, slot: int) -> str:
    return f"{ROOT}/object/trails/{contact}/{slot}"


def _nearest_candidates(surface: ObjectSurface, tiles: ObjectSurface) -> IntArray:
    """Returns the index of the candidate closest to each tile, shape (k,)."""
    length = float(np.sqrt(np.mean(tiles.areas)))
    tree = cKDTree(lifted(surface.p_OQ, surface.nhat_OQ, length))
    candidates: IntArray = tree.query(lifted(tiles.p_OQ, tiles.nhat_OQ, length))[1]
    return candidates


def _tile_mesh(surface: ObjectSurface, tile: int) -> tuple[FloatArray, IntArray]:
    """Returns the vertices, shape (3, 3k), and triangles, shape (3, k), of a candidate's patch."""
    patch = surface.patches[surface.patch_starts[tile] : surface.patch_starts[tile + 1]]
    corners = patch + _REGION_LIFT * unit_normals(patch)[:, None]
    return corners.reshape(-1, 3).T, np.arange(3 * len(patch)).reshape(-1, 3).T
