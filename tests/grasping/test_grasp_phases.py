"""State machine of a grasp: laws of the closing gate, of touch, and of giving up."""

from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.grasping.grasp_phases import GraspView, next_state
from drake_pregrasp.grasping.grasp_state import (
    BASE,
    HOLDING,
    NO_LIMIT,
    NOT_BLOCKED,
    GiveUp,
    GraspPhase,
    GraspState,
    Ramp,
    Squeeze,
    describe_give_up,
    state_unpacker,
)

SETTINGS = GraspConfig().make_settings()
PERIOD, MEETING = 0.02, 1.5
N = 5
ALL = np.ones(N, dtype=bool)
FEW = np.arange(N) < 2
NOTHING = np.zeros((N, 3))


def balanced(active):
    forces = np.where(active[:, None], [-3.0, 0, 0], 0.0)
    return Squeeze(forces, 0.0, forces, NOTHING)


class Scene:
    """Fingers that do as they are told, and an object off the place where it should be."""

    def __init__(self, offset=0.0, active=ALL, distance=0.0, stiffness=500.0):
        self.offset, self.active, self.distance = np.broadcast_to(offset, N), active, distance
        self.stiffness = stiffness
        self.force = np.zeros(N)
        self.is_tracked, self.blocked = True, NOT_BLOCKED
        self.time = self.residual = 0.0

    def view(self, time, close, state):
        """Fingertips meet the object at a gap of minus the offset, and then press."""
        depth = np.maximum(-self.offset - state.standoffs, 0)
        wanted = state.share * 3.0 * self.active
        wanted += state.touched * (depth > 0) * SETTINGS.touch_force * (1 - state.share)
        presses = self.stiffness * depth * self.active + wanted + self.force
        gaps = np.maximum(state.standoffs, -self.offset)
        distances = np.broadcast_to(self.distance, N)
        seen = (self.is_tracked, self.blocked, time >= MEETING)
        felt, rows = np.maximum(presses, 0.0), np.zeros((N, 3))  # The offset of G moves nothing.
        forces = felt, presses, wanted
        return GraspView(time, close, self.active, distances, gaps, *forces, gaps, rows, *seen)


def play(
    scene, *, close_at=2.0, open_at=np.inf, again_at=np.inf, end=8.0, squeeze=balanced, change=None
):
    """Returns the state of each tick; `change` changes the scene before a tick."""
    state, states, time = GraspState.first(N, SETTINGS), [], 0.0
    while time < end:
        scene.time = time
        if change is not None:
            change(scene, state)
        view = scene.view(time, close_at <= time < open_at or time >= again_at, state)
        state = next_state(state, view, SETTINGS, PERIOD, squeeze)
        states.append(state)
        time = len(states) * PERIOD
    return states


def phases(states):
    return [GraspPhase(phase).name for phase, _ in groupby(state.phase for state in states)]


def heights_of(states):
    return np.array([state.height.value(PERIOD * tick) for tick, state in enumerate(states)])


def shares_of(states):
    return np.array([state.share for state in states])


def closing_time(states):
    return PERIOD * [state.phase == GraspPhase.CLOSE for state in states].index(True)


def words(state):
    return describe_give_up(state.reason, state.detail)


WHOLE = ["APPROACH", "TRACK", "CLOSE", "SQUEEZE", "LIFT", "HOLD"]


def test_a_grasp_goes_through_all_phases():
    states = play(Scene())
    assert phases(states) == WHOLE
    assert states[-1].height.value(8.0) == SETTINGS.lift_height
    assert states[-1].reason == GiveUp.NONE
    for state in states:
        # It goes its own way from the squeeze on.
        assert np.isfinite(state.gripped) == (state.phase >= GraspPhase.SQUEEZE)


@pytest.mark.parametrize("is_jerked", [False, True])
@given(st.floats(-0.004, 0.005), st.floats(-0.004, 0.005))
@settings(max_examples=10)
def test_each_finger_stops_where_it_meets_the_object(is_jerked, first, others):
    """Also if it feels a force far from the object."""

    def jerk(scene, state):
        early = state.phase == GraspPhase.CLOSE and scene.time < 2.2
        scene.force = np.full(N, 5.0 * early * is_jerked)

    offset = np.array([first, others, others, others, others])
    states = play(Scene(offset=-offset), change=jerk)
    assert phases(states)[-1] == "HOLD"
    np.testing.assert_allclose(states[-1].standoffs, offset, atol=1.7e-3)  # Two ticks.


