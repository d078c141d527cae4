"""Studies from their files: runs, rows that agree with them, report, and messages."""

import itertools
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from conftest import usable_studies
from hypothesis import given
from hypothesis import strategies as st
from made_up_jobs import write_study
from scipy.spatial.transform import Rotation
from trimesh.creation import box

from drake_pregrasp import ScenarioError, load_scenario, run
from drake_pregrasp.cli import main
from drake_pregrasp.config.yaml_text import dump_yaml
from drake_pregrasp.resources import resource_folder
from drake_pregrasp.simulation.run_log import adapting_phase
from drake_pregrasp.simulation.scenario_file import scenario_data, scenario_from_data
from drake_pregrasp.studies.field_path import read_field, set_field
from drake_pregrasp.studies.measures import MARGINS, PLANNING
from drake_pregrasp.studies.runner import FAILED, JOURNAL, ROWS, SETTINGS
from drake_pregrasp.studies.study_axes import RandomAxis, random_axis
from drake_pregrasp.studies.study_command import STUDY, named_files, study_settings
from drake_pregrasp.studies.study_file import load_study, study_data
from drake_pregrasp.studies.study_run import StudyRun

PLANNED = [*PLANNING.labels, *MARGINS.labels]
"""Measures of the planner."""


def rows_of(study, place):
    (row,) = StudyRun(study, {})(study.jobs()[place])
    return row


@pytest.mark.slow
def test_measures_are_those_of_a_run_folder(tmp_path):
    overrides = {"simulation_duration": 0.4, "planner.static_duration": 0.2}
    study = load_study(write_study(tmp_path, measures=PLANNED, overrides=overrides))
    values = rows_of(study, 7)
    text = (
        "{simulation_duration: 0.4, planner: {static_duration: 0.2, period: 0.05}, random_seed: 1"
        ", motion: {linear_velocity: 0.02}, plant_config: {time_step: 0.025}}"
    )
    scenario = load_scenario("a_base", text=text)
    result = run(scenario, name="one", out=tmp_path, recording=False)
    summary = result.summary
    for quality, kind in itertools.product(("q_msv", "q_gii", "q_vew"), ("mean", "max", "final")):
        assert values[f"{quality}_{kind}"] == summary[kind][quality]
    for name in MARGINS.labels:
        assert values[name] == summary[name]["final"]
    assert values["ticks"] == summary["ticks"] == 9
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
    study = load_study(write_study(tmp_path, overrides=overrides, measures=PLANNED))
    values = rows_of(study, 0)
    assert list(values) == PLANNED
    assert values["ticks"] == 2
    assert values["q_msv_final"] > 2
    assert np.isnan([values[name] for name in ("q_msv_mean", "active_share", "displacement")]).all()


CONDITIONS = {
    "slow": {},
    "fast": {"overrides": {"motion.linear_velocity": 0.02}, "scenario": "i_gii"},
    "other": {"random": {"planner.power": {"uniform": [5, 6]}}},
}
METHODS = {"msv": {"overrides": {"planner": {"strategy": "msv"}}}, "position": {}}


@pytest.mark.slow
@pytest.mark.parametrize(("seeds", "first"), [(1, 0), (3, 70)])
def test_the_runs_of_a_study_are_the_whole_product_with_one_seed_before_the_next(seeds, first):
    study = load_study(PRODUCT, seeds=seeds, first_seed=first)
    jobs = study.jobs()
    seen = [tuple(job[n] for n in ("seed", "condition", "rate", "method")) for job in jobs]
    expected = itertools.product(range(first, first + seeds), CONDITIONS, (10, 20), METHODS)
    assert seen == list(expected)
    few = load_study(PRODUCT, conditions=["fast"], methods=["msv"], seeds=seeds, first_seed=first)
    kept = [job for job in jobs if (job["condition"], job["method"]) == ("fast", "msv")]
    assert few.jobs() == kept
    assert study_settings(few) == study_settings(study)


@pytest.fixture(scope="module", autouse=True)
def product(tmp_path_factory):
    global PRODUCT
    rate = {10: {"planner.period": 0.1}, 20: {"planner.period": 0.05}}
    power = {"planner.power": {"uniform": [1, 2]}}
    PRODUCT = write_study(
        tmp_path_factory.mktemp("product"),
        grid={"rate": rate},
        conditions=CONDITIONS,
        methods=METHODS,
        random=power,
    )


