"""The surface of a box, sampled on regular grids."""

from collections.abc import Sequence

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError, NoGroundError
from drake_pregrasp.geometry.shapes import box_shape
from drake_pregrasp.geometry.surface import ForbiddenPoints, ObjectSurface

MAX_POINTS = 2_000_000
"""Most candidates of a box, and most of its forbidden points, unless fewer are asked for."""

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
    """Makes the surface of a homogeneous box centred on the object frame's origin.

    Candidates lie at the centres of equal cells, so that each stands for the same share of its
    face; forbidden points lie on a grid that includes the rims, so that Eq. 1 fences those off.

    Args:
        size: Edge lengths along x, y and z of O, in metres.
        spacing: Largest distance between neighbouring candidates, in metres.
        forbidden_faces: Names, out of `BOX_FACES`, of the faces that become forbidden points.
        forbidden_spacing: Largest distance between neighbouring forbidden points, in metres.
        forbidden_radius: R_j of each forbidden point, in metres.
        max_points: Most candidates, and most forbidden points.

    Raises:
        InvalidArgumentError: If a length is not above 0, or a face has no such name, or there
            would be more than `max_points`.
        NoGroundError: If no face is left for contacts.
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
        raise NoGroundError("all faces of the box are forbidden: none is left for contacts")
    half = np.asarray(size) / 2
    _check_number(allowed_faces, half, "spacing", spacing, max_points)
    _check_number(forbidden_faces, half, "forbidden_spacing", forbidden_spacing, max_points)

    points, normals, areas, patches = [], [], [], []
    for face in allowed_faces:
        centres, cell_lengths = _cell_centres(face, half, spacing)
        points.append(centres)
        normals.append(np.tile(face_normal(face), (len(centres), 1)))
        areas.append(np.full(len(centres), np.prod(cell_lengths)))
        patches.append(_cell_triangles(face, centres, cell_lengths))
    fences = [np.empty((0, 3))]
    fences += [_rim_to_rim_grid(face, half, forbidden_spacing) for face in forbidden_faces]
    fence_normals = [
        np.tile(face_normal(face), (len(fence), 1))
        for face, fence in zip(forbidden_faces, fences[1:], strict=True)
    ]
    p_OZ = np.concatenate(fences)
    p_OQ = np.concatenate(points)
    return ObjectSurface(
        p_OQ=p_OQ,
        nhat_OQ=np.concatenate(normals),
        areas=np.concatenate(areas),
        forbidden=ForbiddenPoints(
            p_OZ,
            np.full(len(p_OZ), forbidden_radius),
            np.concatenate([np.empty((0, 3)), *fence_normals]),
        ),
        p_OCoM=np.zeros(3),
        mesh=box_shape(size).mesh,
        patches=np.concatenate(patches),
        patch_starts=2 * np.arange(len(p_OQ) + 1),
    )


def _check_number(
    faces: Sequence[str], half: FloatArray, name: str, spacing: float, max_points: int
) -> None:
    count = 0.0  # An estimate: whole numbers could be too large.
    for face in faces:
        first, second = np.delete(2 * half, _face_axis(face)[0]).tolist()
        count += (first / spacing + 1) * (second / spacing + 1)
    if count > max_points:
        raise InvalidArgumentError(
            f"{name} {spacing:g} m makes {count:.2g} points on this box, at most {max_points};"
            " choose a larger one"
        )


def face_normal(face: str) -> FloatArray:
    """Returns the outward normal of the face of that name, shape (3,)."""
    axis, sign = _face_axis(face)
    normal = np.zeros(3)
    normal[axis] = sign
    return normal


def _face_axis(face: str) -> tuple[int, float]:
    return "xyz".index(face[1]), 1.0 if face[0] == "+" else -1.0


def _cell_centres(face: str, half: FloatArray, spacing: float) -> tuple[FloatArray, list[float]]:
    centres, cell_lengths = [], []
    for length in np.delete(2 * half, _face_axis(face)[0]):
        count = _cell_count(length, spacing)
        centres.append((np.arange(count) + 0.5) * length / count - length / 2)
        cell_lengths.append(float(length / count))
    return _on_face(face, half, centres), cell_lengths


def _cell_triangles(face: str, centres: FloatArray, cell_lengths: list[float]) -> FloatArray:
    """Returns the two triangles of each cell, shape (2k, 3, 3), their normals outward."""
    normal = face_normal(face)
    axis = _face_axis(face)[0]
    u, v = (
        length / 2 * np.eye(3)[k]
        for k, length in zip(np.delete(np.arange(3), axis), cell_lengths, strict=True)
    )
    if np.cross(u, v) @ normal < 0:
        u = -u
    square = np.array([[-u - v, u - v, u + v], [-u - v, u + v, v - u]])
    triangles: FloatArray = centres[:, None, None] + square
    return triangles.reshape(-1, 3, 3)


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
