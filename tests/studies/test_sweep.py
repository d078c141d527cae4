"""The command `sweep`: runs of its file, rows that agree with them, report, and messages."""

import copy
import itertools
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from conftest import usable_studies
from drake_pregrasp.studies.sweep import sweep_report
from drake_pregrasp.studies.sweep.field_path import read_field, set_field
from drake_pregrasp.studies.sweep.measures import MEASURES
from drake_pregrasp.studies.sweep.study_file import load_study, named_files
from drake_pregrasp.studies.sweep.sweep_command import STUDY, SweepRun, sweep
from drake_pregrasp.studies.sweep.sweep_plan import GridAxis, RandomAxis, SweepPlan, random_axis
from drake_pregrasp.studies.sweep.sweep_report import axis_table, write_sweep_report
from hypothesis import given
from hypothesis import strategies as st
from made_up_jobs import write_study
from scipy.spatial.transform import Rotation
from trimesh.creation import box

from drake_pregrasp import ScenarioError, load_scenario, run
from drake_pregrasp.cli import main
from drake_pregrasp.resources import resource_folder
from drake_pregrasp.simulation.run_log import adapting_phase
from drake_pregrasp.simulation.scenario_file import scenario_data, scenario_from_data
from drake_pregrasp.simulation.summary import MARGINS
from drake_pregrasp.simulation.yaml_text import dump_yaml
from drake_pregrasp.studies.runner import FAILED, JOURNAL, ROWS, SETTINGS, StudyRows


def sweep_run(study):
    measures = tuple(study.config.measures)
    return SweepRun(study.plan, study.scenario, study.source, study.folder, (), measures)


@pytest.mark.slow
def test_measures_are_those_of_a_run_folder(tmp_path):
    overrides = {"simulation_duration": 0.4, "planner.static_duration": 0.2}
    study = load_study(write_study(tmp_path, measures=list(MEASURES), overrides=overrides))
    values = sweep_run(study)(study.plan.job(7))
    text = (
        "{simulation_duration: 0.4, planner: {static_duration: 0.2, period: 0.05}, random_seed: 1"
        ", motion: {linear_velocity: 0.02}, plant_config: {time_step: 0.025}}"
    )
    scenario = load_scenario("a_base", text=text)
    result = run(scenario, name="one", out=tmp_path, recording=False)
    summary = result.summary
    for quality, kind in itertools.product(("q_msv", "q_gii", "q_vew"), ("mean", "max", "final")):
        assert values[f"{quality}_{kind}"] == summary[kind][quality]
    for name in MARGINS:
        assert values[name] == summary[name]["final"]
    assert values["ticks"] == summary["ticks"] == 9
    assert np.isnan(values["grasp_lift_height"])
    log = pd.read_csv(result.folder / "log.csv")
    phase = adapting_phase(scenario, log["time"].values)
    assert values["position_error_max"] == 1e3 * log["position_error"][phase].max()
    assert values["displacement"] == pytest.approx(1e3 * log["displacement"][phase].sum() / 0.25)
    assert values["active_share"] == 1
    R_OW = Rotation.from_quat(log[[f"q{c}_wo_estimated" for c in "xyzw"]]).inv()
    p_WO = log[[f"{a}_wo_estimated" for a in "xyz"]].values
    p_OC = [R_OW.apply(log[[f"c{i}_{a}" for a in "xyz"]].values - p_WO) for i in range(5)]
    steps = np.linalg.norm(np.diff(p_OC, axis=1), axis=2)[:, phase.start - 1 :]
    assert values["motion_on_object"] == pytest.approx(1e3 * steps.sum() / 0.25)


def test_a_run_whose_contacts_are_still_held_has_numbers_too(tmp_path):
    overrides = {"simulation_duration": 0.1}
    study = load_study(write_study(tmp_path, overrides=overrides, measures=list(MEASURES)))
    values = sweep_run(study)(study.plan.job(0))
    assert list(values) == list(MEASURES)
    assert values["ticks"] == 2
    assert values["q_msv_final"] > 2
    assert np.isnan([values[name] for name in ("q_msv_mean", "active_share", "displacement")]).all()


