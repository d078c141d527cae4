"""Trials of a study: goals of the methods, their diagrams, and outcomes of grasps."""

import dataclasses
import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from driven import Driven
from five_finger_hand import AROUND, FRAMES
from made_up_jobs import write_study
from made_up_records import motion_of, record, state_of
from pydrake.math import RigidTransform, RotationMatrix

from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.config.limits_config import LimitsConfig
from drake_pregrasp.config.object_config import Box, Conveyor, Cylinder, Mesh
from drake_pregrasp.contacts.assignment import wrapped
from drake_pregrasp.contacts.selection_input import ContactStatus
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.geometry.solids import BallSolid, BoxSolid, HalfSpace
from drake_pregrasp.grasping.catch_limits import CatchLimit
from drake_pregrasp.grasping.grasp_state import GiveUp, GraspPhase, GraspState
from drake_pregrasp.grasping.held_criterion import HOLD_DURATION, SHAKE_END
from drake_pregrasp.regions.constraints import Obstacles
from drake_pregrasp.simulation.hand_file import load_hand
from drake_pregrasp.simulation.scenario_file import read_mapping
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.studies.grasps import grasp_outcome, grasp_trial
from drake_pregrasp.studies.grasps.baseline_goals import (
    RayTarget,
    ReactiveChoice,
    StationaryHand,
    antipodal_grasps,
    rays_at,
)
from drake_pregrasp.studies.grasps.fitting_objects import fits, opening
from drake_pregrasp.studies.grasps.goal_sources import GOAL_SOURCES
from drake_pregrasp.studies.study_file import load_study, shipped_studies
from drake_pregrasp.studies.study_run import REFUSED, UNFIT, StudyRun

CUBE = BoxSolid(np.zeros(3), np.eye(3), np.full(3, 0.1))
CORNERS = 0.05 * np.array(list(itertools.product((-1, 1), repeat=3)))
TARGET = RayTarget(CUBE, CORNERS, np.zeros(3))


def stationary_hand(close, *, obstacles=(), yaw=0.3):
    limits = LimitsConfig(tip_radii=[0.009] * 5, standoff=0.02, clearance=0.004)
    system = StationaryHand(FRAMES, azimuths=AROUND, target=TARGET, limits=limits)
    X_WO = RigidTransform(RotationMatrix.MakeZRotation(yaw), [0.2, 0.1, 0.05])
    driven = Driven(
        system,
        X_WO_estimated=X_WO,
        contact_weights=[0, 0, 0, 0, -np.inf],
        obstacles=Obstacles(tuple(obstacles)),
    )
    system.set_time(driven.context, 0.0 if close else np.inf)
    return driven.eval("fingertip_targets"), driven.eval("contact_status"), X_WO


@pytest.mark.parametrize("yaw", [0.0, 0.3, 1.0])
def test_a_stationary_hand_waits_on_a_ring_and_closes_along_its_rays(yaw):
    waiting, status, X_WO = stationary_hand(False, yaw=yaw)
    closed, _, _ = stationary_hand(True, yaw=yaw)
    assert list(status) == [ContactStatus.ACTIVE] * 4 + [ContactStatus.LOST]
    for name, azimuth in zip(FRAMES, AROUND, strict=True):
        X_WC = waiting.Find(name)
        tip = X_WC.translation() - 0.029 * X_WC.rotation().matrix()[:, 2]
        on_ring = 0.092 * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        np.testing.assert_allclose(tip - X_WO.translation(), on_ring, atol=1e-12)
        X_OC = X_WO.inverse() @ closed.Find(name)
        assert abs(CUBE.distance(X_OC.translation()[None])[0]) < 1e-9
        outside = X_OC.translation() - 1e-6 * X_OC.rotation().matrix()[:, 2]
        assert CUBE.distance(outside[None])[0] == pytest.approx(1e-6, abs=1e-9)
        ray = closed.Find(name).translation() - X_WO.translation()
        assert wrapped(np.arctan2(ray[1], ray[0]) - azimuth) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("close", [False, True])
