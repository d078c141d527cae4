"""Trials of the study: who says where fingers go, what is random, and what is read from a grasp."""

import dataclasses

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BusValue

from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.contacts.assignment import wrapped
from drake_pregrasp.contacts.selection_input import ContactStatus
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.geometry.box_surface import box_surface
from drake_pregrasp.geometry.solids import BoxSolid, HalfSpace
from drake_pregrasp.grasping.grasp_state import GiveUp, GraspPhase, GraspState
from drake_pregrasp.quality.grasp_quality import grasp_quality
from drake_pregrasp.regions.constraints import Obstacles, RegionConstraints
from drake_pregrasp.simulation.hand_file import load_hand
from drake_pregrasp.studies.static_versus_dynamic import outcome_csv
from drake_pregrasp.studies.static_versus_dynamic.arms import ARMS
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.grasp_outcome import GoalLook, grasp_outcome
from drake_pregrasp.studies.static_versus_dynamic.outcome import TrialJob
from drake_pregrasp.studies.static_versus_dynamic.planned_start import planned_start
from drake_pregrasp.studies.static_versus_dynamic.reassignment import Reassignment
from drake_pregrasp.studies.static_versus_dynamic.scene import BOX, HAND, SCENES
from drake_pregrasp.studies.static_versus_dynamic.simulated import EXPERIMENT
from drake_pregrasp.studies.static_versus_dynamic.start import random_start
from drake_pregrasp.studies.static_versus_dynamic.still_hand import StillHand
from drake_pregrasp.studies.static_versus_dynamic.study import study_static_versus_dynamic
from drake_pregrasp.studies.static_versus_dynamic.study_settings import study_settings
from drake_pregrasp.studies.static_versus_dynamic.trial import Trial, run_trial
from drake_pregrasp.systems.loggers import GraspRecord

MODEL = HandModel(load_hand(HAND))
FRAMES = MODEL.kinematics.tip_frames
SURFACE = box_surface(BOX.size, spacing=0.01, forbidden_faces=["+z", "-z"])
AROUND = 2 * np.pi * np.arange(5) / 5
CUBE = BoxSolid(np.zeros(3), np.eye(3), np.full(3, 0.1))


def test_every_condition_has_a_scene_and_settings_are_plain():
    assert list(SCENES) == list(CONDITIONS)
    assert set(study_settings()["conditions"]) == set(SCENES)


@pytest.mark.parametrize("condition", SCENES)
def test_starts_are_those_of_the_seed_apart_and_in_reach(condition):
    scene = SCENES[condition]
    seen = []
    for seed in range(6):
        start = random_start(scene, SURFACE, MODEL, seed)
        again = random_start(scene, SURFACE, MODEL, seed)
        np.testing.assert_array_equal(start.p_OC, again.p_OC)
        distances = np.linalg.norm(start.p_OC[:, None] - start.p_OC, axis=2) + np.eye(5)
        assert np.min(distances) >= 0.024
        aside = wrapped(np.arctan2(start.p_OC[:, 1], start.p_OC[:, 0]) - AROUND - start.yaw)
        assert np.all(np.abs(aside) <= MODEL.largest_offsets + 1e-4)
        assert scene.yaw_range[0] <= start.yaw <= scene.yaw_range[1]
        assert len(set(start.lost)) == scene.lost_fingers
        seen.append(start.p_OC)
    assert not np.array_equal(seen[0], seen[1])


def test_a_planned_start_is_a_better_grasp_within_reach():
    scene = SCENES["turning"]
    X_WO = RigidTransform([0, 0, 0.05])
    for seed in range(4):
        start = random_start(scene, SURFACE, MODEL, seed)
        planned = planned_start(scene, SURFACE, start.p_OC, X_WO, hand=MODEL, yaw=start.yaw)
        np.testing.assert_allclose(SURFACE.project(planned)[0], planned, atol=1e-9)
        assert grasp_quality(planned).q_gii > grasp_quality(start.p_OC).q_gii
        _, normals = SURFACE.project(planned)
        tips = planned + 0.029 * normals
        reach = [tip.reach.make_reach() for tip in load_hand(HAND).fingertips]
        # The wrist is limited: H is as the world, but for its place.
        for finger in range(5):
            one = planned[[finger]], normals[[finger]], tips[[finger]]
            assert reach[finger].permits(*one)[0]


def targets(contacts):
    value = BusValue()
    for name, (point, normal) in zip(FRAMES, contacts, strict=True):
        R = RotationMatrix.MakeFromOneVector(-np.array(normal, dtype=float), 2)
        value.Set(name, AbstractValue.Make(RigidTransform(R, point)))
    return value


def points_of(value):
    return np.array([value.Find(name).translation() for name in FRAMES])


def ring(turn):
    ways = np.stack([np.cos(AROUND + turn), np.sin(AROUND + turn), 0 * AROUND], axis=1)
    return [(0.05 * way, way) for way in ways]


