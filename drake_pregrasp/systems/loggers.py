"""Loggers that call a function with a record of each tick."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, EventStatus, LeafSystem

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.contacts.selection_input import is_active
from drake_pregrasp.estimation.pose_track import TrackingStatus
from drake_pregrasp.quality.grasp_quality import GraspQuality
from drake_pregrasp.regions.safe_regions import SafeRegions
from drake_pregrasp.systems.link_contacts import TOUCHED
from drake_pregrasp.systems.ports import POSE, REGIONS, copied_inputs, declare_inputs


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
    tracking_status: int
    time_since_measurement: float

    def active_contacts(self) -> tuple[IntArray, FloatArray]:
        """Returns the indices of the active contacts, and their goals in the estimated O."""
        active = np.flatnonzero(is_active(self.contact_status))
        return active, (self.X_WO_estimated.inverse() @ self.p_WC[active].T).T


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

    The ports accept the values of the output ports with these names: `p_WC`, `contact_status` and
    `contact_causes` of `CentroidSelector`, `grasp_quality` of `GraspQualityMonitor`,
    `safe_regions` of `SafeRegionPartitioner`, `X_WO` of `ObjectPlant`, and `X_WO_estimated`,
    `tracking_status` and `time_since_measurement` of `PoseEstimator`.

    Publish events of one time run in the order in which systems were added. Add this system before
    visualizers, so that it times the planner and not a cache look-up.

    Args:
        num_contacts: Number of contacts n.
        period: Seconds between ticks.
        sink: Function that is called with each record, in the order of time.
    """

    def __init__(
        self,
        *,
        num_contacts: int,
        period: float,
        sink: Callable[[TickRecord], None],
    ) -> None:
        super().__init__()
        n, self._sink = num_contacts, sink
        self._inputs = declare_inputs(
            self,
            p_WC=3 * n,
            contact_status=n,
            grasp_quality=len(GraspQuality.names()),
            safe_regions=REGIONS,
            X_WO=POSE,
            X_WO_estimated=POSE,
            contact_causes=n,
            tracking_status=1,
            time_since_measurement=1,
        )
        self.DeclarePeriodicPublishEvent(period, 0.0, self._log)

    def _log(self, context: Context) -> EventStatus:
        start = time.perf_counter()
        self._inputs["p_WC"].Eval(context)
        wall_seconds = time.perf_counter() - start
        values = copied_inputs(self._inputs, context)
        self._sink(
            TickRecord(
                time=context.get_time(),
                p_WC=values.pop("p_WC").reshape(-1, 3),
                regions=values.pop("safe_regions"),
                wall_seconds=wall_seconds,
                tracking_status=TrackingStatus(values.pop("tracking_status")[0]),
                time_since_measurement=float(values.pop("time_since_measurement")[0]),
                **values,
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
        link_forces: Largest forces between links and the object, surroundings and other fingers
            since the last tick, shape (3,), in newtons.
        catch_certificate: Output of `InterceptionPlanner`, shape (5,).
    """

    time: float
    report: FloatArray
    p_WT: FloatArray
    p_GT: FloatArray
    f_T_W: FloatArray
    X_WG: RigidTransform
    X_WO: RigidTransform
    X_WD: RigidTransform
    link_forces: FloatArray
    catch_certificate: FloatArray


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
        - link_forces
        - catch_certificate

    The ports accept the values of the output ports with these names: `grasp_report`, `p_GT`,
    `p_WT`, `f_T_W`, `X_WG` and `catch_certificate` of `HandController`, `X_WO`, `X_WD` and
    `link_forces` of `HandStation`.

    Args:
        num_fingers: Number of fingers n.
        period: Seconds between ticks.
        sink: Function that is called with each record, in the order of time.
    """

    def __init__(
        self, *, num_fingers: int, period: float, sink: Callable[[GraspRecord], None]
    ) -> None:
        super().__init__()
        n, self._sink = num_fingers, sink
        self._inputs = declare_inputs(
            self,
            grasp_report=4,
            p_GT=3 * n,
            p_WT=3 * n,
            f_T_W=3 * n,
            X_WG=POSE,
            X_WO=POSE,
            X_WD=POSE,
            link_forces=len(TOUCHED),
            catch_certificate=5,
        )
        self.DeclarePeriodicPublishEvent(period, 0.0, self._log)

    def _log(self, context: Context) -> EventStatus:
        values = copied_inputs(self._inputs, context)
        points = {name: values.pop(name).reshape(-1, 3) for name in ("p_WT", "p_GT", "f_T_W")}
        report = values.pop("grasp_report")
        self._sink(GraspRecord(time=context.get_time(), report=report, **points, **values))
        return EventStatus.Succeeded()
