"""Evenly sampled surface of a closed mesh, and its no-touch areas."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.errors import InvalidArgumentError, NoSurfaceError
from drake_pregrasp.geometry.sampling import Triangles, choose_evenly, split_triangles
from drake_pregrasp.geometry.shapes import Shape
from drake_pregrasp.geometry.solids import SignedDistance, Solid
from drake_pregrasp.geometry.surface import ForbiddenPoints, ObjectSurface

_DISTANCE = 0.75
"""Ratio of candidates' least distance to the spacing: neighbours are 0.75 to 1.5 spacings apart."""

EDGE = 0.5
"""Ratio of the longest edge of the patches' triangles to the spacing."""

_SLIVER = 1e-8
"""Ratio of area to squared longest edge, up to which a triangle is too thin for a normal."""


@dataclass(eq=False)
class FacingArea:
    """Area whose outward normal is near a direction.

    Attributes:
        direction: Direction in O, shape (3,), not zero; it is normalized.
        angle: Largest angle between normal and direction, in radians.
    """

    direction: FloatArray
    angle: float

    def __post_init__(self) -> None:
        self.direction = np.asarray(self.direction, dtype=float)
        length = float(np.linalg.norm(self.direction))
        if not length > 0:
            raise InvalidArgumentError("a facing area's direction must not be zero")
        self.direction = self.direction / length


@dataclass(frozen=True)
class AxisArea:
    """Area whose outward normal is nearer to one axis of O than to the others.

    Attributes:
        face: Sign and name of the axis, such as `+z`.
    """

    face: str

    def holds(self, normals: FloatArray) -> BoolArray:
        """Returns whether outward unit normals in O, shape (k, 3), belong to the area, as (k,)."""
        axis, sign = "xyz".index(self.face[1]), -1.0 if self.face[0] == "-" else 1.0
        nearest = np.argmax(np.abs(normals), axis=1)
        on_it: BoolArray = (nearest == axis) & (sign * normals[:, axis] > 0)
        return on_it


@dataclass(frozen=True)
class PartArea:
    """Area of one part of the mesh.

    Attributes:
        part: Index of the part in the shape.
    """

    part: int


NoTouchArea = FacingArea | AxisArea | PartArea | Solid
"""Area without contacts. A solid in O forbids the surface inside it."""


_SLOPE = 0.2  # Largest mean slope around a contact, which is 0.3 on a right-angled edge.
_AROUND = 8  # Directions in which the surface around a contact is compared with its plane.
_PLACES = 6  # Number of places on the way from the standoff, at which a fingertip has to fit.


INTRUSION = 0.0015
"""Largest depth of a fingertip in the object, beside its contact, in metres."""


@dataclass(frozen=True)
class TipSize:
    """Size of fingertips, which decides where they have a place on an object.

    Attributes:
        radius: Radius of the largest fingertip, in metres.
        standoff: Gap from which it closes along the normal, in metres.
        clearance: Largest gap that it keeps to the object on its way, in metres.
    """

    radius: float
    standoff: float
    clearance: float

    def has_place(self, p_OC: FloatArray, nhat_OC: FloatArray, solid: SignedDistance) -> BoolArray:
        """Returns the mask of contacts at which a fingertip fits and the surface is even, (k,).

        Args:
            p_OC: Contacts in O, shape (k, 3), in metres.
            nhat_OC: Outward unit normals at the contacts, shape (k, 3).
            solid: The object in O.
        """
        left = np.arange(len(p_OC))
        for gap in np.linspace(0.0, self.standoff, _PLACES):
            gaps = solid.distance(p_OC[left] + (self.radius + gap) * nhat_OC[left]) - self.radius
            left = left[gaps >= min(gap, self.clearance) - INTRUSION]
        slopes = mean_slopes(p_OC[left], nhat_OC[left], solid, self.radius / 2)
        fits = np.zeros(len(p_OC), dtype=bool)
        fits[left[slopes <= _SLOPE]] = True
        return fits


def mean_slopes(
    p_OC: FloatArray, nhat_OC: FloatArray, solid: SignedDistance, radius: float
) -> FloatArray:
    """Returns the mean slope from each contact to the surface around it, shape (k,).

    It is 0 on a plane.

    Args:
        p_OC: Contacts in O, shape (k, 3), in metres.
        nhat_OC: Outward unit normals at the contacts, shape (k, 3).
        solid: The object in O.
        radius: Distance from the contacts at which the surface is compared, in metres.
    """
    angles = 2 * np.pi * np.arange(_AROUND) / _AROUND
    across = np.cross(nhat_OC, np.eye(3)[np.argmin(np.abs(nhat_OC), axis=1)])
    across *= radius / np.linalg.norm(across, axis=1, keepdims=True)
    circle = np.cos(angles)[:, None, None] * across
    circle += np.sin(angles)[:, None, None] * np.cross(nhat_OC, across)
    heights = np.abs(solid.distance((p_OC + circle).reshape(-1, 3))).reshape(_AROUND, -1)
    slopes: FloatArray = np.mean(heights, axis=0) / radius
    return slopes