def test_fingers_never_close_faster_than_they_may():
    standoffs = np.array([state.standoffs for state in play(Scene())])
    steps = np.diff(standoffs[:, 0])
    assert np.min(steps) >= -SETTINGS.closing_speed * PERIOD - 1e-12
    first = np.flatnonzero(steps)[0]
    gains = np.diff(steps[first - 1 : first + 5])
    assert np.min(gains) >= -SETTINGS.closing_acceleration * PERIOD**2 - 1e-12


@pytest.mark.parametrize(
    "change",
    [
        lambda scene, late: setattr(scene, "distance", 0.01 * late),
        lambda scene, late: setattr(scene, "active", FEW if late else ALL),
        lambda scene, late: setattr(scene, "residual", float(late)),
    ],
    ids=["a finger on its way", "a missing finger", "balance"],
)
@pytest.mark.parametrize("comes", [0.0, 0.3, 1.2, 5.0])
def test_the_gate_waits_for_what_comes_up_to_its_limit_and_never_closes_without_it(change, comes):
    scene = Scene()
    states = play(
        scene,
        squeeze=lambda active: Squeeze(NOTHING, scene.residual, NOTHING, NOTHING),
        change=lambda scene, _: change(scene, scene.time < 2.0 + comes - 1e-9),
        end=9.0,
    )
    if comes < SETTINGS.gate_limit:
        assert closing_time(states) == pytest.approx(2.0 + comes)
    else:
        assert GraspPhase.CLOSE not in [state.phase for state in states]


def test_lost_fingers_take_no_part_and_the_gate_does_not_wait_for_them():
    lost = np.arange(N) == 3
    states = play(Scene(active=~lost, distance=1.0 * lost))
    assert phases(states) == WHOLE
    assert closing_time(states) == pytest.approx(2.0)
    np.testing.assert_array_equal(states[-1].touched, ~lost)
    assert states[-1].standoffs[3] == SETTINGS.standoff


def test_fingers_that_come_too_late_take_no_part():
    late = np.arange(N) >= 3
    states = play(Scene(distance=0.025 * late))
    assert phases(states) == WHOLE
    assert closing_time(states) == pytest.approx(2.0 + SETTINGS.gate_limit)
    np.testing.assert_array_equal(states[-1].touched, ~late)


def pressed(scene, state):
    scene.force = np.where(np.arange(N) == 2, 20.0 * (state.phase == GraspPhase.SQUEEZE), 0.0)


def slipped(scene, state):
    scene.force = np.where(np.arange(N) == 4, -9.0 * (state.phase == GraspPhase.LIFT), 0.0)


def unbalanced(active):
    return Squeeze(NOTHING, 1.5, NOTHING, NOTHING)


@pytest.mark.parametrize(
    ("scene", "more", "reason"),
    [
        (Scene(active=FEW), {}, "only 2 active fingers"),
        (Scene(distance=0.025 * ~FEW), {}, "finger 2 did not arrive at its goal"),
        (Scene(offset=0.03 * (np.arange(N) % 4 > 0)), {}, "finger 1 met nothing"),
        (Scene(), {"change": pressed}, "finger 2 pressed too hard"),
        (Scene(), {"change": slipped}, "finger 4 lost touch"),
        (Scene(), {"squeeze": unbalanced}, "no squeeze balances the weight: 1.50 N are left"),
        (Scene(), {"open_at": 4.0}, "told to open"),
    ],
)
def test_it_backs_off_and_says_why(scene, more, reason):
    states = play(scene, end=14.0, **more)
    last = states[-1]
    assert phases(states)[-1] == "BACK_OFF"
    assert words(last) == reason
    assert not np.any(last.touched)
    assert last.share == 0
    np.testing.assert_allclose(last.standoffs, SETTINGS.standoff)
    assert last.height.value(14.0) == pytest.approx(SETTINGS.approach_height)


