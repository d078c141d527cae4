"""Convex solids with signed distances: no-touch areas, obstacles, and the reach of fingers."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError


class Solid(ABC):
    """A closed convex set of points in a frame F, described by its signed distance."""

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
    def moved(self, R_GF: FloatArray, p_GF: FloatArray) -> "Solid":
        """Returns the same solid expressed in a frame G.

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


@dataclass(frozen=True, eq=False)
class BallSolid(Solid):
    """A ball.

    Attributes:
        center: Position of the centre in F, shape (3,), in metres.
        radius: Radius of the ball, at least zero, in metres.
    """

    center: FloatArray
    radius: float

    def __post_init__(self) -> None:
        if not self.radius >= 0:
            raise InvalidArgumentError(f"a ball's radius must be at least 0 m, not {self.radius}")
        _check_finite("a ball's", radius=self.radius, center=self.center)

    def distance_and_gradient(self, p_FP: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Solid`; at the centre the gradient is +z."""
        away = p_FP - self.center
        length = np.linalg.norm(away, axis=1)
        gradient = np.where(length[:, None] > 0, away, [0.0, 0.0, 1.0])
        return length - self.radius, gradient / np.where(length > 0, length, 1)[:, None]

    def moved(self, R_GF: FloatArray, p_GF: FloatArray) -> "BallSolid":
        """See `Solid`."""
        return BallSolid(R_GF @ self.center + p_GF, self.radius)


@dataclass(frozen=True, eq=False)
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
        if not np.all(self.size >= 0):
            raise InvalidArgumentError(
                f"a box's edges must be at least 0 m long, not {list(self.size)}"
            )
        _check_finite("a box's", edges=self.size, center=self.center, R_FB=self.R_FB)

    def distance_and_gradient(self, p_FP: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Solid`."""
        p_BP = (p_FP - self.center) @ self.R_FB
        beyond = np.abs(p_BP) - self.size / 2
        outside = np.maximum(beyond, 0)
        length = np.linalg.norm(outside, axis=1)
        nearest_face = np.eye(3)[np.argmax(beyond, axis=1)]
        toward = np.where(length[:, None] > 0, outside, nearest_face)
        toward *= np.where(p_BP < 0, -1.0, 1.0)
        gradient = toward / np.linalg.norm(toward, axis=1, keepdims=True)
        return length + np.minimum(np.max(beyond, axis=1), 0), gradient @ self.R_FB.T

    def distance(self, p_FP: FloatArray) -> FloatArray:
        """See `Solid`."""
        beyond = np.abs((p_FP - self.center) @ self.R_FB) - self.size / 2
        outside = np.linalg.norm(np.maximum(beyond, 0), axis=1)
        distances: FloatArray = outside + np.minimum(beyond.max(axis=1), 0)
        return distances

    def moved(self, R_GF: FloatArray, p_GF: FloatArray) -> "BoxSolid":
        """See `Solid`."""
        return BoxSolid(R_GF @ self.center + p_GF, R_GF @ self.R_FB, self.size)


@dataclass(frozen=True, eq=False)
class HalfSpace(Solid):
    """A half-space, the points on one side of a plane.

    Attributes:
        point: Position of a point of the plane in F, shape (3,), in metres.
        normal: Outward normal in F, shape (3,), not zero; it is normalized.
    """

    point: FloatArray
    normal: FloatArray

    def __post_init__(self) -> None:
        _check_finite("a half-space's", point=self.point, normal=self.normal)
        length = float(np.linalg.norm(self.normal))
        if not length > 0:
            raise InvalidArgumentError("a half-space's normal must not be zero")
        object.__setattr__(self, "normal", self.normal / length)

    def distance_and_gradient(self, p_FP: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Solid`."""
        return self.distance(p_FP), np.tile(self.normal, (len(p_FP), 1))

    def distance(self, p_FP: FloatArray) -> FloatArray:
        """See `Solid`."""
        distances: FloatArray = (p_FP - self.point) @ self.normal
        return distances

    def moved(self, R_GF: FloatArray, p_GF: FloatArray) -> "HalfSpace":
        """See `Solid`."""
        return HalfSpace(R_GF @ self.point + p_GF, R_GF @ self.normal)


def _check_finite(owner: str, **fields: float | FloatArray) -> None:
    for name, value in fields.items():
        if not np.isfinite(value).all():
            given = np.asarray(value).tolist()
            raise InvalidArgumentError(f"{owner} {name} must be finite, not {given}")
