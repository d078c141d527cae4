"""What happened at each planning tick, handed to whoever keeps it."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, EventStatus, LeafSystem

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.safe_regions import SafeRegions
from drake_pregrasp.planning.tracking_status import TrackingStatus
from drake_pregrasp.planning.usable_inputs import usable_status


@dataclass(frozen=True, eq=False)
class TickRecord:
    """One planning tick.

    Attributes:
        time: In seconds.
        p_WC: Contact goals in W, shape (n, 3), in metres.
        contact_status: `ContactStatus` of each, shape (n,).
        contact_causes: The contact or obstacle behind it, or -1, shape (n,).
        grasp_quality: As `GraspQualityMonitor` emits it, shape (5,).
        regions: The safe regions.
        X_WO: The object's true pose.
        X_WO_estimated: Its estimate.
        wall_seconds: What it took to compute the goals from the plant's state.
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
    """Hands a `TickRecord` to a function at each planning tick.

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
    optional, `tracking_status` and `time_since_measurement` of `PoseEstimator`. Without these two
    the object is always tracked.

    Publish events of one time run in the order in which systems were added: to time the planner,
    and not a cache look-up, add this system before visualizers.

    Args:
        num_contacts: n.
        quality_size: Length of `grasp_quality`.
        period: Seconds between ticks.
        sink: Called with each record, in the order of time.
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
        self._X_WO = self.DeclareAbstractInputPort("X_WO", AbstractValue.Make(RigidTransform()))
        self._X_WO_estimated = self.DeclareAbstractInputPort(
            "X_WO_estimated", AbstractValue.Make(RigidTransform())
        )
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
            status = usable_status(self._tracking_status.Eval(context)[0])
        if self._age.HasValue(context):
            age = float(self._age.Eval(context)[0])
        # Evaluating an abstract port gives the cached object itself, which later ticks overwrite.
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