def test_a_hand_that_gripped_nothing_begins_anew_when_it_is_told_to_again():
    def appear(scene, state):
        scene.active = ALL if scene.time > 6.0 else FEW

    states = play(Scene(), change=appear, open_at=7.0, again_at=9.0, end=14.0)
    assert phases(states) == ["APPROACH", "TRACK", "BACK_OFF", *WHOLE]
    tracking = [s for s in states if s.phase == GraspPhase.TRACK]
    assert tracking[-1].reason == GiveUp.TOO_FEW_FINGERS
    assert states[-1].reason == GiveUp.NONE


def test_what_was_lifted_is_set_down_before_it_is_let_go():
    states = play(Scene(), open_at=6.5, end=14.0)
    heights, forces = heights_of(states), shares_of(states)
    backing = np.array([state.phase == GraspPhase.BACK_OFF for state in states])
    assert heights[backing][0] > 0.05
    letting_go = backing & (forces < 1) & (forces > 0)
    assert np.any(letting_go)
    np.testing.assert_allclose(heights[letting_go], 0, atol=1e-12)


@pytest.mark.parametrize("open_at", [2.9, 3.5])
def test_it_stops_at_once_when_it_is_told_to_open(open_at):
    states = play(Scene(), open_at=open_at, end=6.0)
    first = [state.phase for state in states].index(GraspPhase.BACK_OFF)
    down = np.array(
        [values[first : first + 20] for values in (heights_of(states), shares_of(states))]
    )
    assert down[:, 0].max() > 0.1  # It goes up only once it has opened.
    assert np.max(np.diff(down)) <= 1e-12


def test_a_state_survives_as_a_vector():
    for state in play(Scene(), end=5.0)[::20]:
        again = state_unpacker(N)(state.to_vector())
        np.testing.assert_array_equal(again.to_vector(), state.to_vector())
        assert again.height == state.height


@given(st.floats(0, 3), st.floats(0.1, 2), st.floats(-1, 1), st.floats(-1, 1))
def test_a_ramp_is_smooth_and_monotonic(time, duration, first, last):
    ramp = Ramp(0.5, duration, first, last)
    assert min(first, last) - 1e-12 <= ramp.value(time) <= max(first, last) + 1e-12
    h = 1e-6
    slope = (ramp.value(time + h) - ramp.value(time - h)) / (2 * h)
    assert slope == pytest.approx(ramp.rate(time), abs=1e-3)
    assert ramp.value(0.0) == first
    assert ramp.value(10.0) == pytest.approx(last, abs=1e-15)


def unseen(start, end):
    """Loses the object from sight from one time to another."""

    def change(scene, state):
        scene.is_tracked = not start - 1e-9 <= scene.time < end - 1e-9

    return change


@pytest.mark.parametrize(("found", "late"), [(3.0, 0.0), (6.0, 0.0), (5.0, 1.2)])
def test_no_closing_starts_on_an_object_that_is_not_seen(found, late):
    def change(scene, state):
        unseen(1.8, found)(scene, state)
        scene.distance = 1.0 * (scene.time < found + late - 1e-9)

    # The limit of the gate is counted from the return of the object.
    states = play(Scene(), change=change, end=found + 6.0)
    assert closing_time(states) == pytest.approx(found + late, abs=1.1 * PERIOD)
    assert phases(states)[-1] == "HOLD"
    for tick, state in enumerate(states):
        waits = 2.0 - 1e-9 <= tick * PERIOD < found - 1e-9
        assert words(state) == ("the object is lost from sight" if waits else None)


@pytest.mark.parametrize("touched", [0, 3])
def test_a_closing_that_has_no_hold_opens_when_the_object_is_lost(touched):
    scene = Scene(offset=np.where(np.arange(N) < touched, -0.005, 0.005))

    def lose(scene, state):
        scene.is_tracked &= not (
            state.phase == GraspPhase.CLOSE and np.sum(state.touched) == touched
        )

    states = play(scene, change=lose, end=10.0)
    assert phases(states) == ["APPROACH", "TRACK", "CLOSE", "BACK_OFF"]
    last = states[-1]
    assert words(last) == "the object is lost from sight"
    np.testing.assert_allclose(last.standoffs, SETTINGS.standoff)
    assert last.height.value(10.0) == pytest.approx(SETTINGS.approach_height)


