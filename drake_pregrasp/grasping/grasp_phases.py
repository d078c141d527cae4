"""State machine of a grasp: approach, track, close until touch, squeeze, lift, hold, or back off.

The state machine decides at each control tick. Other parts move goals and joints, and measure
forces.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from drake_pregrasp.arrays import TIME_ROUNDING, BoolArray, FloatArray, norms
from drake_pregrasp.grasping.grasp_state import (
    NOT_BLOCKED,
    RELEASE_SHARE,
    GiveUp,
    GraspPhase,
    GraspSettings,
    GraspState,
    Ramp,
    Squeeze,
)
from drake_pregrasp.grasping.touch_correction import (
    LARGEST_SHIFT,
    is_settled,
    limited_offset,
    touch_correction,
)

GATE_SHARE = 0.5
"""Share of the largest imbalance that is allowed before closing, as contacts may still shift."""

CRUSHING = 1.3
"""Ratio of force to largest planned force at which a hand opens; measured forces are rough."""

_BOUNCE = 0.02  # Time without force after which a finger in the lift or hold has lost touch, in s.
_STRAIN = 0.002  # Depth to which a finger that touches presses, within the limit of its force.
_ON_THE_WAY = 1.5  # Distance from its goal, in gate distances, beyond which a finger moves to it.
_BESIDE = 2.0  # Distance along the surface, in gate distances, up to which a finger may touch.
_YIELDING = 0.1  # Speed with which a hand that is not closing moves away from a touch, in m/s.
_BESIDE_OBJECT = 0.5  # Least horizontal part of a normal with which such a touch counts.
_INSIDE = 0.002  # Depth in the object from which on a finger that touches nothing moves G, in m.
_EASING = 0.2  # Share of the closing speed with which fingers give up this strain.

_FOLLOWS = 0.25  # Share of a small commanded force from which on a finger presses.
_SLOWER = 0.25  # Share of the pace of the squeeze while a finger does not press.
_ALMOST = 0.9  # Share of the forces that is not exceeded meanwhile.


@dataclass(frozen=True, eq=False)
class GraspView:
    """Observations at a tick; NaN where a finger's value is unknown.

    Attributes:
        time: Time of the tick, in seconds.
        close: Whether the hand is commanded to close.
        active: Whether each finger has an active contact, shape (n,).
        distances: Distance of each fingertip from its goal, shape (n,), in metres.
        gaps: Gap between each fingertip and the surface at its contact, shape (n,), in metres.
        felt: Size of the force that each finger feels in any direction, shape (n,), in newtons.
        presses: Normal force of each fingertip on the object, shape (n,), in newtons; 0 until the
            hand closes.
        wanted: Normal force with which each fingertip should press, shape (n,), in newtons.
        surface_gaps: Gap between each fingertip and the nearest point of the surface, shape (n,),
            in metres; until the hand closes, it counts only for fingertips that feel a force.
        rows: Displacement of the surface there by a unit change of `GraspState.offset`, along its
            normal, or for a pad along the direction in which it closes, shape (n, 3).
        is_tracked: Whether the object is tracked.
        blocked: Index of the finger that stops the hand, `BASE`, or `NOT_BLOCKED`.
        has_met: Whether the palm has met the object.
    """

    time: float
    close: bool
    active: BoolArray
    distances: FloatArray
    gaps: FloatArray
    felt: FloatArray
    presses: FloatArray
    wanted: FloatArray
    surface_gaps: FloatArray
    rows: FloatArray
    is_tracked: bool = True
    blocked: int = NOT_BLOCKED
    has_met: bool = False


def grasp_problem(
    fingers: BoolArray, settings: GraspSettings, squeeze: Callable[[BoolArray], Squeeze]
) -> tuple[GiveUp, float] | None:
    """Returns the reason why fingers cannot hold the object, with its detail, or None if they can.

    Args:
        fingers: Mask of the fingers, shape (n,).
        settings: Settings of the grasp.
        squeeze: Function that plans a squeeze; see `next_state`.
    """
    count = int(np.sum(fingers))
    if count < settings.least_fingers:
        return GiveUp.TOO_FEW_FINGERS, count
    planned = squeeze(fingers)
    allowed = GATE_SHARE * settings.imbalance
    return (planned.lack, planned.residual) if planned.residual > allowed else None


def next_state(
    state: GraspState,
    view: GraspView,
    settings: GraspSettings,
    period: float,
    squeeze: Callable[[BoolArray], Squeeze],
) -> GraspState:
    """Returns the state after a tick.

    Args:
        state: State before the tick.
        view: Observations at the tick.
        settings: Settings of the grasp.
        period: Seconds to the next tick.
        squeeze: Function that plans a squeeze of the fingers in a mask of shape (n,), with forces
            in G, which are zero for other fingers.
    """
    asked = min(state.asked, view.time) if view.close else np.inf
    if asked != state.asked:
        state = replace(state, asked=asked)
    if view.blocked != NOT_BLOCKED and state.phase < GraspPhase.BACK_OFF:
        state = replace(state, reason=GiveUp.BLOCKED, detail=float(view.blocked))
    elif state.reason == GiveUp.BLOCKED:
        state = replace(state, reason=GiveUp.NONE, detail=0.0)
    if state.phase <= GraspPhase.TRACK:
        feel = view.felt >= settings.bump_force
        state = _yielding(state, view, settings, feel, period) if feel.any() else state
    if state.phase in (GraspPhase.LIFT, GraspPhase.HOLD):
        # A finger near the surface that feels a force may touch it beside its tip.
        is_away = (view.felt < settings.touch_force / 2) | (view.surface_gaps > settings.search)
        is_off = is_away & (view.presses < settings.touch_force / 2)
        state = replace(state, pressed=np.where(is_off, state.pressed, view.time))
    if GraspPhase.CLOSE <= state.phase <= GraspPhase.HOLD:
        fault = _fault(state, view, settings)
        if fault is not None:
            return _open(state, view, *fault)
    match state.phase:
        case GraspPhase.APPROACH if view.has_met:
            return replace(_enter(state, GraspPhase.TRACK, view), height=Ramp.at_rest(0.0))
        case GraspPhase.TRACK:
            return _track(state, view, settings, squeeze)
        case GraspPhase.CLOSE:
            return _close(state, view, settings, period, squeeze)
        case GraspPhase.SQUEEZE:
            return _squeeze(state, view, settings, period, squeeze)
        case GraspPhase.LIFT if state.height.is_over(view.time):
            return _enter(state, GraspPhase.HOLD, view)
        case GraspPhase.BACK_OFF:
            return _back_off(state, view, settings, period)
    return state


def _fault(
    state: GraspState, view: GraspView, settings: GraspSettings
) -> tuple[GiveUp, float] | None:
    if not view.close:
        return GiveUp.TOLD_TO_OPEN, 0.0
    # Until the squeeze, the fingers do not hold the object yet.
    if state.phase == GraspPhase.CLOSE and not view.is_tracked:
        return GiveUp.OBJECT_UNSEEN, 0.0
    excess = view.presses - CRUSHING * settings.largest_force
    hardest = int(np.argmax(np.where(np.isnan(excess), -np.inf, excess)))
    if excess[hardest] > 0:
        return GiveUp.PRESSED_TOO_HARD, hardest
    if state.phase >= GraspPhase.LIFT:
        lost = np.flatnonzero(state.active & (view.time - state.pressed >= _BOUNCE - TIME_ROUNDING))
        if len(lost):
            return GiveUp.LOST_TOUCH, float(lost[0])
    return None


def _enter(state: GraspState, phase: GraspPhase, view: GraspView) -> GraspState:
    return replace(state, phase=phase, since=view.time)


def _open(state: GraspState, view: GraspView, reason: GiveUp, detail: float) -> GraspState:
    return replace(
        _enter(state, GraspPhase.BACK_OFF, view),
        reason=reason,
        detail=detail,
        height=Ramp.at_rest(state.height.value(view.time)),
    )


def _yielding(
    state: GraspState, view: GraspView, settings: GraspSettings, feel: BoolArray, period: float
) -> GraspState:
    """Moves the frame G to where fingertips feel the object, whose standoff then moves them off it.

    What is far away from the object is something else, and on top of it, no motion of G helps.
    """
    near = view.surface_gaps <= settings.standoff + LARGEST_SHIFT
    beside = norms(view.rows[:, :2]) >= _BESIDE_OBJECT
    change = touch_correction(view.surface_gaps, view.rows, feel & near & beside, np.zeros(3))
    return replace(state, offset=limited_offset(state.offset, change, _YIELDING * period))


def _track(
    state: GraspState,
    view: GraspView,
    settings: GraspSettings,
    squeeze: Callable[[BoolArray], Squeeze],
) -> GraspState:
    """Waits until the fingers are at their goals and can hold the object, or gives up.

    After the time limit, fingers that are off their goals take no part in the grasp. While
    the object is not tracked, the hand waits without a limit. The limit then starts again.
    """
    if np.isinf(state.asked):
        return state
    if not view.is_tracked:
        waiting = _enter(state, GraspPhase.TRACK, view)
        return replace(waiting, reason=GiveUp.OBJECT_UNSEEN, detail=0.0)
    if state.reason == GiveUp.OBJECT_UNSEEN:
        state = replace(state, reason=GiveUp.NONE, detail=0.0)
    waited = view.time - max(state.asked, state.since) >= settings.gate_limit - TIME_ROUNDING
    late = np.where(view.active, view.distances, 0.0)
    is_late = bool(np.any(late > settings.gate_distance))
    if is_late and not waited:
        return state
    fingers = view.active & (late <= settings.gate_distance)
    why_not = grasp_problem(fingers, settings, squeeze)
    if why_not is None:
        state = replace(state, active=fingers, yielded=state.offset)
        return replace(_enter(state, GraspPhase.CLOSE, view), reason=GiveUp.NONE, detail=0.0)
    if is_late:
        why_not = GiveUp.OFF_GOAL, float(np.argmax(late))
    return _open(state, view, *why_not) if waited else state


def _close(
    state: GraspState,
    view: GraspView,
    settings: GraspSettings,
    period: float,
    squeeze: Callable[[BoolArray], Squeeze],
) -> GraspState:
    """Moves fingers in until they touch, and the frame G to where they touch the object.

    The squeeze begins once G rests, fingers that balance the weight touch the surface there, and
    the others have searched for it in vain. Until a limit of time, the hand waits for this.
    """
    touched_before, elapsed = state.touched, view.time - state.since
    state, rests = _moved_by_touch(state, view, settings, period)
    touched = state.touched & (view.surface_gaps <= settings.search)
    ready = (touched & touched_before) | (state.standoffs <= -np.asarray(settings.search))
    is_over = elapsed > settings.closing_duration + settings.correction_limit
    if not is_over and not (rests and np.all(ready | ~state.active)):
        return state
    planned = None
    if np.sum(touched) >= settings.least_fingers:
        planned = squeeze(touched)
        if planned.residual <= settings.imbalance:
            gripping = _enter(state, GraspPhase.SQUEEZE, view)
            gripping = replace(gripping, gripped=view.time, active=touched)
            return _with_plan(gripping, planned, settings)
    if not is_over:
        return state
    missing = np.flatnonzero(state.active & ~touched)
    if planned is not None and not len(missing):
        return _open(state, view, planned.lack, planned.residual)
    return _open(state, view, GiveUp.MET_NOTHING, float(missing[0]))


def _with_plan(state: GraspState, planned: Squeeze, settings: GraspSettings) -> GraspState:
    """Returns the state with the forces of a plan, if this balances the weight."""
    if planned.residual > settings.imbalance:
        return state
    forces, internal, stopping = planned.forces, planned.internal, planned.stopping
    return replace(state, forces=forces, internal=internal, stopping=stopping)


def _moved_by_touch(
    state: GraspState, view: GraspView, settings: GraspSettings, period: float
) -> tuple[GraspState, bool]:
    """Returns the state with the next standoffs and the next offset of G, and whether G rests.

    G also moves away from a finger that is inside the object and feels nothing. A finger that
    touches stays where it is in W while G moves. One that is far from its goal along the surface,
    because G has moved, moves out and touches again there. No goal is far ahead of a finger that is
    held back.
    """
    least = np.where(state.touched, RELEASE_SHARE, 1.0) * settings.touch_force
    along = np.sqrt(np.maximum(0.0, view.distances**2 - (view.gaps - state.standoffs) ** 2))
    behind = ~(along <= _BESIDE * settings.gate_distance)
    # A fingertip that bounces off the surface is still touching while something holds it back.
    is_held_back = state.touched & (view.gaps - state.standoffs > _STRAIN / 2)
    is_held_back &= np.abs(view.surface_gaps) <= _STRAIN
    # What is far from its goal is on the way to it, and what it feels there is another contact.
    arrived = np.abs(view.gaps - state.standoffs) <= _ON_THE_WAY * settings.gate_distance
    touched = state.active & arrived & ~behind & ((view.presses >= least) | is_held_back)
    elapsed = view.time - state.since
    speed = np.minimum(settings.closing_speed, settings.closing_acceleration * elapsed)
    inside = state.active & ~touched & (view.surface_gaps < -_INSIDE)
    # Across the normals of what touches, G stays where touches have moved it before.
    found = state.offset - state.yielded
    change = touch_correction(view.surface_gaps, view.rows, touched, found, inside)
    offset = limited_offset(state.offset, change, float(np.min(speed)) * period)
    met = np.maximum(state.standoffs, view.gaps - _STRAIN)
    away = view.rows @ (offset - state.offset)
    stays = met - away
    ahead = state.standoffs + np.where(behind, period, -period) * speed
    ahead = np.where(inside, ahead - away, ahead)
    ahead = np.clip(ahead, view.gaps - settings.gate_distance, settings.standoff)
    standoffs = np.where(touched, stays, ahead)
    standoffs = np.maximum(standoffs, -np.asarray(settings.search))
    standoffs = np.where(state.active, standoffs, state.standoffs)
    moved = replace(state, touched=touched, standoffs=standoffs, offset=offset)
    return moved, is_settled(change)


def _squeeze(
    state: GraspState,
    view: GraspView,
    settings: GraspSettings,
    period: float,
    squeeze: Callable[[BoolArray], Squeeze],
) -> GraspState:
    """Increases the forces together, and lifts when they are complete and all fingers press.

    They are planned anew at each tick, for where the fingertips have settled; the last plan that
    balances the weight counts. A finger that does not press moves in; meanwhile the forces increase
    slowly, and not to the end. One that does not press for long, or that is farther off the surface
    than it would search for it, has lost the object. For others the strain of the touch fades,
    because the planned forces replace it.
    """
    if state.share < 1:
        state = _with_plan(state, squeeze(state.active), settings)
        strain = np.nan_to_num(view.gaps - state.standoffs)
        step = _EASING * np.asarray(settings.closing_speed) * period
        least = np.minimum(_FOLLOWS * view.wanted, settings.touch_force / 2)
        behind = state.active & (view.presses < least)
        inward = np.clip(_STRAIN - strain, 0.0, step)
        moved = np.where(behind, -inward, np.clip(strain, 0.0, step))
        standoffs = state.standoffs + np.where(state.active, moved, 0.0)
        share = min(1.0, state.share + period / settings.squeeze_duration)
        if behind.any():
            longest = settings.squeeze_duration + settings.squeeze_limit
            is_over = view.time - state.since > longest
            lost = np.flatnonzero(behind & (is_over | (view.surface_gaps > settings.search)))
            if len(lost):
                return _open(state, view, GiveUp.LOST_TOUCH, float(lost[0]))
            slower = state.share + _SLOWER * (share - state.share)
            share = min(slower, max(state.share, _ALMOST))
        return replace(state, share=share, standoffs=standoffs)
    lift = Ramp(view.time, settings.lift_duration, 0.0, settings.lift_height)
    pressed = np.full(len(state.active), view.time)
    return replace(_enter(state, GraspPhase.LIFT, view), height=lift, pressed=pressed)


def _back_off(
    state: GraspState, view: GraspView, settings: GraspSettings, period: float
) -> GraspState:
    """Sets the object down, lets go, opens the fingers, and moves the hand up, in this order.

    After the command to close has ended, a hand that had not gripped the object approaches again. A
    hand that had gripped the object stays up.
    """
    now = view.time
    if not state.height.is_over(now):
        return state
    height = state.height.value(now)
    if state.share > 0 or np.any(state.touched):
        if height > 0:
            return replace(state, height=Ramp(now, settings.lift_duration, height, 0.0))
        share = max(0.0, state.share - 2 * period / settings.squeeze_duration)
        return replace(state, share=share, touched=np.zeros_like(state.touched))
    opened = np.minimum(settings.standoff, state.standoffs + settings.closing_speed * period)
    if np.any(opened < settings.standoff):
        return replace(state, standoffs=opened)
    if height < settings.approach_height:
        up = Ramp(now, settings.rise_duration, height, settings.approach_height)
        return replace(state, height=up, standoffs=opened)
    if view.close or np.isfinite(state.gripped):
        return replace(state, standoffs=opened)
    approaching = _enter(state, GraspPhase.APPROACH, view)
    return replace(approaching, standoffs=opened, offset=np.zeros(3))
