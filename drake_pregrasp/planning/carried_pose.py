"""How a hand goes on with an object that it has just gripped on a moving table."""

from dataclasses import dataclass

import numpy as np

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.rotation_vectors import rotation_matrix


@dataclass(frozen=True, eq=False)
class Coasting:
    """A motion that goes on with a constant twist, and then comes to rest evenly.

    Attributes:
        R_WG: Orientation at the start, shape (3, 3).
        p_WG: Position at the start, shape (3,), in metres.
        w_WG: Angular velocity, in rad/s.
        v_WG: Velocity of the origin, in m/s.
    """

    R_WG: FloatArray
    p_WG: FloatArray
    w_WG: FloatArray
    v_WG: FloatArray

    def after(self, elapsed: float, *, coast: float, stop: float) -> "Coasting":
        """Returns pose and twist some time later.

        Args:
            elapsed: Seconds since the start, at least 0.
            coast: Seconds for which the twist stays.
            stop: Seconds in which it then vanishes, above 0.
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
        """Returns everything in one vector of 18."""
        return np.concatenate([self.R_WG.ravel(), self.p_WG, self.w_WG, self.v_WG])

    @staticmethod
    def from_vector(vector: FloatArray) -> "Coasting":
        """Returns the motion that `to_vector` made a vector of."""
        return Coasting(vector[:9].reshape(3, 3), *np.array(vector[9:]).reshape(3, 3))