def test_later_changes_come_on_top_of_those_of_the_study():
    study = load_study(PRODUCT, text="{overrides: {measures: {friction: 0.4}}, seeds: 3}")
    jobs = study.jobs()
    assert len(jobs) == 36
    for job in jobs:
        data = study.scenario_of(job)
        assert data["measures"]["friction"] == 0.4
        assert data["simulation_duration"] == 0.2  # Of the study, in all conditions.
        assert data["planner"]["period"] == 1 / job["rate"]
        assert data["random_seed"] == job["seed"]
        strategy = "gii" if job["condition"] == "fast" else "position"
        assert data["planner"]["strategy"] == ("msv" if job["method"] == "msv" else strategy)
        low = 5 if job["condition"] == "other" else 1
        assert low <= data["planner"]["power"] == job["planner.power"] <= low + 1
        speed = 0.02 if job["condition"] == "fast" else 0.001
        assert data["motion"]["linear_velocity"] == speed


@pytest.mark.slow
def test_the_content_of_a_study_is_a_file_of_the_same_study(tmp_path):
    study = load_study(PRODUCT)
    (tmp_path / "again.yaml").write_text(dump_yaml(study_data(study.config)))
    again = load_study(str(tmp_path / "again.yaml"))
    assert again.jobs() == study.jobs()
    assert study_settings(again) == study_settings(study)


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (
            {"conditions": ["quick"]},
            "--conditions: quick: there is none with this key; there are: slow, fast",
        ),
        ({"methods": [""]}, "--methods: there is none with this key; there are: msv, position"),
        ({"text": "{sead: 1}"}, "study text: sead: unknown key (value 1); did you mean seeds?"),
        ({"text": "[1]"}, "study text: [1] must be a mapping"),
        ({"seeds": 0}, "mine.yaml: seeds: 0 must be a whole number at least 1"),
        (
            {"seeds": 2, "first_seed": 2**53},
            "first_seed: 9007199254740992 is too large: the last of 2 seeds would be"
            " 9007199254740993, not at most 9007199254740992",
        ),
    ],
)
def test_unusable_choices_are_refused(options, problem):
    with pytest.raises(ScenarioError, match=re.escape(problem)):
        load_study(PRODUCT, **options)


@pytest.mark.slow
def test_the_command_makes_a_study_and_goes_on(tmp_path, capsys):
    grid = {"planner.period": [0.1, -1.0], "motion.linear_velocity": [0.0, 0.02]}
    file = write_study(tmp_path, grid=grid, seeds=1, overrides={"simulation_duration": 0.2})
    arguments = ["study", file, "--out", str(tmp_path), "--processes", "1"]
    assert main(arguments) == 1
    captured = capsys.readouterr()
    folder = tmp_path / "mine"
    assert "2 of 4 runs are complete" in captured.out
    assert f"2 runs failed: see {folder / FAILED}" in captured.err
    failed = pd.read_csv(folder / FAILED)
    assert failed["planner.period"].tolist() == [-1, -1]
    said = f"{file}: planner.period: -1.0 must be a number at least"
    assert failed["error"].str.startswith(said).all()
    files = {ROWS, JOURNAL, FAILED, SETTINGS, STUDY, "report.html", "report.md"}
    assert {path.name for path in folder.iterdir()} == files
    before = (folder / ROWS).read_bytes()
    assert main(arguments) == 1
    assert (folder / ROWS).read_bytes() == before
    assert main([*arguments, "--first_seed", "5"]) == 1  # Other seeds come beside these.
    assert len(pd.read_csv(folder / ROWS)) == 4
    write_study(tmp_path, grid={**grid, "motion.linear_velocity": [0.1]}, seeds=1)
    capsys.readouterr()
    assert main(arguments) == 2
    assert "has rows of other settings (study.grid.motion" in capsys.readouterr().err
    assert len(pd.read_csv(folder / ROWS)) == 4


BAD = yaml.safe_load((Path(__file__).parent / "bad_studies.yaml").read_text())
SPREAD = RandomAxis("spread", ("planner.position_spread",), "log_uniform", (0.01, 0.1))
TURN = RandomAxis("turn", ("motion.angular_velocity",), "uniform", (-1.0, 1.0))


@given(st.integers(0, 2**31), st.integers(0, 2**31))
def test_a_value_depends_on_the_seed_and_the_name_alone(seed, other):
    assert TURN.draw(seed) == RandomAxis("turn", ("x", "y"), "uniform", (-1.0, 1.0)).draw(seed)
    assert -1 <= TURN.draw(seed) <= 1
    assert 0.01 <= SPREAD.draw(seed) <= 0.1
    assert TURN.draw(seed) != TURN.draw(other) or seed == other
    assert TURN.draw(seed) != RandomAxis("turns", ("x",), "uniform", (-1.0, 1.0)).draw(seed)


