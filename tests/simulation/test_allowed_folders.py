"""Folders of the files that a scenario and a hand's model may name."""

import re

import pytest
from conftest import read_log
from hand_files import MODEL, write_hand

from drake_pregrasp import ScenarioError, load_hand, load_scenario
from drake_pregrasp.cli import main
from drake_pregrasp.diagrams.package_files import find_packages
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.resources import resolve_path

STREAM = "time,x,y,z,qw,qx,qy,qz\n0,0,0,0.3,1,0,0,0\n1,0,0,0.4,1,0,0,0\n"


@pytest.fixture
def there(tmp_path):
    """A folder with a stream in it, beside the scenario's own."""
    for name in ("own", "other"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "poses.csv").write_text(STREAM)
    (tmp_path / "own" / "link.csv").symlink_to(tmp_path / "other" / "poses.csv")
    return tmp_path


def scenario_of(folder, name):
    file = folder / "own" / "mine.yaml"
    file.write_text(f"case: {{motion: !PoseStream {{file: '{name}'}}}}\n")
    return file


@pytest.mark.parametrize("name", ["../other/poses.csv", "{}/other/poses.csv", "link.csv"])
def test_a_scenario_names_files_in_its_own_folder_or_in_allowed_ones(there, name):
    file = scenario_of(there, name.format(there))
    with pytest.raises(ScenarioError, match=r"case.motion.file: .* is outside of") as caught:
        load_scenario(file=file)
    (advice,) = re.findall(r"add --allow (\S+) ", str(caught.value))
    assert advice == str(there / "other")
    scenario = load_scenario(file=file, folders=[advice])
    assert scenario.motion.file == str(there / "other" / "poses.csv")


@pytest.mark.slow
def test_the_command_takes_the_advice_and_runs_again_from_the_run_folder(there, capsys):
    options = ["--out", str(there), "--no-recording", "--simulation_duration", "0.5"]
    allowed = [*options, "--allow", str(there / "other")]
    logs = []
    for file in (scenario_of(there, "../other/poses.csv"), there / "case" / "scenario.yaml"):
        assert main(["run", "--scenario_file", str(file), *options]) == 2
        assert capsys.readouterr().err.count("\n") == 1
        assert main(["run", "--scenario_file", str(file), *allowed]) == 0
        logs.append((there / "case" / "log.csv").read_bytes())
    assert logs[0] == logs[1]
    assert read_log(there / "case" / "log.csv")["z_wo"][-1] == pytest.approx(0.35)


def test_a_text_names_files_in_the_working_directory(there, monkeypatch):
    text = "{motion: !PoseStream {file: poses.csv}}"
    monkeypatch.chdir(there / "own")
    assert load_scenario("a_base", text=text).motion.file == str(there / "own" / "poses.csv")
    with pytest.raises(ScenarioError, match=r"a_base.motion.file: .* is outside of"):
        load_scenario("a_base", text=text.replace("poses", "../other/poses"))


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("package://drake_pregrasp/../README.md", "leads out of package://drake_pregrasp/"),
        ("https://example.org/x.obj", "only package://drake_pregrasp/ is known as a URL"),
        ("x" * 300, "cannot be a file: File name too long"),
        ("a\0b", "cannot be a file: .*embedded null"),
        ("~nobody-of-that-name/x", "cannot be a file: "),
    ],
)
def test_names_that_are_not_files_are_refused(tmp_path, name, problem):
    with pytest.raises(InvalidArgumentError, match=problem):
        resolve_path(name, tmp_path)


SDF = '<sdf version="1.9"><model name="m"><link name="l">{}</link></model></sdf>'
MESH = '<visual name="v"><geometry><mesh><uri>{}</uri></mesh></geometry></visual>'
COLLISION = MESH.replace("visual", "collision")


