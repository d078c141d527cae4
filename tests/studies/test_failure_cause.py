"""Each failed grasp has one cause, from what happened to the object and what the hand reports."""

import dataclasses

import numpy as np
import pytest
from made_up_records import motion_of, record

from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.contacts.selection_input import ContactStatus
from drake_pregrasp.grasping.catch_limits import CatchLimit
from drake_pregrasp.grasping.grasp_state import GiveUp, GraspPhase, GraspState
from drake_pregrasp.studies.grasps.failure_cause import failure_cause

TRACKED = [record(0.0, GraspPhase.APPROACH), record(2.0, GraspPhase.TRACK)]
CLOSED = [*TRACKED, record(3.0, GraspPhase.CLOSE)]
LIFTED = [*CLOSED, record(3.5, GraspPhase.LIFT), record(4.0, GraspPhase.LIFT, lift=0.05)]
BACK = record(4.5, GraspPhase.BACK_OFF)
SUNK = record(5.0, GraspPhase.HOLD, lift=0.05, sunk=0.01)
PUSHED = record(2.6, GraspPhase.CLOSE, slid=0.006)
TIPPED = record(2.5, GraspPhase.TRACK, tilt=np.radians(30))
TIPPED_IN_HAND = record(4.2, GraspPhase.HOLD, lift=0.05, tilt=np.radians(60))


def cause(records, reason=GiveUp.NONE, statuses=()):
    first = GraspState.first(5, GraspConfig().make_settings())
    state = dataclasses.replace(first, reason=reason)
    return failure_cause(records, motion_of(records, 2.5), statuses, state)


@pytest.mark.parametrize(
    ("records", "reason", "expected"),
    [
        (CLOSED, GiveUp.NONE, "timed out"),
        ([*CLOSED, BACK], GiveUp.MET_NOTHING, "missed"),
        ([*CLOSED, BACK], GiveUp.PRESSED_TOO_HARD, "pressed too hard"),
        ([*CLOSED, BACK], GiveUp.OBJECT_UNSEEN, "lost from sight"),
        ([*TRACKED, BACK], GiveUp.OFF_GOAL, "not at its goals"),
        (TRACKED, GiveUp.BLOCKED, "links blocked"),
        ([*CLOSED, BACK], GiveUp.OUT_OF_BALANCE, "no balance"),
        ([*CLOSED, BACK], GiveUp.NEEDS_FRICTION, "no balance"),
        ([*LIFTED, BACK], GiveUp.LOST_TOUCH, "slipped"),
        ([*LIFTED, BACK], GiveUp.PRESSED_TOO_HARD, "pressed too hard"),
        ([*LIFTED, SUNK], GiveUp.NONE, "moved in the hold"),
        ([*CLOSED, PUSHED, *LIFTED[3:]], GiveUp.NONE, "moved in closing"),
        ([*TRACKED, TIPPED, BACK], GiveUp.OFF_GOAL, "knocked over"),
        ([*LIFTED, TIPPED_IN_HAND, BACK], GiveUp.LOST_TOUCH, "slipped"),
    ],
)
def test_the_cause_follows_the_object_first_and_then_the_hand(records, reason, expected):
    assert cause(records, reason) == expected


def test_a_hand_that_never_met_the_object_says_what_prevented_it():
    waiting = record(9.0, GraspPhase.APPROACH)
    certificate = np.array([CatchLimit.SPEED, *np.full(4, np.nan)])
    slow = dataclasses.replace(waiting, catch_certificate=certificate)
    assert cause([TRACKED[0], slow]) == "not met: the palm is too slow"
    assert cause([TRACKED[0], waiting]) == "timed out"


def test_closing_begins_when_the_hand_has_met_an_object_on_its_way():
    coming = [record(0.1 * tick, GraspPhase.APPROACH, slid=0.1 * tick - 1.0) for tick in range(10)]
    met = [record(1.0, GraspPhase.TRACK), record(1.1, GraspPhase.CLOSE, slid=0.001)]
    motion = motion_of([*coming, *met], 0.0, is_carried=False)
    assert motion["moved_closing_mm"] == pytest.approx(1.0)
    assert motion["moved_before_mm"] is None


def test_every_reason_of_the_hand_has_a_cause():
    for reason in GiveUp:
        assert cause([*CLOSED, BACK], reason, [[ContactStatus.OUT_OF_REACH] * 5])


@pytest.mark.parametrize(
    ("status", "expected"),
    [
        (ContactStatus.OUT_OF_REACH, "no reach"),
        (ContactStatus.CROWDED_OUT, "crowded"),
        (ContactStatus.OBSTRUCTED, "obstructed"),
        (ContactStatus.NO_ALLOWED_SURFACE, "no allowed surface"),
    ],
)
def test_too_few_fingers_are_explained_by_the_limit_of_most_of_the_others(status, expected):
    statuses = [[1, 1, status, status, ContactStatus.LOST]]
    assert cause([*TRACKED, BACK], GiveUp.TOO_FEW_FINGERS, statuses) == expected


def test_an_object_that_lies_tilted_from_the_start_was_not_knocked_over():
    lying = [record(time, GraspPhase.TRACK, tilt=0.5) for time in (0.0, 1.0)]
    assert cause([*lying, BACK], GiveUp.MET_NOTHING) == "missed"
