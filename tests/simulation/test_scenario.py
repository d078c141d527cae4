import dataclasses
from pathlib import Path

import pytest
from conftest import usable_scenarios

from drake_pregrasp import Scenario, ScenarioError, load_scenario, shipped_scenarios
from drake_pregrasp.config.object_config import PoseStream
from drake_pregrasp.resources import resolve_path, resource_folder
from drake_pregrasp.simulation.scenario_file import check_scenario, dump_scenario

TEMPLATE = "case:\n  description: for a test\n"

BAD = [
    (
        "planner: {perod: 0.1}",
        "case.planner.perod",
        "unknown key (value 0.1); did you mean period?",
    ),
    ("zzz: 1", "case.zzz", "unknown key"),
    (
        "planner: {period: -0.1}",
        "case.planner.period",
        "-0.1 must be a number at least 0.0001 and at",
    ),
    ("planner: {period: 0}", "case.planner.period", "0 must be a number at least 0.0001"),
    ("planner: {period: .nan}", "case.planner.period", "nan must be a number at least"),
    ("planner: {period: .inf}", "case.planner.period", "inf must be"),
    ("planner: {period: fast}", "case.planner.period", "'fast' must be a number at least"),
    ("planner: {period: [1]}", "case.planner.period", "[1] must be a number"),
    ("planner: {period: true}", "case.planner.period", "True must be a number"),
    ("planner: {strategy: luck}", "case.planner.strategy", "'luck' must be one of: position, msv"),
    ("planner: 3", "case.planner", "3 must be a mapping with keys out of: period"),
    ("planner: {estimator: {lookahead: -1}}", "planner.estimator.lookahead", "at least 0"),
    ("planner: {blend: {vew: -1}}", "case.planner.blend.vew", "-1 must be a number at least 0"),
    ("planner: {blend: {luck: 1}}", "case.planner.blend.luck", "keys are: position, msv"),
    ("planner: {strategy: blend}", "case.planner.blend", "all weights are 0; a blend needs one"),
    ("planner: {power: 0}", "case.planner.power", "0 must be a number above 0 and at most 100"),
    ("measures: {contact_model: glue}", "measures.contact_model", "must be one of: complete, hard"),
    ("measures: {friction: -1}", "case.measures.friction", "-1 must be a number at least 0"),
    ("random_seed: 1.5", "case.random_seed", "1.5 must be a whole number at least 0"),
    ("description: 7", "case.description", "7 must be a text"),
    ("object: {size: [0.1, 0.1]}", "case.object.size", "a list of exactly 3 elements"),
    (
        "object: {size: [0.1, 0.1, -1]}",
        "case.object.size[2]",
        "-1 must be a number at least 0.005 and at most 0.25",
    ),
    ("initial_contacts: []", "case.initial_contacts", "a list of at least 1 elements"),
    ("initial_contacts: [[1, 0]]", "case.initial_contacts[0]", "a list of exactly 3 elements"),
    ("initial_contacts: [[1, 0, .nan]]", "case.initial_contacts[0][2]", "nan must be a number"),
    ("initial_contacts: [[1, 0, 0], [0.9, 0, 0]]", "case.initial_contacts[1]", "5 mm off the surf"),
    (
        "damage: [{at: 99, contacts: [1]}]",
        "case.damage[0].at",
        "99.0 is after the end, the last tick",
    ),
    ("damage: [{at: 1, contacts: [5]}]", "case.damage[0].contacts", "there is no contact 5 left"),
    ("damage: [{at: 1, contacts: [1, 1]}]", "case.damage[0].contacts", "no contact 1 left to lose"),
    ("damage: [{at: 1, contacts: [0, 1, 2, 3, 4]}]", "damage[0].contacts", "leaves no contact"),
    ("damage: [{at: 1, contacts: []}]", "case.damage[0].contacts", "at least 1 elements"),
    ("damage: [{at: 1, contacts: [1], x: 2}]", "case.damage[0].x", "unknown key"),
    ("damage: [{at: 1}]", "case.damage[0]", "lacks the key contacts"),
    ("damage: [{contacts: [1]}]", "case.damage[0]", "lacks the key at"),
    (
        "{simulation_duration: 5.02, damage: [{at: 5.01, contacts: [1]}]}",
        "case.damage[0].at",
        "5.01 is after the end, the last tick is at 5 s",
    ),
    ("contact_weights: [0, 2]", "case.contact_weights[1]", "2 must be a number at least -1"),
    ("contact_weights: [0, 1]", "case.contact_weights", "one number for each of the 5"),
    ("surface: {forbidden_faces: [top]}", "surface.forbidden_faces[0]", "must be one of: +x, -x"),
    (
        "surface: {forbidden_faces: [+x, -x, +y, -y, +z, -z]}",
        "case.surface.forbidden_faces",
        "none is left",
    ),
    ("plant_config: {contact_model: magic}", "case.plant_config", "magic"),
    ("plant_config: {time_step: 0}", "case.plant_config.time_step", "0 must be a number at least"),
    ("simulator_config: {integration_scheme: magic}", "case.simulator_config", "magic"),
    ("simulator_config: {max_step_size: -1}", "case.simulator_config.max_step_size", "above 0"),
    ("simulator_config: {start_time: 5}", "case.simulator_config.start_time", "5 must be a number"),
    ("plant_config: {stiction_tolerance: 0}", "case.plant_config.stiction_tolerance", "above 0"),
    ("object: {mass: 1.0e+300}", "case.object.mass", "above 0 and at most 1000"),
    ("planner: {position_spread: 1.0e+200}", "case.planner.position_spread", "at most 1000"),
    ("planner: {period: '1_0'}", "case.planner.period", "must be a number"),
    ("1: 2", "case", "the key 1 must be a name"),
    ("random_seed: 9007199254740993", "case.random_seed", "at most 9007199254740992"),
    ("motion: !Throw {}", "case.motion", "no such tag !Throw; there are: !Conveyor, !Toss, !Push"),
    ("motion: {velocity: [0, 0, 1]}", "case.motion.velocity", "unknown key"),
    ("motion: {profile: [[0, 1]]}", "case.motion.profile[0]", "a list of exactly 3 elements"),
    ("motion: {profile: [[1, 0, 0]]}", "case.motion.profile[0][0]", "1.0 must be 0, the first"),
    (
        "motion: {profile: [[0, 0, 0], [2, 1, 0], [2, 0, 0]]}",
        "case.motion.profile[2][0]",
        "2.0 must be more than 2.0, the time before it",
    ),
    (
        "motion: {profile: [[0, 11, 0]]}",
        "case.motion.profile[0][1]",
        "11.0 must be from -10 to 10 m/s",
    ),
    ("motion: {profile: [[0, .nan, 0]]}", "case.motion.profile[0][1]", "nan must be a number"),
    ("motion: !Toss {position: [0, 1]}", "case.motion.position", "a list of exactly 3 elements"),
    ("motion: !Toss {velocity: [0, 0, 99]}", "case.motion.velocity[2]", "at most 50"),
    (
        "motion: !Toss {table: true, position: [0, 0, 0.06], rpy: [0, 0.8, 0]}",
        "case.motion.position[2]",
        "0.06 must be at least 0.0707, to start above the table",
    ),
    ("motion: {profile: [[0, 0, 101]]}", "case.motion.profile[0][2]", "101.0 must be from -100"),
    ("motion: !Toss {table: 3}", "case.motion.table", "3 must be true or false"),
    ("motion: !Push {speed: 0}", "case.motion.speed", "0 must be a number above 0"),
    (
        "motion: !Push {direction: 0.8, start_distance: 0.06}",
        "case.motion.start_distance",
        "0.06 must be at least 0.0707, where the object ends",
    ),
    ("motion: !PoseStream {}", "case.motion", "lacks the key file"),
    ("motion: !PoseStream {file: 3}", "case.motion.file", "3 must be a text"),
    ("motion: !PoseStream {file: none.csv}", "case.motion.file", "none.csv: can't be read"),
    ("motion: !PoseStream {file: bad.yaml}", "case.motion.file", "row 1: lacks the column time"),
    ("planner: {estimator: {gravity: -9.81}}", "estimator.gravity", "at least 0"),
    ("object: !Sphere {}", "case.object", "no such tag !Sphere; there are: !Box, !Cylinder"),
    ("object: !Mesh {}", "case.object", "lacks the key file"),
    ("object: !Mesh {file: none.obj}", "case.object.file", "none.obj: no such file"),
    ("object: !Mesh {file: bad.yaml}", "case.object.file", "bad.yaml can't be read as a mesh"),
    ("object: !Revolved {profile: [[0, 0], [1, 1]]}", "case.object.profile", "at least 3 elements"),
    (
        "object: !Revolved {profile: [[0, 0], [0.1, 0], [0, 0]]}",
        "case.object.profile",
        "the profile encloses no area",
    ),
    (
        "object: !Revolved {profile: [[0, 0], [0.1, 0], [0.1, 0.1], [0.05, -0.05], [0, 0.1]]}",
        "case.object.profile",
        "the profile is no body: its surface crosses itself",
    ),
    (
        "object: !Mesh {file: package://other/x.obj}",
        "case.object.file",
        "package://other/x.obj: only package://drake_pregrasp/ is known",
    ),
    (
        "object: !Mesh {file: package://drake_pregrasp/mug.obj, scale: 1.0e-6}",
        "case.object.file",
        "m long; at least 0.001 m, choose a scale",
    ),
    (
        "{description: x, object: !Ball {}, plant_config: {contact_model: point}}",
        "case.plant_config.contact_model",
        "only boxes stand on it; choose hydroelastic_with_fallback",
    ),
    ("obstacles: [{size: [1, 1, 1]}]", "case.obstacles[0]", "without a tag it is a !BallObstacle"),
    ("object: !Ball {radius: 40}", "case.object.radius", "40 must be a number at least 0.001"),
    (
        "{description: x, object: !Ball {radius: 0.5}, surface: {spacing: 0.0005}}",
        "case.surface.spacing",
        "choose a larger spacing",
    ),
    (
        "surface: {no_touch: [!Facing {direction: [0, 0, 0]}]}",
        "case.surface.no_touch[0]",
        "direction must not be zero",
    ),
    ("surface: {no_touch: [!Part {name: lid}]}", "no_touch[0]", "no part 'lid'; there are: body"),
    (
        "surface: {no_touch: [!BehindPlane {point: [0, 0, 1], normal: [0, 0, 1]}]}",
        "case.surface.no_touch",
        "no ground is left for contacts",
    ),
    ("surface: {no_touch: [!InsideBall {radius: 0}]}", "no_touch[0].radius", "above 0"),
    ("obstacles: [!PlaneObstacle {normal: [0, 0, 0]}]", "obstacles[0]", "normal must not be zero"),
    ("obstacles: [{radius: 0.1, speed: 1}]", "case.obstacles[0].speed", "unknown key"),
    ("hand: {fingertips: [[0, 0, 0]]}", "case.hand.fingertips", "1 rows must be none or one for"),
    ("ring_contacts: 99", "case.ring_contacts", "99 must be a whole number at least 0 and at most"),
    ("planner: {wall_test: luck}", "case.planner.wall_test", "must be one of: none, normals"),
    ("planner: {limits: {tip_radii: [0.01]}}", "limits.tip_radii", "1 elements must be none or"),
    ("planner: {limits: {guard: [luck]}}", "limits.guard[0]", "'luck' must be one of: q_msv"),
    ("planner: {limits: {deadband: 2}}", "limits.deadband", "more than the object's own 0.173 m"),
    (
        "planner: {limits: {tip_radii: [9, 9, 9, 9, 9]}}",
        "limits.tip_radii",
        "9.0 is more than the object's own 0.1 m",
    ),
    (
        "planner: {limits: {pairs: [{first: 0, second: 9, distance: 0.1}]}}",
        "limits.pairs[0]",
        "there is no contact 9",
    ),
    (
        "planner: {limits: {pairs: [{first: 1, second: 1, distance: 0.1}]}}",
        "limits.pairs[0]",
        "contact 1 can't follow itself",
    ),
    (
        "planner: {limits: {pairs: [{first: 0, second: 1, distance: 0.5}]}}",
        "limits.pairs[0].distance",
        "0.5 is more than the object's own 0.173 m",
    ),
    (
        "planner: {limits: {tip_radii: [0.01, 0.01, 0.01, 0.01, 0.01],"
        " pairs: [{first: 0, second: 1, distance: 0.015}]}}",
        "limits.pairs[0].distance",
        "0.015 contradicts tip_radii, which keep the two 0.02 m apart",
    ),
    (
        "planner: {limits: {pairs: [{first: 0, second: 1, distance: 0.03},"
        " {first: 1, second: 2, distance: 0.03}]}}",
        "limits.pairs",
        "a contact is in two pairs",
    ),
    (
        "{description: x, initial_contacts: [[1, 0, 0]],"
        " planner: {limits: {reach: [!BallReach {center: [1, 0, 0], radius: 0.1}]}}}",
        "limits.reach[0]",
        "the object is never nearer to it than 0.",
    ),
    ("simulator_config: {max_step_size: big}", "case.simulator_config.max_step_size", "'big'"),
]


