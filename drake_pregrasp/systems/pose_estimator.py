"""The object's pose, twist and uncertainty from noisy pose measurements."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    LeafSystem,
    ValueProducer,
)

from drake_pregrasp.arrays import (
    FARTHEST,
    FloatArray,
    finite_vector,
    is_integer,
    number_or_nan,
    pack,
    unpack,
)
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.estimation.pose_filter import (
    NO_BELIEF,
    PoseFilterNoise,
    PoseMeasurement,
    predict,
)
from drake_pregrasp.estimation.pose_track import PoseTrack, TrackingStatus, tracking_status
from drake_pregrasp.estimation.pose_tracker import OLDEST, TrackerSettings, update_track
from drake_pregrasp.ticks import tick_index

WAITING_STD = 1.0
"""Standard deviation of the position before the first measurement, in metres."""

MOST_LATE = 1000
"""Largest number of used measurements before which an out-of-sequence measurement may come."""


class PoseEstimator(LeafSystem):
    """Estimates pose and twist of the object O in the world W.

    .. pydrake_system::

        name: PoseEstimator
        input_ports:
        - X_WO_measured
        - measurement_time
        output_ports:
        - X_WO_estimated
        - V_WO_estimated
        - p_WO_covariance
        - tracking_status
        - time_since_measurement
        - measurement_verdict
        - innovation_squared

    Port `X_WO_measured` accepts a `RigidTransform`; it is sampled once each period. An invalid pose
    (not finite, not a rotation, beyond `FARTHEST`) is refused.

    Port `measurement_time` (optional) accepts a vector of 1: the time at which the pose at
    `X_WO_measured` was measured, in seconds; -inf if there was none yet. A time that was read
    before means that there is no new measurement. An out-of-sequence measurement, one older than
    the newest, corrects the estimate of its own time and all since then, if at most
    `late_measurements` newer ones were used, and is refused otherwise. If the port is unconnected,
    every sample is new, and measured at its tick.

    Port `X_WO_estimated` emits a `RigidTransform`.

    Port `V_WO_estimated` emits a `SpatialVelocity`: of O's frame in W, expressed in W.

    Port `p_WO_covariance` emits a vector of 9: the covariance Sigma of the position estimate, taken
    at the object's centre of mass, expressed in W, row-major, in m² (Eq. 3). It grows while no
    measurement is used.

    Port `tracking_status` emits a `TrackingStatus` as a number. It is not `TRACKING` while
    measurements contradict a belief whose twist none has confirmed. While it is `LOST`, pose and
    twist stand still: the pose is the prediction for the time of the loss, the twist is zero. It is
    `LOST`, too, if the prediction is beyond `FARTHEST`; the pose then is the newest one that was
    measured. While it is `WAITING`, the pose is the identity.

    Port `time_since_measurement` emits the seconds since the newest measurement that was used was
    made, or since time 0 if none was.

    Port `measurement_verdict` emits the result of the check of the last tick's sample: a
    `MeasurementVerdict` as a number.

    Port `innovation_squared` emits a vector of 2: νᵀ S⁻¹ ν of position and orientation, of the
    last measurement that was compared with a prediction. If the filter's assumptions hold, each is
    chi-square distributed with 3 degrees of freedom.

    A Kalman filter estimates the centre of mass, an error-state filter the orientation. There is no
    lag: at a tick the outputs are the posterior of that tick's measurement, whether they are
    evaluated before the discrete update stores it or after (the stored state carries its time, so
    that no measurement is used twice). Between ticks they are predictions.

    Args:
        period: Seconds between measurements, above 0.
        noise: Noise and motion that the filter assumes.
        p_OCoM: The object's centre of mass in O, shape (3,), in metres.
        lookahead: Seconds by which the outputs are predicted ahead of the time, from 0 to `OLDEST`.
        gate: See `TrackerSettings`; 0 to use all measurements.
        reacquire_after: See `TrackerSettings`.
        refuse_repeats: See `TrackerSettings`.
        late_measurements: Number of used measurements before which an out-of-sequence measurement
            may come, from 1 to `MOST_LATE`.
        coast_after: Seconds overdue after which the status is `COASTING`, at least 0.
        lost_after: Seconds overdue after which it is `LOST`, at least `coast_after`; may be
            infinite.

    Raises:
        InvalidArgumentError: If an argument is out of its range or not a number.
    """

    def __init__(
        self,
        *,
        period: float,
        noise: PoseFilterNoise,
        p_OCoM: FloatArray | None = None,
        lookahead: float = 0.0,
        gate: float = 7.0,
        reacquire_after: int = 3,
        refuse_repeats: bool = True,
        late_measurements: int = 20,
        coast_after: float = 0.1,
        lost_after: float = 1.0,
    ) -> None:
        super().__init__()
        self._period, self._lookahead = number_or_nan(period), number_or_nan(lookahead)
        self._coast_after, self._lost_after = number_or_nan(coast_after), number_or_nan(lost_after)
        place = np.zeros(3) if p_OCoM is None else finite_vector(p_OCoM, 3)
        if not 0 < self._period < np.inf:
            raise InvalidArgumentError(f"period must be finite and above 0 s, not {period}")
        if not 0 <= self._lookahead <= OLDEST:
            raise InvalidArgumentError(f"lookahead must be from 0 to {OLDEST:g} s, not {lookahead}")
        if not is_integer(late_measurements, 1, MOST_LATE):
            raise InvalidArgumentError(
                f"late_measurements must be a whole number from 1 to {MOST_LATE},"
                f" not {late_measurements}"
            )
        if not self._lost_after >= 0:
            raise InvalidArgumentError(f"lost_after must be at least 0 s, not {lost_after}")
        if not 0 <= self._coast_after <= self._lost_after:
            raise InvalidArgumentError(
                f"coast_after must be from 0 s to lost_after, {lost_after} s, not {coast_after}"
            )
        if place is None:
            raise InvalidArgumentError(f"p_OCoM must be three finite numbers, not {p_OCoM}")
        self._noise = noise
        self._p_OCoM = place
        self._settings = TrackerSettings(
            noise=noise,
            p_OCoM=self._p_OCoM if np.any(self._p_OCoM) else None,
            gate=gate,
            reacquire_after=reacquire_after,
            refuse_repeats=refuse_repeats,
        )
        # The belief before the oldest measurement that may still be corrected belongs to them.
        self._empty = PoseTrack.empty(late_measurements + 1)

        self._time_index = self.DeclareDiscreteState(np.array([-np.inf]))
        self._track_index = self.DeclareDiscreteState(pack(self._empty))
        self._X_WO_measured = self.DeclareAbstractInputPort(
            "X_WO_measured", AbstractValue.Make(RigidTransform())
        )
        self._measurement_time = self.DeclareVectorInputPort("measurement_time", 1)
        self._track = self.DeclareCacheEntry(
            "track at the Context's last tick",
            ValueProducer(lambda: AbstractValue.Make(self._empty), self._calc_track),
            {self.time_ticket(), self.xd_ticket(), self.all_input_ports_ticket()},
        )
        self._estimate = self.DeclareCacheEntry(
            "estimate at the Context's time",
            ValueProducer(
                lambda: AbstractValue.Make((TrackingStatus.WAITING, NO_BELIEF)), self._calc_estimate
            ),
            {self.time_ticket(), self._track.ticket()},
        )
        estimate, track = {self._estimate.ticket()}, {self.time_ticket(), self._track.ticket()}
        self.DeclareAbstractOutputPort(
            "X_WO_estimated",
            lambda: AbstractValue.Make(RigidTransform()),
            self._calc_pose,
            estimate,
        )
        self.DeclareAbstractOutputPort(
            "V_WO_estimated",
            lambda: AbstractValue.Make(SpatialVelocity()),
            self._calc_velocity,
            estimate,
        )
        self.DeclareVectorOutputPort("p_WO_covariance", 9, self._calc_covariance, track | estimate)
        self.DeclareVectorOutputPort("tracking_status", 1, self._calc_status, estimate)
        self.DeclareVectorOutputPort("time_since_measurement", 1, self._calc_age, track)
        self.DeclareVectorOutputPort("measurement_verdict", 1, self._calc_verdict, track)
        self.DeclareVectorOutputPort("innovation_squared", 2, self._calc_innovation, track)
        self.DeclarePeriodicDiscreteUpdateEvent(self._period, 0.0, self._store_track)

    def _calc_track(self, context: Context, output: AbstractValue) -> None:
        time = context.get_time()
        stored_time = context.get_discrete_state(self._time_index).value()[0]
        track = unpack(self._empty, context.get_discrete_state(self._track_index).value())
        if tick_index(time, self._period) != tick_index(stored_time, self._period):
            if stored_time > time:  # The Context was set back.
                track = self._empty
            X_WO: RigidTransform = self._X_WO_measured.Eval(context)
            measured_at = time
            if self._measurement_time.HasValue(context):
                measured_at = float(self._measurement_time.Eval(context)[0])
            p_OCoM = self._settings.p_OCoM
            p_WCoM = X_WO.translation().copy() if p_OCoM is None else X_WO @ p_OCoM
            measurement = PoseMeasurement(measured_at, p_WCoM, X_WO.rotation().matrix())
            track = update_track(track, measurement, time, self._settings)
        output.set_value(track)

    def _store_track(self, context: Context, discrete_state: DiscreteValues) -> None:
        discrete_state.set_value(self._time_index, [context.get_time()])
        discrete_state.set_value(self._track_index, pack(self._track.Eval(context)))

    def _calc_estimate(self, context: Context, output: AbstractValue) -> None:
        """Sets the status and the belief for the outputs, which stands still from the loss on."""
        track: PoseTrack = self._track.Eval(context)
        newest = track.newest
        since = context.get_time() - newest.time
        status = tracking_status(since, self._period, self._coast_after, self._lost_after)
        if status == TrackingStatus.TRACKING and not track.is_locked:
            status = TrackingStatus.COASTING
        if status == TrackingStatus.LOST:
            since = self._period + self._lost_after
        belief = newest
        if status != TrackingStatus.WAITING:
            belief = predict(newest, min(max(0.0, since), OLDEST), self._noise)
            belief = predict(belief, self._lookahead, self._noise) if self._lookahead else belief
            p_WO = belief.p_WCoM - belief.R_WO @ self._p_OCoM
            if not np.abs([p_WO, belief.v_WCoM, belief.w_WO]).max() <= FARTHEST:
                status, belief = TrackingStatus.LOST, newest
        output.set_value((status, belief))

    def _calc_pose(self, context: Context, output: AbstractValue) -> None:
        belief = self._estimate.Eval(context)[1]
        R_WO = RotationMatrix.ProjectToRotationMatrix(belief.R_WO)
        p_OCoM = self._settings.p_OCoM
        p_WO = belief.p_WCoM if p_OCoM is None else belief.p_WCoM - R_WO @ p_OCoM
        p_WO = np.clip(p_WO, -FARTHEST, FARTHEST)  # So that the pose is valid, if LOST.
        output.set_value(RigidTransform(R_WO, p_WO))

    def _calc_velocity(self, context: Context, output: AbstractValue) -> None:
        status, belief = self._estimate.Eval(context)
        if not status.is_followed:
            output.set_value(SpatialVelocity.Zero())
            return
        p_CoMO_W = -(belief.R_WO @ self._p_OCoM)
        v_WO = belief.v_WCoM + np.cross(belief.w_WO, p_CoMO_W)
        output.set_value(SpatialVelocity(w=belief.w_WO, v=v_WO))

    def _calc_covariance(self, context: Context, output: BasicVector) -> None:
        status, belief = self._estimate.Eval(context)
        covariance = belief.P_position[:3, :3]
        if status == TrackingStatus.WAITING:
            covariance = WAITING_STD**2 * np.eye(3)
        elif status == TrackingStatus.LOST:  # The pose stands still, but its uncertainty grows.
            newest = self._track.Eval(context).newest
            since = min(max(0.0, context.get_time() - newest.time), OLDEST)
            later = predict(predict(newest, since, self._noise), self._lookahead, self._noise)
            covariance = later.P_position[:3, :3]
        output.SetFromVector(covariance.ravel())

    def _calc_status(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([self._estimate.Eval(context)[0]])

    def _calc_age(self, context: Context, output: BasicVector) -> None:
        newest = self._track.Eval(context).newest.time
        output.SetFromVector([max(0.0, context.get_time() - (newest if newest > -np.inf else 0))])

    def _calc_verdict(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([self._track.Eval(context).verdict])

    def _calc_innovation(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._track.Eval(context).innovation_squared)
