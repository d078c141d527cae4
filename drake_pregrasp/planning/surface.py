"""The object's surface for the planner: candidate points Y, forbidden points Z, projection."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.planning.arrays import BoolArray, FloatArray

BOX_FACES = ("+x", "-x", "+y", "-y", "+z", "-z")
"""Names of a box's faces, by their outward normals in the object frame."""


CONTACT_TOLERANCE = 1e-4
"""Farthest a contact may be off the surface to count as on it, in metres."""


@dataclass(frozen=True, eq=False)
class ForbiddenPoints:
    """Points Z that contacts keep away from (the obstacles of Eq. 1).

    Attributes:
        points: z_j, shape (m, 3), in metres; the frame is named by whoever holds them.
        radii: R_j of Eq. 2, shape (m,), in metres.
    """

    points: FloatArray
    radii: FloatArray

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.points.shape[1:] != (3,):
            raise InvalidArgumentError(f"points must have shape (m, 3), not {self.points.shape}")
        if self.radii.shape != (len(self.points),) or not np.all(self.radii >= 0):
            raise InvalidArgumentError("radii must be one number >= 0 for each forbidden point")

    @staticmethod
    def none() -> "ForbiddenPoints":
        """Returns an empty set."""
        return ForbiddenPoints(np.empty((0, 3)), np.empty(0))

    def joined(self, other: "ForbiddenPoints") -> "ForbiddenPoints":
        """Returns the union with `other`, which is in the same frame."""
        return ForbiddenPoints(
            np.concatenate([self.points, other.points]),
            np.concatenate([self.radii, other.radii]),
        )