@pytest.mark.parametrize("phase", [GraspPhase.SQUEEZE, GraspPhase.LIFT, GraspPhase.HOLD])
def test_a_hand_that_holds_goes_on_holding_an_object_that_it_no_longer_sees(phase):
    def lose(scene, state):
        scene.is_tracked = state.phase < phase

    assert phases(play(Scene(), change=lose)) == WHOLE


def test_an_unknown_force_hides_no_other_force():
    scene, last = Scene(), play(Scene())[-1]
    for others, phase in ((0.0, GraspPhase.HOLD), (100.0, GraspPhase.BACK_OFF)):
        scene.force = np.where(np.arange(N) == 0, np.nan, others)
        view = scene.view(9.0, True, last)
        assert next_state(last, view, SETTINGS, PERIOD, balanced).phase == phase


def closing_view(**changes):
    """Fingertips at their goals at the surface, which they touch; some values are changed."""
    nothing, touch = np.zeros(N), np.full(N, SETTINGS.touch_force)
    forces = touch, touch, touch
    view = GraspView(3.0, True, ALL, nothing, nothing, *forces, nothing, np.zeros((N, 3)))
    return replace(view, **changes)


CLOSING = replace(GraspState.first(N, SETTINGS), phase=GraspPhase.CLOSE, active=ALL)


def test_a_fingertip_that_is_said_to_be_deep_inside_does_not_touch():
    gaps = np.array([-1e6, 0.0, 0.0, 0.0, 0.0])
    state = replace(CLOSING, standoffs=np.zeros(N))
    after = next_state(state, closing_view(gaps=gaps), SETTINGS, PERIOD, balanced)
    np.testing.assert_array_equal(after.touched, gaps == 0)
    assert abs(after.standoffs[0]) < SETTINGS.closing_speed * PERIOD + 1e-12


@pytest.mark.parametrize(("jump", "touches"), [(-0.008, False), (0.001, True), (0.008, False)])
def test_forces_that_accelerate_a_finger_are_no_touch(jump, touches):
    """Fingers follow an estimate that has jumped, and feel it."""
    state = replace(CLOSING, standoffs=np.full(N, 0.01))
    felt = closing_view(gaps=0.01 + jump * ALL, presses=np.full(N, SETTINGS.touch_force))
    after = next_state(state, felt, SETTINGS, PERIOD, balanced)
    assert np.all(after.touched == touches)


ROUND = np.column_stack([np.cos(1.2566 * np.arange(N)), np.sin(1.2566 * np.arange(N)), np.zeros(N)])
"""Rows of `touch_correction` for fingers around an object."""


@pytest.mark.parametrize(("depth", "moves"), [(0.001, False), (0.004, True)])
@pytest.mark.parametrize("finger", [0, 3])
def test_the_frame_moves_away_from_a_finger_that_is_inside_and_feels_nothing(finger, depth, moves):
    gaps = np.where(np.arange(N) == finger, -depth, SETTINGS.standoff)
    nothing = np.zeros(N)
    view = closing_view(gaps=gaps, surface_gaps=gaps, presses=nothing, rows=ROUND)
    after = next_state(replace(CLOSING, standoffs=gaps), view, SETTINGS, PERIOD, balanced)
    displaced = ROUND @ after.offset
    assert (displaced[finger] < 0) == moves
    assert not after.touched.any()
    # In W, the finger goes on as before.
    inward = gaps[finger] - after.standoffs[finger] - displaced[finger]
    still = closing_view(gaps=gaps, surface_gaps=np.abs(gaps), presses=nothing, rows=ROUND)
    before = next_state(replace(CLOSING, standoffs=gaps), still, SETTINGS, PERIOD, balanced)
    assert inward == pytest.approx(gaps[finger] - before.standoffs[finger])


