import re
import runpy
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from pages import DOCS, ROOT, block, blocks, executed
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from drake_pregrasp import (
    AddPregraspPlanner,
    GraspPhase,
    HandModel,
    PlannerConfig,
    TrackingStatus,
    load_scenario,
    run,
    shipped_scenarios,
)
from drake_pregrasp.cli import main
from drake_pregrasp.estimation.fault_settings import MeasurementFaults
from drake_pregrasp.estimation.recorded_poses import MAX_ROWS
from drake_pregrasp.simulation.run_log import grasp_columns, log_columns
from drake_pregrasp.studies import runner
from drake_pregrasp.studies.grasps.goal_sources import GOAL_SOURCES
from drake_pregrasp.studies.grasps.grasp_outcome import CLEAN_IN_WORDS, HELD_IN_WORDS
from drake_pregrasp.studies.study_command import STUDY
from drake_pregrasp.studies.study_file import load_study, shipped_studies
from drake_pregrasp.studies.study_run import StudyRun

FILES = (runner.ROWS, runner.JOURNAL, runner.FAILED, runner.SETTINGS)  # Of every study.


@pytest.fixture
def thing(tmp_path, monkeypatch):
    """A mesh file in millimetres, in the working directory."""
    monkeypatch.chdir(tmp_path)
    trimesh.creation.cone(radius=40, height=110).export("thing.stl")


def test_the_first_run_changes_what_the_page_says():
    text = (DOCS / "first_run.md").read_text(encoding="utf-8")
    (faster,) = re.findall(r"--scenario_text '(.*?)'", text)
    assert load_scenario("a_base", text=faster).planner.strategy == "vew"


