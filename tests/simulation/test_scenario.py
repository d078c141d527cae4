import dataclasses
from pathlib import Path

import pytest
import yaml
from conftest import slow, usable_scenarios

from drake_pregrasp import Scenario, ScenarioError, load_resolved, load_scenario, shipped_scenarios
from drake_pregrasp.config import object_config
from drake_pregrasp.config.object_config import PoseStream
from drake_pregrasp.interfaces.pose_files import read_poses
from drake_pregrasp.resources import resolve_path, resource_folder
from drake_pregrasp.simulation.recording import camera_view
from drake_pregrasp.simulation.scenario_file import (
    dump_scenario,
    resolve,
    scenario_data,
    scenario_from_data,
)
from drake_pregrasp.simulation.simulation_diagram import make_diagram

TEMPLATE = "case:\n  description: for a test\n"

BAD = yaml.safe_load((Path(__file__).parent / "bad_scenarios.yaml").read_text())


@pytest.mark.parametrize(("text", "key", "problem"), BAD, ids=[case[0] for case in BAD])
def test_bad_keys_are_named_in_one_line(tmp_path, text, key, problem):
    whole = "description" in text or text.startswith("{")
    message = refusal(tmp_path, f"case:\n  {text}\n" if whole else f"{TEMPLATE}  {text}\n")
    assert key in message
    assert problem in message


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("case: [1", "is not valid YAML"),
        ("- a\n- b\n", "must be a mapping"),
        (b"\xff\xfe\x00", "cannot be read"),
        ("", "must be a mapping"),
        ("a: {}\nb: {}\n", "there are: a, b"),
        ("1: {}\n", "is not a name"),
        ("case: 3\n", "3 must be a mapping"),
    ],
)
def test_bad_files_are_named_in_one_line(tmp_path, content, problem):
    assert problem in refusal(tmp_path, content)


def refusal(folder, content):
    """Returns the line that refuses a scenario's file."""
    file = folder / "bad.yaml"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ScenarioError) as caught:
        load_resolved(file=file)
    message = str(caught.value)
    assert message.startswith(str(file))
    assert "\n" not in message
    return message


def test_missing_files_and_names_are_named(tmp_path):
    with pytest.raises(ScenarioError, match="cannot be read"):
        load_scenario(file=tmp_path / "none.yaml")
    with pytest.raises(ScenarioError, match="no such scenario; there are: a_base"):
        load_scenario("z_none")
    with pytest.raises(ScenarioError, match="needs a name or a file"):
        load_scenario()
    file = tmp_path / "one.yaml"
    file.write_text(TEMPLATE)
    with pytest.raises(ScenarioError, match="no such entry; there are: case"):
        load_scenario("other", file=file)


def test_texts_override_single_keys_and_are_checked(tmp_path):
    scenario = load_scenario("c_faster", text="{planner: {period: 1e-1}, random_seed: 4}")
    assert (scenario.planner.period, scenario.random_seed) == (0.1, 4)
    # The text keeps other keys but the description, which may be false for what it makes.
    assert (scenario.motion.angular_velocity, scenario.description) == (0.0349, "")
    assert load_scenario("c_faster", text="{description: mine}").description == "mine"
    with pytest.raises(ScenarioError, match=r"^scenario text: planner.period: -1 must"):
        load_scenario("a_base", text="{planner: {period: -1}}")
    with pytest.raises(ScenarioError, match=r"with scenario text: a_base.contact_weights"):
        load_resolved("a_base", text="{contact_weights: [1.0]}")


FIRST = {file: name for name, (file, _) in reversed(shipped_scenarios().items())}.values()


@pytest.mark.parametrize(
    "name", [one if one.values[0] in FIRST else slow(*one.values) for one in usable_scenarios()]
)
def test_shipped_scenarios_survive_being_written_and_read(name, tmp_path):
    scenario = load_scenario(name)
    file = tmp_path / "scenario.yaml"
    file.write_text(dump_scenario(name, scenario))
    assert dump_scenario(name, load_scenario(file=file)) == file.read_text()
    data = scenario_data(scenario)
    assert scenario_data(scenario_from_data(data, source="x", folder=tmp_path).scenario) == data
    assert scenario.description
    assert "publish_every_time_step" not in file.read_text()  # Gone in Drake 1.58.


def test_cases_differ_from_the_base_by_what_table_1_says():
    base = plain(load_scenario("a_base"))
    differences = {
        name: {key for key, value in plain(load_scenario(name)).items() if value != base[key]}
        for name, (file, _) in shipped_scenarios().items()
        if file.stem in ("paper", "measures")
    }
    changed = {
        "b_slower c_faster": "motion",
        "d_smaller e_bigger": "object",
        "f_damage": "damage",
        "g_poor_start": "initial_contacts",
        "h_msv i_gii j_vew margin blend": "planner",
        "soft_finger frictionless": "measures",
    }
    expected = {
        name: {"description", key} for names, key in changed.items() for name in names.split()
    }
    assert differences == {"a_base": set(), **expected}


def plain(scenario: Scenario) -> dict[str, str]:
    return {f.name: repr(getattr(scenario, f.name)) for f in dataclasses.fields(scenario)}


STREAM = "time,x,y,z,qw,qx,qy,qz\n0,0,0,0.3,1,0,0,0\n1,0,0,0.4,1,0,0,0\n"


def test_a_file_is_looked_for_beside_the_scenario(tmp_path, monkeypatch):
    """And wherever a run folder's copy of the scenario goes, it names the same file."""
    stream = tmp_path / "data" / "poses.csv"
    stream.parent.mkdir()
    stream.write_text(STREAM)
    file, copy = tmp_path / "mine.yaml", stream.with_name("copy.yaml")
    file.write_text("case: {motion: !PoseStream {file: data/poses.csv}}\n")
    scenario = load_scenario(file=file)
    copy.write_text(dump_scenario("case", scenario))
    monkeypatch.chdir(stream.parent)
    text = "{motion: !PoseStream {file: poses.csv}}"
    made = Scenario(motion=PoseStream(file="poses.csv"))
    resolve(made)
    for found in (scenario, load_scenario(file=copy), load_scenario("a_base", text=text), made):
        assert found.motion.file == str(stream)


def test_a_file_of_the_package_keeps_its_name():
    file = "package://drake_pregrasp/carried_by_hand.csv"
    assert load_scenario("pose_stream").motion.file == file
    here = Path("/nowhere")
    assert resolve_path(file, here) == resource_folder("models") / "carried_by_hand.csv"
    assert resolve_path("x/../y.csv", here) == here / "y.csv"
    assert resolve_path("/y.csv", here) == Path("/y.csv")
    assert resolve_path("~/y.csv", here) == Path.home() / "y.csv"


@pytest.mark.slow
def test_the_poses_of_a_run_are_read_once(monkeypatch):
    read = []
    monkeypatch.setattr(
        object_config, "read_poses", lambda *args: read.append(args) or read_poses(*args)
    )
    resolved = load_resolved("see_handed_over")
    make_diagram(resolved)
    camera_view(resolved)
    assert len(read) == 1
