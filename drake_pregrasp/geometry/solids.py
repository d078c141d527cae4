"""Sets with signed distances: no-touch areas, obstacles, the reach of fingers, and objects."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray, norms
from drake_pregrasp.errors import InvalidArgumentError

_I = np.eye(3)
_ALONG = 1e-12  # In place of zero, so that a line parallel to faces divides by no zero.
_HALF = [-np.inf] * 3 + [np.inf] * 2 + [0.0, 0.0]  # Bounds and radius of a half-space's box.


class SignedDistance(ABC):
    """A closed set of points in a frame F, described by its signed distance."""

    @abstractmethod
    def distance_and_gradient(self, p_FP: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Returns the signed distances of points and their gradients.

        Args:
            p_FP: Positions of the points in F, shape (k, 3), in metres.

        Returns:
            Distances, shape (k,), in metres, below zero inside; and unit gradients in F, shape
            (k, 3).
        """

    @abstractmethod
    def moved(self, R_GF: FloatArray, p_GF: FloatArray) -> "SignedDistance":
        """Returns the same set expressed in a frame G.

        Args:
            R_GF: Orientation of F in G, shape (3, 3).
            p_GF: Position of F in G, shape (3,), in metres.
        """

    def distance(self, p_FP: FloatArray) -> FloatArray:
        """Returns the signed distances of points, shape (k,), in metres, below zero inside.

        Args:
            p_FP: Positions of the points in F, shape (k, 3), in metres.
        """
        return self.distance_and_gradient(p_FP)[0]

    @abstractmethod
    def highest(self, direction: FloatArray) -> float:
        """Returns the largest coordinate of its points along a unit vector in F, in metres."""

    def hull(self) -> "SignedDistance":
        """Returns the convex hull; a convex set is its own hull."""
        return self


