"""Runs of a sweep's file, and messages about invalid files."""

import itertools
import re
from pathlib import Path

import pytest
import yaml
from conftest import usable_studies
from hypothesis import given
from hypothesis import strategies as st
from made_up_jobs import write_study

from drake_pregrasp import ScenarioError, load_scenario
from drake_pregrasp.resources import resource_folder
from drake_pregrasp.simulation.scenario_file import scenario_data, scenario_from_data
from drake_pregrasp.simulation.yaml_text import dump_yaml
from drake_pregrasp.studies.sweep.field_path import read_field, set_field
from drake_pregrasp.studies.sweep.study_file import load_study, named_files
from drake_pregrasp.studies.sweep.sweep_plan import GridAxis, RandomAxis, SweepPlan, random_axis

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


@pytest.mark.parametrize("name", ["a_base", "toss", "can", "grasp_five_finger", "passing_ball"])
def test_a_scenario_is_the_same_as_data(name, tmp_path):
    data = scenario_data(load_scenario(name))
    assert scenario_data(scenario_from_data(data, source="x", folder=tmp_path)) == data


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
    for index in range(0, len(study.plan), len(study.plan) // 7):
        data = scenario_data(load_scenario(study.config.scenario))
        for path, value in study.plan.changes(index).items():
            set_field(data, path, value, "x")
        scenario_from_data(data, source=name, folder=study.folder)


FILES_STUDY = """
scenario: a_base
grid:
  grasp.hand: [hand/own.yaml]
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
    mug = (resource_folder("models") / "mug.obj").read_bytes()
    (tmp_path / "m.obj").write_bytes(mug)
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