@pytest.mark.parametrize(("text", "key", "problem"), BAD, ids=[case[0] for case in BAD])
def test_bad_keys_are_named_in_one_line(tmp_path, text, key, problem):
    file = tmp_path / "bad.yaml"
    whole = "description" in text or text.startswith("{")
    file.write_text(f"case:\n  {text}\n" if whole else f"{TEMPLATE}  {text}\n")
    with pytest.raises(ScenarioError) as caught:
        load_scenario(file=file)
    message = str(caught.value)
    assert message.startswith(str(file))
    assert key in message
    assert problem in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"case: [1", "is no YAML"),
        (b"- a\n- b\n", "must be a mapping"),
        (b"\xff\xfe\x00", "can't be read"),
        (b"", "must be a mapping"),
        (b"a: {}\nb: {}\n", "there are: a, b"),
        (b"1: {}\n", "is no name"),
        (b"case: 3\n", "3 must be a mapping"),
    ],
)
def test_bad_files_are_named_in_one_line(tmp_path, content, problem):
    file = tmp_path / "bad.yaml"
    file.write_bytes(content)
    with pytest.raises(ScenarioError) as caught:
        load_scenario(file=file)
    assert str(file) in str(caught.value)
    assert problem in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_files_and_names_are_named(tmp_path):
    with pytest.raises(ScenarioError, match="can't be read"):
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
    assert scenario.planner.period == 0.1
    assert scenario.random_seed == 4
    assert scenario.motion.angular_velocity == 0.0349
    with pytest.raises(ScenarioError, match=r"^scenario text: planner.period: -1 must"):
        load_scenario("a_base", text="{planner: {period: -1}}")
    with pytest.raises(ScenarioError, match=r"with scenario text: a_base.contact_weights"):
        load_scenario("a_base", text="{contact_weights: [1.0]}")


