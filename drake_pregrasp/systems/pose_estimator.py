"""Estimate of the object's pose, twist and uncertainty from noisy pose measurements."""

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from drake_pregrasp.arrays import (
    FARTHEST,
    FloatArray,
    are_valid,
    are_valid_points,
    finite_vector,
    number_or_nan,
    pack,
    tick_index,
    unpacker,
)
from drake_pregrasp.config.planner_config import EstimatorConfig, tracker_settings
from drake_pregrasp.config.validation import checked
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.estimation.contact_measurement import (
    Contacts,
    conditioned,
    felt,
    touch_noise,
)
from drake_pregrasp.estimation.point_measurement import SeenObject
from drake_pregrasp.estimation.pose_belief import (
    NO_MEASUREMENT,
    PoseBelief,
    PoseMeasurement,
    boosted,
    no_belief,
)
from drake_pregrasp.estimation.pose_filter import origin_covariance, predict, predicted_mean
from drake_pregrasp.estimation.pose_track import (
    FOLLOWED,
    PoseTrack,
    TrackerSettings,
    TrackingStatus,
)
from drake_pregrasp.estimation.pose_tracker import OLDEST, update_track
from drake_pregrasp.estimation.surface_alignment import SurfacePoints
from drake_pregrasp.fast import default_kernels
from drake_pregrasp.fast.kernels import Kernels
from drake_pregrasp.geometry.mesh_solid import MeshSolid
from drake_pregrasp.geometry.resting import FlatSide, flat_sides
from drake_pregrasp.geometry.rotations import skew
from drake_pregrasp.systems.ports import (
    CLOUD,
    POSE,
    VELOCITY,
    declare_cache,
    declare_output,
    points_in,
)

WAITING_STD = 1.0
"""Standard deviation of the position before the first measurement, in metres."""

FASTEST = 100.0
"""Largest component of the twist of an object that a hand holds, in rad/s and m/s."""

_UNKNOWN = np.full(6, np.nan)  # Twist of an object that no hand holds.


class _Estimate(NamedTuple):
    """Estimate at one time.

    Attributes:
        status: Status of the estimate.
        belief: Mixture of the models at the newest measurement, with the twist that is known since.
        R_WO: Predicted orientation, shape (3, 3).
        p_WO: Predicted position, shape (3,), in metres.
        V_WO: Predicted angular velocity, and velocity of the origin, shape (6,).
    """

    status: TrackingStatus
    belief: PoseBelief
    R_WO: FloatArray = np.eye(3)
    p_WO: FloatArray = np.zeros(3)
    V_WO: FloatArray = np.zeros(6)