@dataclass(frozen=True, eq=False)
class ObjectSurface:
    """Where contacts may be on an object O, in its frame.

    The arrays are never written to after construction, so one surface serves many systems.

    Attributes:
        p_OQ: Candidate points q of Y, shape (N, 3), in metres.
        nhat_OQ: Outward unit normals at the candidates, shape (N, 3).
        areas: Surface area each candidate stands for, shape (N,), in m².
        forbidden: Points Z that are part of the object.
        p_OCoM: The object's centre of mass, shape (3,), in metres.
        mesh: The whole surface, closed, in O.
        allowed_triangles: Mask over `mesh.faces` of those on which contacts may be.
    """

    p_OQ: FloatArray
    nhat_OQ: FloatArray
    areas: FloatArray
    forbidden: ForbiddenPoints
    p_OCoM: FloatArray
    mesh: trimesh.Trimesh
    allowed_triangles: BoolArray

    def __post_init__(self) -> None:
        # Sliced once here, because `project` runs at every tick.
        object.__setattr__(self, "_triangles", self.mesh.triangles[self.allowed_triangles])
        object.__setattr__(self, "_normals", self.mesh.face_normals[self.allowed_triangles])

    _triangles = np.empty((0, 3, 3))
    _normals = np.empty((0, 3))

    @property
    def longest_lever_arm(self) -> float:
        """Distance of the mesh's farthest vertex from the centre of mass, in metres."""
        return float(np.max(np.linalg.norm(self.mesh.vertices - self.p_OCoM, axis=1)))

    def project(self, p_OP: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Projects points onto the allowed surface.

        Args:
            p_OP: Points in O, shape (k, 3), in metres.

        Returns:
            The nearest allowed points, shape (k, 3), and the outward normals there, shape (k, 3).
            Between faces at the same distance the one that comes first in the mesh is taken.
        """
        return _nearest_on_triangles(p_OP, self._triangles, self._normals)

    def distance(self, p_OP: FloatArray) -> FloatArray:
        """Returns the distances of points in O, shape (k, 3), from the whole surface, in metres."""
        nearest, _ = _nearest_on_triangles(p_OP, self.mesh.triangles, self.mesh.face_normals)
        distances: FloatArray = np.linalg.norm(nearest - p_OP, axis=1)
        return distances


def _nearest_on_triangles(
    points: FloatArray, triangles: FloatArray, normals: FloatArray
) -> tuple[FloatArray, FloatArray]:
    count = len(triangles)
    nearest: FloatArray = trimesh.triangles.closest_point(
        np.tile(triangles, (len(points), 1, 1)), np.repeat(points, count, axis=0)
    ).reshape(len(points), count, 3)
    which = np.argmin(np.sum((nearest - points[:, None]) ** 2, axis=2), axis=1)
    return nearest[np.arange(len(points)), which], normals[which]


def box_surface(
    size: Sequence[float],
    *,
    spacing: float,
    forbidden_faces: Sequence[str] = ("-z", "+z"),
    forbidden_spacing: float = 0.02,
    forbidden_radius: float = 0.005,
) -> ObjectSurface:
    """Makes the surface of a homogeneous box centred on the object frame's origin.

    Candidates lie at the centres of equal cells, so that each stands for the same share of its
    face; forbidden points lie on a grid that includes the rims, so that Eq. 1 fences those off.

    Args:
        size: Edge lengths along x, y and z of O, in metres.
        spacing: Largest distance between neighbouring candidates, in metres.
        forbidden_faces: Names, out of `BOX_FACES`, of the faces that become forbidden points.
        forbidden_spacing: Largest distance between neighbouring forbidden points, in metres.
        forbidden_radius: R_j of each forbidden point, in metres.

    Raises:
        InvalidArgumentError: If a length is not above 0, a face has no such name, or no face is
            left for contacts.
    """
    if len(size) != 3 or not all(length > 0 for length in size):
        raise InvalidArgumentError(f"size must be three lengths above 0 m, not {list(size)}")
    if not (spacing > 0 and forbidden_spacing > 0):
        raise InvalidArgumentError("spacings must be above 0 m")
    for face in forbidden_faces:
        if face not in BOX_FACES:
            raise InvalidArgumentError(f"{face!r} is no face of a box: {', '.join(BOX_FACES)}")
    allowed_faces = [face for face in BOX_FACES if face not in forbidden_faces]
    if not allowed_faces:
        raise InvalidArgumentError("all faces of the box are forbidden: none is left for contacts")
    half = np.asarray(size) / 2

    points, normals, areas = [], [], []
    for face in allowed_faces:
        grid, area = _cell_centres(face, half, spacing)
        points.append(grid)
        normals.append(np.tile(_face_normal(face), (len(grid), 1)))
        areas.append(np.full(len(grid), area))
    fences = [np.empty((0, 3))]
    fences += [_rim_to_rim_grid(face, half, forbidden_spacing) for face in forbidden_faces]
    p_OZ = np.concatenate(fences)

    mesh = trimesh.creation.box(extents=size)
    allowed_normals = np.array([_face_normal(face) for face in allowed_faces])
    return ObjectSurface(
        p_OQ=np.concatenate(points),
        nhat_OQ=np.concatenate(normals),
        areas=np.concatenate(areas),
        forbidden=ForbiddenPoints(p_OZ, np.full(len(p_OZ), forbidden_radius)),
        p_OCoM=np.zeros(3),
        mesh=mesh,
        allowed_triangles=np.any(mesh.face_normals @ allowed_normals.T > 0.5, axis=1),
    )


def _face_axis(face: str) -> tuple[int, float]:
    return "xyz".index(face[1]), 1.0 if face[0] == "+" else -1.0


def _face_normal(face: str) -> FloatArray:
    axis, sign = _face_axis(face)
    normal = np.zeros(3)
    normal[axis] = sign
    return normal


def _cell_centres(face: str, half: FloatArray, spacing: float) -> tuple[FloatArray, float]:
    centres, area = [], 1.0
    for length in np.delete(2 * half, _face_axis(face)[0]):
        count = _cell_count(length, spacing)
        centres.append((np.arange(count) + 0.5) * length / count - length / 2)
        area *= length / count
    return _on_face(face, half, centres), float(area)


def _rim_to_rim_grid(face: str, half: FloatArray, spacing: float) -> FloatArray:
    lengths = np.delete(2 * half, _face_axis(face)[0])
    return _on_face(
        face,
        half,
        [np.linspace(-a / 2, a / 2, _cell_count(a, spacing) + 1) for a in lengths],
    )


def _cell_count(length: float, spacing: float) -> int:
    # The slack keeps 0.1 / 0.005 at 20 cells, whatever the rounding of the quotient.
    return max(1, int(np.ceil(length / spacing - 1e-9)))


def _on_face(face: str, half: FloatArray, coordinates: list[FloatArray]) -> FloatArray:
    axis, sign = _face_axis(face)
    first, second = np.meshgrid(*coordinates, indexing="ij")
    points = np.empty((first.size, 3))
    points[:, axis] = sign * half[axis]
    points[:, np.delete(np.arange(3), axis)] = np.stack([first.ravel(), second.ravel()], axis=1)
    return points
