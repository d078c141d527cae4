import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from simulation_runs import closing_words, contacts, points, pose, run_log, run_text

from drake_pregrasp import (
    OutputError,
    ScenarioError,
    load_scenario,
    resolve,
    run,
    shipped_scenarios,
)
from drake_pregrasp.config.planner_config import filter_noise
from drake_pregrasp.estimation.pose_belief import PoseMeasurement, first_belief
from drake_pregrasp.estimation.pose_filter import filter_step, merged
from drake_pregrasp.quality.force_closure import ferrari_canny, min_weight_margin
from drake_pregrasp.quality.grasp_quality import grasp_quality
from drake_pregrasp.regions.independent_regions import force_closed_share, slip_radii_within
from drake_pregrasp.regions.safe_regions import compute_safe_regions
from drake_pregrasp.simulation.run import RUN_FILES
from drake_pregrasp.simulation.summary import MARGINS
from drake_pregrasp.systems.pose_sensor import NoiseSource

STATIC_PUBLISHED = {"q_msv": (2.2089, 0.001), "q_gii": (0.9749, 0.001), "q_vew": (125.4176, 0.005)}


@pytest.mark.slow
def test_the_run_folder_is_complete(base_run):
    files = {path.name for path in base_run.folder.iterdir()}
    others = {"diagram.svg", "recording.html", "grasp.csv", "run.mcap", "grasp.npz"}
    assert files | others == set(RUN_FILES)
    assert json.loads((base_run.folder / "summary.json").read_text()) == base_run.summary


def test_both_phases_meet_table_2(base_run, base_log):
    static, best = base_run.summary["static"], base_run.summary["max"]
    for measure, (published, tolerance) in STATIC_PUBLISHED.items():
        assert static[measure] == pytest.approx(published, abs=tolerance)
        assert np.max(base_log[measure][:80]) == pytest.approx(published, abs=tolerance)
    assert best["q_msv"] >= 2.225
    assert best["q_gii"] >= 0.989
    assert 125.30 <= best["q_vew"] <= 125.60


def test_measures_follow_from_the_log_alone(base_log):
    """G_i = [[I, 0], [[r_i]x, I]] of the active contacts about the true centre, once more."""
    for row in range(0, len(base_log["time"]), 7):
        active = [base_log[f"c{i}_active"][row] == 1 for i in range(5)]
        r = (contacts(base_log, row) - points(base_log, "wo")[row])[active]
        blocks = [np.block([[np.eye(3), np.zeros((3, 3))], [skew(p), np.eye(3)]]) for p in r]
        sigma = np.linalg.svd(np.hstack(blocks), compute_uv=False)
        expected = (sigma[-1], sigma[-1] / sigma[0], np.prod(sigma))
        measured = [base_log[name][row] for name in STATIC_PUBLISHED]
        np.testing.assert_allclose(measured, expected, rtol=1e-9)


def skew(p):
    return np.cross(np.eye(3), -p)


def test_contacts_are_rigid_with_the_object_and_then_move_over_its_surface(surface, base_log, p_OC):
    for row in range(len(base_log["time"])):
        X_WO = pose(base_log, row, "wo_estimated")
        logged_p_OC = (X_WO.inverse() @ contacts(base_log, row).T).T
        nearest, _ = surface.project(logged_p_OC)
        assert np.max(np.linalg.norm(nearest - logged_p_OC, axis=1)) < 1e-12
        moved = np.max(np.abs(logged_p_OC - p_OC))
        assert moved < 1e-14 if row < 80 else moved > 1e-3