@pytest.mark.parametrize(
    ("model", "problem"),
    [
        (SDF.format(MESH.format("../../secret.obj")), "names ../../secret.obj: .* is outside of"),
        (SDF.format(MESH.format("/etc/passwd")), "names /etc/passwd: .* is outside of"),
        (SDF.format(MESH.format("file:///etc/x.obj")), "names file:///etc/x.obj: .* is outside of"),
        (SDF.format(MESH.format("https://a.b/x.obj")), "only files and packages are read"),
        (SDF.format(MESH.format("package://drake_models/x.obj")), "no such package is here"),
        (
            SDF.format(COLLISION.format("x.yaml")),
            "names x.yaml: convert it, as by trimesh, to .obj",
        ),
        (SDF.format(MESH.format("m.obj")), "names m.obj: .*x.mtl is outside of"),
        (SDF.format(MESH.format("m.gltf")), "names m.gltf: .*x.bin is outside of"),
        (SDF.format("<include><uri>x</uri></include>"), "has <include>; write out"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><sdf>&b;</sdf>', "has a DOCTYPE"),
        ("<sdf>", "is no model of a hand"),
    ],
)
def test_a_models_files_are_near_it(tmp_path, model, problem):
    folder = tmp_path / "a" / "b"
    hand = write_hand(folder, model=model)
    (folder / "m.obj").write_text("mtllib ../../x.mtl\n")
    (folder / "m.gltf").write_text('{"buffers": [{"uri": "../../x.bin"}]}')
    with pytest.raises(ScenarioError, match=problem):
        load_hand(hand, folders=[])
    scenario = folder / "mine.yaml"
    scenario.write_text("case: {hand: {file: hand.yaml}}\n")
    with pytest.raises(ScenarioError, match=f"case.hand.file: .*{problem}"):
        load_scenario(file=scenario)
    assert load_hand(hand).model == str(folder / "own.sdf")


LOOPED = {
    "own.urdf": """<robot name="h"><link name="a"><visual><geometry>
        <mesh filename="loop/x.obj"/></geometry></visual></link></robot>""",
    "own.xml": """<mujoco model="h"><compiler meshdir="loop"/><asset><mesh file="x.obj"/></asset>
        <worldbody><body name="a"><geom type="mesh" mesh="x"/></body></worldbody></mujoco>""",
    "include.xml": """<mujoco model="h"><include file="loop/x.xml"/><worldbody/></mujoco>""",
    "loop/own.sdf": "",
}


@pytest.mark.parametrize("name", LOOPED)
def test_a_loop_of_links_is_refused_in_one_line(tmp_path, name):
    (tmp_path / "loop").symlink_to("pool")
    (tmp_path / "pool").symlink_to("loop")
    hand = write_hand(tmp_path, "package://drake_pregrasp/five_finger_hand.sdf", name)
    if LOOPED[name]:
        (tmp_path / name).write_text(LOOPED[name])
    with pytest.raises(ScenarioError, match=r"(?i)symbolic links|symlink loop|no such file"):
        load_hand(hand, folders=[])


def test_a_package_that_is_a_link_is_not_opened(tmp_path):
    (tmp_path / "secret.xml").write_text("<package><name>secret</name></package>")
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "package.xml").symlink_to(tmp_path / "secret.xml")
    assert "secret" not in find_packages(tmp_path / "own" / "hand.sdf")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("own.sdf", MODEL.replace("<mass>3.0<", "<mass>-5<", 1)),
        ("own.sdf", MODEL.replace("<mass>3.0<", "<mass>nan<", 1)),
        (
            "own.urdf",
            '<robot name="h"><link name="a"><inertial><mass value="-5"/></inertial></link></robot>',
        ),
        (
            "own.xml",
            '<mujoco><worldbody><body><geom size="1" mass="-5"/></body></worldbody></mujoco>',
        ),
    ],
)
def test_a_mass_is_not_negative(tmp_path, name, text):
    assert text != MODEL
    hand = write_hand(tmp_path, "package://drake_pregrasp/five_finger_hand.sdf", name)
    (tmp_path / name).write_text(text)
    with pytest.raises(ScenarioError, match=r"has a mass of (-5|nan); it must be finite"):
        load_hand(hand, folders=[])
