"""Motion of an object that a hand has gripped: an admittance that yields to its push."""

from dataclasses import dataclass, replace

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.geometry.rotations import rotation_matrix, rotation_vector, skew

DAMPING_RATIO = 0.8
"""Ratio K h/D of the fingers' stiffness K and the damping D, with the control period h."""

MASS_RATIO = 1.8
"""Ratio K h²/M of the fingers' stiffness K and the virtual mass M, with the control period h."""

TETHER = 0.005
"""Largest distance of G from a tracked object, as estimated and corrected by touch, in metres."""


@dataclass(frozen=True, eq=False)
class HeldMotion:
    """Motion of a frame G in W at one time.

    Attributes:
        time: Time in seconds.
        R_WG: Orientation of G in W, shape (3, 3).
        p_WG: Position of G in W, shape (3,), in metres.
        V_WG: Angular velocity, and velocity of the origin of G, shape (2, 3), in rad/s and m/s.
        V_WBelt: Twist of the belt under the object before a finger touched it, or in the air that
            of the object, shape (2, 3), in rad/s and m/s.
        a_W: Acceleration of the centre of mass in W, shape (3,), in m/s²: zero on a belt, gravity
            in the air.
    """

    time: float
    R_WG: FloatArray
    p_WG: FloatArray
    V_WG: FloatArray
    V_WBelt: FloatArray
    a_W: FloatArray

    @staticmethod
    def at_rest() -> "HeldMotion":
        """Returns the motion of a frame that rests in W."""
        still = np.zeros((2, 3))
        return HeldMotion(0.0, np.eye(3), np.zeros(3), still, still, np.zeros(3))

    def at(self, time: float, p_GCoM: FloatArray) -> "HeldMotion":
        """Returns the motion at another time, with the same angular velocity and acceleration.

        Args:
            time: Time in seconds.
            p_GCoM: Centre of mass in G, shape (3,), in metres: the origin of G turns about it.
        """
        (w, v), dt = self.V_WG, time - self.time
        R_WG, w_cross = rotation_matrix(dt * w) @ self.R_WG, skew(w)
        before, after = self.R_WG @ p_GCoM, R_WG @ p_GCoM
        v_CoM, change = v + w_cross @ before, dt * self.a_W
        p_WG = self.p_WG + before + dt * (v_CoM + change / 2) - after
        V_WG = np.array([w, v_CoM + change - w_cross @ after])
        return replace(self, time=time, R_WG=R_WG, p_WG=p_WG, V_WG=V_WG)

    def nearer(
        self, R_WO: FloatArray, p_WO: FloatArray, p_GCoM: FloatArray, share: float
    ) -> "HeldMotion":
        """Returns the motion with G brought nearer to a pose, by a share of the way.

        Args:
            R_WO: Orientation of the pose in W, shape (3, 3).
            p_WO: Its position in W, shape (3,), in metres.
            p_GCoM: Centre of mass in G and in O, shape (3,), in metres: it moves straight.
            share: The share, from 0 to 1.
        """
        R_WG = rotation_matrix(share * rotation_vector(R_WO @ self.R_WG.T)) @ self.R_WG
        p_WCoM, there = self.p_WG + self.R_WG @ p_GCoM, p_WO + R_WO @ p_GCoM
        p_WG = p_WCoM + share * (there - p_WCoM) - R_WG @ p_GCoM
        return replace(self, R_WG=R_WG, p_WG=p_WG)

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
        self, f: FloatArray, stiffness: float, friction: float, since: float, period: float
    ) -> "HeldMotion":
        """Returns the motion after a push by the object, as that of a mass on the belt.

        In the horizontal plane, with the velocity v relative to the belt, the push F, the friction
        F₀ and the period h, it is the admittance 1/(M s) + 1/D with Coulomb friction (Moreau's time
        step):

            p⁺ = p + (h/D) max(0, 1 - F₀/|F|) F
            v⁺ = max(0, 1 - h F₀/(M |u|)) u   with  u = v + (h/M) F

        Its energy is at most the work of F on it, which moves it in each period by p⁺ - p + h v⁺.
        `DAMPING_RATIO` and `MASS_RATIO` state D and M. With fingertips that stick to something
        fixed, F = -K p is stable for 0 < K h/D < 2 and K h²/M < 4 - 2 K h/D.

        G does not turn beside the belt: turns and tilts of the fingertips look like the strain of
        fingers of unequal stiffness. The object stands on the table, so a vertical push is not a
        motion either: G sinks where fingers would lift the object, and it does not rise.

        Args:
            f: Force of the object on the fingertips beyond what is commanded, in W, shape (3,), in
                newtons.
            stiffness: Horizontal stiffness K of all fingertips that feel it, in N/m.
            friction: Largest horizontal force F₀ that does not move G on the belt, in newtons.
            since: Seconds since the last push, which this one replaces up to `period`.
            period: Seconds h between pushes.
        """
        share = min(1.0, since / period)
        x, y, z = f / stiffness
        level, slack = np.array([x, y, 0.0]), friction / stiffness
        e = level * max(0.0, 1 - slack / max(np.hypot(x, y), 1e-12)) + [0.0, 0.0, min(z, 0.0)]
        rate = share * MASS_RATIO / period
        u = self.V_WG[1] - self.V_WBelt[1] + rate * level
        v = u * max(0.0, 1 - rate * slack / max(float(np.linalg.norm(u)), 1e-12))
        moved = self._displaced(share * DAMPING_RATIO * np.array([np.zeros(3), e]), self.time)
        return replace(moved, V_WG=np.array([self.V_WG[0], self.V_WBelt[1] + v]))

    def within(self, p_WQ: FloatArray, distance: float) -> "HeldMotion":
        """Returns the motion with the origin of G brought back to a distance from a point Q.

        As an inelastic tether does, it also takes the velocity that leads away from Q, which moves
        with the belt: a push that cannot move G would otherwise make it faster at each period.

        Args:
            p_WQ: The point in W, shape (3,), in metres.
            distance: Largest distance, in metres.
        """
        away = self.p_WG - p_WQ
        far = float(np.linalg.norm(away))
        if not far > distance:
            return self
        outward = away / far
        taken = max(0.0, float((self.V_WG[1] - self.V_WBelt[1]) @ outward)) * outward
        V_WG = np.array([self.V_WG[0], self.V_WG[1] - taken])
        return replace(self, p_WG=p_WQ + distance * outward, V_WG=V_WG)

    def _displaced(self, e: FloatArray, time: float) -> "HeldMotion":
        """Returns the motion after a displacement: a rotation vector and a translation, (2, 3)."""
        R_WG = rotation_matrix(e[0]) @ self.R_WG
        return replace(self, time=time, R_WG=R_WG, p_WG=self.p_WG + e[1])