def test_the_logged_estimate_is_the_filter_on_each_ticks_own_measurement(scenario, base_log):
    """No lag anywhere: pose and noise of tick k are in the estimate and the goals of tick k."""
    noise = filter_noise(scenario.planner.estimator)
    source = NoiseSource(size=6, period=scenario.planner.period, seed=scenario.random_seed)
    context = source.CreateDefaultContext()
    belief = None
    for row, time in enumerate(base_log["time"]):
        context.SetTime(time)
        n = source.get_output_port().Eval(context)
        X_WO = pose(base_log, row, "wo")
        p = X_WO.translation() + scenario.sensor.position_std * n[:3]
        turn = Rotation.from_rotvec(scenario.sensor.orientation_std * n[3:]).as_matrix()
        measured = PoseMeasurement(time, p, turn @ X_WO.rotation().matrix())
        if belief is None:
            belief = first_belief(measured, noise)
        else:
            belief = filter_step(belief, measured, noise)[1].belief
        estimate = pose(base_log, row, "wo_estimated")
        mean = merged(belief)
        np.testing.assert_allclose(estimate.translation(), mean.p_WCoM[0], atol=1e-12)
        np.testing.assert_allclose(estimate.rotation().matrix(), mean.R_WO[0], atol=1e-10)


def test_displacement_and_energy_follow_from_the_contacts(base_log):
    for row in (79, 80, 81, 120):
        steps = np.linalg.norm(contacts(base_log, row) - contacts(base_log, row - 1), axis=1)
        assert base_log["displacement"][row] == pytest.approx(np.sum(steps), rel=1e-9)
        energy = np.sum((steps / 0.05) ** 2) / 2
        assert base_log["energy"][row] == pytest.approx(energy, rel=1e-6)
    assert base_log["displacement"][0] == base_log["energy"][0] == 0


def test_ticks_and_yaw_are_those_of_the_scenario(scenario, base_run, base_log):
    np.testing.assert_allclose(base_log["time"], 0.05 * np.arange(161), rtol=1e-12)
    assert base_run.summary["ticks"] == 161
    w = scenario.motion.angular_velocity
    np.testing.assert_allclose(base_log["yaw_wo"], w * base_log["time"], atol=2e-3)


@pytest.mark.slow
def test_a_recording_changes_no_byte_of_the_log_and_another_seed_all(
    base_run, recorded_run, tmp_path
):
    logs = [(result.folder / "log.csv").read_bytes() for result in (base_run, recorded_run)]
    assert logs[0] == logs[1]
    other = run_text("a_base", "random_seed: 1, simulation_duration: 0.5", tmp_path)
    errors = [run_log(result)["position_error"][:11] for result in (base_run, other)]
    assert np.all(errors[0] != errors[1])


@pytest.mark.slow
def test_poor_start_recovers(base_run, tmp_path):
    """Row g of Table II: first four contacts on one face, the fifth on forbidden surface."""
    result = run_text("g_poor_start", "simulation_duration: 8.0", tmp_path)
    log = run_log(result)
    static = log["time"] < 4
    assert np.all(log["c4_active"][static] == 0)
    assert log["c4_active"][-1] == 1
    assert result.summary["static"]["q_msv"] == pytest.approx(1.9508, abs=1e-3)
    assert result.summary["static"]["q_gii"] == pytest.approx(0.9512, abs=1e-3)
    for measure in STATIC_PUBLISHED:
        assert result.summary["max"][measure] > 0.99 * base_run.summary["max"][measure]


@pytest.mark.slow
def test_damage_is_recovered_from(tmp_path, capsys):
    """Row f of Table II: both sets are measured after the loss; Q_VEW cannot be below 3³ = 27."""
    text = "simulation_duration: 9.0, damage: [{at: 7.0, contacts: [3, 4]}]"
    result = run_text("f_damage", text, tmp_path)
    log = run_log(result)
    for contact, active in ((2, 1), (3, 0), (4, 0)):
        assert np.all(log[f"c{contact}_active"][log["time"] < 6.99] == 1)
        assert np.all(log[f"c{contact}_active"][log["time"] > 6.99] == active)
    loss = int(np.searchsorted(log["time"], 6.99))
    steps = np.linalg.norm(contacts(log, loss) - contacts(log, loss - 1), axis=1)
    assert log["displacement"][loss] == pytest.approx(np.sum(steps[:3]), rel=1e-9)
    static, best = (result.summary["after_damage"][key] for key in ("static", "max"))
    for measure in STATIC_PUBLISHED:
        assert best[measure] > static[measure]
    assert 27 < static["q_vew"] < 27.2
    assert best["q_msv"] < np.sqrt(3)
    assert 27 < best["q_vew"] < 27.2
    assert result.summary["max"]["q_msv"] > 2.2
    said = closing_words(result, capsys)
    assert "damage" in said
    assert f"Q_VEW {static['q_vew']:.4f}" in said["static"]
    assert f"Q_VEW {best['q_vew']:.4f}" in said["best"]


