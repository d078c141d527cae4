"""Laws of meetings: quintics end with the object, limits are kept, certificates are right."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import slow
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from throws import (
    FALL,
    IN_AIR,
    REST,
    SETTINGS,
    chosen,
    on_belt,
    plan_of,
    random_throws,
    throws_to_a_palm,
    with_limits,
)

from drake_pregrasp.fast import default_kernels
from drake_pregrasp.grasping.catch_limits import CatchLimit, describe_catch_limit
from drake_pregrasp.grasping.interception import (
    rest_limit,
)
from drake_pregrasp.grasping.palm_paths import (
    Meeting,
    clear_times,
    moved,
    peaks,
    quintic,
    turning_points,
)

numbers = arrays(float, (3, 3), elements=st.floats(-2, 2))


def path_of(plan, count=60):
    """Palm positions, velocities and accelerations from the start of a plan to the meeting."""
    times = np.linspace(plan.start, plan.time - 1e-9, count)
    return np.array([plan.object_at(t) + plan.offset_at(t) for t in times])


@given(numbers, st.floats(0.05, 5))
def test_quintics_meet_both_ends(start, duration):
    np.testing.assert_allclose(quintic(start, 0.0, duration), start, atol=1e-9)
    np.testing.assert_allclose(quintic(start, duration, duration), 0, atol=1e-6)


@given(numbers, st.floats(0.2, 5), st.floats(0.1, 0.8))
def test_a_quintic_that_is_planned_again_on_its_way_stays_the_same(start, duration, share):
    since, later = share * duration, 0.95 * duration
    again = quintic(quintic(start, since, duration), later - since, duration - since)
    np.testing.assert_allclose(again, quintic(start, later, duration), atol=1e-8)


@given(numbers, numbers, st.floats(0.05, 3))
def test_no_part_of_a_way_is_beyond_its_peaks(offset, motion, duration):
    bound = peaks(offset[:, 0], motion[:, 0], np.array([duration]))
    at = np.linspace(0, duration, 400)
    way = np.array([(moved(motion, t) + quintic(offset, t, duration))[:, 0] for t in at])
    slack = 1e-9 * (1 + np.max(np.abs(way), axis=0))
    assert np.max(np.abs(way[:, 1])) <= bound.speed[0] + slack[1]
    assert np.max(np.abs(way[:, 2])) <= bound.acceleration[0] + slack[2]
    assert bound.lowest[0] - slack[0] <= np.min(way[:, 0])
    assert np.max(way[:, 0]) <= bound.highest[0] + slack[0]


@given(numbers, st.floats(0.05, 3), st.floats(0.01, 0.5))
def test_a_quintic_is_clear_of_a_height_for_as_long_as_it_says(offset, duration, height):
    until = clear_times(offset[:, 0], np.array([duration]), height)[0]
    assert until < duration
    way = np.array([quintic(offset, t, duration)[0, 0] for t in np.linspace(0, max(until, 0), 50)])
    assert until < 0 or np.all(way >= height - 1e-9 * (1 + np.max(np.abs(way))))


def test_a_quintic_that_only_falls_is_clear_until_it_reaches_the_height():
    start, T = np.array([1.0, 0.0, 0.0]), 0.7
    until = clear_times(start, np.array([T]), 0.5)[0]
    assert until == pytest.approx(T / 2, abs=T / 100)
    assert clear_times(0.4 * start, np.array([T]), 0.5)[0] < 0


@pytest.mark.parametrize("throws", [40, slow(1000)])
def test_a_fast_carrier_meets_nearly_all_throws_and_the_object_passes_between_the_fingers(throws):
    kernels, met, direct = default_kernels().hand(), 0, 0
    slower = with_limits(IN_AIR, speed=np.full(3, 1.35), acceleration=np.full(3, 9.0))
    for motion, palm in throws_to_a_palm(throws, 5):
        assert chosen(motion, palm, slower, choose=kernels.choose_meeting).limit
        choice = chosen(motion, palm, IN_AIR, choose=kernels.choose_meeting)
        met += choice.limit == CatchLimit.NONE
        if choice.limit != CatchLimit.NONE or choice.height or choice.over == choice.time:
            continue
        direct += 1
        plan = plan_of(choice, palm, motion)
        for t in np.linspace(0, plan.time, 100):
            d = plan.offset_at(t)[0]
            assert d[2] >= IN_AIR.height - 1e-9 or np.linalg.norm(d[:2]) <= 1e-6
    assert met >= 0.95 * throws
    assert direct >= throws / 2


def test_a_plan_ends_with_the_object_over_it_and_then_at_it():
    motion = on_belt(0.4, y=0.1)
    plan = plan_of(chosen(motion), REST, motion)
    np.testing.assert_allclose(plan.offset_at(0.0), REST - motion)
    for before in (plan.over - 1e-9, plan.over):
        high = [[0, 0, plan.height], np.zeros(3), np.zeros(3)]
        np.testing.assert_allclose(plan.offset_at(before), high, atol=1e-6)
    np.testing.assert_allclose(plan.offset_at(plan.time - 1e-9), 0, atol=1e-5)
    # The way down begins clear of the object, and leads straight down.
    down = path_of(replace(plan, start=plan.over, motion=plan.object_at(plan.over)))
    assert plan.height >= SETTINGS.height
    assert np.all(np.diff(down[:, 0, 2]) <= 1e-12)


@pytest.mark.parametrize("throws", [300, slow(2500)])
def test_no_accepted_meeting_exceeds_the_limits(throws):
    kernels, accepted = default_kernels().hand(), 0
    for motion, palm, settings in random_throws(throws, 1):
        choice = chosen(motion, palm, settings, choose=kernels.choose_meeting)
        if choice.limit != CatchLimit.NONE:
            assert np.isnan(choice.time)
            continue
        accepted += 1
        plan = plan_of(choice, palm, motion)
        places, rates, changes = path_of(plan).swapaxes(0, 1)
        assert np.all(np.abs(rates) <= settings.limits.speed * (1 + 1e-9))
        assert np.all(np.abs(changes) <= settings.limits.acceleration * (1 + 1e-9))
        low, high = settings.limits.lower - 1e-9, settings.limits.upper + 1e-9
        assert np.all((low <= places) & (places <= high))
        for t in np.linspace(plan.time, plan.time + settings.follow, 40):
            left, rate, _ = plan.object_at(t)
            assert np.all((low <= left) & (left <= high))
            assert np.all(np.abs(rate) <= settings.limits.speed * (1 + 1e-9))
        stopped = left + settings.stop / 2 * rate
        assert np.all((low <= stopped) & (stopped <= high))
        brakes = np.abs(rate) / settings.stop
        assert np.all(brakes <= settings.limits.acceleration * (1 + 1e-9))
        # While the object moves as predicted, the rest of the meeting keeps the limits as well.
        for t in np.linspace(0, plan.time, 7):
            here = plan.object_at(t)
            assert rest_limit(plan.offset_at(t), here, t, plan, settings) == CatchLimit.NONE
    assert accepted > throws / 20


@given(arrays(float, 3, elements=st.floats(-1, 1)), arrays(float, 3, elements=st.floats(-3, 3)))
def test_a_motion_is_extreme_where_it_turns(x, v):
    motion = np.array([x, v, FALL])
    time, place = turning_points(motion)
    assert np.all(np.isinf(time[:2]))
    turning = moved(motion, time[2])
    np.testing.assert_allclose(turning[:2, 2], [place[2], 0], atol=1e-9)


@pytest.mark.parametrize(
    ("motion", "limit"),
    [
        (on_belt(0.4), CatchLimit.NONE),
        (on_belt(0.4, y=0.02), CatchLimit.NONE),
        (on_belt(0.4, y=0.4), CatchLimit.ACCELERATION),  # As far beside the palm as that.
        (on_belt(1.6), CatchLimit.SPEED),
        (on_belt(1.2), CatchLimit.ACCELERATION),  # It would be stopped by 4 m/s².
        (on_belt(0.4, x=3.0), CatchLimit.REACH),
        (on_belt(0.6, x=0.4), CatchLimit.TIME),
    ],
)
def test_the_rest_of_a_meeting_is_checked_with_the_present_estimate(motion, limit):
    first = on_belt(0.4)
    plan = plan_of(chosen(first), REST, first)
    now = plan.time - 0.3
    palm = plan.object_at(now) + plan.offset_at(now)
    offset = palm - moved(first, now)
    offset[0, 1] -= motion[0, 1]
    here = motion.copy()
    here[0, 0] += now * 0.4
    assert rest_limit(offset, here, now, plan, SETTINGS) == limit
    if not limit:  # Its next estimates exceed the limits by less than a tenth.
        slower = with_limits(speed=SETTINGS.limits.speed / 1e3)
        assert rest_limit(offset, here, now, plan, slower) == CatchLimit.SPEED


@pytest.mark.parametrize(
    ("motion", "settings", "limit"),
    [
        (on_belt(0.4), SETTINGS, CatchLimit.NONE),
        (on_belt(1.5), SETTINGS, CatchLimit.SPEED),
        (on_belt(0.4, x=-5.0), SETTINGS, CatchLimit.REACH),
        (on_belt(0.4, y=2.0), SETTINGS, CatchLimit.REACH),
        # It leaves the travel while the hand would still be closing.
        (on_belt(0.8, x=0.9), SETTINGS, CatchLimit.TIME),
        # It is met at 1 m/s, and stopping in 0.3 s takes 3.3 m/s² of the palm and of the grip.
        (on_belt(1.0), SETTINGS, CatchLimit.ACCELERATION),
        (on_belt(0.8), replace(SETTINGS, grip=2.6), CatchLimit.GRIP),
        (on_belt(1.0), with_limits(acceleration=np.full(3, 0.3)), CatchLimit.ACCELERATION),
        # No palm falls as fast as an object with less acceleration than gravity.
        (
            np.array([[0, 0, 1.5], np.zeros(3), FALL]),
            with_limits(speed=np.full(3, 30.0)),
            CatchLimit.ACCELERATION,
        ),
    ],
)
def test_the_certificate_names_what_limits_the_hand(motion, settings, limit):
    assert chosen(motion, settings=settings).limit == limit
    assert (describe_catch_limit(limit) is None) == (limit == CatchLimit.NONE)


@given(
    st.floats(0.0, 1.5),
    st.floats(-1.4, 0.5),
    st.floats(-0.3, 0.3),
    st.tuples(*[st.floats(1.0, 3.0)] * 3),
)
def test_higher_limits_never_lose_a_meeting(speed, x, y, more):
    motion = on_belt(speed, x, y)
    limits = SETTINGS.limits
    faster = with_limits(
        speed=more[0] * limits.speed,
        acceleration=more[1] * limits.acceleration,
        upper=more[2] * limits.upper,
    )
    faster = replace(faster, grip=more[0] * SETTINGS.grip, follow=SETTINGS.follow / more[0])
    if chosen(motion).limit == CatchLimit.NONE:
        assert chosen(motion, settings=faster).limit == CatchLimit.NONE


def test_a_meeting_stays_while_the_object_moves_as_predicted():
    motion, kept, now = on_belt(0.4, y=0.1), None, 0.0
    meetings = []
    while not meetings or now < meetings[-1].time - 0.5:
        palm = REST if kept is None else kept.object_at(now) + kept.offset_at(now)
        here = moved(motion, now)
        choice = chosen(here, palm, now=now, kept=kept)
        kept = plan_of(choice, palm, here, now)
        if now >= choice.over:
            kept = replace(kept, over=choice.time, height=0.0)
        meetings.append(choice)
        now += 0.02
    assert np.ptp([meeting.time for meeting in meetings]) < 1e-9
    # The whole path is that of the first plan.
    first = plan_of(meetings[0], REST, motion)
    np.testing.assert_allclose(kept.offset_at(now), first.offset_at(now), atol=1e-6)


def test_a_large_cost_of_time_selects_the_earliest_or_the_latest_meeting():
    motion = on_belt(0.4, y=0.1)
    first, usual, last = (
        chosen(motion, settings=replace(SETTINGS, lateness=cost)).time for cost in (1e3, 0.3, -1e3)
    )
    assert first < usual < last
    for moment in (first, usual, last):
        after = replace(SETTINGS, earliest=moment + SETTINGS.step / 2)
        assert (chosen(motion, settings=after).limit == CatchLimit.NONE) == (moment < last)


def test_a_stop_ends_at_rest_where_it_says():
    palm = np.array([[0.1, 0.2, 0.3], [1.0, -0.5, 0.0], [2.0, 0.0, 1.0]])
    plan = Meeting.stopping(palm, 2.0, 0.4)
    np.testing.assert_allclose(plan.object_at(2.0) + plan.offset_at(2.0), palm)
    np.testing.assert_allclose(plan.offset_at(2.4 - 1e-9), 0, atol=1e-5)
    np.testing.assert_allclose(plan.object_at(5.0)[0], [0.3, 0.1, 0.3])
    assert not plan.meets