def test_one_seed_of_all_points_comes_before_the_next(tmp_path, monkeypatch):
    asked = []

    def noted(function, jobs, **options):
        asked.extend(jobs)
        raise ScenarioError("", "", "enough")

    monkeypatch.setattr("drake_pregrasp.studies.sweep.sweep_command.run_jobs", noted)
    with pytest.raises(ScenarioError, match="enough"):
        sweep(load_study(write_study(tmp_path)), tmp_path)
    assert [job["seed"] for job in asked] == [0] * 4 + [1] * 4
    assert sorted(job["index"] for job in asked) == list(range(8))


@pytest.mark.slow
def test_the_command_sweeps_and_goes_on(tmp_path, capsys):
    grid = {"planner.period": [0.1, -1.0], "motion.linear_velocity": [0.0, 0.02]}
    file = write_study(tmp_path, grid=grid, seeds=1, overrides={"simulation_duration": 0.2})
    arguments = ["sweep", file, "--out", str(tmp_path), "--processes", "1"]
    assert main(arguments) == 1
    captured = capsys.readouterr()
    folder = tmp_path / "mine"
    assert "2 of 4 runs are complete" in captured.out
    assert f"2 runs failed: see {folder / FAILED}" in captured.err
    failed = pd.read_csv(folder / FAILED)
    assert failed["index"].tolist() == [2, 3]
    said = f"{file}: planner.period: -1.0 must be a number at least"
    assert failed["error"].str.startswith(said).all()
    files = {ROWS, JOURNAL, FAILED, SETTINGS, STUDY, "report.html"}
    assert {path.name for path in folder.iterdir()} == files
    before = (folder / ROWS).read_bytes()
    assert main(arguments) == 1
    assert (folder / ROWS).read_bytes() == before
    assert load_study(str(folder / STUDY)).plan == load_study(file).plan
    write_study(tmp_path, grid={**grid, "motion.linear_velocity": [0.1]}, seeds=1)
    capsys.readouterr()
    assert main(arguments) == 2
    assert "has rows of other settings (study.grid.motion" in capsys.readouterr().err
    assert (folder / ROWS).read_bytes() == before


EVIL = "rate <script>alert(1)</script> $x^{$ [Hz]"
GRID = {
    "motion.linear_velocity": [0.0, 0.001, 0.1],
    EVIL: {"slow <b>": {"planner.period": 0.1}, "$fast": {"planner.period": 0.05}},
}
RANDOM = {"planner.power": {"uniform": [1, 2]}, "planner.strategy": {"choice": ["position", "msv"]}}
MADE_UP = ["q_gii_mean", "displacement", "position_error_mean", "ticks"]


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    changes = {"grid": GRID, "random": RANDOM, "samples": 10, "measures": MADE_UP}
    folder = tmp_path_factory.mktemp("study")
    return load_study(write_study(folder, description="<script>", **changes))


@pytest.fixture(scope="module")
def rows(study):
    jobs = [study.plan.job(index) for index in range(len(study.plan))]
    rows = pd.DataFrame(jobs)
    rows["q_gii_mean"], rows["displacement"] = 0.9 + rows["motion.linear_velocity"], np.nan
    return rows.assign(position_error_mean=10.0 ** rows["index"] % 50, ticks=rows["index"])


@pytest.mark.slow
def test_all_that_a_study_names_is_escaped_and_missing_rows_are_said_to_be(study, rows, tmp_path):
    failed = rows[["index"]].head(1).assign(error="ScenarioError: <script>alert(2)</script>")
    page = write_sweep_report(tmp_path, study, StudyRows(rows, failed, 120, 120)).read_text()
    assert "<script" not in page
    assert "<b>" not in page
    for text in ("rate &lt;script&gt;", "slow &lt;b&gt;", "alert(2)", "<p>&lt;script&gt;</p>"):
        assert text in page
    assert page.count("data:image/png;base64,") == 4
    assert not re.search(r'(?:src|href)="(?!data:)', page)
    page = write_sweep_report(tmp_path, study, StudyRows(rows[:0], rows[:0], 120, 0)).read_text()
    assert "There are no rows yet." in page