def test_a_stationary_hand_withdraws_fingers_that_would_be_near_obstacles(close):
    wall = HalfSpace(np.array([0.25, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]))
    _, status, _ = stationary_hand(close, obstacles=[wall])
    assert (status[0], status[2]) == (ContactStatus.OBSTRUCTED, ContactStatus.ACTIVE)


class Reactive(Driven):
    """A reactive choice of a grasp of a cube at the origin of W, whose inputs can be changed."""

    def __init__(self, radii=(0.009,) * 5):
        limits = LimitsConfig(tip_radii=[*radii], standoff=0.02, clearance=0.004)
        system = ReactiveChoice(FRAMES, target=TARGET, limits=limits, period=0.05)
        super().__init__(system, X_WO_estimated=RigidTransform(), contact_weights=np.zeros(5))
        self.fix(obstacles=Obstacles(), p_WT=self.tips(0.0))

    @staticmethod
    def tips(turn):
        return 0.092 * rays_at(AROUND + turn).ravel()

    def choose(self):
        """Returns the contacts by finger, and the status, after a tick."""
        self.tick()
        value = self.eval("fingertip_targets")
        found = {finger: value.Find(name) for finger, name in enumerate(FRAMES)}
        contacts = {finger: X_WC for finger, X_WC in found.items() if X_WC is not None}
        status = self.eval("contact_status")
        for finger, X_WC in contacts.items():
            assert status[finger] == ContactStatus.ACTIVE
            assert abs(CUBE.distance(X_WC.translation()[None])[0]) < 1e-9
        return contacts, status


def test_the_nearest_antipodal_grasp_is_chosen_by_three_fingers():
    contacts, status = Reactive().choose()
    # Finger 0 is over the face +x, fingers 2 and 3 are to either side of -x.
    assert sorted(contacts) == [0, 2, 3]
    thumb, left, right = (contacts[finger].translation() for finger in (0, 2, 3))
    np.testing.assert_allclose(thumb, [0.05, 0, 0], atol=1e-9)
    np.testing.assert_allclose((left + right) / 2, -thumb, atol=1e-9)
    assert left[1] > 0 > right[1]
    inward = {finger: X_WC.rotation().matrix()[:, 2] for finger, X_WC in contacts.items()}
    np.testing.assert_allclose([inward[0], -inward[2], -inward[3]], [[-1, 0, 0]] * 3, atol=1e-9)
    assert status[[1, 4]].tolist() == [ContactStatus.INACTIVE] * 2


@pytest.mark.parametrize(("side", "is_free"), [(1, [0, 1, 1, 1, 1]), (-1, [1, 1, 0, 0, 1])])
def test_each_finger_of_a_grasp_has_room_for_its_own_fingertip(side, is_free):
    """Finger 0 is over the face +x, fingers 2 and 3 over -x; there is no room for a large one."""
    wall = HalfSpace(np.array([0.095 * side, 0.0, 0.0]), np.array([-1.0 * side, 0.0, 0.0]))
    for large, free in enumerate(is_free):
        reactive = Reactive(np.where(np.arange(5) == large, 0.012, 0.009))
        reactive.fix(obstacles=Obstacles([wall]))
        contacts, _ = reactive.choose()
        faces = [int(np.argmax(np.abs(contacts[finger].translation()))) for finger in (0, 2)]
        assert (faces == [0, 0]) == bool(free)


@pytest.mark.parametrize(
    ("solid", "corners", "count", "angle"),
    [
        (CUBE, CORNERS, 12, 1e-6),
        (BallSolid(np.zeros(3), 0.05), CORNERS, 24, 0.42),  # Beside its middle it is too steep.
        (BoxSolid(np.zeros(3), np.eye(3), np.array([0.3, 0.02, 0.02])), CORNERS, 2, 1e-6),
    ],
)
def test_grasps_are_opposed_on_the_surface_and_within_friction(solid, corners, count, angle):
    corners = corners * [3, 0.2, 0.2] if count == 2 else corners
    points, normals = antipodal_grasps(RayTarget(solid, corners, np.zeros(3)), 0.009)
    assert len(points) >= count
    np.testing.assert_allclose(solid.distance(points.reshape(-1, 3)), 0, atol=1e-6)
    thumb, fingers = points[:, 0], points[:, 1:]
    line = thumb - fingers.mean(axis=1)
    line /= np.linalg.norm(line, axis=1, keepdims=True)
    for contact, sign in ((0, 1), (1, -1), (2, -1)):
        assert np.all(sign * np.sum(normals[:, contact] * line, axis=1) >= np.cos(angle + 1e-6))
    assert np.min(np.linalg.norm(fingers[:, 0] - fingers[:, 1], axis=1)) >= 0.018


