"""What a hand does at each control tick, handed to whoever keeps it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, EventStatus, LeafSystem

from drake_pregrasp.planning.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class GraspRecord:
    """One control tick.

    Attributes:
        time: In seconds.
        report: As `GraspSequencer` emits it, shape (4,).
        p_WT: The fingertips' centres in W, shape (n, 3), in metres.
        p_GT: Their goals in the frame G that carries them, shape (n, 3).
        f_T_W: What they press with, in W, shape (n, 3), in newtons.
        X_WG: The pose of G.
        X_WO: The object's true pose.
        X_WD: That of the turntable.
    """

    time: float
    report: FloatArray
    p_WT: FloatArray
    p_GT: FloatArray
    f_T_W: FloatArray
    X_WG: RigidTransform
    X_WO: RigidTransform
    X_WD: RigidTransform


class GraspLogger(LeafSystem):
    """Hands a `GraspRecord` to a function at each control tick.

    .. pydrake_system::

        name: GraspLogger
        input_ports:
        - grasp_report
        - p_GT
        - p_WT
        - f_T_W
        - X_WG
        - X_WO
        - X_WD

    All ports but `f_T_W` have to be connected; without it, forces are recorded as zeros.

    The ports accept what ports of these names emit: `grasp_report`, `p_GT`, `p_WT`, `f_T_W` and
    `X_WG` of `HandController`, `X_WO` and `X_WD` of `HandStation`.

    Args:
        num_fingers: n.
        period: Seconds between ticks.
        sink: Called with each record, in the order of time.
    """

    def __init__(
        self, *, num_fingers: int, period: float, sink: Callable[[GraspRecord], None]
    ) -> None:
        super().__init__()
        n = num_fingers
        self._sink = sink
        pose = AbstractValue.Make(RigidTransform())
        self._report = self.DeclareVectorInputPort("grasp_report", 4)
        self._p_GT = self.DeclareVectorInputPort("p_GT", 3 * n)
        self._p_WT = self.DeclareVectorInputPort("p_WT", 3 * n)
        self._f_T_W = self.DeclareVectorInputPort("f_T_W", 3 * n)
        self._X_WG = self.DeclareAbstractInputPort("X_WG", pose)
        self._X_WO = self.DeclareAbstractInputPort("X_WO", pose)
        self._X_WD = self.DeclareAbstractInputPort("X_WD", pose)
        self.DeclarePeriodicPublishEvent(period, 0.0, self._log)

    def _log(self, context: Context) -> EventStatus:
        self._sink(
            GraspRecord(
                time=context.get_time(),
                report=self._report.Eval(context).copy(),
                p_WT=self._p_WT.Eval(context).reshape(-1, 3).copy(),
                p_GT=self._p_GT.Eval(context).reshape(-1, 3).copy(),
                f_T_W=self._forces(context),
                X_WG=RigidTransform(self._X_WG.Eval(context)),
                X_WO=RigidTransform(self._X_WO.Eval(context)),
                X_WD=RigidTransform(self._X_WD.Eval(context)),
            )
        )
        return EventStatus.Succeeded()

    def _forces(self, context: Context) -> FloatArray:
        if not self._f_T_W.HasValue(context):
            return np.zeros((self._f_T_W.size() // 3, 3))
        forces: FloatArray = self._f_T_W.Eval(context).reshape(-1, 3).copy()
        return forces
