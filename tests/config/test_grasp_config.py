"""Time of a grasp's closing, its duration, and the range of the wrist."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_pregrasp import GraspConfig, InvalidArgumentError, PlannerConfig
from drake_pregrasp.config.hand_description import Closing, Fingertip
from drake_pregrasp.contacts.assignment import FREE_TURN
from drake_pregrasp.grasping.grasp_phases import GraspView, next_state
from drake_pregrasp.grasping.grasp_state import GraspPhase, GraspState, Squeeze

N, PERIOD = 4, 0.002
ALL = np.ones(N, dtype=bool)


def fingertips(speeds, depths):
    closing = [Closing(speed=v, depth=d) for v, d in zip(speeds, depths, strict=True)]
    return [Fingertip(closing=one) for one in closing]


def balanced(active):
    return Squeeze(np.zeros((N, 3)), 0.0, *np.zeros((2, N, 3)))


def last_touch(config, tips, arrival=0.0, gap=None):
    """Returns the state of a hand whose fingers touch at a gap, when all have.

    They arrive at their goals at some time before that. Without a gap they touch as late as they
    may.
    """
    settings = config.make_settings(tips)
    state = replace(GraspState.first(N, settings), phase=GraspPhase.TRACK)
    tick = 0
    while np.isinf(state.gripped) and state.phase != GraspPhase.BACK_OFF:
        least = -settings.search if gap is None else gap
        touches = state.standoffs <= least + settings.closing_speed * PERIOD
        view = GraspView(
            tick * PERIOD,
            tick * PERIOD >= config.close_at,
            ALL,
            np.full(N, 1.0 * (tick * PERIOD < arrival)),
            state.standoffs,
            felt := np.where(touches, settings.touch_force, 0.0),
            felt,
            np.zeros(N),
            state.standoffs,
            np.zeros((N, 3)),
        )
        state = next_state(state, view, settings, PERIOD, balanced)
        tick += 1
    return state


four = {"min_size": N, "max_size": N}


@pytest.mark.slow
@settings(max_examples=30)
@given(
    st.lists(st.floats(0.01, 0.3), **four),
    st.lists(st.floats(0.002, 0.02), **four),
    st.floats(0.008, 0.04),
    st.floats(0.01, 0.3),
)
def test_closing_lasts_as_long_as_the_slowest_finger_takes(speeds, depths, standoff, speed):
    config = GraspConfig(close_at=0.1, standoff=standoff, closing_speed=speed)
    tips = fingertips(speeds, depths)
    took = last_touch(config, tips).gripped - config.close_at
    assert took == pytest.approx(config.make_settings(tips).closing_duration, abs=4 * PERIOD)


@pytest.mark.parametrize("gate_limit", [0.0, 0.4])
def test_no_hand_comes_to_rest_later_than_it_is_expected_to(gate_limit):
    config = GraspConfig(close_at=0.1, gate_limit=gate_limit)
    tips = fingertips([0.02] * N, [0.006] * N)
    settings = config.make_settings(tips)
    latest = last_touch(config, tips, config.close_at + gate_limit - 2 * PERIOD)
    rest = latest.gripped + settings.squeeze_duration
    assert rest + settings.stop_duration == pytest.approx(config.latest_rest(tips), abs=4 * PERIOD)


def test_a_hand_that_touches_at_the_standoff_moves_as_far_as_until_its_earliest_rest():
    config, tips = GraspConfig(close_at=0.1), fingertips([0.02] * N, [0.006] * N)
    settings = config.make_settings(tips)
    gripped = last_touch(config, tips, gap=0.0).gripped + settings.squeeze_duration
    earliest = gripped + settings.stop_duration / 2
    assert earliest == pytest.approx(config.earliest_rest(tips), abs=4 * PERIOD)


@pytest.mark.parametrize("wrong", [[1.0], [0.2, -0.1], [0.0, 1.0, 2.0], [0.0, np.nan]])
def test_a_wrist_has_two_angles_in_order(wrong):
    with pytest.raises(InvalidArgumentError, match="wrist_range must be empty or two angles"):
        assert GraspConfig(wrist_range=wrong).yaw_range
    assert GraspConfig(wrist_range=[-0.1, 0.2]).yaw_range == (-0.1, 0.2)
    assert GraspConfig().yaw_range == FREE_TURN


def test_contacts_adapt_for_a_while_before_a_hand_closes_by_default():
    assert GraspConfig().close_at >= PlannerConfig().static_duration + 2
