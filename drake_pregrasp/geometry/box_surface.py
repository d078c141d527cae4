"""Surface of a box, sampled on regular grids."""

from collections.abc import Sequence

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError, NoSurfaceError
from drake_pregrasp.geometry.shapes import box_shape
from drake_pregrasp.geometry.surface import ForbiddenPoints, ObjectSurface

MAX_POINTS = 2_000_000
"""Default of the largest number of a box's candidates, and of its forbidden points."""

BOX_FACES = ("+x", "-x", "+y", "-y", "+z", "-z")
"""Names of a box's faces, by their outward normals in the object frame."""


def box_surface(
    size: Sequence[float],
    *,
    spacing: float,
    forbidden_faces: Sequence[str] = ("-z", "+z"),
    forbidden_spacing: float = 0.02,
    forbidden_radius: float = 0.005,
    max_points: int = MAX_POINTS,
) -> ObjectSurface:
    """Returns the surface of a homogeneous box centred on the object frame's origin.

    Candidates are the centres of equal cells, so that all candidates of a face have the same area.
    Forbidden points are on a grid that includes the rims, so that safe regions exclude them.

    Args:
        size: Edge lengths along x, y and z of O, in metres.
        spacing: Largest distance between neighbouring candidates, in metres.
        forbidden_faces: Names from `BOX_FACES` of the faces that become forbidden points.
        forbidden_spacing: Largest distance between neighbouring forbidden points, in metres.
        forbidden_radius: Radius R_j of each forbidden point, in metres.
        max_points: Largest number of candidates, and of forbidden points.

    Raises:
        InvalidArgumentError: If a length is not above 0, a face's name is unknown, or there would
            be more than `max_points` points.
        NoSurfaceError: If no face is left for contacts.
    """
    if len(size) != 3 or not all(length > 0 for length in size):
        raise InvalidArgumentError(f"size must be three lengths above 0 m, not {list(size)}")
    if not (spacing > 0 and forbidden_spacing > 0):
        raise InvalidArgumentError("spacings must be above 0 m")
    for face in forbidden_faces:
        if face not in BOX_FACES:
            raise InvalidArgumentError(f"{face!r} is not a face of a box: {', '.join(BOX_FACES)}")
    allowed_faces = [face for face in BOX_FACES if face not in forbidden_faces]
    if not allowed_faces:
        raise NoSurfaceError("all faces of the box are forbidden: none is left for contacts")
    half = np.asarray(size) / 2
    _check_number(allowed_faces, half, "spacing", spacing, max_points)
    _check_number(forbidden_faces, half, "forbidden_spacing", forbidden_spacing, max_points)

    grids = [_face_grid(face, half, spacing, corners=False) for face in allowed_faces]
    fences = [_face_grid(face, half, forbidden_spacing, corners=True) for face in forbidden_faces]
    p_OQ, nhat_OQ = _joined(allowed_faces, [centres for centres, _ in grids])
    p_OZ, nhat_OZ = _joined(forbidden_faces, [points for points, _ in fences])
    return ObjectSurface(
        p_OQ=p_OQ,
        nhat_OQ=nhat_OQ,
        areas=np.concatenate([np.full(len(p), np.prod(cell)) for p, cell in grids]),
        forbidden=ForbiddenPoints(p_OZ, np.full(len(p_OZ), forbidden_radius), nhat_OZ),
        p_OCoM=np.zeros(3),
        mesh=box_shape(size).mesh,
        patches=np.concatenate(
            [_cell_triangles(f, *grid) for f, grid in zip(allowed_faces, grids, strict=True)]
        ),
        patch_starts=2 * np.arange(len(p_OQ) + 1),
    )


def _joined(faces: Sequence[str], points: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Returns the points of all faces in O in metres and their normals, each shape (k, 3)."""
    normals = [np.tile(face_normal(f), (len(p), 1)) for f, p in zip(faces, points, strict=True)]
    empty = np.empty((0, 3))
    return np.concatenate([empty, *points]), np.concatenate([empty, *normals])


def _check_number(
    faces: Sequence[str], half: FloatArray, name: str, spacing: float, max_points: int
) -> None:
    count = 0.0  # A float, because integers could overflow.
    for face in faces:
        first, second = (2 * half[face_normal(face) == 0]).tolist()  # Overflows to inf in silence.
        count += (first / spacing + 1) * (second / spacing + 1)
    if count > max_points:
        raise InvalidArgumentError(
            f"{name} {spacing:g} m makes {count:.2g} points on this box, at most {max_points};"
            " choose a larger one"
        )


def face_normal(face: str) -> FloatArray:
    """Returns the outward normal of a face in O, shape (3,), by the face's name."""
    normal = np.zeros(3)
    normal["xyz".index(face[1])] = 1.0 if face[0] == "+" else -1.0
    return normal


def _face_grid(
    face: str, half: FloatArray, spacing: float, *, corners: bool
) -> tuple[FloatArray, FloatArray]:
    """Returns corners or centres of a face's cells, shape (k, 3), and a cell's edge lengths."""
    normal = face_normal(face)
    axis, others = np.flatnonzero(normal)[0], np.flatnonzero(normal == 0)
    lengths = 2 * half[others]
    # The slack keeps 0.1 / 0.005 at 20 cells, whatever the rounding of the quotient.
    counts = np.maximum(1, np.ceil(lengths / spacing - 1e-9)).astype(int)
    coordinates = [
        np.linspace(-a / 2, a / 2, n + 1) if corners else (np.arange(n) + 0.5) * a / n - a / 2
        for a, n in zip(lengths, counts, strict=True)
    ]
    first, second = np.meshgrid(*coordinates, indexing="ij")
    points = np.empty((first.size, 3))
    points[:, axis] = normal[axis] * half[axis]
    points[:, others] = np.stack([first.ravel(), second.ravel()], axis=1)
    return points, lengths / counts


def _cell_triangles(face: str, centres: FloatArray, cell: FloatArray) -> FloatArray:
    """Returns two triangles of each cell with outward normals, shape (2k, 3, 3)."""
    normal = face_normal(face)
    u, v = cell[:, None] / 2 * np.eye(3)[normal == 0]
    if np.cross(u, v) @ normal < 0:
        u = -u
    square = np.array([[-u - v, u - v, u + v], [-u - v, u + v, v - u]])
    triangles: FloatArray = centres[:, None, None] + square
    return triangles.reshape(-1, 3, 3)