@pytest.mark.parametrize("name", usable_scenarios())
def test_shipped_scenarios_survive_being_written_and_read(name, tmp_path):
    scenario = load_scenario(name)
    file = tmp_path / "scenario.yaml"
    file.write_text(dump_scenario(name, scenario))
    assert dump_scenario(name, load_scenario(file=file)) == file.read_text()
    assert scenario.description
    assert "publish_every_time_step" not in file.read_text()  # Gone in Drake 1.58.


def test_cases_differ_from_the_base_by_what_table_1_says():
    base = plain(load_scenario("a_base"))
    differences = {
        name: {key for key, value in plain(load_scenario(name)).items() if value != base[key]}
        for name, (file, _) in shipped_scenarios().items()
        if file.stem in ("paper", "measures")
    }
    assert differences == {
        "a_base": set(),
        "b_slower": {"description", "motion"},
        "c_faster": {"description", "motion"},
        "d_smaller": {"description", "object"},
        "e_bigger": {"description", "object"},
        "f_damage": {"description", "damage"},
        "g_poor_start": {"description", "initial_contacts"},
        "h_msv": {"description", "planner"},
        "i_gii": {"description", "planner"},
        "j_vew": {"description", "planner"},
        "margin": {"description", "planner"},
        "blend": {"description", "planner"},
        "soft_finger": {"description", "measures"},
        "frictionless": {"description", "measures"},
    }