def test_contacts_that_turn_away_go_to_the_next_finger_round_the_hand():
    system = Reassignment(tip_frames=FRAMES, azimuths=AROUND, period=0.05)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    system.GetInputPort("X_WH").FixValue(context, RigidTransform())
    lost = np.array([0, 0, -np.inf, 0, 0])
    system.GetInputPort("contact_weights").FixValue(context, lost)
    system.GetInputPort("contact_status").FixValue(context, np.arange(1.0, 6.0))
    for index, turn in enumerate(np.arange(0.0, 7.0, 0.1)):
        system.GetInputPort("fingertip_targets").FixValue(context, targets(ring(turn)))
        simulator.AdvanceTo(0.05 * index + 0.01)
        points = points_of(system.GetOutputPort("fingertip_targets").Eval(context))
        aside = wrapped(np.arctan2(points[:, 1], points[:, 0]) - AROUND)
        assert np.all(np.abs(aside) <= np.radians(40) + 1e-9)
        status = system.GetOutputPort("contact_status").Eval(context)
        assert status[2] == ContactStatus.LOST
        given = [points_of(targets(ring(turn))).tolist().index(p) for p in points.tolist()]
        assert [status[f] for f in (0, 1, 3, 4)] == [given[f] + 1 for f in (0, 1, 3, 4)]


def still_hand(close, *, obstacles=(), yaw=0.3):
    system = StillHand(
        tip_frames=FRAMES,
        azimuths=AROUND,
        ring_radius=0.092,
        box=CUBE,
        constraints=RegionConstraints(tip_radii=np.full(5, 0.009), standoff=0.02, clearance=0.004),
    )
    context = system.CreateDefaultContext()
    X_WO = RigidTransform(RotationMatrix.MakeZRotation(yaw), [0.2, 0.1, 0.05])
    system.GetInputPort("X_WO_estimated").FixValue(context, X_WO)
    system.GetInputPort("contact_weights").FixValue(context, np.array([0, 0, 0, 0, -np.inf]))
    system.GetInputPort("obstacles").FixValue(
        context, AbstractValue.Make(Obstacles(tuple(obstacles)))
    )
    system.GetInputPort("close").FixValue(context, [float(close)])
    value = system.GetOutputPort("fingertip_targets").Eval(context)
    return value, system.GetOutputPort("contact_status").Eval(context), X_WO


def test_a_still_hand_waits_on_a_ring_whatever_the_objects_angle():
    for yaw in (0.0, 0.3, 1.0):
        value, status, X_WO = still_hand(False, yaw=yaw)
        for name, azimuth in zip(FRAMES, AROUND, strict=True):
            X_WC = value.Find(name)
            tip = X_WC.translation() - 0.029 * X_WC.rotation().matrix()[:, 2]
            way = 0.092 * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
            np.testing.assert_allclose(tip - X_WO.translation(), way, atol=1e-12)
        assert list(status) == [ContactStatus.ACTIVE] * 4 + [ContactStatus.LOST]


def test_a_still_hand_closes_where_its_rays_meet_the_object():
    value, _, X_WO = still_hand(True)
    for name, azimuth in zip(FRAMES, AROUND, strict=True):
        X_OC = X_WO.inverse() @ value.Find(name)
        assert abs(CUBE.distance(X_OC.translation()[None])[0]) < 1e-12
        outside = X_OC.translation() - 1e-6 * X_OC.rotation().matrix()[:, 2]
        assert CUBE.distance(outside[None])[0] == pytest.approx(1e-6)
        way = value.Find(name).translation() - X_WO.translation()
        assert wrapped(np.arctan2(way[1], way[0]) - azimuth) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("close", [False, True])
def test_a_still_hand_withdraws_fingers_that_would_be_near_obstacles(close):
    wall = HalfSpace(np.array([0.25, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]))
    _, status, _ = still_hand(close, obstacles=[wall])
    assert status[0] == ContactStatus.OBSTRUCTED
    assert status[2] == ContactStatus.ACTIVE


def record(time, phase, *, lift=0.0, slid=0.0, slip=0.0, tilt=0.0):
    R = RotationMatrix.MakeXRotation(tilt)
    X_WO = RigidTransform(R, [slid, 0.0, 0.05 + lift])
    tips = np.array([[0.059, 0, 0], [-0.059, 0.01, 0], [0, 0.059, 0], [0, -0.059, 0], [0, 0, 0.2]])
    tips[0, 1] += slip
    return GraspRecord(
        time=time,
        report=np.array([phase, 0.0, 0.0, 0.0]),
        p_WT=(X_WO @ tips.T).T,
        p_GT=tips,
        f_T_W=np.zeros((5, 3)),
        X_WG=X_WO,
        X_WO=X_WO,
        X_WD=RigidTransform(),
    )


