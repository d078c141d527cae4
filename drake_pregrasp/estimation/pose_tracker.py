"""Tracks a moving object by pose measurements that may be delayed, lost, repeated or wrong.

The pose filter estimates the pose; the tracker decides which measurements the filter uses. The
state of the tracker is a `PoseTrack`, which `update_track` updates at each tick.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from drake_pregrasp.arrays import BoolArray, is_valid_pose, pack
from drake_pregrasp.estimation.manoeuvres import MANOEUVRE_GATE, find_manoeuvre
from drake_pregrasp.estimation.pose_filter import (
    NO_BELIEF,
    Innovation,
    PoseBelief,
    PoseMeasurement,
    corrected,
    first_belief,
    innovation,
    two_point_belief,
)
from drake_pregrasp.estimation.pose_track import (
    MEASUREMENT_SIZE,
    NO_ALTERNATIVE,
    MeasurementVerdict,
    PoseTrack,
    TrackerSettings,
    unpack_belief,
    unpack_measurement,
)

OLDEST = 1e6
"""Largest age of a valid measurement, and longest prediction, in seconds."""

_SLACK = 1e-6  # Seconds by which rounding may put a time ahead of the clock.
_FORGETTING = 0.05  # Share of the newest innovation in the running means.
_LARGEST_EXCESS = 9.0  # Largest excess of a single innovation: it may be an outlier.
_TOLERATED_EXCESS = 2.0  # Excess of the innovations' variance that may be chance.
_VAGUE = 1.0  # Radians; a larger deviation is beyond the linearisation of the correction.
_NOISY = 0.25  # Noise level of a sensor without noise is below this.
_DOUBT = 2  # Times `reacquire_after`: with so many outliers in excess the track is not locked.
_PATIENCE = 5  # Times `reacquire_after`: with so many outliers in excess the belief is dropped.
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
    time, noise, last_seen = measurement.time, settings.noise, track.recent[-1, :MEASUREMENT_SIZE]
    is_late = time <= track.steps[-1, 0]
    is_known = time == last_seen[0] or (is_late and np.any(track.steps[:, 0] == time))
    if time == -math.inf or is_known:
        return replace(track, verdict=MeasurementVerdict.NOTHING_NEW)
    is_recent = now - OLDEST <= time <= now + _SLACK
    X = np.concatenate([measurement.R_WO, measurement.p_WCoM[:, None]], axis=1)
    if not (is_recent and is_valid_pose(X)):
        return replace(track, verdict=MeasurementVerdict.UNUSABLE)
    recent = np.concatenate([track.recent[1:], track.recent[:1]])
    seen = recent[-1, :MEASUREMENT_SIZE]
    seen[:], recent[-1, MEASUREMENT_SIZE:] = pack(measurement), 0.0
    track, newest = replace(track, recent=recent), track.newest
    if time - newest.time > OLDEST:  # Also without a belief, whose time is -inf.
        return _start(track, measurement, settings)
    is_suspect = settings.refuse_repeats and track.noise_level > _NOISY
    if is_suspect and (seen[1:] == last_seen[1:]).all() and _moves(newest):
        return replace(track, verdict=MeasurementVerdict.REPEATED)
    earlier = newest
    if is_late:
        before = track.steps[track.steps[:, 0] < time]
        if len(before) == 0 or before[-1, 0] == -math.inf:
            return replace(track, verdict=MeasurementVerdict.TOO_LATE)
        earlier = unpack_belief(before[-1, MEASUREMENT_SIZE:])
    factor = track.noise_factor
    prior, new, posterior = settings.step(earlier, measurement, noise, settings.p_OCoM, factor)
    variance = max(prior.P_orientation.diagonal()[:3].tolist())
    if variance > _VAGUE**2 + noise.orientation**2 and not is_late:
        return _start(track, measurement, settings, prior)
    largest = max(new.squared.tolist())
    is_expected = largest <= settings.first_gate_squared
    is_expected = is_expected or bool((new.squared <= settings.gates_squared(earlier)).all())
    steps = np.concatenate([seen, pack(posterior)])[None]
    recent[-1, MEASUREMENT_SIZE:] = new.squared
    exceeds_gate = (
        settings.gate > 0 and track.is_locked and not is_late and largest > MANOEUVRE_GATE**2
    )
    if exceeds_gate and (manoeuvre := find_manoeuvre(track, new, not is_expected, settings)):
        steps, new, is_expected = manoeuvre.steps(), manoeuvre.last, True
        recent[-len(steps) :, MEASUREMENT_SIZE:] = manoeuvre.squared
        track = replace(track, support=0)
    excess = min(sum((factor * new.squared).tolist()) / 6, _LARGEST_EXCESS)
    excess = (1 - _FORGETTING) * track.excess + _FORGETTING * excess
    statistics: dict[str, Any] = {
        "excess": excess,
        "noise_factor": excess if excess > _TOLERATED_EXCESS else 1.0,
        "innovation_squared": new.squared,
    }
    if is_late:
        after = replace(track, **statistics)
        if not is_expected:
            return replace(after, verdict=MeasurementVerdict.OUTLIER)
        return _insert(track, after, posterior, settings)
    alternative, support = NO_ALTERNATIVE, 0
    if not is_expected or (track.support and not track.is_locked):
        rival, support, is_better = _next_alternative(track, prior, new, measurement, settings)
        if is_better or not is_expected:
            confirmed = track.confirmed if is_expected else 0
            after = replace(track, **statistics, confirmed=confirmed)
            return _refuse(after, rival, support, measurement, settings)
        alternative = pack(rival)
    before = track.steps
    if len(steps) > 1:  # Those of a manoeuvre replace earlier ones.
        before = before[: np.searchsorted(before[:, 0], steps[0, 0])]
    # With noise, successive innovations differ, with the covariance 2 S. With a motion that the
    # filter does not expect, they are similar.
    change = new.nu - track.last_innovation
    trace = new.S[:, 0, 0] + new.S[:, 1, 1] + new.S[:, 2, 2]
    level = min(1.0, sum((np.add.reduce(change * change, axis=1) / trace).tolist()) / 4)
    confirmed = track.confirmed + 1
    refused = 0 if confirmed >= settings.reacquire_after else max(0, track.refused - 1)
    after = replace(
        track,
        **statistics,
        steps=np.concatenate([before, steps])[-len(track.steps) :],
        alternative=alternative,
        support=support,
        refused=refused,
        confirmed=confirmed,
        is_locked=track.is_locked or refused == 0,
        last_innovation=new.nu,
        noise_level=(1 - _FORGETTING) * track.noise_level + _FORGETTING * level,
        verdict=MeasurementVerdict.USED,
    )
    if len(steps) == 1:
        vars(after)["newest"] = posterior  # Fills the cached property.
    return after


def _moves(belief: PoseBelief) -> bool:
    rates = ((belief.v_WCoM, belief.P_position), (belief.w_WO, belief.P_orientation))
    return any(rate @ np.linalg.solve(P[3:, 3:], rate) > _AT_REST**2 for rate, P in rates)


def _begin(
    track: PoseTrack, belief: PoseBelief, verdict: MeasurementVerdict, is_locked: bool
) -> PoseTrack:
    """Returns a track with one step, of the last measurement and the belief after it."""
    steps = PoseTrack.empty(len(track.steps)).steps
    steps[-1] = np.concatenate([track.last_seen, pack(belief)])
    return replace(
        track,
        steps=steps,
        alternative=NO_ALTERNATIVE,
        support=0,
        refused=0,
        confirmed=0,
        is_locked=is_locked,
        verdict=verdict,
    )


def _start(
    track: PoseTrack,
    measurement: PoseMeasurement,
    settings: TrackerSettings,
    prior: PoseBelief = NO_BELIEF,
) -> PoseTrack:
    """Returns the track that starts from a measurement.

    If the prior's orientation is too uncertain after a single measurement, only the initial
    uncertainty of the velocities causes that. The orientation then starts from both measurements.
    """
    belief = first_belief(measurement, settings.noise, settings.p_OCoM)
    if prior.time > -math.inf and np.sum(track.steps[:, 0] > -np.inf) == 1:
        new = innovation(prior, measurement, settings.noise, settings.p_OCoM)
        is_expected = np.array([new.squared[0] <= settings.gate_squared, False])
        fresh = two_point_belief(track.newest, measurement, settings.noise, settings.p_OCoM)
        belief = _combined(corrected(prior, new), fresh, is_expected)
    is_first = track.newest.time == -math.inf
    return _begin(track, belief, MeasurementVerdict.STARTED, is_first)


def _insert(
    track: PoseTrack, after: PoseTrack, belief: PoseBelief, settings: TrackerSettings
) -> PoseTrack:
    """Returns the track with the last measurement inserted, and the later ones applied again.

    Args:
        track: Track before the measurement, with the measurement as the last one seen.
        after: The same track with new statistics of the innovations.
        belief: Belief after the measurement.
        settings: Settings of the checks.
    """
    is_later = track.steps[:, 0] > belief.time
    rows = [np.concatenate([track.last_seen, pack(belief)])]
    for seen in track.steps[is_later, :MEASUREMENT_SIZE]:
        later = unpack_measurement(seen)
        _, _, belief = settings.step(
            belief, later, settings.noise, settings.p_OCoM, track.noise_factor
        )
        rows.append(np.concatenate([seen, pack(belief)]))
    steps = np.vstack([track.steps[~is_later], *rows])[1:]
    return replace(after, steps=steps, verdict=MeasurementVerdict.USED_LATE)


def _next_alternative(
    track: PoseTrack,
    prior: PoseBelief,
    new: Innovation,
    measurement: PoseMeasurement,
    settings: TrackerSettings,
) -> tuple[PoseBelief, int, bool]:
    """Returns the alternative hypothesis after a measurement, and its support.

    In the first alternative, the object has jumped and keeps its twist. If the next measurement
    contradicts this, the twist starts from the difference of the last two poses: if one part has
    changed its velocity, the other one may have, too. Any two poses agree with some twist, so later
    measurements must confirm it.

    The last value is whether the alternative explains the measurement better than the belief does:
    by chance, a fast rotation repeatedly comes close to the belief's orientation.
    """
    noise, p_OCoM = settings.noise, settings.p_OCoM
    earlier = unpack_belief(track.alternative)
    if not -math.inf < earlier.time < measurement.time:
        return _jumped(prior, first_belief(measurement, noise, p_OCoM)), 1, False
    _, other, posterior = settings.step(earlier, measurement, noise, p_OCoM, track.noise_factor)
    is_expected = other.squared <= settings.gates_squared(earlier)
    if not np.all(is_expected):
        return two_point_belief(earlier, measurement, noise, p_OCoM), 1, False
    # Minus twice the logarithm of the likelihood, but for a constant.
    cost, cost_of_other = (
        np.sum(i.squared) + np.sum(np.linalg.slogdet(i.S)[1]) for i in (new, other)
    )
    return posterior, track.support + 1, bool(cost_of_other < cost)


def _refuse(
    track: PoseTrack,
    alternative: PoseBelief,
    support: int,
    measurement: PoseMeasurement,
    settings: TrackerSettings,
) -> PoseTrack:
    """Returns the track after an outlier; it continues from an alternative with enough support.

    After too many outliers without such an alternative, the belief starts anew.
    """
    if support >= settings.reacquire_after:
        return _begin(track, alternative, MeasurementVerdict.REACQUIRED, support > 1)
    refused, newest = track.refused + 1, track.newest
    is_at_rest = not (np.any(newest.v_WCoM) or np.any(newest.w_WO))  # As before any update.
    is_doubtful = is_at_rest or refused >= _DOUBT * settings.reacquire_after
    if refused >= _PATIENCE * settings.reacquire_after:
        return _start(track, measurement, settings)
    return replace(
        track,
        alternative=pack(alternative),
        support=support,
        refused=refused,
        is_locked=track.is_locked and not is_doubtful,
        verdict=MeasurementVerdict.OUTLIER,
    )


def _combined(first: PoseBelief, second: PoseBelief, is_first: BoolArray) -> PoseBelief:
    """Returns a belief with the position of one of two beliefs, and the orientation of one."""
    position, orientation = (first if mine else second for mine in is_first)
    return replace(
        position,
        R_WO=orientation.R_WO,
        w_WO=orientation.w_WO,
        P_orientation=orientation.P_orientation,
    )


def _jumped(prior: PoseBelief, fresh: PoseBelief) -> PoseBelief:
    """Returns the pose of a fresh belief with the velocities of a prior."""
    P_position, P_orientation = fresh.P_position.copy(), fresh.P_orientation.copy()
    P_position[3:, 3:] = prior.P_position[3:, 3:]
    P_orientation[3:, 3:] = prior.P_orientation[3:, 3:]
    return replace(
        fresh,
        v_WCoM=prior.v_WCoM,
        w_WO=prior.w_WO,
        P_position=P_position,
        P_orientation=P_orientation,
    )