def test_an_object_too_narrow_for_two_fingertips_has_no_grasp():
    pin = BoxSolid(np.zeros(3), np.eye(3), np.full(3, 0.02))
    points, _ = antipodal_grasps(RayTarget(pin, 0.2 * CORNERS, np.zeros(3)), 0.009)
    assert len(points) == 0


def test_another_grasp_is_chosen_only_if_it_is_better_by_the_margin():
    turns = np.radians(np.arange(0, 91, 2))
    choices = []
    for order in (turns, turns[::-1]):
        hand = Reactive()
        hand.fix(p_WT=hand.tips(order[0]))
        found = []
        for turn in order:
            hand.fix(p_WT=hand.tips(turn))
            found.append(
                {f: X.translation().round(6).tolist() for f, X in hand.choose()[0].items()}
            )
        choices.append(found)
    up, down = choices[0], choices[1][::-1]
    assert up[0] != up[-1]
    kept = sum(one != other for one, other in zip(up, down, strict=True))
    assert kept >= 3  # Near the turns at which two grasps cost the same.


def test_lost_fingers_and_obstructed_grasps_are_not_chosen():
    hand = Reactive()
    hand.choose()
    hand.fix(contact_weights=np.array([0, 0, -np.inf, 0, 0]))
    contacts, status = hand.choose()
    assert len(contacts) == 3
    assert status[2] == ContactStatus.LOST
    wall = HalfSpace(np.array([0.06, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]))
    hand.fix(obstacles=Obstacles((wall,)))
    contacts, _ = hand.choose()
    normals = np.array([X_WC.rotation().matrix()[:, 2] for X_WC in contacts.values()])
    np.testing.assert_allclose(np.abs(normals[:, 1]), 1, atol=1e-9)
    around = [HalfSpace(0.06 * ray, -ray) for ray in rays_at(np.pi / 2 * np.arange(4))]
    hand.fix(obstacles=Obstacles(tuple(around)))
    contacts, status = hand.choose()
    assert not contacts
    assert (
        status.tolist()
        == [ContactStatus.OBSTRUCTED] * 2 + [ContactStatus.LOST] + [ContactStatus.OBSTRUCTED] * 2
    )


def outcome_of(records, statuses=(), reason=GiveUp.NONE):
    first = GraspState.first(5, GraspConfig().make_settings())
    state = dataclasses.replace(first, active=np.array([True] * 4 + [False]), reason=reason)
    resolved = SimpleNamespace(
        surface=SimpleNamespace(p_OCoM=np.zeros(3)),
        scenario=SimpleNamespace(motion=Conveyor(), grasp=GraspConfig(shake=True)),
    )
    return grasp_outcome.grasp_outcome(resolved, 2.0, records, statuses, state)


def good_grasp(**last):
    hold = {"since": 4.5, "lift": 0.1, "slid": 0.003}
    return [
        record(0.0, GraspPhase.TRACK),
        record(2.0, GraspPhase.TRACK, slid=0.001),
        record(2.3, GraspPhase.CLOSE, slid=0.001),
        record(3.0, GraspPhase.SQUEEZE, slid=0.002, links=(0.1, 0.2, 0.3)),
        record(3.5, GraspPhase.LIFT, slid=0.003),
        record(4.5, GraspPhase.HOLD, **hold),
        record(4.5 + HOLD_DURATION, GraspPhase.HOLD, **hold),
        record(4.5 + SHAKE_END, GraspPhase.HOLD, **hold | last),
    ]