def outcome_of(records, condition="nominal", looks=(), reason=GiveUp.NONE):
    first = GraspState.first(5, GraspConfig().make_settings())
    state = dataclasses.replace(first, active=np.array([True] * 4 + [False]), reason=reason)
    return grasp_outcome(
        TrialJob(condition, "frozen", 0),
        2.0,
        SCENES[condition],
        records,
        looks,
        state=state,
        p_OCoM=np.zeros(3),
        tip_radii=np.full(5, 0.009),
    )


def good_grasp(**last):
    end = {"lift": 0.1, "slip": 0.002, **last}
    return [
        record(0.0, GraspPhase.TRACK),
        record(2.0, GraspPhase.TRACK, slid=0.001),
        record(2.3, GraspPhase.CLOSE, slid=0.001),
        record(3.0, GraspPhase.SQUEEZE, slid=0.002),
        record(3.5, GraspPhase.LIFT, slid=0.003),
        record(4.5, GraspPhase.HOLD, slid=0.003, **end),
    ]


def test_a_grasp_is_read_from_what_was_seen():
    outcome = outcome_of(good_grasp())
    assert outcome.clean
    assert outcome.fingers == 4
    assert outcome.waited_s == pytest.approx(0.3)
    assert outcome.pushed_before_mm == pytest.approx(1)
    assert outcome.pushed_closing_mm == pytest.approx(2)
    assert outcome.slip_mm == pytest.approx(2)
    assert outcome.residual_n < 1e-3
    assert np.isnan(outcome.goal_in_area)
    assert np.isnan(outcome.tip_in_area)


@pytest.mark.parametrize(
    ("last", "lifted", "level"),
    [({"lift": 0.07}, False, True), ({"tilt": 0.5}, True, False), ({"slip": 0.006}, True, True)],
)
def test_what_falls_tilts_or_slips_is_not_clean(last, lifted, level):
    outcome = outcome_of(good_grasp(**last))
    assert (outcome.lifted, outcome.level, outcome.clean) == (lifted, level, False)


def test_a_grasp_that_never_came_about_has_no_contacts():
    outcome = outcome_of([*good_grasp()[:3], record(3.0, GraspPhase.BACK_OFF)])
    assert not outcome.lifted
    assert np.isnan([outcome.slip_mm, outcome.residual_n, outcome.q_msv, outcome.q_gii]).all()


def test_contacts_that_do_not_balance_are_contacts_too():
    records = [*good_grasp()[:3], record(3.0, GraspPhase.BACK_OFF)]
    outcome = outcome_of(records, reason=GiveUp.OUT_OF_BALANCE)
    assert not outcome.lifted
    assert np.isfinite([outcome.residual_n, outcome.q_msv, outcome.q_gii]).all()
    early = [*good_grasp()[:2], record(3.0, GraspPhase.BACK_OFF)]  # At the gate: none touched.
    assert np.isnan(outcome_of(early, reason=GiveUp.OUT_OF_BALANCE).q_gii)


def test_shares_in_the_area_are_those_of_the_ticks():
    looks = [
        GoalLook(0.1, 5 - k, k, distance) for k, distance in enumerate((0.01, -0.001, 0.02, 0.03))
    ]
    records = good_grasp()
    outcome = outcome_of(records, "wall", looks)
    assert outcome.goal_in_area == 0.25
    assert outcome.withdrawn == 1.5
    assert outcome.tip_in_area == 1.0  # A fingertip is at y = 59 mm, the wall at 40 mm.


def state_of(trial):
    state = trial.context.get_discrete_state()
    groups = [state.get_vector(k).value() for k in range(state.num_groups())]
    return np.concatenate([[trial.context.get_time()], *groups])


@pytest.mark.parametrize("arm", ARMS)
def test_each_arm_can_be_tracked_and_set_back(arm, capfd):
    trial = Trial(TrialJob("headline", arm, 3))
    trial.track(0.2)
    assert len(trial.looks) == 4
    saved, before = trial.context.Clone(), state_of(trial)
    trial.track(0.4)
    assert not np.array_equal(state_of(trial), before)
    trial.context.SetTimeStateAndParametersFrom(saved)
    np.testing.assert_array_equal(state_of(trial), before)
    assert all(look.distance >= 0 for look in trial.looks)  # Of active goals, whatever the arm.
    assert all(look.usable + look.withdrawn == 5 for look in trial.looks)
    capfd.readouterr()


def test_a_tiny_study_grasps_and_reports(tmp_path):
    job = TrialJob("nominal", "dynamic_reach", 0)
    result = study_static_versus_dynamic(tmp_path, EXPERIMENT, [job], processes=1)
    assert (result.wanted, result.made, result.failed) == (1, 1, 0)
    here = run_trial(job)
    assert all(outcome.clean for outcome in here)
    assert outcome_csv.to_lines(here) in (result.report.parent / "outcomes.csv").read_text()
    assert "dynamic with reach" in result.report.read_text()