def test_a_scenario_in_the_way_of_hardware_sim_loads(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(blocks("hardware_sim.md", "yaml")[0])
    scenario = load_scenario("slow", file=file)
    assert scenario.random_seed == 3
    assert scenario.simulator_config.target_realtime_rate == 1.0


@pytest.mark.slow
def test_hardware_sim_with_a_hand_takes_forty_lines(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    scenario, code = blocks("hardware_sim.md", "yaml")[1], block("hardware_sim.md", "python")
    quiet = "  visualization: {enable_meshcat_creation: false}\n"
    Path("pregrasp_sim.yaml").write_text(scenario + quiet)
    assert len(list(filter(str.strip, code.splitlines()))) <= 40
    Path("pregrasp_sim.py").write_text(code)
    names = runpy.run_path("pregrasp_sim.py")
    context, controller = names["simulator"].get_context(), names["hand"].controller
    report = controller.GetOutputPort("grasp_report")
    phase = report.Eval(controller.GetMyContextFromRoot(context))[0]
    assert phase == GraspPhase.HOLD


@pytest.mark.slow
def test_the_station_of_the_page_holds_and_then_waits_for_its_robot(capsys):
    simulated, over_lcm = blocks("station.md", "python")
    assert len(list(filter(str.strip, simulated.splitlines()))) <= 20
    here = over_lcm.replace("udpm://239.255.76.67:7667?ttl=0", "memq://")
    short = here.replace("scenario.grasp.period)", "scenario.grasp.period, duration=0.1)")
    names = executed("station.md", simulated + short)
    assert capsys.readouterr().out == "HOLD with 19 joints\n"
    assert names["meshcat"].HasPath("/drake/visualizer")
    assert list(names["station"].initial) == ["hand"]


@pytest.mark.slow
@pytest.mark.usefixtures("thing")
def test_the_guide_to_meshes_is_followed_as_it_stands():
    Path("mine.yaml").write_text(block("own_mesh.md", "yaml"))
    result = run(load_scenario(file="mine.yaml"), name="mine", out="runs", recording=False)
    assert result.summary["final"]["q_msv"] > 2
    assert result.summary["inactive_contacts"] == {}
    names = executed("own_mesh.md", block("own_mesh.md", "python"))
    surface = names["surface"]
    assert surface.patches[:, :, 2].min() >= 0.03
    context = names["diagram"].CreateDefaultContext()
    names["diagram"].GetInputPort("X_WO_measured").FixValue(context, RigidTransform())
    p_WC = names["diagram"].GetOutputPort("p_WC").Eval(context).reshape(-1, 3)
    assert np.all(np.linalg.norm(p_WC - [0.1, 0.0, 0.05], axis=1) > 0.03)


@pytest.mark.slow
@pytest.mark.parametrize("hand", ["five_finger_hand", "allegro_panda"])
def test_the_robot_in_a_plant_of_ones_own_lifts_the_box(hand, request, capsys):
    if hand == "allegro_panda":
        request.getfixturevalue(hand)
    code = blocks("compose.md", "python")[0].replace("five_finger_hand.yaml", f"{hand}.yaml", 1)
    names = executed("compose.md", code)
    height = capsys.readouterr().out.rpartition("HOLD at ")[2].removesuffix(" m\n")
    assert float(height) == pytest.approx(0.1, abs=0.003)
    assert names["X_WO"].rotation().matrix()[2, 2] > 0.99


def tip_errors(names, p_WT):
    """Distances of fingertips from their last goals, in metres."""
    goals = [names["centers"].Find(frame).translation() for frame in names["frames"]]
    return np.linalg.norm(p_WT - goals, axis=1)


@pytest.mark.slow
def test_a_controller_of_ones_own_follows_with_drakes_kinematics():
    goals, drake, _ = blocks("own_controller.md", "python")
    masks = "follow.cartesian_axis_masks = center.cartesian_axis_masks = masks\n"
    assert masks in drake
    for code, least, most in ((drake, 0.0, 0.001), (drake.replace(masks, ""), 0.02, 1.0)):
        names = executed("own_controller.md", goals + code)
        p_WT = HandModel(names["hand"]).tips_at(names["q"])
        assert least <= np.max(tip_errors(names, p_WT)) < most
        assert names["meshcat"].HasPath("/drake/visualizer")


@pytest.mark.slow
def test_a_controller_of_ones_own_follows_with_mink(monkeypatch, tmp_path):
    pytest.importorskip("mink")
    monkeypatch.chdir(tmp_path)
    shutil.copy(DOCS / "own_hand" / "gripper.urdf", tmp_path)
    goals, _, mink = blocks("own_controller.md", "python")
    names = executed("own_controller.md", goals + mink)
    p_WT = [names["robot"].data.site(frame).xpos for frame in names["frames"]]
    assert np.max(tip_errors(names, np.array(p_WT))) < 0.001
    assert names["meshcat"].HasPath("/drake/gripper")


@pytest.mark.slow
def test_the_live_view_shows_the_whole_run(capsys):
    code = block("live_view.md", "python").replace("target_realtime_rate: 1.0", "")
    names = executed("live_view.md", code)
    assert f"open {names['meshcat'].web_url()}\n" in capsys.readouterr().out
    assert names["meshcat"].HasPath("/drake/pregrasp")
    assert names["simulator"].get_context().get_time() == names["scenario"].simulation_duration


def test_the_estimator_alone_follows_until_the_object_is_lost(capsys):
    names = executed("compose.md", blocks("compose.md", "python")[1])
    assert capsys.readouterr().out == "status at 3 s: LOST\n"
    estimates, measure = names["estimates"], names["measure"]
    statuses = [status for _, _, status in estimates]
    assert statuses[3:] == sorted(statuses[3:])  # The first measurements confirm the estimate.
    assert set(statuses) == set(TrackingStatus) - {TrackingStatus.WAITING}
    for time, pose, status in estimates:
        if status == TrackingStatus.LOST:
            assert pose.IsExactlyEqualTo(estimates[-1][1])
        elif time > 1:  # Velocities are known, and hold on.
            assert pose.IsNearlyEqualTo(measure(time), 1e-9)


@pytest.mark.slow
def test_the_guide_to_a_hand_of_your_own_grasps_with_it(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    shutil.copy(DOCS / "own_hand" / "gripper.urdf", tmp_path)
    text = (DOCS / "own_hand.md").read_text(encoding="utf-8")
    (options,) = re.findall(r"--scenario_text '(.*file: gripper.yaml.*)'", text)
    (tmp_path / "gripper.yaml").write_text(block("own_hand.md", "yaml"))
    scenario = load_scenario("grasp_five_finger", text=options)
    grasp = run(scenario, name="mine", out=tmp_path, recording=False).summary["grasp"]
    assert (grasp["phase"], grasp["gave_up"]) == ("hold", None)
    assert grasp["lift_height_mm"] > 98


PAGES = sorted([*DOCS.rglob("*.md"), *DOCS.rglob("*.ipynb"), *ROOT.glob("*.md")])


def links(page):
    text = page.read_text(encoding="utf-8")
    return re.findall(r"\]\((?!https)([^)#]+)[^)]*\)", text)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in links(page):
        assert (page.parent / target).exists(), target


def test_the_index_names_each_page_once():
    named = [(DOCS / target).resolve() for target in links(DOCS / "index.md")]
    others = {DOCS / "index.md", ROOT / "README.md"}
    assert sorted(named) == sorted(set(PAGES) - others)


@pytest.mark.slow
def test_the_page_on_the_study_says_what_its_file_does():
    text = (DOCS / "static_versus_dynamic.md").read_text(encoding="utf-8")
    study = load_study("static_versus_dynamic")
    rows = {f"| `{key}` | {c.description} |" for key, c in study.conditions.items()}
    rows |= {f"| `{key}` | {m.label} | {m.description} |" for key, m in study.methods.items()}
    lines = [line for line in text.splitlines() if line.startswith("| `") and "against" not in line]
    assert len(lines) == len(rows)
    assert {row for line in lines for row in rows if line.startswith(row)} == rows
    for words in (CLEAN_IN_WORDS, HELD_IN_WORDS):
        assert words in " ".join(text.split())
    assert f"{len(study.jobs()):,} trials" in text


def test_the_guide_to_studies_names_what_there_is(capsys):
    text = (DOCS / "studies.md").read_text(encoding="utf-8")
    for file in (*FILES, STUDY, "report.html"):
        assert f"`{file}`" in text
    for name in shipped_studies():
        assert f"`{name}`" in text
    with pytest.raises(SystemExit):
        main(["study", "--help"])
    known = set(re.findall(r"--\w+", capsys.readouterr().out)) - {"--help"}
    others = {"--host", "--dashboard", "--nworkers", "--nthreads", "--lifetime"}
    assert set(re.findall(r"--\w+", text)) <= known | others


@pytest.mark.slow
def test_the_study_in_the_guide_makes_its_runs(tmp_path):
    (tmp_path / "my_study.yaml").write_text(blocks("studies.md", "yaml")[0])
    study = load_study(str(tmp_path / "my_study.yaml"))
    jobs = study.jobs()
    assert len(jobs) == 2 * 2 * 2 * 5
    (values,) = StudyRun(study, {})(jobs[0])
    assert values["q_gii_mean"] > 0.9
    assert values["active_share"] == 1


@pytest.mark.slow
def test_the_source_of_goals_in_the_guide_to_studies_grasps(tmp_path, monkeypatch):
    source = block("studies.md", "python")
    (tmp_path / "my_goals.py").write_text(source)
    (tmp_path / "my_study.yaml").write_text(blocks("studies.md", "yaml")[1])
    assert len(source.splitlines()) <= 30
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [*sys.path])
    monkeypatch.setitem(GOAL_SOURCES, "carried", None)
    command = ["study", "my_study.yaml", "--import", "my_goals", "--processes", "1"]
    assert (
        main([*command, "--seeds", "1", "--study_text", "{overrides: {grasp.close_at: 2.5}}"]) == 0
    )
    text = (tmp_path / "studies" / "my_study" / "report.md").read_text(encoding="utf-8")
    assert re.search(r"^\| 2\.5 +\| 1 of 1 .*\| 1 of 1 ", text, flags=re.MULTILINE)


def test_the_strategy_that_contributing_shows_is_planned_with(surface, p_OC):
    strategy = executed("CONTRIBUTING", block("../CONTRIBUTING.md", "python"))["high_contacts"]
    heights = []
    for weight_function in (None, strategy):
        config = PlannerConfig(static_duration=0.0)
        planner = AddPregraspPlanner(
            DiagramBuilder(), config, surface, p_OC, weight_function=weight_function
        )
        context = planner.CreateDefaultContext()
        planner.GetInputPort("X_WO_measured").FixValue(context, RigidTransform())
        heights.append(planner.GetOutputPort("p_WC").Eval(context)[2::3])
    assert np.all(heights[1] >= heights[0])
    assert np.mean(heights[1] - heights[0]) > 0.01


def test_the_page_on_run_folders_explains_every_column_and_key(base_run):
    text = (DOCS / "reference" / "run_files.md").read_text(encoding="utf-8")
    log, grasp, summary = (
        re.findall(r"`([^`]+)`", " ".join(re.findall(r"^\| (`.*?`) \| ", part, flags=re.MULTILINE)))
        for part in text.split("\n## ")[1:4]
    )
    for shown, columns in ((log, log_columns(2)), (grasp, grasp_columns(2))):
        named = {name.format(i=i) for name in shown for i in range(2)}
        assert named == set(columns)
    assert set(summary) == {*base_run.summary, "after_damage", "coordinates", "grasp"}


def test_the_page_on_faults_has_a_row_for_each_status():
    text = (DOCS / "faults.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([A-Z_]+)` \|", text, flags=re.MULTILINE)
    assert sorted(rows) == sorted(TrackingStatus.__members__)


def test_the_run_with_everything_has_the_faults_of_all_other_runs():
    """docs/faults.md says so."""
    names = [name for name in shipped_scenarios() if name.startswith("fault_")]
    faults = {name: load_scenario(name).sensor.faults for name in names}
    unset = vars(MeasurementFaults())
    chosen = {
        name: {key for key, value in vars(fault).items() if value != unset[key]}
        for name, fault in faults.items()
    }
    assert len(names) > 10
    assert set.union(*chosen.values()) == chosen["fault_everything"]


@pytest.mark.slow
def test_the_pose_streams_file_and_scenario_run(tmp_path):
    (tmp_path / "poses.csv").write_text(block("pose_stream.md", "csv"))
    scenario = tmp_path / "mine.yaml"
    scenario.write_text(block("pose_stream.md", "yaml"))
    assert load_scenario(file=scenario).motion.file == str(tmp_path / "poses.csv")
    command = ["run", "--scenario_file", str(scenario), "--out", str(tmp_path), "--no-recording"]
    assert main([*command, "--simulation_duration", "0.2"]) == 0
    assert main(["smooth", str(tmp_path / "poses.csv"), str(tmp_path / "smoothed.csv")]) == 0
    assert f"{MAX_ROWS:,}" in (DOCS / "pose_stream.md").read_text(encoding="utf-8")


def test_the_goals_of_a_pose_stream_follow(capsys):
    names = executed("pose_stream.md", block("pose_stream.md", "python"))
    assert capsys.readouterr().out.startswith("goals in W, 50 ms ahead:")
    ahead = names["measure"](names["time"] + names["estimator"].lookahead)
    p_OC = (ahead.inverse() @ names["p_WC"].T).T
    assert np.max(names["surface"].distance(p_OC)) < 2e-3


def test_the_loop_at_100_hz_keeps_its_time(capsys):
    diagram = block("pose_stream.md", "python").partition("for tick in")[0]
    assert diagram.count("period=0.02") == 1
    loop = block("control_loop.md", "python").replace("range(200)", "range(20)")
    names = executed("control_loop.md", diagram.replace("period=0.02", "period=0.01") + loop)
    assert names["monotonic"]() - names["start"] >= 0.19
    assert names["context"].get_time() == pytest.approx(0.2)
    assert re.fullmatch(r"tick [\d.]+ ms .*\n", capsys.readouterr().out)


@pytest.mark.slow
def test_the_pictures_of_the_method_are_made(tmp_path):
    runpy.run_path(str(DOCS / "method" / "make_pictures.py"))["main"](tmp_path)
    made = {path.name for path in tmp_path.iterdir()}
    assert made == {path.name for path in (DOCS / "method").glob("*.png")}
    text = (DOCS / "equations.md").read_text(encoding="utf-8")
    assert all(f"(method/{name})" in text for name in made)