def test_a_grasp_is_read_from_what_was_seen():
    expected = {
        "held": True,
        "clean": True,
        "fingers": 4,
        "waited_s": 0.3,
        "link_on_object_n": 0.1,
        "link_on_surroundings_n": 0.2,
        "link_on_hand_n": 0.3,
        "withdrawn": 1,
        "cause": "",
    }
    statuses = [(1, 1, ContactStatus.OUT_OF_REACH, ContactStatus.LOST, 1)] * 3
    outcome = outcome_of(good_grasp(), statuses)
    found = {name: getattr(outcome, name) for name in expected}
    assert found == pytest.approx(expected, abs=1e-3, nan_ok=True)
    assert {"held": True, **outcome.motion} == motion_of(good_grasp(), 2.0)


@pytest.mark.parametrize("limits", [(CatchLimit.NONE, CatchLimit.SPEED, CatchLimit.SIGHT), ()])
def test_the_wait_says_how_often_a_meeting_is_possible(limits):
    waiting = [record(0.1 * k, GraspPhase.APPROACH) for k in range(len(limits))]
    for each, limit in zip(waiting, limits, strict=True):
        each.catch_certificate[0] = limit
    found = outcome_of([*waiting, *good_grasp()[1:]]).catchable
    assert found == pytest.approx(1 / 3 if limits else np.nan, nan_ok=True)


@pytest.mark.parametrize("touched", range(3))
def test_a_grasp_in_which_a_link_touches_anything_at_any_tick_is_held_but_not_clean(touched):
    for force, clean in ((0.34, True), (0.35, False)):
        records = good_grasp()
        records[1].link_forces[touched] = force
        outcome = outcome_of(records)
        assert (outcome.held, outcome.clean) == (True, clean)


def test_what_moves_too_far_is_neither_held_nor_clean():
    outcome = outcome_of(good_grasp(sunk=0.006))
    assert (outcome.held, outcome.clean, outcome.cause) == (False, False, "moved in the shake")


def test_a_grasp_that_gave_up_says_why():
    records = [*good_grasp()[:3], record(3.0, GraspPhase.BACK_OFF)]
    outcome = outcome_of(records, reason=GiveUp.OUT_OF_BALANCE)
    assert (outcome.held, outcome.clean) == (False, False)
    assert outcome.motion["moved_lift_mm"] is None
    assert outcome.gave_up.startswith("no squeeze balances the weight")


METHODS = list(read_mapping(shipped_studies()["static_versus_dynamic"])["methods"])


@pytest.fixture(scope="module")
def study():
    """The study with a seed that its results do not use."""
    return load_study("static_versus_dynamic", first_seed=3)


def trial_of(study, condition, method):
    chosen = {"condition": condition, "method": method}
    job = next(job for job in study.jobs() if chosen.items() <= job.items())
    return StudyRun(study, GOAL_SOURCES).trial(job)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["stationary", "reactive", "dynamic_reach"])
def test_each_source_can_be_tracked_and_set_back(study, method):
    trial = trial_of(study, "headline", method)
    trial.track(0.2)
    assert len(trial.statuses) == 4
    saved, before = trial.context.Clone(), state_of(trial.context)
    trial.track(0.4)
    assert not np.array_equal(state_of(trial.context), before)
    trial.context.SetTimeStateAndParametersFrom(saved)
    np.testing.assert_array_equal(state_of(trial.context), before)


def graph(diagram):
    """Names of systems, and connections from and to their ports."""
    name = {system: system.get_name() for system in diagram.GetSystems()}
    links = {
        (
            f"{name[source]}.{source.get_output_port(k).get_name()}",
            f"{name[target]}.{target.get_input_port(j).get_name()}",
        )
        for (target, j), (source, k) in diagram.connection_map().items()
    }
    return set(name.values()), links


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_the_diagram_of_a_method_is_that_of_a_run_but_for_the_source_of_goals(study, method):
    trial = trial_of(study, "turning", method)
    run = make_diagram(trial.resolved, sink=lambda record: None, grasp_sink=lambda record: None)
    (systems, links), (known, usual) = graph(trial.diagram), graph(run)
    assert known <= systems
    assert systems - known == ({"goal_source"} if study.methods[method].goals else set())
    goals = {f"hand_controller.{port}" for port in ("fingertip_targets", "contact_status")}
    for source, target in links ^ usual:
        assert "goal_source" in (source.split(".")[0], target.split(".")[0]) or target in goals
    assert {target for _, target in links} - {target for _, target in usual} <= {
        f"goal_source.{port}" for port in ("X_WO_estimated", "contact_weights", "obstacles", "p_WT")
    }
    assert ("pregrasp_planner.tracking_status", "hand_controller.tracking_status") in links