def is_forbidden(
    triangles: Triangles, face_parts: IntArray, areas: Sequence[NoTouchArea]
) -> BoolArray:
    """Returns whether each triangle is forbidden, shape (T,).

    A triangle that may overlap a solid is forbidden as a whole, so that the allowed surface is
    outside the solid.

    Args:
        triangles: Triangles in O that the mesh's faces are split into.
        face_parts: Index of each face's part, shape (F,).
        areas: No-touch areas of the surface.
    """
    forbidden = np.zeros(len(triangles.faces), dtype=bool)
    for area in areas:
        if isinstance(area, FacingArea):
            forbidden |= triangles.normals @ area.direction >= np.cos(area.angle) - 1e-9
        elif isinstance(area, AxisArea):
            forbidden |= area.holds(triangles.normals)
        elif isinstance(area, PartArea):
            forbidden |= face_parts[triangles.faces] == area.part
        else:
            forbidden |= area.distance(triangles.centroids) < triangles.radii
    return forbidden


def mesh_surface(
    shape: Shape,
    *,
    spacing: float,
    seed: int = 0,
    no_touch: Sequence[NoTouchArea] = (),
    forbidden_spacing: float = 0.02,
    forbidden_radius: float = 0.005,
    tip: TipSize | None = None,
) -> ObjectSurface:
    """Returns the surface of a homogeneous body from its mesh.

    Candidates are spread evenly over the allowed surface. The patch of a candidate is the allowed
    surface that is nearer to it than to other candidates. Forbidden points sample the no-touch
    areas, but not the surface on which fingertips have no place.

    Args:
        shape: Shape of the body, a closed mesh.
        spacing: Mean distance of neighbouring candidates, in metres.
        seed: Seed of the choice of candidates.
        no_touch: Areas without contacts.
        forbidden_spacing: Mean distance of neighbouring forbidden points, in metres.
        forbidden_radius: Radius R_j of each forbidden point, in metres.
        tip: Size of the fingertips: surface on which they have no place is not allowed either.

    Raises:
        InvalidArgumentError: If a length is not above 0, or the spacing is so fine that the
            triangles would not fit into memory.
        NoSurfaceError: If no surface is left for contacts.
    """
    if not (spacing > 0 and forbidden_spacing > 0):
        raise InvalidArgumentError("spacings must be above 0 m")
    mesh = shape.mesh
    triangles = split_triangles(
        np.array(mesh.triangles), np.array(mesh.face_normals), EDGE * spacing
    )
    triangles = triangles.chosen(triangles.areas > _SLIVER * (EDGE * spacing) ** 2)
    forbidden = is_forbidden(triangles, shape.face_parts, no_touch)
    allowed = triangles.chosen(~forbidden)
    if tip is not None and len(allowed.faces):
        allowed = allowed.chosen(tip.has_place(allowed.centroids, allowed.normals, shape.solid))
        if len(allowed.faces) == 0:
            raise NoSurfaceError(
                f"fingertips of radius {tip.radius:g} m have no place on the allowed surface, which"
                " must be even there, and free of other parts of the object"
            )
    if len(allowed.faces) == 0:
        raise NoSurfaceError(
            "no surface is left for contacts: make the forbidden areas smaller, or the spacing,"
            " since small triangles that reach into an area are forbidden as a whole"
        )
    generator = np.random.default_rng(seed)
    samples, owners = choose_evenly(allowed, _DISTANCE * spacing, generator)
    untouched = triangles.chosen(forbidden)
    fence, _ = choose_evenly(untouched, _DISTANCE * forbidden_spacing, generator)
    order = np.argsort(owners, kind="stable")
    return ObjectSurface(
        p_OQ=allowed.centroids[samples],
        nhat_OQ=allowed.normals[samples],
        areas=np.bincount(owners, weights=allowed.areas).astype(float),
        forbidden=ForbiddenPoints(
            untouched.centroids[fence],
            np.full(len(fence), forbidden_radius),
            untouched.normals[fence],
        ),
        p_OCoM=shape.p_OCoM,
        mesh=mesh,
        patches=allowed.corners[order],
        patch_starts=np.concatenate([[0], np.cumsum(np.bincount(owners))]),
    )
