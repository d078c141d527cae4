"""Loggers that call a function with a record of each tick."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, EventStatus, LeafSystem

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.estimation.pose_track import TrackingStatus
from drake_pregrasp.regions.safe_regions import SafeRegions
from drake_pregrasp.systems.pose_ports import POSE


@dataclass(frozen=True, eq=False)
class TickRecord:
    """Record of one planning tick.

    Attributes:
        time: Time of the tick, in seconds.
        p_WC: Contact goals in W, shape (n, 3), in metres.
        contact_status: `ContactStatus` of each contact, shape (n,).
        contact_causes: Index of the contact or obstacle that causes each status, or -1, shape (n,).
        grasp_quality: Output of `GraspQualityMonitor`, shape (5,).
        regions: Safe regions.
        X_WO: True pose of the object.
        X_WO_estimated: Estimated pose of the object.
        wall_seconds: Wall time in which the goals were computed from the plant's state, in seconds.
        tracking_status: A `TrackingStatus`.
        time_since_measurement: Age of the newest measurement in the estimate, in seconds.
    """

    time: float
    p_WC: FloatArray
    contact_status: FloatArray
    contact_causes: FloatArray
    grasp_quality: FloatArray
    regions: SafeRegions
    X_WO: RigidTransform
    X_WO_estimated: RigidTransform
    wall_seconds: float
    tracking_status: int = TrackingStatus.TRACKING
    time_since_measurement: float = 0.0


class TickLogger(LeafSystem):
    """Calls a function with a `TickRecord` at each planning tick.

    .. pydrake_system::

        name: TickLogger
        input_ports:
        - p_WC
        - contact_status
        - grasp_quality
        - safe_regions
        - X_WO
        - X_WO_estimated
        - contact_causes
        - tracking_status
        - time_since_measurement

    The ports accept what the ports of these names emit: `p_WC`, `contact_status` and
    `contact_causes` of `CentroidSelector`, `grasp_quality` of `GraspQualityMonitor`,
    `safe_regions` of `SafeRegionPartitioner`, `X_WO` of `ObjectPlant`, and `X_WO_estimated` and,
    optional, `tracking_status` and `time_since_measurement` of `PoseEstimator`. If these two are
    unconnected, the object is always tracked.

    Publish events of one time run in the order in which systems were added. Add this system before
    visualizers, so that it times the planner and not a cache look-up.

    Args:
        num_contacts: Number of contacts n.
        quality_size: Number of elements of `grasp_quality`.
        period: Seconds between ticks.
        sink: Function that is called with each record, in the order of time.
    """

    def __init__(
        self,
        *,
        num_contacts: int,
        quality_size: int,
        period: float,
        sink: Callable[[TickRecord], None],
    ) -> None:
        super().__init__()
        self._sink = sink
        self._p_WC = self.DeclareVectorInputPort("p_WC", 3 * num_contacts)
        self._contact_status = self.DeclareVectorInputPort("contact_status", num_contacts)
        self._grasp_quality = self.DeclareVectorInputPort("grasp_quality", quality_size)
        self._safe_regions = self.DeclareAbstractInputPort(
            "safe_regions", AbstractValue.Make(object())
        )
        self._X_WO = self.DeclareAbstractInputPort("X_WO", POSE)
        self._X_WO_estimated = self.DeclareAbstractInputPort("X_WO_estimated", POSE)
        self._contact_causes = self.DeclareVectorInputPort("contact_causes", num_contacts)
        self._tracking_status = self.DeclareVectorInputPort("tracking_status", 1)
        self._age = self.DeclareVectorInputPort("time_since_measurement", 1)
        self.DeclarePeriodicPublishEvent(period, 0.0, self._log)

    def _log(self, context: Context) -> EventStatus:
        start = time.perf_counter()
        p_WC: FloatArray = self._p_WC.Eval(context)
        wall_seconds = time.perf_counter() - start
        regions: SafeRegions = self._safe_regions.Eval(context)
        status, age = TrackingStatus.TRACKING, 0.0
        if self._tracking_status.HasValue(context):
            status = TrackingStatus(self._tracking_status.Eval(context)[0])
        if self._age.HasValue(context):
            age = float(self._age.Eval(context)[0])
        # Copies, because Drake overwrites the values of ports at later ticks.
        self._sink(
            TickRecord(
                time=context.get_time(),
                p_WC=p_WC.reshape(-1, 3).copy(),
                contact_status=self._contact_status.Eval(context).copy(),
                contact_causes=self._contact_causes.Eval(context).copy(),
                grasp_quality=self._grasp_quality.Eval(context).copy(),
                regions=regions,
                X_WO=RigidTransform(self._X_WO.Eval(context)),
                X_WO_estimated=RigidTransform(self._X_WO_estimated.Eval(context)),
                wall_seconds=wall_seconds,
                tracking_status=status,
                time_since_measurement=age,
            )
        )
        return EventStatus.Succeeded()


@dataclass(frozen=True, eq=False)
class GraspRecord:
    """Record of one control tick.

    Attributes:
        time: Time of the tick, in seconds.
        report: Output `grasp_report` of `GraspSequencer`, shape (4,).
        p_WT: Centres of the fingertips in W, shape (n, 3), in metres.
        p_GT: Goals of the fingertips in the frame G, shape (n, 3), in metres.
        f_T_W: Forces that the fingertips press with, in W, shape (n, 3), in newtons.
        X_WG: Pose of the frame G in which goals are planned.
        X_WO: True pose of the object.
        X_WD: Pose of the turntable.
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
    """Calls a function with a `GraspRecord` at each control tick.

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

    All ports except `f_T_W` must be connected; without it, the recorded forces are zero.

    The ports accept what ports of these names emit: `grasp_report`, `p_GT`, `p_WT`, `f_T_W` and
    `X_WG` of `HandController`, `X_WO` and `X_WD` of `HandStation`.

    Args:
        num_fingers: Number of fingers n.
        period: Seconds between ticks.
        sink: Function that is called with each record, in the order of time.
    """

    def __init__(
        self, *, num_fingers: int, period: float, sink: Callable[[GraspRecord], None]
    ) -> None:
        super().__init__()
        n = num_fingers
        self._sink = sink
        self._report = self.DeclareVectorInputPort("grasp_report", 4)
        self._p_GT = self.DeclareVectorInputPort("p_GT", 3 * n)
        self._p_WT = self.DeclareVectorInputPort("p_WT", 3 * n)
        self._f_T_W = self.DeclareVectorInputPort("f_T_W", 3 * n)
        self._X_WG = self.DeclareAbstractInputPort("X_WG", POSE)
        self._X_WO = self.DeclareAbstractInputPort("X_WO", POSE)
        self._X_WD = self.DeclareAbstractInputPort("X_WD", POSE)
        self.DeclarePeriodicPublishEvent(period, 0.0, self._log)

    def _log(self, context: Context) -> EventStatus:
        forces: FloatArray = np.zeros(self._f_T_W.size())
        if self._f_T_W.HasValue(context):
            forces = self._f_T_W.Eval(context).copy()
        self._sink(
            GraspRecord(
                time=context.get_time(),
                report=self._report.Eval(context).copy(),
                p_WT=self._p_WT.Eval(context).reshape(-1, 3).copy(),
                p_GT=self._p_GT.Eval(context).reshape(-1, 3).copy(),
                f_T_W=forces.reshape(-1, 3),
                X_WG=RigidTransform(self._X_WG.Eval(context)),
                X_WO=RigidTransform(self._X_WO.Eval(context)),
                X_WD=RigidTransform(self._X_WD.Eval(context)),
            )
        )
        return EventStatus.Succeeded()
