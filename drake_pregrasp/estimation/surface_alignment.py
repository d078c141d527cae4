"""Pose of an object from points on its surface, by its signed distances.

A point that is r away from the surface, such as the centre of a fingertip of radius r that touches
it, has the residual e = phi(q) - r, with the signed distance phi and the place q = Rᵀ (p_WQ - p_WO)
in O. An error (theta, p) of the pose, for which the true orientation is Exp(theta) R, changes it by
H = [(n x a)ᵀ, -nᵀ] with the outward normal n in W and a = p_WQ - p_WO. Points that a camera sees,
fingertips and the table differ by r and by the standard deviation of e only.

The weights are those of Geman and McClure: c⁴ / (c² + e²)², so that points far from the surface,
which belong to something else, hardly count.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.estimation.pose_belief import PoseMeasurement
from drake_pregrasp.geometry.distance_grid import DistanceGrid
from drake_pregrasp.geometry.rotations import rotation_matrix

SCALES = (0.02, 0.01, 0.005, 0.005, 0.005, 0.005)
"""Scale c of the weights in each iteration, in metres. The first ones let a start converge that is
a centimetre off."""

LEAST_SHARE = 0.02
"""Share of the information of a measured pose below which it counts as none. The facets of a round
mesh, which the object does not have, tell a turn about its axis with up to two thousandths, and one
or two points that a wrong pose has on a handle by chance with a hundredth or more."""


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points at known distances from the surface of an object.

    Attributes:
        p_WQ: Positions in W, shape (N, 3), in metres.
        radius: Distances from the surface, shape (N,), in metres.
        std: Standard deviations of these, shape (N,), in metres.
        is_bound: Whether the distance is at least the radius, and not equal to it, shape (N,).
    """

    p_WQ: FloatArray
    radius: FloatArray
    std: FloatArray
    is_bound: BoolArray

    def chosen(self, which: BoolArray) -> "SurfacePoints":
        """Returns the points of a mask, shape (N,)."""
        return SurfacePoints(*(values[which] for values in vars(self).values()))

    @staticmethod
    def seen(p_WQ: FloatArray, std: float) -> "SurfacePoints":
        """Returns points on the surface.

        Args:
            p_WQ: Positions in W, shape (N, 3), in metres.
            std: Standard deviation of their distances, in metres.
        """
        n = len(p_WQ)
        return SurfacePoints(p_WQ, np.zeros(n), np.full(n, std), np.zeros(n, dtype=bool))


class Alignment(NamedTuple):
    """Pose for which points are on the surface, as far as they observe it.

    Attributes:
        R_WO: Orientation, shape (3, 3).
        p_WO: Position, shape (3,), in metres.
        information: Information of the points on the errors (theta, p), shape (6, 6).
        fits: Sum of the weights, each from 0 to 1: number of points that fit.
    """

    R_WO: FloatArray
    p_WO: FloatArray
    information: FloatArray
    fits: float


def align_pose(
    grid: DistanceGrid,
    points: SurfacePoints,
    R_WO: FloatArray,
    p_WO: FloatArray,
    std: FloatArray,
    scales: tuple[float, ...] = SCALES,
) -> Alignment:
    """Returns the pose to which Gauss-Newton steps lead; unobserved directions do not change.

    Args:
        grid: Signed distances of the object in O.
        points: Points on its surface.
        R_WO: Orientation to start from, shape (3, 3).
        p_WO: Position to start from, shape (3,), in metres.
        std: Assumed standard deviations of a measured pose (theta, p), shape (6,), as units.
        scales: Scale of the weights in each step, in metres.
    """
    for scale in scales:
        H, e, w, _ = _residuals(grid, points, R_WO, p_WO, scale)
        x = observed_step((H.T * w) @ H, (H.T * w) @ e, std)
        R_WO, p_WO = rotation_matrix(x[:3]) @ R_WO, p_WO + x[3:]
    H, _, w, fits = _residuals(grid, points, R_WO, p_WO, scales[-1])
    return Alignment(R_WO, p_WO, (H.T * w) @ H, fits)


def observed_step(information: FloatArray, slope: FloatArray, std: FloatArray) -> FloatArray:
    """Returns the Gauss-Newton step in the directions that points observe, shape (6,).

    Args:
        information: Hᵀ w H, shape (6, 6).
        slope: Hᵀ w e, shape (6,).
        std: Assumed standard deviations of a measured pose (theta, p), shape (6,), as units.
    """
    squares, axes = np.linalg.eigh(information * std * std[:, None])
    along = -(axes.T @ (slope * std)) / np.where(squares < LEAST_SHARE, np.inf, squares)
    step: FloatArray = std * (axes @ along)
    return step


def _residuals(
    grid: DistanceGrid, points: SurfacePoints, R_WO: FloatArray, p_WO: FloatArray, scale: float
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Returns Jacobian, shape (N, 6), residuals and information, shape (N,), and the fits."""
    a = points.p_WQ - p_WO
    distances, gradients = grid.at(a @ R_WO)
    e, n = distances - points.radius, gradients @ R_WO.T
    weights = np.square(scale**2 / (scale**2 + e**2)) * ~(points.is_bound & (e > 0))
    H = np.hstack([np.cross(n, a), -n])
    return H, e, weights / points.std**2, float(weights.sum())


def measured_part(time: float, found: Alignment, std: FloatArray) -> PoseMeasurement:
    """Returns an aligned pose as a measurement of the directions that the points observe.

    Errors that points share, such as those of the camera's place, do not average out: the assumed
    noise of a measured pose is added. In coordinates with this noise as unit, a direction of
    information l has the information l / (1 + l). The more the points observe, the nearer the
    measurement comes to a measured pose.

    Args:
        time: Time at which the points were measured, in seconds.
        found: The aligned pose.
        std: Assumed standard deviations of a measured pose (theta, p), shape (6,).
    """
    squares, axes = np.linalg.eigh(found.information * std * std[:, None])
    shares = np.maximum(squares, 0.0)
    shares = shares / (1 + shares)
    root = np.sqrt(np.where(shares < LEAST_SHARE, 0.0, shares))[:, None] * axes.T
    # The lower triangular root of the same information: the first rows are those of orientation.
    lower = np.linalg.qr(root[:, ::-1])[1][::-1, ::-1]
    return PoseMeasurement(time, found.p_WO, found.R_WO, lower * std[:, None] / std)
