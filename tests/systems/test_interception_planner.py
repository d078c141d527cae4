"""The interception planner: its palm meets the object, without jumps, and waits unless it can."""

import numpy as np
import pytest
from driven import Driven
from five_finger_hand import HAND
from made_systems import CONTROL_PERIOD, make_interception
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity

from drake_pregrasp.config.grasp_config import GraspConfig, MeetingConfig
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.palm_meeting import meeting_settings
from drake_pregrasp.estimation.pose_track import TrackingStatus
from drake_pregrasp.geometry.solids import BallSolid
from drake_pregrasp.grasping.catch_limits import CatchLimit
from drake_pregrasp.grasping.grasp_state import GraspPhase

HOME = np.array([0.0, 0.0, 0.2])
START, BELT = np.array([-0.8, 0.1, 0.05]), np.array([0.4, 0.0, 0.0])


class Belt:
    """A palm that waits at home, and an object on a belt."""

    def __init__(self, velocity=BELT, noise=0.0, **changes):
        self.v, self.noise, self.random = np.array(velocity), noise, np.random.default_rng(0)
        self.hand = Driven(
            make_interception(HOME, **changes),
            X_WO_estimated=RigidTransform(START),
            V_WO_estimated=SpatialVelocity(np.zeros(3), self.v),
            p_WO_covariance=1e-6 * np.eye(3).ravel(),
            tracking_status=[TrackingStatus.TRACKING],
            X_WG=RigidTransform(HOME),
            grasp_report=np.zeros(4),
        )
        self.time, self.turned = 0.0, RotationMatrix()

    def play(self, seconds):
        """Times, places and velocities of the palm, and certificates, at each tick."""
        rows = []
        for _ in range(round(seconds / CONTROL_PERIOD)):
            jump, drift = self.random.normal(0, self.noise, (2, 3))
            self.hand.fix(
                X_WO_estimated=RigidTransform(self.turned, self.place() + jump),
                V_WO_estimated=SpatialVelocity(np.zeros(3), self.v + drift),
            )
            rows.append(
                [self.time, self.hand.array("approach"), self.hand.array("catch_certificate")]
            )
            self.hand.tick()
            self.time += CONTROL_PERIOD
        times, approach, certificates = zip(*rows, strict=True)
        return np.array(times), np.array(approach), np.array(certificates)

    def place(self):
        return START + self.time * self.v


def test_the_palm_meets_the_object_with_its_velocity():
    belt = Belt()
    times, approach, certificates = belt.play(3.0)
    meeting = approach[5, 0]
    np.testing.assert_allclose(approach[5 : int(meeting / CONTROL_PERIOD), 0], meeting)
    np.testing.assert_allclose(certificates[5, :2], [CatchLimit.NONE, meeting])
    np.testing.assert_allclose(certificates[5, 2:], START + meeting * BELT, atol=1e-9)
    met = times >= meeting
    np.testing.assert_allclose(approach[met, 1:4], START + times[met, None] * BELT, atol=1e-9)
    np.testing.assert_allclose(approach[met, 4:], np.tile(BELT, (np.sum(met), 1)), atol=1e-9)
    # The velocity is the mean one until the next tick.
    steps = np.diff(approach[:, 1:4], axis=0) / CONTROL_PERIOD
    np.testing.assert_allclose(approach[1:-1, 4:], steps[1:], atol=1e-6)


def test_estimates_that_jump_do_not_make_the_palm_jump_on_its_way():
    noise = 0.002
    times, approach, _ = Belt(noise=noise).play(3.0)
    steps = np.diff(approach[:, 1:4], axis=0)
    # Until it is near, it takes up a jump over the rest of its way.
    early = times[2:] < approach[5, 0] - 1.0
    assert np.max(np.abs(np.diff(steps, axis=0))[early]) < noise / 2
    assert np.max(np.abs(np.diff(steps, axis=0))) < 6 * noise


def test_a_palm_that_sees_nothing_waits_and_one_on_its_way_stops():
    belt = Belt()
    belt.hand.fix(tracking_status=[TrackingStatus.LOST])
    _, approach, certificates = belt.play(0.2)
    np.testing.assert_allclose(approach[:, 1:], np.tile([*HOME, 0, 0, 0], (10, 1)), atol=1e-12)
    assert np.all(approach[:, 0] == np.inf)
    assert np.all(certificates[:, 0] == CatchLimit.SIGHT)
    belt.hand.fix(tracking_status=[TrackingStatus.TRACKING])
    _, moving, _ = belt.play(1.0)
    assert np.linalg.norm(moving[-1, 4:]) > 0.01
    belt.hand.fix(tracking_status=[TrackingStatus.LOST])
    _, stopped, _ = belt.play(0.5)
    steps = np.diff(stopped[:, 4:], axis=0) / CONTROL_PERIOD
    assert np.max(np.abs(steps)) < 10.0
    np.testing.assert_allclose(stopped[-1, 4:], 0, atol=1e-9)


def test_a_palm_waits_for_an_object_that_it_cannot_meet():
    _, approach, certificates = Belt(velocity=[2.0, 0.0, 0.0]).play(0.3)
    assert np.all(approach[:, 0] == np.inf)
    np.testing.assert_allclose(approach[:, 1:4], np.tile(HOME, (15, 1)), atol=1e-12)
    assert certificates[-1, 0] == CatchLimit.SPEED
    assert np.isnan(certificates[-1, 1:]).all()