@pytest.mark.slow
def test_the_margins_are_those_of_the_active_contacts(scenario, tmp_path):
    text = """simulation_duration: 8.0, damage: [{at: 5.0, contacts: [3, 4]}],
        measures: {contact_model: soft_finger, friction: 0.9, torsional_friction: 0.003,
        length: 0.06}"""
    result = run_text("a_base", text, tmp_path)
    summary, log = result.summary, run_log(result)
    X_OW = pose(log, -1, "wo_estimated").inverse()
    p_OC = (X_OW @ contacts(log, -1).T).T
    surface = resolve(scenario).surface
    _, normals = surface.project(p_OC[:3])
    cone = {"model": "soft_finger", "torsional_friction": 0.003}
    weights = np.array([0, 0, 0, -np.inf, -np.inf])
    regions = compute_safe_regions(surface.p_OQ, p_OC, weights, surface.forbidden)
    generator = np.random.default_rng(0)
    share = force_closed_share(surface, regions, 0.9, generator=generator, **cone)
    expected = {
        "force_closure_margin": min_weight_margin(p_OC[:3], normals, 0.9, **cone),
        "ferrari_canny": ferrari_canny(p_OC[:3], normals, 0.9, length=0.06, **cone),
        "independent_region_share": share,
        "independent_radius": slip_radii_within(
            surface, p_OC[:3], normals, surface.longest_lever_arm, 0.9, **cone
        ).min(),
    }
    quality = grasp_quality(p_OC[:3], normals, model="soft_finger", length=0.06)
    assert log["q_vew"][-1] == pytest.approx(quality.q_vew, rel=0.1)  # About the true centre.
    assert summary["contact_model"] == "soft_finger"
    for name, value in expected.items():
        assert (summary[name]["friction"], summary[name]["contact_model"]) == (0.9, "soft_finger")
        assert summary[name]["final"] == pytest.approx(value, rel=1e-6)
        assert value > (0.005 if name == "independent_radius" else 0.05)
        assert summary[name]["static"] is not None


def test_measures_that_need_a_cone_take_the_hard_finger_for_the_complete_model(base_run):
    assert base_run.summary["contact_model"] == "complete"
    for name in MARGINS:
        measured = base_run.summary[name]
        assert measured["contact_model"] == "hard_finger"
        least = 0 if name == "independent_radius" else 1e-9  # A slip is proven by a bound only.
        assert measured["final"] > measured["static"] >= least


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [name for name, (file, _) in shipped_scenarios().items() if file.stem == "measures"]
)
def test_scenarios_of_other_measures_run(name, base_run, tmp_path):
    text = "simulation_duration: 3.0, planner: {static_duration: 0.5}"
    summary = run_text(name, text, tmp_path).summary
    margin = summary["force_closure_margin"]
    if name == "frictionless":  # Five contacts that only push close nothing.
        assert margin["final"] == summary["final"]["q_msv"] == 0
    else:
        assert margin["final"] > margin["static"] + 0.3
        assert summary["independent_region_share"]["final"] > 0.9
        assert summary["final"]["q_gii"] > 0.3


@pytest.mark.slow
def test_damage_ends_the_static_phase_and_leaves_no_contact_on_forbidden_surface(tmp_path):
    text = "simulation_duration: 6.0, damage: [{at: 2.0, contacts: [3, 4]}]"
    summary = run_text("a_base", text, tmp_path).summary
    assert summary["static"]["q_vew"] == pytest.approx(125.4157, abs=0.01)
    assert summary["max"]["q_vew"] is None
    assert summary["after_damage"]["max"]["q_vew"] < 28
    text = "simulation_duration: 0.2, damage: [{at: 0.1, contacts: [1]}]"
    summary = run_text("g_poor_start", text, tmp_path).summary
    assert summary["after_damage"]["static"]["q_vew"] == pytest.approx(27, abs=0.2)