class Solid(SignedDistance):
    """A convex set."""

    @abstractmethod
    def rounded_box(self) -> FloatArray:
        """Returns the solid as a row of numbers for `rounded_box_distances`, shape (19,)."""

    def distance_and_gradient(self, p_FP: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `SignedDistance`."""
        distances, gradients = nearest_solids(self.rounded_box()[None], p_FP)
        return distances[0], gradients[0]

    @abstractmethod
    def moved(self, R_GF: FloatArray, p_GF: FloatArray) -> "Solid":
        """See `SignedDistance`."""

    def distance(self, p_FP: FloatArray) -> FloatArray:
        """See `SignedDistance`."""
        return rounded_box_distances(self.rounded_box(), p_FP)

    def highest(self, direction: FloatArray) -> float:
        """See `SignedDistance`."""
        row = self.rounded_box()
        along = row[3:12].reshape(3, 3).T @ direction
        extreme = np.where(along > 0, row[15:18], row[12:15])
        # An infinite bound does not count along a direction at right angles to it.
        lengths = np.where(along != 0, along, 0) @ np.where(along != 0, extreme, 0)
        return float(row[:3] @ direction + lengths + row[18])


@dataclass(eq=False)
class BallSolid(Solid):
    """A ball.

    Attributes:
        center: Position of the centre in F, shape (3,), in metres.
        radius: Radius of the ball, at least zero, in metres.
    """

    center: FloatArray
    radius: float

    def __post_init__(self) -> None:
        self.center = np.asarray(self.center, dtype=float)
        if not self.radius >= 0:
            raise InvalidArgumentError(f"a ball's radius must be at least 0 m, not {self.radius}")
        _check_finite("a ball's", radius=self.radius, center=self.center)

    def rounded_box(self) -> FloatArray:
        """See `Solid`."""
        return _row(self.center, np.eye(3), np.zeros(3), np.zeros(3), self.radius)

    def moved(self, R_GF: FloatArray, p_GF: FloatArray) -> "BallSolid":
        """See `Solid`."""
        return BallSolid(R_GF @ self.center + p_GF, self.radius)


@dataclass(eq=False)
class BoxSolid(Solid):
    """A box.

    Attributes:
        center: Position of the centre in F, shape (3,), in metres.
        R_FB: Orientation of the box B in F, shape (3, 3).
        size: Edge lengths along the axes of B, shape (3,), in metres.
    """

    center: FloatArray
    R_FB: FloatArray
    size: FloatArray

    def __post_init__(self) -> None:
        self.center = np.asarray(self.center, dtype=float)
        self.R_FB = np.asarray(self.R_FB, dtype=float)
        self.size = np.asarray(self.size, dtype=float)
        if not np.all(self.size >= 0):
            raise InvalidArgumentError(
                f"a box's edges must be at least 0 m long, not {self.size.tolist()}"
            )
        _check_finite("a box's", edges=self.size, center=self.center, R_FB=self.R_FB)

    def rounded_box(self) -> FloatArray:
        """See `Solid`."""
        return _row(self.center, self.R_FB, -self.size / 2, self.size / 2)

    def moved(self, R_GF: FloatArray, p_GF: FloatArray) -> "BoxSolid":
        """See `Solid`."""
        return BoxSolid(R_GF @ self.center + p_GF, R_GF @ self.R_FB, self.size)


@dataclass(eq=False)
class HalfSpace(Solid):
    """A half-space, the points on one side of a plane.

    Attributes:
        point: Position of a point of the plane in F, shape (3,), in metres.
        normal: Outward normal in F, shape (3,), not zero; it is normalized.
    """

    point: FloatArray
    normal: FloatArray

    def __post_init__(self) -> None:
        self.point = np.asarray(self.point, dtype=float)
        self.normal = np.asarray(self.normal, dtype=float)
        _check_finite("a half-space's", point=self.point, normal=self.normal)
        length = float(np.linalg.norm(self.normal))
        if not length > 0:
            raise InvalidArgumentError("a half-space's normal must not be zero")
        self.normal = self.normal / length

    def rounded_box(self) -> FloatArray:
        """See `Solid`."""
        normal_only = np.outer(self.normal, [0.0, 0.0, 1.0])
        return np.concatenate([self.point, normal_only.ravel(), _HALF])

    def moved(self, R_GF: FloatArray, p_GF: FloatArray) -> "HalfSpace":
        """See `Solid`."""
        return HalfSpace(R_GF @ self.point + p_GF, R_GF @ self.normal)


EVERYWHERE = np.array([0.0] * 12 + [-np.inf] * 3 + [np.inf] * 3 + [0.0])
"""Row of the solid that contains all points; see `rounded_box_distances`."""


@dataclass(frozen=True, eq=False)
class PlacedSolid(Solid):
    """A solid given by its row of numbers only.

    Attributes:
        row: Row for `rounded_box_distances`, shape (19,).
    """

    row: FloatArray

    def rounded_box(self) -> FloatArray:
        """See `Solid`."""
        return self.row

    def distance(self, p_FP: FloatArray) -> FloatArray:
        """See `SignedDistance`."""
        return rounded_box_distances(self.row, p_FP)

    def moved(self, R_GF: FloatArray, p_GF: FloatArray) -> "PlacedSolid":
        """See `Solid`."""
        axes = R_GF @ self.row[3:12].reshape(3, 3)
        p_GB = R_GF @ self.row[:3] + p_GF
        return PlacedSolid(np.concatenate([p_GB, axes.ravel(), self.row[12:]]))


def moved_rows(rows: FloatArray, R_GF: FloatArray, p_GF: FloatArray) -> FloatArray:
    """Returns rows of solids expressed in frames G, shape (..., s, 19); see `Solid.moved`.

    Args:
        rows: Row of each solid for `rounded_box_distances`, shape (..., s, 19).
        R_GF: Orientations of F, shape (..., 3, 3).
        p_GF: Positions of F, shape (..., 3), in metres.
    """
    moved = rows.copy()
    moved[..., :3] = rows[..., :3] @ R_GF.swapaxes(-1, -2) + p_GF[..., None, :]
    axes = R_GF[..., None, :, :] @ rows[..., 3:12].reshape(*rows.shape[:-1], 3, 3)
    moved[..., 3:12] = axes.reshape(*rows.shape[:-1], 9)
    return moved


def rounded_box_distances(row: FloatArray, p_FP: FloatArray) -> FloatArray:
    """Returns the signed distances of points from a box with rounded edges, shape (k,), in metres.

    All solids are such boxes. A ball has no edges, only a radius; a half-space has one face only,
    as its other bounds are infinite.

    Args:
        row: Centre in F (3), the axes of the box in F as columns of a matrix (9, row-major), the
            lower (3) and upper (3) bounds along them, and the radius, in metres.
        p_FP: Positions of the points in F, shape (k, 3), in metres.
    """
    if row[12:].tolist() == _HALF:  # A half-space: the height over its plane.
        return np.asarray((p_FP - row[:3]) @ row[5:12:3])
    p_BP = (p_FP - row[:3]) @ row[3:12].reshape(3, 3)
    beyond = np.maximum(p_BP - row[15:18], row[12:15] - p_BP)
    inside = np.minimum(np.maximum.reduce(beyond, axis=1), 0)
    return np.asarray(norms(np.maximum(beyond, 0)) + inside - row[18])


def nearest_solids(rows: FloatArray, p_FP: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns the signed distances of points from several solids, and their gradients.

    Args:
        rows: Row of each solid for `rounded_box_distances`, shape (s, 19).
        p_FP: Positions of the points in F, shape (k, 3), in metres.

    Returns:
        Distances, shape (s, k), in metres, below zero inside; and unit gradients, shape (s, k, 3).
    """
    R_FB = rows[:, 3:12].reshape(-1, 3, 3)
    p_BP = (p_FP - rows[:, None, :3]) @ R_FB
    above, below = p_BP - rows[:, None, 15:18], rows[:, None, 12:15] - p_BP
    beyond = np.maximum(above, below)
    outside = np.maximum(beyond, 0)
    lengths = norms(outside)
    # Of faces at the same distance, the last one counts.
    nearest_face = _I[2 - beyond[..., ::-1].argmax(axis=2)]
    toward = np.where(lengths[..., None] > 0, outside, nearest_face)
    toward /= norms(toward)[..., None]
    np.negative(toward, out=toward, where=above < below)
    distances = lengths + np.minimum(np.maximum.reduce(beyond, axis=2), 0) - rows[:, 18:19]
    return distances, toward @ R_FB.transpose(0, 2, 1)


def is_hidden(
    p_FP: FloatArray,
    p_FQ: FloatArray,
    X_FB: FloatArray,
    half_widths: FloatArray,
    is_ball: BoolArray,
) -> BoolArray:
    """Returns which points a box or a ball hides from a viewpoint, shape (k,).

    Args:
        p_FP: The viewpoint in F, shape (3,), in metres.
        p_FQ: The points in F, shape (k, 3), in metres.
        X_FB: Poses of boxes, whose middle is Bo, shape (b, 3, 4).
        half_widths: Half widths of the boxes along the axes of B, shape (b, 3), in metres.
        is_ball: Whether the ball in a box counts instead of the box, shape (b,).
    """
    R_FB, p_FB = X_FB[:, :, :3], X_FB[:, :, 3]
    start = np.einsum("bij,bi->bj", R_FB, p_FP - p_FB)[:, None]
    along = np.einsum("bij,ki->bkj", R_FB, p_FQ - p_FP)
    along = np.where(along == 0, _ALONG, along)
    # Shares of a ray at which it passes the planes of each pair of faces (slab method of Kay &
    # Kajiya, "Ray tracing complex scenes", 1986).
    one, other = ((side * half_widths[:, None] - start) / along for side in (-1, 1))
    enters = np.maximum.reduce(np.minimum(one, other), axis=2)
    leaves = np.minimum.reduce(np.maximum(one, other), axis=2)
    crosses = (enters < leaves) & (leaves > 0) & (enters < 1)
    nearest = -np.einsum("bkj,bkj->bk", start, along) / np.einsum("bkj,bkj->bk", along, along)
    gaps = norms(start + np.clip(nearest, 0, 1)[..., None] * along) - half_widths[:, :1]
    return np.asarray(np.where(is_ball[:, None], gaps < 0, crosses).any(axis=0))


def _row(
    center: FloatArray, R_FB: FloatArray, low: FloatArray, high: FloatArray, radius: float = 0.0
) -> FloatArray:
    return np.concatenate([center, R_FB.ravel(), low, high, [radius]])


def _check_finite(owner: str, **fields: float | FloatArray) -> None:
    for name, value in fields.items():
        if not np.isfinite(value).all():
            given = np.asarray(value).tolist()
            raise InvalidArgumentError(f"{owner} {name} must be finite, not {given}")
