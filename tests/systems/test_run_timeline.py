"""The timeline of a run: what it tells, and when."""

import base64
import json

import numpy as np
import pytest
from pydrake.math import RigidTransform

from drake_pregrasp import CatchLimit, ContactStatus, GiveUp, GraspPhase, TrackingStatus
from drake_pregrasp.systems.loggers import GraspRecord, TickRecord
from drake_pregrasp.visualization.run_timeline import RunTimeline


def tick(time, statuses=(1, 1), causes=(-1, -1), tracking=TrackingStatus.TRACKING):
    X = RigidTransform()
    contacts = (np.zeros((2, 3)), np.array(statuses, dtype=float), np.array(causes, dtype=float))
    quality = np.array([2.0, 0.99, 100, 1, 0])
    return TickRecord(time, *contacts, quality, None, X, X, 0.0, tracking, 0.0)


def grasp_record(time, phase, reason=GiveUp.NONE, catch_certificate=None):
    zeros, X, report = np.zeros((2, 3)), RigidTransform(), np.array([phase, time, reason, 0.0])
    certificate = np.full(5, np.nan) if catch_certificate is None else catch_certificate
    return GraspRecord(time, report, zeros, zeros, zeros, X, X, X, np.zeros(3), certificate)


def events_of(*ticks, **options):
    timeline = RunTimeline("title", 2, **options)
    for record in ticks:
        timeline.add_tick(record)
    return timeline.data()["events"]


@pytest.mark.parametrize(
    ("status", "told"),
    [
        (ContactStatus.LOST, "finger 1 out of use"),
        (ContactStatus.OUT_OF_REACH, "finger 1 out of reach"),
        (ContactStatus.OBSTRUCTED, "finger 1 obstructed by the lamp"),
        (ContactStatus.HARDLY_IN_REACH, None),  # It is still active.
    ],
)
def test_a_contact_that_ends_or_returns_is_told_once(status, told):
    during = [tick(t, (1, status), (-1, 7)) for t in (0.1, 0.2)]
    events = events_of(tick(0.0), *during, tick(0.3), obstacle_names={7: "the lamp"})
    assert events == ([(0.1, told), (0.3, "finger 1 has a goal again")] if told else [])


def test_goals_that_fingers_get_as_the_object_is_found_are_no_events():
    nothing = (ContactStatus.LOST, ContactStatus.LOST)
    waits = [tick(t, nothing, tracking=TrackingStatus.WAITING) for t in (0.0, 0.1)]
    assert events_of(*waits, tick(0.2)) == []
    assert events_of(*waits, tick(0.2), tick(0.3, nothing)) != []


def test_fingers_of_a_hand_have_the_names_of_their_fingertips():
    timeline = RunTimeline("title", 2, fingertips=["index", "thumb"])
    timeline.add_tick(tick(0.0))
    timeline.add_tick(tick(0.1, (ContactStatus.HARDLY_IN_REACH, ContactStatus.LOST)))
    assert timeline.data()["names"] == ["finger 0 (index)", "finger 1 (thumb)"]
    assert timeline.data()["events"] == [(0.1, "finger 1 (thumb) out of use")]
    assert timeline.states["0"].startswith("active")  # As which the page shows it.


def test_a_hand_that_waits_says_when_it_meets_the_object_or_why_it_cannot():
    shown = []
    for waits in (True, False):
        timeline = RunTimeline("title", 2, waits=waits)
        for phase, limit in (
            (GraspPhase.APPROACH, CatchLimit.SPEED),
            (GraspPhase.APPROACH, CatchLimit.NONE),
            (GraspPhase.TRACK, CatchLimit.NONE),
        ):
            record = grasp_record(0.1, phase, catch_certificate=np.array([limit, 1.23, 0, 0, 0]))
            timeline.add_grasp(record)
            shown.append(timeline.states.get("meeting"))
    reason = "not possible, because the palm is too slow"
    assert shown == [reason, "planned at 1.2 s", "done", None, None, None]


def test_the_end_of_the_static_phase_and_a_lost_object_are_told():
    lost = [tick(0.3, tracking=TrackingStatus.COASTING), tick(0.4, tracking=TrackingStatus.LOST)]
    events = events_of(tick(0.0), tick(0.1), tick(0.2), *lost, tick(0.5), static_end=0.2)
    assert [time for time, _ in events] == [0.2, 0.3, 0.4, 0.5]
    assert [text.split(":")[0] for _, text in events] == [
        "contacts adapt",
        "object not confirmed",
        "object lost from sight",
        "object tracked",
    ]


def test_phases_of_a_grasp_are_told_with_the_reason_to_give_up():
    timeline = RunTimeline("title", 2)
    phases = (GraspPhase.TRACK, GiveUp.NONE), (GraspPhase.BACK_OFF, GiveUp.TOLD_TO_OPEN)
    for time, (phase, reason) in enumerate(phases):
        timeline.add_grasp(grasp_record(float(time), phase, reason))
    (_, first), (at, second) = timeline.data()["events"]
    assert first == "hand follows the object"
    assert at == 1.0
    assert second.startswith("hand backs off, because ")


def test_the_present_is_short_and_a_page_is_safe_from_its_title():
    timeline = RunTimeline("</script><script>alert(1)</script>", 2)
    for k in range(500):
        timeline.add_tick(tick(0.1 * k, (1, 1 if k % 2 else -4)))
    assert len(json.dumps(timeline.now())) < 2000
    assert timeline.now()["changes"][-1][1:] == ("1", "active")
    page = timeline.added_to("<body></body>")
    assert "alert(1)</script>" not in page
    assert page.count("</body>") == 1


def test_a_page_gets_all_pictures_and_the_present_the_newest_of_each_camera():
    timeline = RunTimeline("title", 2)
    for k in range(30):
        for camera in range(2):
            timeline.add_picture(0.1 * k, camera, f"{k}/{camera}".encode())
    pictures = timeline.data()["pictures"]
    assert len(pictures) == 60
    assert pictures[-2][:2] == (pytest.approx(2.9), 0)
    newest = [source for _, _, source in timeline.now()["pictures"]]
    assert newest == [source for _, _, source in pictures[-2:]]
    assert base64.b64decode(newest[1].partition(",")[2]) == b"29/1"
