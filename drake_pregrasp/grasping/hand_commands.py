"""Command of a grasp's phase to the systems that move a hand."""

from dataclasses import dataclass

from drake_pregrasp.arrays import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class GraspCommand:
    """Command of a grasp's phase to fingertips, palm and joints; all numbers are valid.

    Attributes:
        R_WO: Orientation of the object, as last estimated, shape (3, 3).
        p_WO: Position of the object in W, shape (3,), in metres.
        V_WO: Angular velocity, and velocity of the origin, of the object in W, shape (2, 3), in
            rad/s and m/s.
        R_WG: Orientation of the frame G in which goals are planned, shape (3, 3).
        p_WG: Position of G in W, shape (3,), in metres.
        V_WG: Velocity of G, as that of the object, on average until the next tick, shape (2, 3).
        R_WE: Orientation of the frame E in which links avoid the object, shape (3, 3): G while
            fingers hold, else the estimated object, as touch has corrected it.
        p_WE: Position of E in W, shape (3,), in metres.
        V_WE: Velocity of E, as that of the object, shape (2, 3).
        is_tracked: Whether goals may follow the estimate.
        holds_contacts: Whether contacts are fixed on the object.
        standoffs: Gap between each fingertip and the surface, shape (n,), in metres; negative
            values press.
        fingers_hold: Whether each finger holds its contact, or closes on it, shape (n,).
        f_T_W: Forces that the fingertips should press with, in W, shape (n, 3), in newtons.
        nhat_W: Outward unit normals at the contacts in W, shape (n, 3); zero if unknown.
        force_limits: Largest force of each fingertip against its normal, and across it, shape
            (n, 2), in newtons; `NO_LIMIT` for none.
    """

    R_WO: FloatArray
    p_WO: FloatArray
    V_WO: FloatArray
    R_WG: FloatArray
    p_WG: FloatArray
    V_WG: FloatArray
    R_WE: FloatArray
    p_WE: FloatArray
    V_WE: FloatArray
    is_tracked: bool
    holds_contacts: bool
    standoffs: FloatArray
    fingers_hold: BoolArray
    f_T_W: FloatArray
    nhat_W: FloatArray
    force_limits: FloatArray