@pytest.mark.parametrize(("velocity", "limit"), [([0.4, 2.5, 0], 3), ([1.2, 0.0, 0.0], 4)])
def test_a_final_meeting_is_given_up_if_the_object_can_no_longer_be_met(velocity, limit):
    belt = Belt()
    _, approach, _ = belt.play(0.1)
    meeting = approach[-1, 0]
    belt.play(meeting - belt.time - 0.1)
    before = belt.place()
    belt.v = np.array(velocity)
    belt.place = lambda: before + (belt.time - meeting + 0.1) * belt.v
    _, approach, certificates = belt.play(0.4)
    assert np.all(certificates[2:, 0] == limit)
    assert np.isnan(certificates[2:, 1:]).all()
    assert np.all(approach[2:, 0] == np.inf)
    steps = np.diff(approach[:, 1:4], axis=0) / CONTROL_PERIOD
    np.testing.assert_allclose(steps[-2:], 0, atol=1e-6)


def test_a_meeting_at_a_limit_stays_when_the_object_is_estimated_a_little_farther():
    def meets(away, factor=1.0):
        belt = Belt(velocity=[0.6, 0.0, 0.0])  # It leaves the travel along x.
        belt.place = lambda: np.array(
            [0.6 * belt.time - 0.5, away * (factor if belt.time > 0.1 else 1.0), 0.05]
        )
        return bool(np.all(np.isfinite(belt.play(0.2)[1][1:, 0])))

    near, far = 0.05, 0.9
    assert meets(near)
    for _ in range(12):
        middle = (near + far) / 2
        near, far = (middle, far) if meets(middle) else (near, middle)
    assert not meets(1.02 * near)
    assert meets(near, factor=1.02)
    assert not meets(near, factor=1.3)


def test_the_certificate_is_checked_until_the_hand_grips():
    belt = Belt()
    _, approach, _ = belt.play(0.1)
    meeting = approach[-1, 0]
    belt.play(meeting - belt.time + 0.02)
    belt.hand.fix(grasp_report=[GraspPhase.TRACK, meeting, 0, 0])
    _, _, certificates = belt.play(0.1)
    np.testing.assert_allclose(certificates[:, :2], np.tile([0, meeting], (5, 1)))
    belt.v = np.array([1.6, 0.0, 0.0])
    start = belt.time
    belt.place = lambda: START + [0.4 * start, 0, 0] + (belt.time - start) * belt.v
    _, _, certificates = belt.play(0.1)
    np.testing.assert_allclose(certificates[1:, :2], np.tile([3, meeting], (4, 1)))
    belt.hand.fix(tracking_status=[TrackingStatus.LOST])
    _, _, certificates = belt.play(0.1)
    assert np.all(certificates[1:, 0] == CatchLimit.SIGHT)
    belt.hand.fix(grasp_report=[GraspPhase.SQUEEZE, meeting, 0, 0])
    belt.hand.fix(tracking_status=[TrackingStatus.TRACKING])
    _, _, certificates = belt.play(0.1)
    assert np.all(certificates[1:, 0] == CatchLimit.SIGHT)  # It stays from then on.


def test_a_hand_that_approaches_again_starts_where_it_is_and_follows_the_object_until_then():
    belt = Belt()
    belt.hand.fix(grasp_report=[GraspPhase.BACK_OFF, 0, 0, 0])
    for _ in range(3):
        belt.hand.fix(X_WG=RigidTransform(belt.place() + np.array([0.0, 0.0, 0.15])))
        belt.play(CONTROL_PERIOD)
    belt.hand.fix(grasp_report=np.zeros(4))
    _, approach, _ = belt.play(0.04)
    np.testing.assert_allclose(approach[0, 4:], BELT, atol=1e-9)
    np.testing.assert_allclose(approach[0, 3], START[2] + 0.15)
    assert approach[1, 0] < np.inf


@pytest.mark.parametrize("turn", [0.0, 1.0, 2.0])
def test_a_palm_from_the_side_approaches_again_along_its_axis_which_has_turned(turn):
    R_LA = RotationMatrix.MakeYRotation(np.pi / 2)  # z of A is x of W at the start.
    belt = Belt(np.zeros(3), R_AW=R_LA.matrix().T, R_WO=np.eye(3))
    belt.turned = RotationMatrix.MakeZRotation(turn)
    back = belt.place() + 0.15 * belt.turned.col(0)
    belt.hand.fix(grasp_report=[GraspPhase.BACK_OFF, 0, 0, 0], X_WG=RigidTransform(back))
    belt.play(3 * CONTROL_PERIOD)
    belt.hand.fix(grasp_report=np.zeros(4))
    _, approach, _ = belt.play(0.04)
    np.testing.assert_allclose(approach[0, 1:4], back, atol=1e-9)


@pytest.mark.parametrize("degrees", [0, 30, 180])
def test_the_table_limits_a_palm_from_above_only(degrees):
    R_LA = RotationMatrix.MakeZRotation(np.radians(degrees)) @ RotationMatrix.MakeYRotation(
        np.pi / 2
    )
    ball = BallSolid(np.zeros(3), 0.05)
    for X_LA, is_above in ((RigidTransform(), True), (RigidTransform(R_LA, np.zeros(3)), False)):
        hand = HandModel(HAND.description, X_LA=X_LA)
        q = hand.home(np.array([0.0, 0.0, 0.05]), 0.0)
        settings = meeting_settings(
            GraspConfig(), hand, q, ball, 0.4, np.zeros(3), np.eye(3), 0.0, 0.0
        )
        own = hand.kinematics.lower[hand.base.joints[2]] - hand.base.p_AL[2]
        assert (settings.limits.lower[2] > own) == is_above


@pytest.mark.parametrize("predicts", [True, False])
def test_without_a_prediction_the_palm_goes_where_the_object_is(predicts):
    belt = Belt(meeting=MeetingConfig(predicts=predicts))
    _, _, certificates = belt.play(0.1)
    ahead = certificates[-1, 2] - belt.place()[0]
    assert (ahead > 0.2) == predicts
