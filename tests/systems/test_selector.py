"""Contact goals through the ports of their system: strategies, time, held and lost objects."""

import dataclasses

import numpy as np
import pytest
from broken_values import BAD_NUMBERS, NO_POSES
from driven import Driven
from five_finger_hand import points_of
from made_systems import (
    AROUND,
    PERIOD,
    X_WO,
    N,
    make_selector,
    partition,
    regions_of,
)
from pydrake.math import RigidTransform, RollPitchYaw

import drake_pregrasp as dp
from drake_pregrasp.contacts.assignment import ring_contacts
from drake_pregrasp.contacts.centroids import position_tracking, select_contacts
from drake_pregrasp.contacts.reassignment import ReassignmentRule
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import make_blend, make_strategy
from drake_pregrasp.errors import ContactError
from drake_pregrasp.regions.constraints import NO_CAUSE
from drake_pregrasp.regions.safe_regions import SafeRegions
from drake_pregrasp.systems import centroid_selector

COVARIANCE = np.diag([1e-6, 4e-6, 1e-6])
SKEWED = np.diag([4e-3, 1e-4, 1e-3])
LATER = RigidTransform(RollPitchYaw(0.1, 0.2, -0.7), [0.3, 0.1, 0.0])
STANDOFF = dp.PlannerConfig().lost_standoff
NOT_FOLLOWED = [dp.TrackingStatus.WAITING, dp.TrackingStatus.LOST, np.nan, 17.0, -np.inf]


class Selector(Driven):
    """A selector on its own; at each tick its regions are those of its goals."""

    def __init__(self, surface, p_OC, **settings):
        self.surface = surface
        super().__init__(
            make_selector(surface, p_OC, **settings),
            X_WO_estimated=X_WO,
            p_WO_covariance=COVARIANCE.ravel(),
            safe_regions=regions_of(surface, p_OC),
        )

    @property
    def stored(self):
        return self.context.get_discrete_state(1).value().reshape(-1, 3).copy()

    @property
    def goals(self):
        return self.array("p_WC").reshape(-1, 3)

    @property
    def targets(self):
        return points_of(self.eval("fingertip_targets"), [f"fingertip_{i}" for i in range(N)])

    def tick(self):
        super().tick()
        self.fix(safe_regions=regions_of(self.surface, self.stored))


@pytest.fixture
def selector(surface, p_OC):
    return Selector(surface, p_OC)


def in_world(p_OC, X=X_WO):
    return (X @ p_OC.T).T


def goals_of(surface, p_OC, covariance_W=COVARIANCE, strategy=position_tracking, **options):
    """The goals of a tick, in W."""
    R_OW = X_WO.rotation().inverse().matrix()
    covariance_O = R_OW @ covariance_W @ R_OW.T + 0.04**2 * np.eye(3)
    chosen = SelectionInput(surface, p_OC, regions_of(surface, p_OC), covariance_O)
    return in_world(select_contacts(chosen, strategy, **options).p_OC)


def test_goals_of_a_tick_are_the_same_before_and_after_it_stores_them(selector, surface, p_OC):
    before = selector.goals
    np.testing.assert_allclose(before, goals_of(surface, p_OC), atol=1e-12)
    np.testing.assert_array_equal(selector.array("contact_status"), dp.ContactStatus.ACTIVE)
    np.testing.assert_allclose(selector.array("p_WC_previous"), in_world(p_OC).ravel(), atol=1e-15)
    selector.update()
    np.testing.assert_array_equal(selector.goals, before)
    np.testing.assert_array_equal(selector.array("p_WC_previous"), before.ravel())


def test_the_covariance_is_turned_into_the_objects_frame(selector, surface, p_OC):
    selector.fix(p_WO_covariance=SKEWED.ravel())
    np.testing.assert_allclose(selector.goals, goals_of(surface, p_OC, SKEWED), atol=1e-12)


@pytest.mark.parametrize(
    ("settings", "strategy"),
    [
        ({"strategy": "vew", "power": 3.0}, make_strategy("vew", power=3.0)),
        ({"strategy": "margin", "friction": 0.3}, make_strategy("margin", friction=0.3)),
        ({"strategy": "margin", "in_turns": True}, make_strategy("margin")),
        (
            {"strategy": "blend", "blend": dp.BlendConfig(vew=1.0, position=2.0), "stretch": False},
            make_blend({"vew": 1, "position": 2}, stretch=False),
        ),
    ],
)
def test_settings_reach_the_strategy(surface, p_OC, settings, strategy):
    in_turns = settings.get("in_turns", False)
    expected = goals_of(surface, p_OC, strategy=strategy, in_turns=in_turns)
    np.testing.assert_allclose(Selector(surface, p_OC, **settings).goals, expected, atol=1e-12)