def test_a_table_has_medians_and_ranges_by_value_without_nan(study, rows):
    axes = study.plan.axes
    rows = sweep_report.with_categories(rows, axes)
    by_speed = axis_table(rows, axes[0], MADE_UP)
    assert by_speed.columns[:2].tolist() == ["motion.linear_velocity [m/s]", "runs"]
    assert by_speed.iloc[:, 0].tolist() == ["0", "0.001", "0.1"]
    assert by_speed["Q_GII, mean"].tolist() == [
        f"{v:.5g} ({v:.4g} to {v:.4g})" for v in (0.9, 0.901, 1.0)
    ]
    assert by_speed[MEASURES["displacement"]].isna().all()
    ticks = rows.loc[rows["motion.linear_velocity"] == 0.1, "ticks"]
    said = f"{ticks.median():.5g} ({ticks.min():.4g} to {ticks.max():.4g})"
    assert by_speed[MEASURES["ticks"]].iloc[2] == said
    assert axis_table(rows, axes[1], MADE_UP).iloc[:, 0].tolist() == ["slow <b>", "$fast"]
    quarters = axis_table(rows, axes[2], MADE_UP)
    assert len(quarters) == 4
    assert quarters["runs"].sum() == len(rows)


@pytest.mark.slow
def test_random_numbers_are_shown_run_by_run_and_never_joined_or_used_for_colours(study, rows):
    axes = study.plan.axes
    rows = sweep_report.with_categories(rows, axes)
    assert [sweep_report.is_scattered(rows, axis) for axis in axes] == [False, False, True, False]
    colors = [sweep_report.color_axis(rows, axes, axis).name for axis in axes]
    assert colors == [EVIL, "planner.strategy", "planner.strategy", "motion.linear_velocity"]
    # Few samples are no values of an axis either: they differ in all other random fields.
    few = rows[rows["planner.power"].isin(rows["planner.power"].unique()[:3])]
    assert sweep_report.is_scattered(few, axes[2])
    for axis, color in itertools.product(axes[:3], (None, axes[1])):
        figure = sweep_report.plot_axis(few, axis, MADE_UP[:1], color)
        joined = [line for line in figure.axes[0].lines if line.get_linestyle() == "-"]
        curves = [line for line in joined if len(line.get_xdata()) > 2]
        assert len(curves) == (axis is axes[0]) * (1 if color is None else 2)


def test_axes_have_the_units_of_their_fields():
    assert sweep_report.axis_label("motion.linear_velocity") == "motion.linear_velocity [m/s]"
    assert sweep_report.axis_label("object.size[0]") == "object.size[0] [m]"
    assert sweep_report.axis_label("planner.strategy") == "planner.strategy"
    assert sweep_report.axis_label("the period [ms]") == "the period [ms]"


SPREAD = RandomAxis("spread", ("planner.position_spread",), "log_uniform", (0.01, 0.1))
BAD = yaml.safe_load((Path(__file__).parent / "bad_sweeps.yaml").read_text())
TURN = RandomAxis("turn", ("motion.angular_velocity",), "uniform", (-1.0, 1.0))


def axis(name, count):
    return GridAxis(name, tuple(range(count)), tuple({name: k} for k in range(count)))


@given(st.lists(st.integers(1, 3), min_size=1, max_size=3), st.integers(1, 3), st.integers(1, 3))
def test_a_plan_is_the_whole_product_and_each_run_is_there_once(counts, samples, seeds):
    grid = tuple(axis(f"a{k}", count) for k, count in enumerate(counts))
    plan = SweepPlan(grid, (SPREAD,), samples, 5, range(7, 7 + seeds))
    runs = [(plan.changes(index), plan.job(index)) for index in range(len(plan))]
    draws = {SPREAD.draw(5, sample) for sample in range(samples)}
    product = itertools.product(*(range(count) for count in counts), draws, range(7, 7 + seeds))
    made = {
        (*(changes[a.name] for a in grid), changes["planner.position_spread"], job["seed"])
        for changes, job in runs
    }
    assert made == set(product)
    assert len(made) == len(plan) == len(runs)


