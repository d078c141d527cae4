"""Motion of an object that a hand has gripped, by the kinematics of its fingertips."""

from dataclasses import dataclass, replace

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.geometry.rotations import rotation_matrix

# Gains of the alpha-beta-gamma filter (Bar-Shalom, Li and Kirubarajan, section 6.5) for the pose,
# the twist and the acceleration. Fingertips follow G in turn: with a larger gain of the
# acceleration, an arm, whose drives yield, swings with the object. The acceleration fades, because
# fingertips that follow G cannot contradict it.
_ALPHA, _BETA, _GAMMA, _FADING = 0.8, 0.9, 0.2, 0.9


@dataclass(frozen=True, eq=False)
class HeldMotion:
    """Motion of a frame G in W at one time; twist and acceleration have their angular part first.

    Attributes:
        time: Time in seconds.
        R_WG: Orientation of G in W, shape (3, 3).
        p_WG: Position of G in W, shape (3,), in metres.
        V_WG: Angular velocity, and velocity of the origin of G, shape (2, 3), in rad/s and m/s.
        A_WG: Angular and linear acceleration, shape (2, 3), in rad/s² and m/s².
    """

    time: float
    R_WG: FloatArray
    p_WG: FloatArray
    V_WG: FloatArray
    A_WG: FloatArray

    @staticmethod
    def at_rest() -> "HeldMotion":
        """Returns the motion of a frame that rests in W."""
        return HeldMotion(0.0, np.eye(3), np.zeros(3), np.zeros((2, 3)), np.zeros((2, 3)))

    def at(self, time: float) -> "HeldMotion":
        """Returns the motion at another time, with the same acceleration."""
        dt = time - self.time
        return self._displaced(dt * self.V_WG + dt**2 / 2 * self.A_WG, time, dt * self.A_WG)

    def without_acceleration(self) -> "HeldMotion":
        """Returns the motion with zero acceleration."""
        return replace(self, A_WG=np.zeros((2, 3)))

    def stopping(self, time: float, duration: float) -> "HeldMotion":
        """Returns the motion at a later time, with constant deceleration to rest.

        Args:
            time: Time in seconds.
            duration: Duration of the deceleration in seconds, above 0.
        """
        braking = replace(self, A_WG=-self.V_WG / duration)
        return braking.at(min(time, self.time + duration))

    def following(
        self, p_WT: FloatArray, p_GT: FloatArray, since: float, period: float
    ) -> "HeldMotion":
        """Returns the motion, corrected by fingertips that stick to an object on a table.

        G follows the mean horizontal shift of the fingertips. Turns and tilts stay as they were:
        those of the fingertips look like the strain of fingers of unequal stiffness, and a G that
        followed a strain would increase it, and turn or tip the object without end. The object
        stands on a table, so a vertical shift is not a motion either: G sinks where fingers would
        lift the object, and it does not rise.

        Args:
            p_WT: Centres of the fingertips in W, shape (k, 3), in metres.
            p_GT: Their goals in G, shape (k, 3), in metres.
            since: Seconds since the last correction, which this one replaces up to `period`.
            period: Seconds between corrections.
        """
        x, y, z = np.mean(p_WT - self.p_WG - p_GT @ self.R_WG.T, axis=0)
        level = np.array([np.zeros(3), [x, y, 0.0]])
        e = np.array([np.zeros(3), [x, y, min(z, 0.0)]])
        share = min(1.0, since / period)
        fading = 1 - share * (1 - _FADING)
        corrected = replace(self, A_WG=fading * self.A_WG + share * _GAMMA / period**2 * level)
        return corrected._displaced(share * _ALPHA * e, self.time, share * _BETA / period * level)

    def _displaced(self, e: FloatArray, time: float, dV: FloatArray) -> "HeldMotion":
        R_WG = rotation_matrix(e[0]) @ self.R_WG
        return HeldMotion(time, R_WG, self.p_WG + e[1], self.V_WG + dV, self.A_WG)