class PoseEstimator(LeafSystem):
    """Estimates pose and twist of the object O in the world W.

    .. pydrake_system::

        name: PoseEstimator
        input_ports:
        - X_WO_measured
        - measurement_time
        - V_WO_held
        - point_cloud
        - p_WT
        - touching
        output_ports:
        - X_WO_estimated
        - V_WO_estimated
        - p_WO_covariance
        - tracking_status
        - time_since_measurement
        - measurement_verdict
        - innovation_squared
        - camera_offset

    Port `X_WO_measured` accepts a `RigidTransform`, which is sampled once each period. A pose that
    is not finite, has an invalid rotation, or is beyond `FARTHEST` is refused. It need not be
    connected if `point_cloud` is.

    Port `measurement_time` (optional) accepts a vector of 1: the time at which the pose at
    `X_WO_measured`, or the points at `point_cloud`, were measured, in seconds; -inf before the
    first measurement. A time that was received before means that there is no new measurement. A
    measurement that is older than the newest one corrects the estimate for its own time and for all
    later times, if at most `late_measurements` used ones are newer; otherwise it is refused. If the
    port is unconnected, every sample is new and was measured at its tick.

    Port `V_WO_held` (optional) accepts a `SpatialVelocity`: that with which a hand moves O in W;
    not finite while no hand holds the object. A change of this velocity changes the estimated one
    by as much; measurements still correct it, and gravity no longer accelerates the object.
    Out-of-sequence measurements from before a change are refused. A velocity with a component
    beyond 100 rad/s or m/s (`FASTEST`) counts as no change.

    Port `point_cloud` (optional) accepts a `PointCloud` in W, in place of measured poses: points on
    the surface of the object. The pose predicted for their time is aligned to them (`align_pose`);
    a direction that they do not observe keeps its uncertainty. Points of other bodies hardly count.
    Without a pose to start from, at first and after a loss, they are registered (`register_pose`).

    Port `p_WT` (optional) accepts a vector of 3n: the centres in W of the n fingertips of
    `tip_radii`, in metres. With `object_solid`, and `touch` of `config`, fingertips measure the
    pose without the offset of cameras (`felt`).

    Port `touching` (optional) accepts a vector of n, above 0 for each fingertip that touches the
    object. One that touches it where it is expected keeps an object that the hand hides from
    becoming lost, for about 10 s after the last picture, or longer with `bias_std`: then the
    prediction is too vague. A lost object is found again by pictures only.

    Port `X_WO_estimated` emits a `RigidTransform`: the estimated pose.

    Port `V_WO_estimated` emits a `SpatialVelocity`: the velocity of O in W, expressed in W.

    Port `p_WO_covariance` emits a vector of 9: the covariance Sigma of the estimated p_WO in W,
    row-major, in m². It contains the spread of the means of the motion models. It grows while no
    measurement is used, but along the normals of present contacts; before the first one it is 1 m²
    per axis.

    Port `tracking_status` emits a vector of 1: a `TrackingStatus`. It is `TRACKING` if the newest
    measurements confirm the estimate; the error of the position is then within the covariance. It
    is `COASTING` while the newest measurement was refused as an outlier, is overdue, or is one of
    the first. A touch that is felt where it is expected does not change it to `TRACKING`, but keeps
    it from `LOST`. While it is `LOST`, the pose stays at its prediction for the moment of the loss
    and the twist is zero. It is also `LOST` if the prediction is beyond `FARTHEST`; the pose then
    stays at the newest one that was used. While it is `WAITING`, the pose is the identity.

    Port `time_since_measurement` emits a vector of 1: the age of the newest measurement that was
    used, in seconds; the Context's time if none was used yet.

    Port `measurement_verdict` emits a vector of 1: the `MeasurementVerdict` on the last tick's
    sample.

    Port `innovation_squared` emits a vector of 2: νᵀ S⁻¹ ν of the position and of the orientation
    for the last measurement that was compared with a prediction; that of the position is given the
    orientation. If the assumptions hold, each is chi-square distributed with 3 degrees of freedom.

    Port `camera_offset` emits a vector of 12: the estimated displacement of what sensors show, in
    W, in metres, and its covariance, row-major, in m². A direction in which nothing touches keeps
    the variance of `bias_std`. Zero without `bias_std`, and before the first measurement.

    An interacting-multiple-model filter estimates the position of the centre of mass, the
    orientation and the twist (`estimation.pose_filter`). Between ticks the outputs are predictions,
    whose covariance grows as that of the liveliest model. At a tick they are the posterior of that
    tick's measurement, both before and after the discrete update: the stored state carries its
    time, so no measurement is used twice.

    Args:
        config: Assumptions of the filter; `EstimatorConfig()` by default.
        period: Seconds between measurements, greater than zero.
        p_OCoM: The object's centre of mass in O, shape (3,), in metres; zero by default.
        object_solid: The object in O, for `point_cloud`; None without.
        tip_radii: Radii of the fingertips of `p_WT`, shape (n,), in metres; none by default.
        kernels: Implementation of the filter's steps; that of `default_kernels` by default.

    Raises:
        InvalidArgumentError: If an argument or a field of `config` is out of its range.
    """

    def __init__(
        self,
        config: EstimatorConfig | None = None,
        *,
        period: float,
        p_OCoM: FloatArray | None = None,
        object_solid: MeshSolid | None = None,
        tip_radii: FloatArray | None = None,
        kernels: Kernels | None = None,
    ) -> None:
        super().__init__()
        config = checked(config or EstimatorConfig())
        if not config.coast_after <= config.lost_after:
            raise InvalidArgumentError(
                f"coast_after must be at most lost_after, {config.lost_after} s, not"
                f" {config.coast_after}"
            )
        if not 0 < number_or_nan(period) < np.inf:
            raise InvalidArgumentError(f"period must be finite and above 0 s, not {period}")
        place = np.zeros(3) if p_OCoM is None else finite_vector(p_OCoM, 3)
        if place is None:
            raise InvalidArgumentError(f"p_OCoM must be three finite numbers, not {p_OCoM}")
        self._config, self._period, self._p_OCoM = config, period, place
        self._touch_noise = touch_noise(config.touch_std, period)
        settings = tracker_settings(config, place if np.any(place) else None)
        kernels = kernels or default_kernels()
        self._settings = replace(settings, step=kernels.filter_step)
        self._merged, self._noise = kernels.merged, settings.noise
        self._held_settings = replace(self._settings, noise=replace(self._noise, gravity=0.0))
        self._seen_object, self._flat_sides = None, list[FlatSide]()
        if object_solid is not None:
            if not isinstance(object_solid, MeshSolid):
                kind = type(object_solid).__name__
                raise InvalidArgumentError(f"object_solid must be a MeshSolid, not a {kind}")
            if config.rests_on_table:
                self._flat_sides = flat_sides(object_solid.corners, place)
            assumed = config.point_std, config.fewest_points, config.rests_on_table
            solid, align = object_solid, kernels.align_pose()
            self._seen_object = SeenObject(solid, self._noise, place, *assumed, align)
        # The track also holds the belief before the measurements that may be newer.
        models = len(self._noise.densities)
        offset = 3 if config.bias_std else 0
        self._no_track = PoseTrack.empty(config.late_measurements + 1, models, offset)
        self._unpack = unpacker(self._no_track)
        self._time_index = self.DeclareDiscreteState(np.array([-np.inf]))
        self._track_index = self.DeclareDiscreteState(pack(self._no_track))
        self._X_WO_measured = self.DeclareAbstractInputPort("X_WO_measured", POSE)
        self._measurement_time = self.DeclareVectorInputPort("measurement_time", 1)
        self._V_WO_held = self.DeclareAbstractInputPort("V_WO_held", VELOCITY)
        self._point_cloud = self.DeclareAbstractInputPort("point_cloud", CLOUD)
        self._tip_radii = np.zeros(0) if tip_radii is None else tip_radii
        sizes = {"p_WT": 3 * len(self._tip_radii), "touching": len(self._tip_radii)}
        self._tips = [self.DeclareVectorInputPort(name, size) for name, size in sizes.items()]
        self._declare_results()
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._store_track)

    def _declare_results(self) -> None:
        """Declares the cache entries of an estimate, and the ports that emit it."""
        cache, output = partial(declare_cache, self), partial(declare_output, self)
        time = self.time_ticket()
        index, merged = self._track_index, self._merged
        self._stored = stored = cache(
            "track of the last update",
            self._no_track,
            lambda c: self._unpack(c.get_discrete_state(index).value()),
            self.discrete_state_ticket(index),
        )
        words = "mixture of the models at the newest measurement of that track"
        self._mixture = cache(words, no_belief(), lambda c: merged(stored.Eval(c).newest), stored)
        words = "track after the measurement of the Context's last tick, and its mixture"
        model, state = (self._no_track, no_belief()), self.xd_ticket()
        sensors = (self._X_WO_measured, self._measurement_time, self._V_WO_held, self._point_cloud)
        self._measured_track = measured = cache(
            words, model, self._calc_track, state, time, *sensors
        )
        self._track = track = measured
        if self._seen_object is not None:
            words = "the same track after the contacts of that tick"
            tips = self._tips if self._config.touch else []
            sources = (state, time, measured, self._V_WO_held, *tips)
            self._track = track = cache(words, model, self._calc_felt, *sources)
        words = "status, and mean of the prediction for the Context's time"
        first = _Estimate(TrackingStatus.WAITING, no_belief())
        self._estimate = estimate = cache(
            words, first, self._calc_estimate, time, track, self._V_WO_held
        )
        output("X_WO_estimated", POSE, self._calc_pose, estimate)
        output("V_WO_estimated", VELOCITY, self._calc_velocity, estimate)
        output("p_WO_covariance", 9, self._calc_covariance, time, estimate)
        output("tracking_status", 1, lambda c: estimate.Eval(c).status.value, estimate)
        output("time_since_measurement", 1, self._calc_age, time, measured)
        output("measurement_verdict", 1, lambda c: measured.Eval(c)[0].verdict.value, measured)
        output("innovation_squared", 2, lambda c: measured.Eval(c)[0].innovation_squared, measured)
        offset_source = track if self._config.bias_std else self.nothing_ticket()
        output("camera_offset", 12, self._calc_offset, offset_source)

    def _calc_track(self, context: Context) -> tuple[PoseTrack, PoseBelief]:
        time = context.get_time()
        stored_time = context.get_discrete_state(self._time_index)[0]
        track: PoseTrack = self._stored.Eval(context)
        if tick_index(time, self._period) == tick_index(stored_time, self._period):
            return track, self._mixture.Eval(context)
        if stored_time > time:  # The clock was set back.
            track = self._no_track
        if self._V_WO_held.HasValue(context):
            V_held = self._twist(context, self._merged(track.newest), track.V_held)
            track = track.with_twist(V_held, time - self._period / 2)
        settings = self._settings_of(context) if self._noise.gravity else self._settings
        track = update_track(track, self._measured(context, track), time, settings)
        return track, self._merged(track.newest)

    def _calc_felt(self, context: Context) -> tuple[PoseTrack, PoseBelief]:
        time = context.get_time()
        track, belief = self._measured_track.Eval(context)
        stored_time = context.get_discrete_state(self._time_index)[0]
        is_stored = tick_index(time, self._period) == tick_index(stored_time, self._period)
        if is_stored or self._status(track, time) not in FOLLOWED:
            return track, belief
        contacts = self._contacts(context)
        dt = max(0.0, time - belief.time)
        assumed = self._settings_of(context).noise, self._merged
        belief, confirms = felt(track.newest, dt, contacts, *assumed)
        track = track.with_newest(belief, confirmed_at=time if confirms else track.confirmed_at)
        return track, self._merged(belief)

    def _contacts(self, context: Context) -> Contacts:
        """Returns the present contacts of the object: fingertips, and the table."""
        assert self._seen_object is not None
        rests = self._config.rests_on_table and not self._is_held(context)
        touches, solid = self._touching(context), self._seen_object.solid
        return Contacts(solid, self._p_OCoM, touches, rests, *self._touch_noise, self._flat_sides)

    def _measured(self, context: Context, track: PoseTrack) -> PoseMeasurement:
        """Returns what the input ports measure at a tick."""
        measured_at = context.get_time()
        if self._measurement_time.HasValue(context):
            measured_at = float(self._measurement_time.Eval(context)[0])
        if self._point_cloud.HasValue(context):
            return self._seen(context, track, measured_at)
        X_WO: RigidTransform = self._X_WO_measured.Eval(context)
        return PoseMeasurement(measured_at, X_WO.translation().copy(), X_WO.rotation().matrix())

    def _seen(self, context: Context, track: PoseTrack, measured_at: float) -> PoseMeasurement:
        """Returns the part of a pose that points of the surface measure."""
        now = context.get_time()
        if not now - OLDEST <= measured_at <= now + self._period:  # The tracker refuses it.
            return replace(NO_MEASUREMENT, time=measured_at)
        if measured_at == track.last_seen[0]:
            return NO_MEASUREMENT
        if self._seen_object is None:
            raise InvalidArgumentError("port point_cloud needs the argument object_solid")
        before, is_followed = track.before(measured_at), self._status(track, now) in FOLLOWED
        belief = self._merged(before) if before.time > -np.inf else None
        p_WQ = points_in(self._point_cloud.Eval(context))
        seen = replace(self._seen_object, noise=self._settings_of(context).noise)
        return seen.measured(p_WQ, measured_at, belief, is_followed=is_followed)

    def _settings_of(self, context: Context) -> TrackerSettings:
        """Returns the settings of the checks: what a hand holds does not fall."""
        return self._held_settings if self._is_held(context) else self._settings

    def _status(self, track: PoseTrack, time: float) -> TrackingStatus:
        config = self._config
        return track.status(time, self._period, config.coast_after, config.lost_after)

    def _twist(self, context: Context, belief: PoseBelief, before: FloatArray) -> FloatArray:
        """Returns the present twist of the held object, at its centre of mass, or NaN.

        One that is beyond `FASTEST` is taken for that of the last tick.
        """
        V_WO: FloatArray = self._V_WO_held.Eval(context).get_coeffs()
        if not are_valid(V_WO):
            return _UNKNOWN
        if np.abs(V_WO).max() > FASTEST:
            return before
        w_WO, v_WO = V_WO.reshape(2, 3)
        return np.append(w_WO, v_WO + skew(w_WO) @ (belief.R_WO[0] @ self._p_OCoM))

    def _store_track(self, context: Context, discrete_state: DiscreteValues) -> None:
        discrete_state.set_value(self._time_index, [context.get_time()])
        track, _ = self._track.Eval(context)
        discrete_state.set_value(self._track_index, pack(track))

    def _calc_estimate(self, context: Context) -> _Estimate:
        track, belief = self._track.Eval(context)
        time, config = context.get_time(), self._config
        status = self._status(track, time)
        if status == TrackingStatus.WAITING:
            return _Estimate(status, belief)
        since = time - belief.time
        if self._V_WO_held.HasValue(context):
            dV = self._twist(context, belief, track.V_held) - track.V_held
            if not np.isnan(dV.sum()):
                last_tick = self._period * tick_index(time, self._period)
                belief = boosted(belief, dV, (last_tick + time) / 2)
        if status == TrackingStatus.LOST:  # The pose stays where it was lost.
            since = track.confirmed_at + self._period + config.lost_after - belief.time
        gravity = 0.0 if self._is_held(context) else self._noise.gravity
        R_WO, p_WCoM, V_WO = predicted_mean(belief, self._ahead(since), gravity)
        p_CoMO_W = -R_WO @ self._p_OCoM
        if not max(np.abs(p_WCoM + p_CoMO_W).max(), np.abs(V_WO).max()) <= FARTHEST:
            status, R_WO, p_WCoM = TrackingStatus.LOST, belief.R_WO[0], belief.p_WCoM[0]
            p_CoMO_W = -R_WO @ self._p_OCoM
        if status == TrackingStatus.LOST:  # The centre of mass is valid, but the origin may not be.
            p_WO = (p_WCoM + p_CoMO_W).clip(-FARTHEST, FARTHEST)
            return _Estimate(status, belief, R_WO, p_WO)
        V_WO[3:] += skew(V_WO[:3]) @ p_CoMO_W
        return _Estimate(status, belief, R_WO, p_WCoM + p_CoMO_W, V_WO)

    def _ahead(self, since: float) -> float:
        """Returns the length of a prediction after a time, with the look-ahead, in seconds."""
        return min(max(0.0, since), OLDEST) + self._config.lookahead

    def _calc_pose(self, context: Context) -> RigidTransform:
        _, _, R_WO, p_WO, _ = self._estimate.Eval(context)
        return RigidTransform(RotationMatrix.ProjectToRotationMatrix(R_WO), p_WO)

    def _calc_offset(self, context: Context) -> FloatArray:
        if not self._config.bias_std:
            return np.zeros(12)
        _, belief = self._track.Eval(context)
        return np.concatenate([belief.b_W, belief.P[0, 12:, 12:]], axis=None)

    def _touching(self, context: Context) -> SurfacePoints:
        """Returns the fingertips: those that do not touch the surface are outside."""
        if not (self._config.touch and all(port.HasValue(context) for port in self._tips)):
            return SurfacePoints.seen(np.zeros((0, 3)), 0.0)
        p_WT, touching = (port.Eval(context) for port in self._tips)
        p_WT, std = p_WT.reshape(-1, 3), np.full(len(touching), self._touch_noise[0])
        tips = SurfacePoints(p_WT, self._tip_radii, std, touching <= 0)
        return tips.chosen(are_valid_points(p_WT) & np.isfinite(touching))

    def _is_held(self, context: Context) -> bool:
        port = self._V_WO_held
        return port.HasValue(context) and are_valid(port.Eval(context).get_coeffs())

    def _calc_velocity(self, context: Context) -> SpatialVelocity:
        return SpatialVelocity(self._estimate.Eval(context).V_WO)

    def _calc_covariance(self, context: Context) -> FloatArray:
        status, belief, R_WO, p_WO, _ = self._estimate.Eval(context)
        if status == TrackingStatus.WAITING:
            return WAITING_STD**2 * np.eye(3)
        # The pose of a lost object stays, but its uncertainty grows on.
        ahead = self._ahead(context.get_time() - belief.time)
        predicted = predict(belief, ahead, self._noise.liveliest)
        if self._seen_object is not None and status in FOLLOWED and not self._config.lookahead:
            p_WCoM = p_WO + R_WO @ self._p_OCoM
            predicted = conditioned(predicted, self._contacts(context), R_WO, p_WCoM)
        return origin_covariance(predicted, self._settings.p_OCoM)

    def _calc_age(self, context: Context) -> float:
        newest = self._measured_track.Eval(context)[0].steps[-1, 0]
        return float(max(0.0, context.get_time() - (newest if newest > -np.inf else 0.0)))