@pytest.mark.parametrize(
    "arguments",
    [
        *({name: 0.0} for name in ("period", "position_spread")),
        *({name: np.nan} for name in ("lost_standoff", "static_duration")),
        *({"strategy": name} for name in ("telepathy", "blend")),
        {"strategy": "blend", "blend": dp.BlendConfig(vew=-1.0)},
        {"strategy": "msv", "power": 0.0},
        {"strategy": "margin", "friction": -1.0},
        *({"p_OC": np.array(p)} for p in (np.zeros((1, 3)), [[0.05, 0, np.nan]], np.zeros((0, 3)))),
        {"fingertip_frames": ["only_one"]},
    ],
)
def test_bad_arguments_are_refused(surface, p_OC, arguments):
    with pytest.raises(dp.InvalidArgumentError):
        make_selector(surface, arguments.pop("p_OC", p_OC), **arguments)


@pytest.mark.parametrize(("label", "contacts"), [(-2, N), (N, N), (0, N - 1), (0, N + 1)])
def test_regions_of_other_contacts_are_refused(selector, surface, label, contacts):
    """Compiled code would read beside its arrays."""
    labels = np.full(len(surface.p_OQ), label)
    selector.fix(safe_regions=SafeRegions.unlimited(labels, contacts))
    with pytest.raises(dp.InvalidArgumentError, match="regions"):
        selector.eval("p_WC")


def test_static_contacts_stay_on_the_object_for_their_duration(surface, p_OC):
    selector = Selector(surface, p_OC, static_duration=4.0)
    for tick in (0, 1, 79):
        selector.at(tick * PERIOD)
        np.testing.assert_array_equal(selector.goals, in_world(p_OC))
    moved = -p_OC * [1, 1, -1]
    selector.context.get_mutable_discrete_state(1).SetFromVector(moved.ravel())
    np.testing.assert_allclose(selector.goals, in_world(moved), atol=1e-12)
    selector.at(80 * PERIOD)
    assert np.max(np.abs(selector.goals - in_world(moved))) > 1e-3


def test_fingertip_targets_look_into_the_object(surface, p_OC):
    names = [f"hand::tip_{i}" for i in range(N)]
    selector = Selector(surface, p_OC, fingertip_frames=names)
    expected = goals_of(surface, p_OC)
    normals = surface.project(in_world(expected, X_WO.inverse()))[1]
    for name, p_WCi, normal in zip(names, expected, normals, strict=True):
        X_WF = selector.eval("fingertip_targets").Find(name)
        np.testing.assert_allclose(X_WF.translation(), p_WCi, atol=1e-12)
        np.testing.assert_allclose(X_WF.rotation().col(2), X_WO.rotation() @ -normal, atol=1e-12)


def test_a_lost_contact_has_no_fingertip_target(selector, surface, p_OC):
    selector.fix(safe_regions=regions_of(surface, p_OC, np.array([0, 0, -np.inf, 0, 0])))
    targets = selector.eval("fingertip_targets")
    assert [targets.Find(f"fingertip_{i}") is not None for i in range(N)] == [1, 1, 0, 1, 1]


def test_goals_are_verified_if_settings_say_so(surface, p_OC, monkeypatch):
    """With a defect put in: goals that hover over the object."""

    def hovering(selection, strategy, **_):
        goals = centroid_selector.hold_contacts(selection)
        return dataclasses.replace(goals, p_OC=goals.p_OC + 2e-4 * surface.project(p_OC)[1])

    monkeypatch.setattr(centroid_selector, "select_contacts", hovering)
    Selector(surface, p_OC).numbers()
    with pytest.raises(ContactError, match=r"contact 0 is 0.2 mm off the object"):
        Selector(surface, p_OC, verify_contacts=True).numbers()


