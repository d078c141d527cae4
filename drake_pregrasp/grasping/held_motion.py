"""Motion of an object that a hand has gripped: an admittance that yields to its push."""

from dataclasses import dataclass, replace

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.geometry.rotations import rotation_matrix

COMPLIANCE = 0.8
"""Ratio K h/D of the fingertips' stiffness K and the damping D, with the control period h."""

INVERTANCE = 0.9
"""Ratio K h²/M of the fingertips' stiffness K and the mass M, with the control period h."""

FRICTION_SHARE = 0.5
"""Share of the table's friction on the object that does not move G; the rest accelerates G."""

TETHER = 0.005
"""Largest distance of G from the estimate of an object that is tracked, in metres."""

_LEAST_COMPLIANCE = 1e-7
"""Compliance of a fingertip that no joint moves in some direction, in m/N."""


def common_shift(
    shifts: FloatArray, J_WT: FloatArray, stiffness: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Returns the shift of an object that fingertips stick to, and the stiffness against it.

    At rest, drives of stiffness K_q that feel forces f of the object on the fingertips let these
    shift by J K_q⁻¹ Jᵀ f, through the joints of the fingers and of what carries them. The shift of
    the object is the one that causes the same net force F = Σ f_i if all fingertips shift by it.

    Args:
        shifts: Shifts of the fingertips from their goals in W, shape (n, 3), in metres.
        J_WT: Jacobians of the fingertips' velocities in W, shape (n, 3, nq).
        stiffness: Proportional gain of each joint, shape (nq,), in N m/rad or N/m.

    Returns:
        The shift in W, shape (3,), in metres: its height is the mean. And the horizontal stiffness
        K of all fingertips together, shape (2, 2), in N/m, so that F is K times the shift.
    """
    n = len(shifts)
    J = J_WT[:, :2].reshape(2 * n, -1)
    together = np.tile(np.eye(2), (n, 1))
    compliance = J / stiffness @ J.T + _LEAST_COMPLIANCE * np.eye(2 * n)
    forces = np.linalg.solve(compliance, np.column_stack([together, shifts[:, :2].ravel()]))
    net = together.T @ forces
    K = net[:, :2]
    return np.append(np.linalg.solve(K, net[:, 2]), np.mean(shifts[:, 2])), K


@dataclass(frozen=True, eq=False)
class HeldMotion:
    """Motion of a frame G in W at one time.

    Attributes:
        time: Time in seconds.
        R_WG: Orientation of G in W, shape (3, 3).
        p_WG: Position of G in W, shape (3,), in metres.
        V_WG: Angular velocity, and velocity of the origin of G, shape (2, 3), in rad/s and m/s.
        V_WB: Twist of the belt B under the object when the fingers touched it, shape (2, 3).
    """

    time: float
    R_WG: FloatArray
    p_WG: FloatArray
    V_WG: FloatArray
    V_WB: FloatArray

    @staticmethod
    def at_rest() -> "HeldMotion":
        """Returns the motion of a frame that rests in W."""
        return HeldMotion(0.0, np.eye(3), np.zeros(3), np.zeros((2, 3)), np.zeros((2, 3)))

    def at(self, time: float) -> "HeldMotion":
        """Returns the motion at another time, with the same twist."""
        return self._displaced((time - self.time) * self.V_WG, time)

    def stopping(self, time: float, duration: float) -> "HeldMotion":
        """Returns the motion at a later time, with constant deceleration to rest.

        Args:
            time: Time in seconds.
            duration: Duration of the deceleration in seconds, above 0.
        """
        s = min(1.0, (time - self.time) / duration)
        stopped = self._displaced(duration * (s - s**2 / 2) * self.V_WG, time)
        return replace(stopped, V_WG=(1 - s) * self.V_WG)

    def yielding(
        self, shift: FloatArray, stiffness: FloatArray, friction: float, since: float, period: float
    ) -> "HeldMotion":
        """Returns the motion after a push by the object, as that of a mass on the belt.

        In the horizontal plane, with the velocity v relative to the belt, the push F, the friction
        F₀ and the period h, it is the admittance M⁻¹/s + D⁻¹ with Coulomb friction. D and M are
        matrices, as K is; the time step is Moreau's where these are multiples of the identity:

            p⁺ = p + h D⁻¹ max(0, 1 - F₀/|F|) F
            v⁺ = max(0, 1 - h F₀ |u|/(uᵀ M u)) u   with  u = v + h M⁻¹ F

        Its energy is at most the work of F on it, which moves it in each period by p⁺ - p + h v⁺.
        `COMPLIANCE` and `INVERTANCE` state D and M. With fingertips that stick to something fixed,
        F = -K p is stable for 0 < K h/D < 2 and K h²/M < 4 - 2 K h/D.

        G does not turn beside the belt: turns and tilts of the fingertips look like the strain of
        fingers of unequal stiffness. The object stands on the table, so a vertical push is not a
        motion either: G sinks where fingers would lift the object, and it does not rise.

        Args:
            shift: Shift of the object from where the fingertips would hold it, as `common_shift`
                returns it, shape (3,), in metres.
            stiffness: Horizontal stiffness K against it, shape (2, 2), in N/m.
            friction: Largest horizontal force F₀ that does not move G on the belt, in newtons.
            since: Seconds since the last push, which this one replaces up to `period`.
            period: Seconds h between pushes.
        """
        share = min(1.0, since / period)
        level, rate = shift * [1.0, 1.0, 0.0], share * INVERTANCE / period
        push = float(np.linalg.norm(stiffness @ shift[:2]))
        e = level * max(0.0, 1 - friction / max(push, 1e-12)) + [0.0, 0.0, min(shift[2], 0.0)]
        u = self.V_WG[1] - self.V_WB[1] + rate * level
        resisted = rate * friction * np.linalg.norm(u)
        v = u * max(0.0, 1 - resisted / max(float(u[:2] @ stiffness @ u[:2]), 1e-30))
        moved = self._displaced(share * COMPLIANCE * np.array([np.zeros(3), e]), self.time)
        return replace(moved, V_WG=np.array([self.V_WG[0], self.V_WB[1] + v]))

    def within(self, p_W: FloatArray, distance: float) -> "HeldMotion":
        """Returns the motion with the origin of G brought back to a distance from a point.

        Args:
            p_W: The point in W, shape (3,), in metres.
            distance: Largest distance, in metres.
        """
        away = self.p_WG - p_W
        share = min(1.0, distance / max(float(np.linalg.norm(away)), 1e-12))
        return self if share == 1.0 else replace(self, p_WG=p_W + share * away)

    def _displaced(self, e: FloatArray, time: float) -> "HeldMotion":
        R_WG = rotation_matrix(e[0]) @ self.R_WG
        return replace(self, time=time, R_WG=R_WG, p_WG=self.p_WG + e[1])
