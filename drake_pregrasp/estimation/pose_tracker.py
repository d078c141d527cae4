"""Tracks a moving object by pose measurements that may be delayed, lost, repeated or wrong.

The pose filter estimates the pose; the tracker decides which measurements the filter uses. The
state of the tracker is a `PoseTrack`, which `update_track` updates at each tick.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from drake_pregrasp.arrays import FloatArray, is_valid_pose, pack
from drake_pregrasp.estimation.noise_estimate import POSES
from drake_pregrasp.estimation.pose_belief import PoseBelief, PoseMeasurement, first_belief
from drake_pregrasp.estimation.pose_filter import Correction, shown_covariance
from drake_pregrasp.estimation.pose_track import (
    CONFIRMATIONS,
    MEASUREMENT_SIZE,
    SUPPORT,
    MeasurementVerdict,
    PoseTrack,
    TrackerSettings,
    unpack_belief,
    unpack_measurement,
)
from drake_pregrasp.geometry.rotations import rotation_matrix

OLDEST = 1e6
"""Largest age of a valid measurement, and longest prediction, in seconds."""

_SLACK = 1e-6  # Seconds by which rounding may put a time ahead of the clock.
_SILENCE = 100.0  # Seconds without a measurement after which rounding would spoil a correction.
_VAGUE = np.diag(np.repeat(np.square([0.1, 0.03]), 3))  # Of a pose that an outlier may confirm.
_NOISY = 0.25  # Variance over the assumed one; that of a sensor without noise is below this.
_UNLIKELY = 0.1  # Weight of the models that explain a measurement below which it may be an outlier.
_AT_REST = 3.0  # Standard deviations up to which a velocity may be zero.


def update_track(
    track: PoseTrack, measurement: PoseMeasurement, now: float, settings: TrackerSettings
) -> PoseTrack:
    """Returns the track after the sensor's output at a tick.

    A measurement applies to its own time. An out-of-sequence measurement, which is older than the
    newest one that was used, corrects the belief of its own time; the later ones are then applied
    again.

    Args:
        track: State of the tracker before the tick.
        measurement: Output of the sensor; it is not new if its time is that of an earlier one.
        now: Time of the tick, in seconds.
        settings: Settings of the checks.
    """
    time, newest_time = measurement.time, track.steps[-1, 0]
    is_late = time <= newest_time
    is_known = time == track.last_seen[0] or (is_late and np.any(track.steps[:, 0] == time))
    if time == -math.inf or is_known:
        return replace(track, verdict=MeasurementVerdict.NOTHING_NEW)
    is_recent = now - OLDEST <= time <= now + _SLACK
    X = np.concatenate([measurement.R_WO, measurement.p_WO[:, None]], axis=1)
    if not (is_recent and is_valid_pose(X)):
        last_seen = track.last_seen.copy()
        if is_recent:  # Its time is known from now on.
            last_seen[0] = max(last_seen[0], time)
        return replace(track, last_seen=last_seen, verdict=MeasurementVerdict.UNUSABLE)
    seen = pack(measurement)
    if time - newest_time > _SILENCE:  # Also without a belief, whose time is -inf.
        return _begun(track, seen, measurement, settings)
    if (
        (seen[1:] == track.last_seen[1:]).all()
        and (track.noise.ratios > _NOISY).all()
        and _moves(track.newest)
    ):
        return replace(track, last_seen=seen, verdict=MeasurementVerdict.REPEATED)
    earlier = track.newest
    if is_late:
        before = track.steps[track.steps[:, 0] < time]
        if time <= track.begun_at or not len(before):
            return replace(track, last_seen=seen, verdict=MeasurementVerdict.TOO_LATE)
        if before[-1, 0] == -math.inf:  # Older than the first one.
            first = _first(track, measurement, settings)
            return replace(track, last_seen=seen, **_inserted(track, seen, first, 0, settings))
        earlier = unpack_belief(before[-1, MEASUREMENT_SIZE:])
    measurement = _equivalent(earlier, measurement, settings)
    prior, new = _step(earlier, measurement, settings, track)
    is_vague = _is_vague(prior, new, measurement)
    explains = _explains(new, settings)
    is_used = bool(explains.any())
    is_doubted = is_used and track.confirmations == CONFIRMATIONS
    is_doubted = is_doubted and not is_late and prior.weights[explains].sum() < _UNLIKELY
    changes: dict[str, Any] = {"last_seen": seen, "innovation_squared": _innovation_squared(new)}
    if is_late and is_used:
        confirmations = _confirmed(0, is_vague)
        changes |= _inserted(track, seen, new.belief, confirmations, settings)
    elif is_late:
        changes["verdict"] = MeasurementVerdict.OUTLIER
    elif is_doubted:
        changes |= _doubted(track, measurement, new.belief, settings)
    elif is_used:
        confirmations = _confirmed(track.confirmations, is_vague)
        changes |= _used(track, measurement, new.belief, confirmations, settings)
    else:
        changes |= _refused(track, seen, measurement, settings)
    return replace(track, **changes)


def _begun(
    track: PoseTrack, seen: FloatArray, measurement: PoseMeasurement, settings: TrackerSettings
) -> PoseTrack:
    belief = _first(track, measurement, settings)
    is_first = track.steps[-1, 0] == -math.inf
    return replace(
        track,
        last_seen=seen,
        **_restarted(track, seen, belief, 0),
        begun_at=-math.inf if is_first else belief.time,
        confirmed_at=belief.time if is_first else track.confirmed_at,
        verdict=MeasurementVerdict.STARTED,
    )


def _first(track: PoseTrack, measurement: PoseMeasurement, settings: TrackerSettings) -> PoseBelief:
    """Returns a belief that does not continue the one before, but for the offset of the sensor."""
    return first_belief(measurement, settings.noise, settings.p_OCoM, track.newest)


def _restarted(
    track: PoseTrack, seen: FloatArray, belief: PoseBelief, confirmations: int
) -> dict[str, Any]:
    """Returns what a belief changes that does not continue the one before."""
    steps = np.full_like(track.steps, -np.inf)
    steps[-1] = np.concatenate([seen, pack(belief)])
    return {
        "steps": steps,
        "alternative": track.none,
        "support": 0,
        "refused": 0,
        "confirmations": confirmations,
    }


def _used(
    track: PoseTrack,
    measurement: PoseMeasurement,
    belief: PoseBelief,
    confirmations: int,
    settings: TrackerSettings,
) -> dict[str, Any]:
    """Returns what a measurement changes that continues the newest belief."""
    before = unpack_measurement(track.steps[-1, :MEASUREMENT_SIZE])
    row = np.concatenate([pack(measurement), pack(belief)])[None]
    return {
        "steps": np.concatenate([track.steps[1:], row]),
        "alternative": track.none,
        "support": 0,
        "refused": 0,
        "confirmations": confirmations,
        "confirmed_at": max(track.confirmed_at, belief.time)  # A touch may be newer.
        if confirmations == CONFIRMATIONS
        else track.confirmed_at,
        "noise": track.noise.updated(before, measurement, settings.noise.variances),
        "verdict": MeasurementVerdict.USED,
    }


def _doubted(
    track: PoseTrack, measurement: PoseMeasurement, belief: PoseBelief, settings: TrackerSettings
) -> dict[str, Any]:
    """Returns what a measurement changes that only an unlikely model explains.

    It may be an outlier or the start of a manoeuvre, so that it waits for the next one as the
    alternative hypothesis. If the next one agrees with it, both are used.
    """
    if track.alternative[0] == -math.inf:
        return _waiting(track, belief, SUPPORT - 1)
    earlier = unpack_belief(track.alternative)
    if not track.last_seen[0] == earlier.time < measurement.time:
        return _used(track, measurement, belief, CONFIRMATIONS, settings)
    second = _equivalent(earlier, measurement, settings)
    prior, new = _step(earlier, second, settings, track)
    if not _explains(new, settings).any():
        return _waiting(track, belief, SUPPORT - 1)
    first = _equivalent(track.newest, unpack_measurement(track.last_seen), settings)
    between = replace(track, **_used(track, first, earlier, 1, settings))
    confirmations = _confirmed(1, _is_vague(prior, new, second))
    return _used(between, second, new.belief, confirmations, settings)


def _waiting(track: PoseTrack, belief: PoseBelief, support: int) -> dict[str, Any]:
    """Returns what a refused measurement changes that may begin something new."""
    return {
        "alternative": pack(belief),
        "support": support,
        "refused": track.refused + 1,
        "verdict": MeasurementVerdict.OUTLIER,
    }


def _explains(new: Correction, settings: TrackerSettings) -> np.typing.NDArray[np.bool_]:
    """Returns which models explain a measurement, shape (K,)."""
    return np.asarray(np.add.reduce(new.squares, axis=1) <= settings.gate_squared)


def _equivalent(
    earlier: PoseBelief, measurement: PoseMeasurement, settings: TrackerSettings
) -> PoseMeasurement:
    """Returns the equivalent measured pose that is nearest to the prediction."""
    if len(settings.symmetry) == 1:
        return measurement
    k, dt = earlier.weights.argmax(), measurement.time - earlier.time
    R_WO = rotation_matrix(earlier.V_WCoM[k, :3] * dt) @ earlier.R_WO[k]
    equivalent = measurement.R_WO @ settings.symmetry
    nearest = np.einsum("ij,sij->s", R_WO, equivalent).argmax()  # The largest traces.
    return replace(measurement, R_WO=equivalent[nearest])


def _step(
    earlier: PoseBelief, measurement: PoseMeasurement, settings: TrackerSettings, track: PoseTrack
) -> tuple[PoseBelief, Correction]:
    """Returns the prior and its correction, with the noise that was estimated."""
    return settings.step(earlier, measurement, settings.noise, settings.p_OCoM, track.noise.factors)


def _is_vague(prior: PoseBelief, new: Correction, measurement: PoseMeasurement) -> bool:
    """Returns whether a prediction is so uncertain that an outlier agrees with it by chance.

    Its covariance is the mean of those of the models, weighed by how well they explain the
    measurement: if only a lively model does, the prediction was as uncertain as that one says. Only
    directions that were measured count.
    """
    P = np.add.reduce(new.belief.weights[:, None, None] * shown_covariance(prior), axis=0)
    Z = measurement.directions
    excess: FloatArray = np.add.reduce(Z @ (P - _VAGUE) * Z, axis=1)
    return not (excess <= 0).all()


def _confirmed(confirmations: int, is_vague: bool) -> int:
    """Returns the number of confirmations after a prediction that agrees with a measurement.

    Args:
        confirmations: Number before.
        is_vague: Whether it may agree by chance.
    """
    return 0 if is_vague else min(confirmations + 1, CONFIRMATIONS)


def _innovation_squared(new: Correction) -> FloatArray:
    squares = (new.belief.weights @ new.squares).tolist()
    return np.array([sum(squares[3:]), sum(squares[:3])])


def _moves(belief: PoseBelief) -> bool:
    k = belief.weights.argmax()
    V, P = belief.V_WCoM[k], belief.P[k, 6:, 6:]
    parts = (slice(3), slice(3, 6))
    return any(V[i] @ np.linalg.solve(P[i, i], V[i]) > _AT_REST**2 for i in parts)


def _inserted(
    track: PoseTrack,
    seen: FloatArray,
    belief: PoseBelief,
    confirmations: int,
    settings: TrackerSettings,
) -> dict[str, Any]:
    """Returns what an out-of-sequence measurement changes: the later ones are applied again.

    Args:
        track: Track before the measurement.
        seen: The measurement in a vector.
        belief: Belief after the measurement.
        confirmations: Number of confirmations by the measurement, 0 or 1.
        settings: Settings of the checks.
    """
    is_later = track.steps[:, 0] > belief.time
    rows = [np.concatenate([seen, pack(belief)])]
    for later in track.steps[is_later, :MEASUREMENT_SIZE]:
        measurement = _equivalent(belief, unpack_measurement(later), settings)
        prior, new = _step(belief, measurement, settings, track)
        confirmations = _confirmed(confirmations, _is_vague(prior, new, measurement))
        belief = new.belief
        rows.append(np.concatenate([later, pack(belief)]))
    confirmations = max(confirmations, track.confirmations)
    steps = np.vstack([track.steps[~is_later], *rows])[1:]
    newest = steps[-POSES:, :MEASUREMENT_SIZE]
    measurements = [unpack_measurement(row) for row in newest if row[0] > -np.inf]
    return {
        "steps": steps,
        "noise": track.noise.replayed(measurements, settings.noise.variances),
        "confirmations": confirmations,
        "confirmed_at": max(track.confirmed_at, belief.time)  # A touch may be newer.
        if confirmations == CONFIRMATIONS
        else track.confirmed_at,
        "verdict": MeasurementVerdict.USED_LATE,
    }


def _refused(
    track: PoseTrack, seen: FloatArray, measurement: PoseMeasurement, settings: TrackerSettings
) -> dict[str, Any]:
    """Returns what an outlier changes: the track continues from an alternative with enough support.

    The alternative hypothesis starts from an outlier with an unknown twist, and outliers that agree
    with it continue it.
    """
    belief, support = _first(track, measurement, settings), 1
    if -math.inf < track.alternative[0] < measurement.time:
        earlier = unpack_belief(track.alternative)
        measurement = _equivalent(earlier, measurement, settings)
        _, new = _step(earlier, measurement, settings, track)
        if _explains(new, settings).any():
            belief, support = new.belief, track.support + 1
    if support < SUPPORT:
        return _waiting(track, belief, support)
    return {
        **_restarted(track, seen, belief, 1),
        "begun_at": belief.time,
        "verdict": MeasurementVerdict.REACQUIRED,
    }