@pytest.mark.parametrize(
    ("phase", "share", "gap", "level", "moves"),
    [
        (GraspPhase.APPROACH, 1.1, 0.02, 1.0, True),
        (GraspPhase.TRACK, 1.1, 0.02, 1.0, True),
        (GraspPhase.TRACK, 1.1, 0.045, 0.6, True),
        (GraspPhase.TRACK, 0.9, 0.02, 1.0, False),
        (GraspPhase.TRACK, 1.1, 0.06, 1.0, False),  # Something else.
        (GraspPhase.TRACK, 1.1, 0.02, 0.4, False),  # On top of the object.
        (GraspPhase.TRACK, 1.1, 0.02, np.nan, False),
        (GraspPhase.BACK_OFF, 1.1, 0.02, 1.0, False),
    ],
)
@pytest.mark.parametrize("finger", [0, 3])
def test_before_it_closes_the_frame_yields_to_a_finger_that_feels_the_object(
    finger, phase, share, gap, level, moves
):
    gaps = np.full(N, gap)
    felt = np.where(np.arange(N) == finger, share * SETTINGS.bump_force, 0.0)
    view = closing_view(close=False, gaps=gaps, surface_gaps=gaps, felt=felt, rows=level * ROUND)
    before = 0.01 * np.array([-ROUND[finger, 1], ROUND[finger, 0], 0.0])  # Across its normal.
    state = replace(GraspState.first(N, SETTINGS), phase=phase, offset=before, gripped=0.0)
    after = next_state(state, view, SETTINGS, PERIOD, balanced)
    moved = after.offset - before
    assert (moved @ ROUND[finger] > 0) == moves
    np.testing.assert_allclose(moved, (moved @ ROUND[finger]) * ROUND[finger], atol=1e-12)
    assert np.linalg.norm(moved) <= 0.1 * PERIOD + 1e-12
    assert not after.touched.any()
    np.testing.assert_array_equal(after.standoffs, state.standoffs)


def test_without_a_force_of_bumps_the_frame_does_not_yield():
    settings = replace(GraspConfig(), bump_force=0.0).make_settings()
    gaps, felt = np.full(N, 0.02), 100.0 * (np.arange(N) == 0)
    view = closing_view(close=False, gaps=gaps, surface_gaps=gaps, felt=felt, rows=ROUND)
    state = replace(GraspState.first(N, settings), phase=GraspPhase.TRACK)
    assert not next_state(state, view, settings, PERIOD, balanced).offset.any()


def test_across_the_normals_of_touches_the_frame_stays_where_it_was_as_the_hand_closed():
    gaps = np.where(np.arange(N) == 0, 0.01, SETTINGS.standoff)
    presses = SETTINGS.touch_force * (np.arange(N) == 0)
    view = closing_view(gaps=gaps, surface_gaps=gaps, presses=presses, rows=ROUND)
    offset = np.array([0.0, 0.01, 0.0])  # The normal of the first finger is along x.
    tracking = replace(GraspState.first(N, SETTINGS), phase=GraspPhase.TRACK, offset=offset)
    at_goals = closing_view(presses=np.zeros(N), rows=ROUND)
    closing = next_state(tracking, at_goals, SETTINGS, PERIOD, balanced)
    assert closing.phase == GraspPhase.CLOSE
    closing = replace(closing, standoffs=gaps, since=0.0)
    after = next_state(closing, view, SETTINGS, PERIOD, balanced)
    assert after.offset[0] > 0
    assert after.offset[1] == pytest.approx(offset[1], abs=1e-9)
    without = replace(closing, yielded=np.zeros(3))
    assert next_state(without, view, SETTINGS, PERIOD, balanced).offset[1] < offset[1] - 1e-5


def test_a_finger_inside_that_feels_nothing_does_not_outweigh_one_that_touches():
    """Both are before the same face; the second one may be beyond its edge."""
    gaps = np.array([0.0, -0.006, 0.02, 0.02, 0.02])
    rows = np.where(np.arange(N)[:, None] < 2, [1.0, 0.0, 0.0], ROUND)
    state = replace(CLOSING, standoffs=gaps)
    for presses, moves in ((SETTINGS.touch_force, False), (0.0, True)):
        felt = np.where(np.arange(N) == 0, presses, 0.0)
        view = closing_view(gaps=gaps, surface_gaps=gaps, presses=felt, rows=rows)
        after = next_state(state, view, SETTINGS, PERIOD, balanced)
        assert (after.offset[0] < 0) == moves