def test_the_status_of_each_contact_is_emitted_with_its_cause(selector, surface, p_OC):
    balls = dp.Obstacles(
        (dp.BallSolid(np.array([9.0, 0, 0]), 0.1), dp.BallSolid(X_WO @ p_OC[1], 0.05))
    )
    reach = [None, None, dp.BallReach(center=[9.0, 0, 0], radius=0.1), None, None]
    selector.fix(safe_regions=partition(surface, p_OC, {"obstacles": balls}, reach=reach))
    status, causes = selector.array("contact_status"), selector.array("contact_causes")
    assert (status[1], causes[1]) == (dp.ContactStatus.OBSTRUCTED, 1)
    assert (status[2], causes[2]) == (dp.ContactStatus.OUT_OF_REACH, NO_CAUSE)
    np.testing.assert_allclose(selector.goals[1:3], in_world(p_OC)[1:3])
    before = selector.array("p_WC"), status, causes
    selector.update()
    for time in (0.0, 0.02):  # Between ticks what is stored holds.
        selector.at(time)
        for port, value in zip(("p_WC", "contact_status", "contact_causes"), before, strict=True):
            np.testing.assert_array_equal(selector.array(port), value)


def test_held_contacts_on_the_forbidden_surface_are_inactive(surface, p_OC):
    p_OC = np.vstack([[0.0, 0.0, 0.05], p_OC[1:]])
    open_top = dataclasses.replace(surface, forbidden=dp.ForbiddenPoints.none())
    status = Selector(open_top, p_OC, static_duration=1.0).array("contact_status")
    assert list(status) == [dp.ContactStatus.NO_ALLOWED_SURFACE, 1, 1, 1, 1]


@pytest.mark.parametrize("hold", [1.0, np.nan])
def test_a_hand_that_closes_holds_goals_where_they_are_on_the_object(selector, hold):
    selector.update()
    stored, status = selector.stored, selector.array("contact_status")
    selector.at(PERIOD, X_WO_estimated=LATER, p_WO_covariance=SKEWED.ravel())
    moving = selector.goals
    selector.fix(hold_contacts=[hold])
    np.testing.assert_allclose(selector.goals, in_world(stored, LATER), atol=1e-12)
    np.testing.assert_array_equal(selector.array("contact_status"), status)
    assert not np.allclose(selector.goals, moving)
    selector.fix(hold_contacts=[0.0])
    np.testing.assert_array_equal(selector.goals, moving)


@pytest.mark.parametrize("status", NOT_FOLLOWED)
def test_goals_stay_on_a_lost_object_and_targets_off_it(selector, surface, status):
    selector.tick()
    held, known = selector.stored, selector.array("contact_status")
    selector.fix(tracking_status=[float(status)], X_WO_estimated=LATER)
    for _ in range(3):
        np.testing.assert_allclose(selector.goals, in_world(held, LATER), atol=1e-12)
        np.testing.assert_array_equal(selector.array("contact_status"), known)
        normals = (LATER.rotation() @ surface.project(held)[1].T).T
        np.testing.assert_allclose(selector.targets - selector.goals, STANDOFF * normals, 0, 1e-12)
        selector.tick()
        np.testing.assert_array_equal(selector.stored, held)


@pytest.mark.parametrize("status", [dp.TrackingStatus.TRACKING, dp.TrackingStatus.COASTING])
def test_goals_go_on_while_the_object_is_followed(selector, surface, p_OC, status):
    told = Selector(surface, p_OC)
    told.fix(tracking_status=[float(status)])
    for _ in range(3):
        np.testing.assert_array_equal(told.numbers(), selector.numbers())
        np.testing.assert_allclose(told.targets, told.goals, atol=1e-12)
        selector.tick()
        told.tick()


def test_goals_keep_to_their_limits_when_the_object_is_found_again(surface, p_OC):
    step = 0.002
    selector = Selector(surface, p_OC, limits={"max_step": step})
    moved = 0.0
    for tick in range(12):
        lost = 3 <= tick < 8
        selector.fix(tracking_status=[3.0 if lost else 1.0])
        before = selector.stored
        selector.tick()
        ways = np.linalg.norm(selector.stored - before, axis=1)
        assert np.max(ways) <= step + 1e-12
        assert not lost or np.max(ways) == 0
        moved = max(moved, np.max(ways) * (tick >= 8))
    assert moved > step / 2


