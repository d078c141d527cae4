"""What a hand does at each control tick, handed to whoever keeps it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import BusValue, Context, EventStatus, LeafSystem

from drake_pregrasp.planning.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class GraspRecord:
    """One control tick.

    Attributes:
        time: In seconds.
        report: As `GraspSequencer` emits it, shape (4,).
        p_WT: The fingertips' centres in W, shape (n, 3), in metres.
        p_WT_goal: Where they are to be by the time the reference gets there, shape (n, 3).
        f_T_W: What they press with, in W, shape (n, 3), in newtons.
        X_WO: The object's true pose.
        X_WD: That of the turntable.
    """

    time: float
    report: FloatArray
    p_WT: FloatArray
    p_WT_goal: FloatArray
    f_T_W: FloatArray
    X_WO: RigidTransform
    X_WD: RigidTransform


class GraspLogger(LeafSystem):
    """Hands a `GraspRecord` to a function at each control tick.

    .. pydrake_system::

        name: GraspLogger
        input_ports:
        - grasp_report
        - tip_goals
        - p_WT
        - f_T_W
        - X_WO
        - X_WD

    The ports accept what ports of these names emit: `grasp_report`, `tip_goals`, `p_WT` and `f_T_W`
    of `HandController`, `X_WO` and `X_WD` of `HandStation`.

    Args:
        tip_frames: Names in `tip_goals`.
        period: Seconds between ticks.
        sink: Called with each record, in the order of time.
    """

    def __init__(
        self, *, tip_frames: Sequence[str], period: float, sink: Callable[[GraspRecord], None]
    ) -> None:
        super().__init__()
        n = len(tip_frames)
        self._tip_frames = list(tip_frames)
        self._sink = sink
        pose = AbstractValue.Make(RigidTransform())
        self._report = self.DeclareVectorInputPort("grasp_report", 4)
        self._goals = self.DeclareAbstractInputPort("tip_goals", AbstractValue.Make(BusValue()))
        self._p_WT = self.DeclareVectorInputPort("p_WT", 3 * n)
        self._f_T_W = self.DeclareVectorInputPort("f_T_W", 3 * n)
        self._X_WO = self.DeclareAbstractInputPort("X_WO", pose)
        self._X_WD = self.DeclareAbstractInputPort("X_WD", pose)
        self.DeclarePeriodicPublishEvent(period, 0.0, self._log)

    def _log(self, context: Context) -> EventStatus:
        goals: BusValue = self._goals.Eval(context)
        self._sink(
            GraspRecord(
                time=context.get_time(),
                report=self._report.Eval(context).copy(),
                p_WT=self._p_WT.Eval(context).reshape(-1, 3).copy(),
                p_WT_goal=np.array([goals.Find(name).translation() for name in self._tip_frames]),
                f_T_W=self._f_T_W.Eval(context).reshape(-1, 3).copy(),
                X_WO=RigidTransform(self._X_WO.Eval(context)),
                X_WD=RigidTransform(self._X_WD.Eval(context)),
            )
        )
        return EventStatus.Succeeded()