def plain(scenario: Scenario) -> dict[str, str]:
    return {f.name: repr(getattr(scenario, f.name)) for f in dataclasses.fields(scenario)}


STREAM = "time,x,y,z,qw,qx,qy,qz\n0,0,0,0.3,1,0,0,0\n1,0,0,0.4,1,0,0,0\n"


def test_a_file_is_looked_for_beside_the_scenario(tmp_path, monkeypatch):
    """And wherever a run folder's copy of the scenario goes, it names the same file."""
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "poses.csv").write_text(STREAM)
    file = tmp_path / "mine.yaml"
    file.write_text("case: {motion: !PoseStream {file: data/poses.csv}}\n")
    scenario = load_scenario(file=file)
    assert scenario.motion.file == str(tmp_path / "data" / "poses.csv")
    copy = tmp_path / "data" / "copy.yaml"
    copy.write_text(dump_scenario("case", scenario))
    assert load_scenario(file=copy).motion.file == scenario.motion.file
    monkeypatch.chdir(tmp_path / "data")
    text = "{motion: !PoseStream {file: poses.csv}}"
    assert load_scenario("a_base", text=text).motion.file == scenario.motion.file
    made = Scenario(motion=PoseStream(file="poses.csv"))
    check_scenario(made)
    assert made.motion.file == scenario.motion.file


def test_a_file_of_the_package_keeps_its_name():
    file = "package://drake_pregrasp/carried_by_hand.csv"
    assert load_scenario("pose_stream").motion.file == file
    here = Path("/nowhere")
    assert resolve_path(file, here) == resource_folder("models") / "carried_by_hand.csv"
    assert resolve_path("x/../y.csv", here) == here / "y.csv"
    assert resolve_path("/y.csv", here) == Path("/y.csv")
    assert resolve_path("~/y.csv", here) == Path.home() / "y.csv"