def test_values_fill_their_range():
    draws = [TURN.draw(seed) for seed in range(400)]
    assert min(draws) < -0.97 < 0.97 < max(draws)
    logs = [SPREAD.draw(seed) for seed in range(400)]
    assert 170 < sum(value < 0.1**1.5 for value in logs) < 230
    for kind, ends, values in (("integer", (3, 5), {3, 4, 5}), ("choice", ("a", 1), {"a", 1})):
        axis = RandomAxis("n", ("ring_contacts",), kind, ends)
        assert {axis.draw(seed) for seed in range(60)} == values


@given(st.integers(0, 10_000), st.integers(1, 40))
def test_random_objects_come_once_each_before_any_comes_again(first, count):
    axis = RandomAxis("object", ("object",), "random_objects", (100, 99 + count))
    drawn = [axis.label(seed) for seed in range(first, first + count)]
    assert sorted(drawn) == [f"objects://random/{k}.obj" for k in range(100, 100 + count)]
    assert axis.changes(first)["object"]["mass"] == 0.1


def test_fields_that_are_linked_change_together(tmp_path):
    noise = {"uniform": [0.0001, 0.001], "fields": ["sensor.position_std", "planner.power"]}
    study = load_study(write_study(tmp_path, random={"noise [m]": noise}))
    for job in study.jobs():
        data = study.scenario_of(job)
        assert list(job) == ["motion.linear_velocity", "rate [Hz]", "noise [m]", "seed"]
        assert job["rate [Hz]"] * data["planner"]["period"] == 1
        assert data["plant_config"]["time_step"] == data["planner"]["period"] / 2
        assert job["noise [m]"] == data["planner"]["power"] == data["sensor"]["position_std"]


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
    assert study.bases[""]["motion"]["linear_velocity"] == 0.0005
    assert study.config.scenario == "slow"


@pytest.mark.slow
@pytest.mark.parametrize("name", usable_studies())
def test_shipped_studies_load(name):
    study = load_study(name)
    assert study.config.description
    for job in (study.jobs()[0], study.jobs()[-1]):
        scenario_from_data(study.scenario_of(job), source=name, folder=study.folder)


FILES_STUDY = """
scenario: a_base
grid:
  hand.file: [hand/own.yaml]
  object: [!Mesh {file: m.gltf}, !Box {}, !Mesh {file: missing.obj}]
random:
  motion: {choice: [!PoseStream {file: one.csv}, !PoseStream {file: sub/two.csv}]}
"""


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
    assert study.bases[""]["object"]["file"] == str(tmp_path / "m.obj")
    with pytest.raises(ScenarioError, match=r"m\.obj is outside of"):
        load_study(write_study(tmp_path / "sub", scenario="", file="own.yaml"))


def test_texts_to_choose_from_stay_texts_also_if_they_read_as_numbers():
    data = {"description": "", "planner": {"power": 1.0}}
    entry = {"choice": ["1e3", "7"]}
    assert random_axis("description", entry, data, "x").arguments == ("1e3", "7")
    assert random_axis("planner.power", entry, data, "x").arguments == (1000.0, 7.0)


def test_a_run_whose_planner_has_no_tick_at_a_closing_time_is_refused(tmp_path):
    changes = {
        "scenario": "grasp_five_finger",
        "overrides": {},
        "grid": {"planner.period": [0.05, 0.04]},
        "measures": ["held"],
        "closing_times": [1.0, 1.05],
    }
    study = load_study(write_study(tmp_path, **changes))
    job = next(job for job in study.jobs() if job["planner.period"] == 0.04)
    problem = re.escape(
        "closing_times: 1.05 s is between two ticks of the planner; take a multiple"
    )
    with pytest.raises(ScenarioError, match=problem):
        StudyRun(study, {})(job)


@given(st.integers(), st.integers(0, 2**66))
def test_whole_numbers_are_drawn_between_any_ends_of_64_bits_and_no_others(low, width):
    low, high = low * 2**55, low * 2**55 + width
    entry = {"integer": [low, high]}
    if low >= -(2**63) and high < 2**63:
        assert low <= random_axis("random_seed", entry, {"random_seed": 0}, "x").draw(0) <= high
    else:
        with pytest.raises(ScenarioError, match=r"each a whole number at least -9223"):
            random_axis("random_seed", entry, {"random_seed": 0}, "x")