@given(st.integers(0, N - 1), st.floats(0.002, 0.018))
def test_the_touch_of_one_finger_moves_the_frame_but_not_the_finger(finger, gap):
    """The gap that the finger keeps in G shrinks by the displacement of G."""
    touches = np.arange(N) == finger
    gaps = np.where(touches, gap, SETTINGS.standoff)
    presses = SETTINGS.touch_force * touches
    view = closing_view(gaps=gaps, surface_gaps=gaps, presses=presses, rows=ROUND)
    state = replace(CLOSING, standoffs=gaps)
    after = next_state(state, view, SETTINGS, PERIOD, balanced)
    displaced = ROUND @ after.offset
    assert 0 < displaced[finger] <= SETTINGS.closing_speed * PERIOD + 1e-12
    np.testing.assert_allclose(after.standoffs[finger], gap - displaced[finger], atol=1e-12)
    assert np.all(after.standoffs[~touches] < gaps[~touches])


def test_fingers_that_balance_the_weight_do_not_wait_for_those_that_meet_nothing():
    states = play(Scene(offset=0.03 * (np.arange(N) > 2)), end=12.0)
    assert phases(states) == WHOLE
    np.testing.assert_array_equal(states[-1].active, np.arange(N) < 3)


@pytest.mark.parametrize("comes", [True, False])
def test_fingers_that_touch_wait_for_a_balance_up_to_the_limit(comes):
    limit = SETTINGS.closing_duration + SETTINGS.correction_limit
    scene, closed, balances_at = Scene(), closing_time(play(Scene())), np.inf
    if comes:
        balances_at = closed + limit - 0.1

    def squeeze(active):
        until_touch = scene.time <= closed
        return (balanced if until_touch or scene.time >= balances_at else unbalanced)(active)

    states = play(scene, squeeze=squeeze, end=12.0)
    assert phases(states) == (WHOLE if comes else [*WHOLE[:3], "BACK_OFF"])
    left = PERIOD * [s.phase > GraspPhase.CLOSE for s in states].index(True)
    assert left == pytest.approx(balances_at if comes else closed + limit, abs=2 * PERIOD)
    assert all(s.share == 0 for s in states if s.phase == GraspPhase.CLOSE)


def test_a_squeeze_follows_the_last_plan_that_balances_the_weight():
    scene, compared, closed = Scene(), set(), closing_time(play(Scene()))

    def forces_at(tick):
        return balanced(ALL).forces * (1 + PERIOD * tick)

    def squeeze(active):
        tick = round(scene.time / PERIOD)
        if scene.time <= closed:  # The gate allows less imbalance.
            return balanced(active)
        forces, is_off = forces_at(tick), tick % 3 == 0
        residual = (1 + is_off) * SETTINGS.imbalance
        return Squeeze(forces, residual, forces / 2, forces / 4)

    def compare(scene, state):
        if state.phase == GraspPhase.SQUEEZE and state.share < 1:
            last = round(scene.time / PERIOD) - 1
            forces = forces_at(last - (last % 3 == 0))
            np.testing.assert_allclose(state.forces, forces)
            np.testing.assert_allclose(state.internal, forces / 2)
            np.testing.assert_allclose(state.stopping, forces / 4)
            compared.add(last)

    assert phases(play(scene, squeeze=squeeze, change=compare)) == WHOLE
    assert len(compared) >= SETTINGS.squeeze_duration / PERIOD - 1


def test_forces_rise_slowly_while_a_finger_does_not_press_and_it_moves_in():
    def loosen(scene, state):
        loose = state.phase == GraspPhase.SQUEEZE and scene.time < 3.7
        scene.force = np.where(np.arange(N) == 2, -5.0 * loose, 0.0)

    states = play(Scene(), change=loosen, end=6.0)
    waiting = [
        s for k, s in enumerate(states) if s.phase == GraspPhase.SQUEEZE and k < 3.7 / PERIOD
    ]
    pace = np.diff([state.share for state in waiting])
    assert 0 < np.max(pace) <= 0.3 * PERIOD / SETTINGS.squeeze_duration
    first, last = waiting[0].standoffs, waiting[-1].standoffs
    assert last[2] < first[2] - 1e-4
    assert np.all(np.delete(last - first, 2) >= 0)
    assert phases(states)[-1] == "HOLD"


