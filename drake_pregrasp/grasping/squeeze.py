"""Result of planning a squeeze, and the motion of a hand that has gripped an object."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.geometry.rotations import rotation_matrix
from drake_pregrasp.grasping.grasp_state import GiveUp


class Squeeze(NamedTuple):
    """Forces of fingertips on an object.

    Attributes:
        forces: Forces on the object in the frame of the contacts, shape (n, 3), in newtons.
        residual: Norm of the unbalanced wrench, in newtons, with torques divided by the longest
            lever arm.
        lack: Reason of an imbalance: the limit without which the forces would balance, or
            `OUT_OF_BALANCE` if there is no such limit.
    """

    forces: FloatArray
    residual: float
    lack: GiveUp = GiveUp.OUT_OF_BALANCE


@dataclass(frozen=True, eq=False)
class Coasting:
    """Motion of a frame G in W with a constant twist, then with constant deceleration to rest.

    Attributes:
        R_WG: Orientation of G in W at the start, shape (3, 3).
        p_WG: Position of G in W at the start, shape (3,), in metres.
        w_WG: Angular velocity of G in W, shape (3,), in rad/s.
        v_WG: Velocity of the origin of G in W, shape (3,), in m/s.
    """

    R_WG: FloatArray
    p_WG: FloatArray
    w_WG: FloatArray
    v_WG: FloatArray

    def after(self, elapsed: float, *, coast: float, stop: float) -> "Coasting":
        """Returns pose and twist after some time.

        Args:
            elapsed: Time since the start in seconds, at least 0.
            coast: Duration of the constant twist in seconds.
            stop: Duration of the deceleration to rest in seconds, above 0.
        """
        t = min(max(elapsed - coast, 0.0), stop)
        way, share = min(elapsed, coast) + t - t**2 / (2 * stop), 1 - t / stop
        return Coasting(
            rotation_matrix(self.w_WG * way) @ self.R_WG,
            self.p_WG + self.v_WG * way,
            self.w_WG * share,
            self.v_WG * share,
        )

    def to_vector(self) -> FloatArray:
        """Returns the motion as a vector of 18."""
        return np.concatenate([self.R_WG.ravel(), self.p_WG, self.w_WG, self.v_WG])

    @staticmethod
    def from_vector(vector: FloatArray) -> "Coasting":
        """Returns the motion from a vector of `to_vector`."""
        return Coasting(vector[:9].reshape(3, 3), *np.array(vector[9:]).reshape(3, 3))
