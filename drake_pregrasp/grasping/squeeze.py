"""Result of planning a squeeze."""

from typing import NamedTuple

from drake_pregrasp.arrays import FloatArray
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