def test_a_finger_comes_back_in_its_time_and_counts_again(tmp_path):
    text = "simulation_duration: 0.6, damage: [{at: 0.1, contacts: [1], until: 0.3}]"
    text += ", planner: {static_duration: 0.2}"
    result = run_text("a_base", text, tmp_path)
    log, after = run_log(result), result.summary["after_damage"]
    away = (log["time"] > 0.099) & (log["time"] < 0.299)
    np.testing.assert_array_equal(log["c1_active"] == 0, away)
    assert after["static"]["q_vew"] == pytest.approx(125.4157, abs=0.01)
    assert after["max"]["q_msv"] == log["q_msv"][log["time"] > 0.299].max()


def test_a_finger_that_tires_leaves_its_surface_to_the_others(tmp_path):
    text = "simulation_duration: 0.6, planner: {static_duration: 10}"
    text += ", capability: [{contact: 1, times: [0.1, 0.5], values: [1, 0]}]"
    log = run_log(run_text("a_base", text, tmp_path))
    sizes = log["region1_size"]
    assert np.all(np.diff(sizes) <= 0)
    assert sizes[2] == sizes[0] > 2 * sizes[8] > 0
    np.testing.assert_array_equal(log["c1_active"] == 0, log["time"] > 0.499)


def test_the_summary_compares_what_fingers_offer_with_what_their_goals_demand(tmp_path):
    """Goals and the pose in which they are given are both predicted ahead."""
    text = """simulation_duration: 0.6, motion: {linear_velocity: 0.3},
        planner: {static_duration: 10, estimator: {lookahead: 0.2}, coordinates: [
        {name: arm, scale: 1, candidates: lever_arm, fingers: [0, 1, 2, 3, 4]}]}"""
    scenario = load_scenario("a_base", text=f"{{{text}}}")
    p_OC = resolve(scenario).start.p_OC
    arm = run_text("a_base", text, tmp_path).summary["coordinates"]["arm"]
    assert arm["fingers"] == [0, 1, 2, 3, 4]
    np.testing.assert_allclose(arm["goals"], np.hypot(p_OC[:, 0], p_OC[:, 1]), atol=0.005)


@pytest.mark.slow
def test_a_run_that_is_stopped_keeps_its_log_and_any_description_is_plotted(tmp_path):
    ticks = []
    stop = {"on_tick": ticks.append, "should_stop": lambda: len(ticks) >= 5}
    text = "description: '$\\frac{$', initial_contacts: [[0, 0, 1], [1, 0, 0]]"
    result = run_text("a_base", text, tmp_path, plots=True, **stop)
    assert not result.completed
    assert len(run_log(result)["time"]) == len(ticks) == result.summary["ticks"]
    assert result.summary["max"]["q_msv"] is None
    assert result.summary["inactive_contacts"] == {"0": "no allowed surface"}
    assert (result.folder / "metrics.png").exists()


def test_errors_of_a_callback_stay_what_they_are(tmp_path):
    def on_tick(record):
        raise OSError("mine")

    with pytest.raises(OSError, match=r"^mine$"):
        run_text("a_base", "", tmp_path, on_tick=on_tick)


@pytest.mark.slow
def test_a_bad_scenario_from_python_is_refused_before_anything_is_touched(tmp_path):
    folder = run_text("a_base", "simulation_duration: 0.2", tmp_path).folder
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    for change in ({"period": -1.0}, {"static_duration": float("nan")}, {"strategy": "luck"}):
        bad = load_scenario("a_base")
        vars(bad.planner).update(change)
        with pytest.raises(ScenarioError, match=f"planner.{next(iter(change))}"):
            run(bad, name="a_base", out=tmp_path, recording=False)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_a_folder_or_a_name_that_cannot_be_used_is_refused(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("precious")
    with pytest.raises(OutputError, match=r"file: is a file, not a folder"):
        run(load_scenario("a_base"), name="a", out=blocked)
    assert blocked.read_text() == "precious"
    for name in ("../up", "", ".", "a/b"):
        with pytest.raises(ScenarioError, match="name must have only"):
            run(load_scenario("a_base"), name=name, out=tmp_path)