def test_a_squeeze_is_not_completed_while_a_finger_does_not_press():
    def loosen(scene, state):
        loose = state.phase == GraspPhase.SQUEEZE
        scene.force = np.where(np.arange(N) == 2, -20.0 * loose, 0.0)

    states = play(Scene(), change=loosen, end=8.0)
    assert np.max(shares_of(states)) == pytest.approx(0.9)
    assert "LIFT" not in phases(states)
    assert (states[-1].reason, states[-1].detail) == (GiveUp.LOST_TOUCH, 2)


@pytest.mark.parametrize(
    ("press", "gap", "gives_up"), [(0.0, 1.1, True), (0.0, 0.9, False), (9.0, 1.1, False)]
)
def test_a_finger_far_off_the_surface_that_does_not_press_has_lost_the_object(press, gap, gives_up):
    state, others = replace(CLOSING, phase=GraspPhase.SQUEEZE, since=3.0), np.arange(N) != 3
    surface_gaps = np.where(others, 0.0, gap * SETTINGS.search)
    presses = np.where(others, 9.0, press)
    view = closing_view(surface_gaps=surface_gaps, presses=presses, wanted=np.ones(N))
    after = next_state(state, view, SETTINGS, PERIOD, balanced)
    assert (after.reason == GiveUp.LOST_TOUCH) == gives_up
    if gives_up:
        assert (after.phase, after.detail) == (GraspPhase.BACK_OFF, 3)


@pytest.mark.parametrize(
    ("duration", "force", "felt", "gap", "is_lost"),
    [
        (0.018, 0.0, 0.0, 0.0, False),
        (0.022, 0.0, 0.0, 0.0, True),
        (9.0, -1.0, 1.0, 0.0, False),  # Beside its tip, it may press with any force.
        (0.022, -1.0, 1.0, 2 * SETTINGS.search, True),  # It touches something else.
        (9.0, 1.0, 1.0, 2 * SETTINGS.search, False),
    ],
)
def test_a_finger_has_lost_touch_if_it_feels_nothing_for_longer_than_a_bounce(
    duration, force, felt, gap, is_lost
):
    scene, state, period = Scene(), GraspState.first(N, SETTINGS), 0.002
    begun = None
    for tick in range(3000):
        time = tick * period
        if begun is None and state.phase == GraspPhase.LIFT:
            begun = time
        off = begun is not None and time < begun + duration - 1e-9
        view = scene.view(time, time >= 2.0, state)
        if off:
            last = np.arange(N) == 4
            presses, feels = np.where(last, [[force], [felt]], view.presses)
            surface_gaps = np.where(last, gap, view.surface_gaps)
            view = replace(view, presses=presses, felt=feels, surface_gaps=surface_gaps)
        state = next_state(state, view, SETTINGS, period, balanced)
    assert begun is not None
    assert (state.reason == GiveUp.LOST_TOUCH) == is_lost


@pytest.mark.parametrize(("gap", "touches"), [(0.0005, True), (0.01, False)])
def test_a_fingertip_that_bounces_off_the_surface_still_touches(gap, touches):
    state = replace(
        GraspState.first(N, SETTINGS),
        phase=GraspPhase.CLOSE,
        asked=0.0,
        active=ALL,
        touched=np.arange(N) == 0,
        standoffs=np.full(N, gap - 0.002),
    )
    view = replace(
        Scene().view(1.0, True, state),
        gaps=np.full(N, gap),
        surface_gaps=np.full(N, gap),
        presses=np.zeros(N),
        distances=np.full(N, 0.002),
    )
    after = next_state(state, view, SETTINGS, PERIOD, balanced)
    np.testing.assert_array_equal(after.touched, (np.arange(N) == 0) & touches)