@given(st.integers(0, 10), st.integers(0, 1000))
def test_a_sample_depends_on_its_seed_name_and_number_alone(seed, sample):
    few, many = (
        SweepPlan((), axes, count, seed, range(1))
        for axes, count in (((TURN,), sample + 1), ((SPREAD, TURN), 2000))
    )
    turn = few.changes(sample)["motion.angular_velocity"]
    assert turn == many.changes(sample)["motion.angular_velocity"]
    assert turn != few.changes(0)["motion.angular_velocity"] or sample == 0
    assert turn != TURN.draw(seed + 1, sample)
    assert -1 <= turn <= 1
    assert 0.01 <= SPREAD.draw(seed, sample) <= 0.1


def test_samples_fill_their_range():
    draws = [TURN.draw(0, sample) for sample in range(400)]
    assert min(draws) < -0.97 < 0.97 < max(draws)
    logs = [SPREAD.draw(0, sample) for sample in range(400)]
    assert 170 < sum(value < 0.1**1.5 for value in logs) < 230
    for kind, ends, values in (("integer", (3, 5), {3, 4, 5}), ("choice", ("a", 1), {"a", 1})):
        drawn = RandomAxis("n", ("ring_contacts",), kind, ends)
        assert {drawn.draw(0, sample) for sample in range(60)} == values


def test_fields_that_are_linked_change_together(tmp_path):
    noise = {"uniform": [0.0001, 0.001], "fields": ["sensor.position_std", "planner.power"]}
    plan = load_study(write_study(tmp_path, random={"noise [m]": noise}, samples=3)).plan
    points = [(job["noise [m]"], job["seed"]) for job in map(plan.job, range(len(plan)))]
    assert points == points[:6] * 4  # All of them have the same samples and seeds.
    assert [seed for _, seed in points[:6]] == [0, 1] * 3
    for index in range(len(plan)):
        job, changes = plan.job(index), plan.changes(index)
        assert list(job)[:4] == ["index", "motion.linear_velocity", "rate [Hz]", "noise [m]"]
        assert job["rate [Hz]"] * job["planner.period"] == 1
        assert job["plant_config.time_step"] == job["planner.period"] / 2
        assert job["noise [m]"] == job["planner.power"] == changes["sensor.position_std"]
        assert changes["planner.period"] == job["planner.period"]


def test_fields_are_set_and_nothing_else():
    base = scenario_data(load_scenario("f_damage"))
    for path, value in (
        ("planner.period", 0.1),
        ("object.size[1]", 0.08),
        ("damage[0].contacts", [1]),
        ("initial_contacts[2][0]", -0.3),
        ("motion", {"_tag": "!Toss", "rpy": [0.0, 0.0, 0.0]}),
    ):
        data = scenario_data(load_scenario("f_damage"))
        before = read_field(data, path, "x")
        set_field(data, path, value, "x")
        assert read_field(data, path, "x") == value != before
        set_field(data, path, before, "x")
        assert data == base
    set_field(base, "planner", {"period": 0.1, "estimator": {"gravity": 1.0}}, "x")
    assert base["planner"]["estimator"]["gravity"] == 1.0
    assert base["planner"]["static_duration"] == 4.0


@pytest.mark.parametrize(("changes", "problem"), BAD, ids=lambda value: str(value)[:40])
def test_invalid_studies_are_refused_before_anything_runs(changes, problem, tmp_path):
    with pytest.raises(ScenarioError, match=re.escape(problem)) as error:
        load_study(write_study(tmp_path, **changes))
    assert "\n" not in str(error.value)


def test_a_scenario_of_ones_own_is_found_beside_the_study(tmp_path):
    (tmp_path / "own.yaml").write_text("slow: {motion: {linear_velocity: 0.0005}}\n")
    study = load_study(write_study(tmp_path, scenario="", file="own.yaml"))
    assert study.scenario["motion"]["linear_velocity"] == 0.0005
    assert study.config.scenario == "slow"
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "study.yaml").write_text(dump_yaml(study.resolved))
    again = load_study(str(tmp_path / "out" / "study.yaml"))
    assert (again.resolved, again.plan) == (study.resolved, study.plan)