@pytest.mark.slow
def test_earlier_closing_times_change_nothing(study, monkeypatch):
    monkeypatch.setattr(grasp_trial, "SHAKE_END", 0.2)  # The grasp counts as ended soon.
    some, none = (trial_of(study, "headline", "dynamic_reach") for _ in range(2))
    first, last = some.outcomes((0.2, 0.4))
    (alone,) = none.outcomes((0.4,))
    assert (first.close_at, last.close_at) == (0.2, 0.4)
    assert some.statuses == none.statuses
    assert len(some.ticks) == len(none.ticks)
    assert repr(last) == repr(alone)  # In which nan is as nan is.


HAND = HandModel(load_hand("package://drake_pregrasp/five_finger_hand.yaml"))


def test_objects_fit_if_some_width_is_in_the_opening_and_a_tip_reaches_under_their_top():
    limits = (0.02, 0.08)
    assert fits(Box([0.2, 0.05, 0.05]).make_shape(), limits)
    assert not fits(Box([0.2, 0.09, 0.05]).make_shape(), limits)
    assert not fits(Cylinder(0.005, 0.1).make_shape(), limits)
    assert not fits(Box([0.2, 0.05, 0.012]).make_shape(), limits)
    # Two fingertips of the shipped hand have held boxes of 206 mm.
    least, largest = opening(HAND, 0.02)
    assert least == pytest.approx(0.018)
    assert 0.206 < largest < 0.4


@pytest.mark.parametrize("standoff", [0.01, 0.02])
def test_jaws_are_open_by_their_stroke_without_both_standoffs(standoff):
    gripper = HandModel(load_hand("package://drake_pregrasp/gripper.yaml"))
    assert opening(gripper, standoff)[1] == pytest.approx(0.11 - 2 * standoff, abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("standoff", "cause"), [(0.008, REFUSED), (0.02, UNFIT)])
def test_the_standoff_of_the_scenario_decides_what_fits(standoff, cause, tmp_path, monkeypatch):
    wide = Box([0.09, 0.12, 0.05]).make_shape()
    monkeypatch.setattr(Mesh, "make_shape", lambda self: wide)
    hand = {"hand.file": "package://drake_pregrasp/gripper.yaml"}
    # What fits is refused, because the belt leaves the carrier behind.
    fast = {"motion.linear_velocity": 1.0, "grasp.standoff": standoff, "initial_contacts": []}
    random = {"object": {"random_objects": [100, 999]}}
    study = load_study(grasp_study(tmp_path, random=random, overrides={**hand, **fast}))
    ((row,),) = [StudyRun(study, {})(job) for job in study.jobs()]
    assert row["cause"] == cause


def grasp_study(tmp_path, **changes):
    """A study of grasps in which a method differs in its goals."""
    base = {"scenario": "grasp_five_finger", "grid": {}, "seeds": 1, "measures": ["held", "clean"]}
    overrides = {"plant_config": {"time_step": 0.01}, "initial_contacts": [], "grasp.close_at": 2.5}
    return write_study(tmp_path, **{**base, "overrides": overrides, **changes})


@pytest.mark.slow
def test_an_object_without_a_grasp_is_refused_with_what_is_missing(tmp_path):
    grid = {
        "object": {
            "slab": {"object": {"size": [0.25, 0.25, 0.012], "mass": 0.1}},
            "heavy": {"object": {"size": [0.06, 0.06, 0.06], "mass": 20.0}},
        }
    }
    study = load_study(grasp_study(tmp_path, grid=grid, closing_times=[2.0, 3.0]))
    for job, cause, why in zip(
        study.jobs(), ("refused: room", "refused"), ("fingertips", "N"), strict=True
    ):
        rows = StudyRun(study, {})(job)
        assert [row["close_at"] for row in rows] == [2.0, 3.0]
        for row in rows:
            assert (row["held"], row["clean"], row["cause"]) == (False, False, cause)
            assert why in row["gave_up"]