@pytest.mark.parametrize(("finger", "words"), [(2, "finger 2"), (BASE, "the base")])
def test_a_hand_says_what_hinders_it_for_as_long_as_it_stands(finger, words):
    def hinder(scene, state):
        scene.blocked = finger if 0.5 <= scene.time < 1.0 else NOT_BLOCKED

    states = play(Scene(), close_at=2.0, change=hinder)
    reasons = [describe_give_up(state.reason, state.detail) for state in states]
    standing = [reason for reason in reasons if reason is not None]
    assert len(standing) == round(0.5 / PERIOD)
    assert all(words in reason for reason in standing)
    assert states[-1].phase == GraspPhase.HOLD


@pytest.mark.parametrize("lasting", [0.4, 9.0])
def test_a_finger_that_is_left_behind_moves_out_before_it_touches(lasting):
    def leave(scene, state):
        left = 2.3 <= scene.time < 2.3 + lasting
        scene.distance = 0.01 * (np.arange(N) == 3) if left else 0.0

    states = play(Scene(), end=12.0, change=leave)
    left = [k for k in range(116, len(states)) if k * PERIOD < min(2.3 + lasting, 4.9)]
    gaps = np.array([states[k].standoffs[3] for k in left])
    assert not np.any([states[k].touched[3] for k in left])
    assert np.all(np.diff(gaps) >= 0)
    assert gaps[-1] > gaps[0]
    assert phases(states)[-1] == "HOLD"
    assert states[-1].active[3] == (lasting < 1)


def test_a_finger_that_does_not_get_to_its_goal_touches_beside_it():
    def keep_off(scene, state):
        off = 1.5 * SETTINGS.gate_distance * (state.phase >= GraspPhase.CLOSE)
        scene.distance = off * (np.arange(N) == 3)

    last = play(Scene(), change=keep_off)[-1]
    assert last.phase == GraspPhase.HOLD
    assert last.active[3]


@given(st.lists(st.floats(0.5, 12), min_size=N, max_size=N), st.floats(0, 1), st.floats(0, 1))
def test_fingers_that_touch_press_with_a_share_of_the_squeeze_and_at_least_the_touch_force(
    sizes, share, later
):
    forces, least = np.array(sizes)[:, None] * [1.0, 0.0, 0.0], SETTINGS.touch_force
    state = replace(CLOSING, touched=ALL, share=share, internal=forces)
    applied = state.applied_share(least)
    assert share <= applied <= 1
    assert np.min(sizes) * applied >= least - 1e-9
    touching = replace(state, share=0.0).applied_share(least)
    assert np.min(sizes) * touching == pytest.approx(least)
    more = replace(state, share=max(share, later)).applied_share(least)
    assert applied <= more + 1e-12
    assert replace(state, touched=~ALL).applied_share(least) == share


@pytest.mark.parametrize("phase", list(GraspPhase))
def test_forces_are_limited_to_little_more_than_planned_until_the_squeeze_is_complete(phase):
    planned = balanced(ALL)
    state = replace(
        GraspState.first(N, SETTINGS),
        phase=phase,
        active=~FEW,
        touched=ALL,
        share=0.4,
        forces=planned.forces,
        internal=planned.internal,
    )
    gripped = replace(state, gripped=1.0)
    least = SETTINGS.touch_force
    limits, later = state.force_limits(least), gripped.force_limits(least)
    assert np.all(limits[FEW] == NO_LIMIT)
    closes = phase in (GraspPhase.CLOSE, GraspPhase.SQUEEZE)
    if not (closes or phase == GraspPhase.BACK_OFF):
        assert np.all(limits == NO_LIMIT)
        return
    assert closes == np.all(later[~FEW] < NO_LIMIT)  # What was gripped is set down with full force.
    wanted = np.linalg.norm(state.planned_forces(0.0, SETTINGS), axis=1)[~FEW, None]
    across = HOLDING if phase == GraspPhase.SQUEEZE else 1.0
    np.testing.assert_allclose(limits[~FEW], (wanted + 0.5 * least) * [1.0, across])
    touching = replace(state, share=0.0, forces=NOTHING, internal=NOTHING)
    gentle = np.tile([1.5 * least, 1.5 * across * least], (3, 1))
    np.testing.assert_allclose(touching.force_limits(least)[~FEW], gentle)
    free = replace(touching, touched=~ALL).force_limits(least)
    np.testing.assert_allclose(free[~FEW], np.tile([1.5 * least, NO_LIMIT], (3, 1)))