@pytest.mark.parametrize("name", usable_studies())
def test_shipped_sweeps_load(name):
    study = load_study(name)
    assert study.config.description
    data = copy.deepcopy(study.scenario)
    for path, value in study.plan.changes(len(study.plan) - 1).items():
        set_field(data, path, value, "x")
    scenario_from_data(data, source=name, folder=study.folder)


FILES_STUDY = """
scenario: a_base
grid:
  hand.file: [hand/own.yaml]
  object: [!Mesh {file: m.gltf}, !Box {}, !Mesh {file: missing.obj}]
random:
  motion: {choice: [!PoseStream {file: one.csv}, !PoseStream {file: sub/two.csv}]}
"""


def test_the_order_of_labels_is_a_setting_and_labels_may_be_texts_and_numbers(tmp_path):
    rates = {20: {"planner.period": 0.05}, "often": {"planner.period": 0.02}}
    turned = {name: rates[name] for name in ("often", 20)}
    one, other = (
        load_study(write_study(tmp_path / str(k), grid={"rate": labels}))
        for k, labels in enumerate((rates, turned))
    )
    assert [one.plan.job(index)["rate"] for index in range(4)] == [20, 20, "often", "often"]
    assert one.settings["order"] != other.settings["order"]
    (tmp_path / "again.yaml").write_text(dump_yaml(one.resolved))
    assert load_study(str(tmp_path / "again.yaml")).settings == one.settings


@pytest.mark.slow
def test_the_content_of_each_file_that_is_named_is_a_setting(tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "hand").mkdir()
    hand = (resource_folder("models") / "five_finger_hand.yaml").read_text()
    model = (resource_folder("models") / "five_finger_hand.sdf").read_bytes()
    own = re.sub(r"model: \S+", "model: own.sdf", hand)
    files = {
        "m.gltf": b'{"buffers": [{"uri": "m.bin"}]}',
        "m.bin": b"1",
        "one.csv": b"2",
        "sub/two.csv": b"3",
        "hand/own.yaml": own.encode(),
        "hand/own.sdf": model,
    }
    for name, content in {**files, "other.csv": b"4", "mine.yaml": FILES_STUDY.encode()}.items():
        (tmp_path / name).write_bytes(content)
    study = load_study(str(tmp_path / "mine.yaml"))
    before = named_files(study)
    assert set(before) == {str(tmp_path / name) for name in files}
    for name in [*files, "other.csv"]:
        with (tmp_path / name).open("ab") as file:
            file.write(b"\n")
        after = named_files(study)
        changed = {path for path in before if after[path] != before[path]}
        assert changed == ({str(tmp_path / name)} if name in files else set())
        before = after


def test_a_study_below_the_folder_of_its_mesh_may_not_name_it_but_one_above_may(tmp_path):
    (tmp_path / "sub").mkdir()
    box([0.1, 0.1, 0.1]).export(tmp_path / "m.obj")
    (tmp_path / "sub" / "own.yaml").write_text("own: {object: !Mesh {file: ../m.obj}}\n")
    study = load_study(write_study(tmp_path, scenario="", file="sub/own.yaml"))
    assert study.scenario["object"]["file"] == str(tmp_path / "m.obj")
    with pytest.raises(ScenarioError, match=r"m\.obj is outside of"):
        load_study(write_study(tmp_path / "sub", scenario="", file="own.yaml"))


@given(st.integers(), st.integers(0, 2**66))
def test_whole_numbers_are_drawn_between_any_ends_of_64_bits_and_no_others(low, width):
    low, high = low * 2**55, low * 2**55 + width
    entry = {"integer": [low, high]}
    if low >= -(2**63) and high < 2**63:
        assert low <= random_axis("random_seed", entry, {"random_seed": 0}, "x").draw(0, 0) <= high
    else:
        with pytest.raises(ScenarioError, match=r"each a whole number at least -9223"):
            random_axis("random_seed", entry, {"random_seed": 0}, "x")
