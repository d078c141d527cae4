"""Offset of what cameras see from where the hand touches it, estimated beside the pose.

A camera with a wrong place shows the object displaced by a slowly changing b, and the pose filter
follows it there. Contacts in W observe b: those of fingertips, whose centres are a radius away from
the object's surface, and that of the table with its lowest corners. This follows separate-bias
estimation (Friedland, IEEE Transactions on Automatic Control 14(4), 1969): a filter that takes b to
be zero, and a second one for b, with the residuals of the first. Unlike there, the errors of the
pose and of the contacts count as independent of each other and from tick to tick, so the covariance
becomes too small after many ticks. Directions without contact keep their uncertainty.
"""

import math
from dataclasses import dataclass

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.estimation.surface_alignment import SurfacePoints
from drake_pregrasp.geometry.mesh_solid import MeshSolid

_PASSES = 4  # Linearizations of the distances for each correction.
_GATE = 9.0  # Squared Mahalanobis distance up to which something touches: three deviations.


@dataclass(frozen=True, eq=False)
class CameraOffset:
    """Estimate of the offset at one time.

    Attributes:
        time: Time of the estimate, in seconds; -inf before the first one.
        b_W: Mean displacement of what cameras see, in W, shape (3,), in metres.
        P: Its covariance, shape (3, 3), in m².
    """

    time: float
    b_W: FloatArray
    P: FloatArray

    @staticmethod
    def unknown(std: float) -> "CameraOffset":
        """Returns the estimate before anything has touched.

        Args:
            std: Standard deviation of the offset, per axis, in metres.
        """
        return CameraOffset(-math.inf, np.zeros(3), std**2 * np.eye(3))

    def predicted(self, time: float, std: float, correlation_time: float) -> "CameraOffset":
        """Returns the estimate at a later time: a Gauss-Markov process of first order.

        Args:
            time: The time, in seconds.
            std: Standard deviation of the offset in the long run, per axis, in metres.
            correlation_time: Time in which its correlation falls to 1/e, in seconds.
        """
        kept = math.exp(-max(0.0, time - self.time) / correlation_time)
        P = kept**2 * self.P + (1 - kept**2) * std**2 * np.eye(3)
        return CameraOffset(time, kept * self.b_W, P)

    def corrected(
        self,
        solid: MeshSolid,
        touches: SurfacePoints,
        R_WO: FloatArray,
        p_WO: FloatArray,
        P_WO: FloatArray,
    ) -> "CameraOffset":
        """Returns the estimate after something was at known distances from the surface.

        What is so far from the surface that chance does not explain it is left out.

        Args:
            solid: The object in O.
            touches: What touches it; a bound counts where it is violated.
            R_WO: Orientation of the object, shape (3, 3).
            p_WO: Position that cameras show, shape (3,), in metres.
            P_WO: Covariance of that position, without the offset, shape (3, 3), in m².
        """
        b_W, P = self.b_W, self.P
        for _ in range(_PASSES):
            distances, gradients = solid.surface.at((touches.p_WQ - p_WO + b_W) @ R_WO)
            n = gradients @ R_WO.T
            # A displacement of b moves the object back, so that the distance grows along n.
            e = touches.radius - distances - n @ (self.b_W - b_W)
            noise = np.einsum("ki,ij,kj->k", n, P_WO, n) + touches.std**2
            is_apart = touches.is_bound & (distances > touches.radius)
            b_W, P = self._after(n[~is_apart], e[~is_apart], noise[~is_apart])
        return CameraOffset(self.time, b_W, P)

    def rested(self, height: float, variance: float) -> "CameraOffset":
        """Returns the estimate after the lowest point of the object was on the plane z = 0 of W.

        Args:
            height: Height at which the estimate before has this point, in metres.
            variance: Variance of that height without the offset, in m².
        """
        rows = np.array([[0.0, 0.0, 1.0]]), np.array([height]), np.array([variance])
        return CameraOffset(self.time, *self._after(*rows))

    def _after(
        self, H: FloatArray, e: FloatArray, noise: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Returns mean and covariance after residuals, without those that chance does not explain.

        Args:
            H: Jacobian of what is measured, shape (k, 3).
            e: Residuals of the mean, shape (k,), in metres.
            noise: Variances of their noise, shape (k,), in m².
        """
        is_likely = e**2 <= _GATE * (np.einsum("ki,ij,kj->k", H, self.P, H) + noise)
        H, e, noise = H[is_likely], e[is_likely], noise[is_likely]
        gain = np.linalg.solve(H @ self.P @ H.T + np.diag(noise), H @ self.P).T
        P = self.P - gain @ H @ self.P
        return self.b_W + gain @ e, (P + P.T) / 2
