"""Runs of the shipped motions, and the results of a run with a pose stream."""

import numpy as np
import pytest
from conftest import read_log, usable_scenarios
from simulation_runs import contacts, pose, run_log

from drake_pregrasp import Scenario, load_scenario, resolve, run, shipped_scenarios
from drake_pregrasp.config.yaml_text import load_typed
from drake_pregrasp.diagrams.expected_path import expected_path
from drake_pregrasp.estimation.recorded_poses import read_recorded_poses
from drake_pregrasp.resources import resource_folder
from drake_pregrasp.simulation.recording import camera_view
from drake_pregrasp.simulation.scenario_file import read_mapping
from drake_pregrasp.simulation.smooth_file import CARRIED, load_estimator, smooth_file

MOTIONS = [name for name, (file, _) in shipped_scenarios().items() if file.stem == "motions"]
HALF_VIEW = np.radians(75 / 2)  # Of Meshcat's camera, upwards; it sees more to the sides.


@pytest.mark.slow
@pytest.mark.parametrize("name", MOTIONS)
def test_shipped_motions_are_tracked(name, tmp_path):
    scenario = load_scenario(name, text="{planner: {estimator: {lookahead: 0.0}}}")
    scenario.simulation_duration = min(2.0, scenario.simulation_duration)
    result = run(scenario, name=name, out=tmp_path, recording=False)
    assert result.completed
    log = run_log(result)
    late = log["time"] > 0.1
    assert np.max(log["position_error"][late]) < 5e-3
    assert np.all([log[f"c{i}_active"] for i in range(5)])


@pytest.mark.slow
def test_goals_stay_within_the_surface_of_a_tossed_object(tmp_path):
    """On it, where the object is believed to be; with look-ahead that is where it will be."""
    for lookahead in (0.0, 0.05):
        scenario = load_scenario("toss")
        scenario.planner.estimator.lookahead = lookahead
        result = run(scenario, name=f"toss_{lookahead}", out=tmp_path, recording=False)
        log, surface = run_log(result), resolve(scenario).surface
        ahead = round(lookahead / scenario.planner.period)
        assert log["z_wo"].max() - log["z_wo"].min() > 0.4
        for row in range(10, len(log["time"]) - ahead):
            believed = pose(log, row, "wo_estimated").inverse() @ contacts(log, row).T
            assert np.max(np.abs(surface.distance(believed.T))) < 1e-9
            true = pose(log, row + ahead, "wo").inverse() @ contacts(log, row).T
            assert np.max(np.abs(surface.distance(true.T))) < 3e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", usable_scenarios())
def test_the_camera_sees_the_whole_motion(name):
    file, _ = shipped_scenarios()[name]
    resolved = resolve(load_typed(Scenario, read_mapping(file)[name], Scenario()))
    scenario, shape = resolved.scenario, resolved.shape
    end = scenario.simulation_duration
    if resolved.hand is not None and not scenario.grasp.meeting.wait_at:
        end = min(end, scenario.grasp.latest_rest(resolved.hand.description.fingertips))
    path = expected_path(resolved.motion, end, shape)
    extent = max(shape.mesh.extents)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * extent / 2
    for view in (camera_view(resolved, follows=follows) for follows in (False, True)):
        axis = (view.p_WT - view.p_WK) / np.linalg.norm(view.p_WT - view.p_WK)
        camera = view.p_WK + view.share * (path - path[0])
        seen = (path - camera)[:, None] + corners
        angle = np.arccos(seen @ axis / np.linalg.norm(seen, axis=2))
        assert np.max(angle) < HALF_VIEW


def test_a_smoothed_file_is_a_stream_that_is_nearer_to_the_truth(tmp_path):
    truth = read_recorded_poses(resource_folder("models") / "carried_by_hand.csv")
    rng = np.random.default_rng(3)
    noisy, smoothed = tmp_path / "noisy.csv", tmp_path / "smoothed.csv"
    p = truth.p_WO + rng.normal(scale=0.003, size=truth.p_WO.shape)
    q = np.roll(truth.R_WO.as_quat(), 1, axis=1)
    rows = np.column_stack([truth.times, p, q])
    header = "time,x,y,z,qw,qx,qy,qz"
    np.savetxt(noisy, rows, delimiter=",", header=header, comments="")
    assert smooth_file(noisy, smoothed, load_estimator("{position_std: 0.003}")) == len(rows)
    after = read_recorded_poses(smoothed)
    np.testing.assert_array_equal(after.times, truth.times)
    errors = [np.linalg.norm(x - truth.p_WO) for x in (p, after.p_WO)]
    assert errors[1] < 0.8 * errors[0]
    table = read_log(smoothed)
    v = np.gradient(truth.p_WO, truth.times, axis=0)[1:-1]
    for axis, name in enumerate(("vx", "vy", "vz")):
        assert np.sqrt(np.mean((table[name][1:-1] - v[:, axis]) ** 2)) < 0.1
    assert load_estimator("{}") == CARRIED