def test_nothing_is_planned_before_the_object_is_first_seen(selector):
    selector.fix(tracking_status=[float(dp.TrackingStatus.WAITING)])
    selector.tick()
    np.testing.assert_array_equal(selector.array("contact_status"), dp.ContactStatus.INACTIVE)
    selector.fix(tracking_status=[float(dp.TrackingStatus.TRACKING)])
    assert np.all(selector.array("contact_status") > 0)


@pytest.mark.parametrize("X", NO_POSES)
def test_without_a_pose_goals_stay_where_the_object_was_last(selector, X):
    selector.tick()
    selector.fix(X_WO_estimated=LATER)
    selector.tick()
    held = selector.stored
    selector.fix(X_WO_estimated=X)
    for _ in range(2):
        np.testing.assert_allclose(selector.goals, in_world(held, LATER), atol=1e-12)
        np.testing.assert_array_equal(selector.array("p_WC_previous"), selector.array("p_WC"))
        off = np.linalg.norm(selector.targets - selector.goals, axis=1)
        np.testing.assert_allclose(off, STANDOFF, atol=1e-12)
        selector.tick()
    selector.fix(X_WO_estimated=X_WO)
    np.testing.assert_allclose(selector.array("p_WC_previous"), in_world(held).ravel())


@pytest.mark.parametrize("value", [*BAD_NUMBERS, -1.0])
def test_any_covariance_leaves_goals_on_the_surface(selector, surface, value):
    selector.fix(p_WO_covariance=np.full(9, value))
    p_OC = in_world(selector.goals, X_WO.inverse())
    nearest, _ = surface.project(p_OC)
    assert np.max(np.abs(nearest - p_OC)) < 1e-9
    assert np.all(selector.array("contact_status") > 0)


def turned_hand(turn):
    return X_WO @ RigidTransform(RollPitchYaw(0, 0, turn), np.zeros(3))


class Reassigned(Selector):
    """A selector of fixed contacts on a ring, under a hand that turns."""

    def __init__(self, surface, **rule):
        limits = {
            "reach": [dp.SectorReach(azimuth=azimuth) for azimuth in AROUND],
            "reassign": ReassignmentRule(**{"beyond": 0.03, "every": 3 * PERIOD, **rule}),
        }
        p_OC = ring_contacts(surface, N)
        super().__init__(surface, p_OC, static_duration=100.0, limits=limits)
        self.reach = {"reach": limits["reach"]}
        self.turn(0.0)

    def turn(self, turn):
        inputs = {"X_WH": turned_hand(turn)}
        self.fix(safe_regions=partition(self.surface, self.stored, inputs, **self.reach))

    def next_goals(self, turn):
        self.advance(self.period)
        self.turn(turn)
        return self.goals


def test_fingers_take_the_contacts_that_turn_towards_them(surface):
    selector = Reassigned(surface, symmetric=False)
    start = selector.goals
    np.testing.assert_array_equal(selector.next_goals(0.4), start)
    np.testing.assert_array_equal(selector.next_goals(1.2), np.roll(start, -1, axis=0))
    after = selector.goals
    selector.update()
    np.testing.assert_array_equal(selector.goals, after)
    np.testing.assert_array_equal(selector.array("p_WC_previous"), after.ravel())
    for _ in range(2):  # Too soon after the last change.
        np.testing.assert_array_equal(selector.next_goals(2.4), after)
    np.testing.assert_array_equal(selector.next_goals(2.4), np.roll(start, -2, axis=0))


@pytest.mark.parametrize(
    "inputs", [{"hold_contacts": [1.0]}, {"tracking_status": [float(dp.TrackingStatus.LOST)]}]
)
def test_fingers_that_hold_their_contacts_keep_them(surface, inputs):
    selector = Reassigned(surface)
    start = selector.goals
    selector.advance(selector.period)
    selector.fix(**inputs)
    selector.turn(1.2)
    np.testing.assert_array_equal(selector.goals, start)


def test_a_turning_hand_never_runs_out_of_reach_of_an_equivalent_grasp(surface):
    least = {}
    for beyond in (0.0, 0.03):
        selector = Reassigned(surface, beyond=beyond, every=0.0)
        counts = []
        for turn in np.arange(0, 7, 0.2):
            selector.next_goals(turn)
            counts.append(np.sum(selector.array("contact_status") > 0))
        least[beyond] = min(counts)
    assert least == {0.0: 0, 0.03: N}
