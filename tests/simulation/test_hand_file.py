"""Descriptions of hands: loaded values, and rejections in one line."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from hand_files import MODEL, SHIPPED, SHIPPED_TEXT, write_hand
from pydrake.multibody.plant import MultibodyPlant

from drake_pregrasp import (
    HandModel,
    PregraspError,
    ScenarioError,
    add_hand_model,
    load_hand,
    load_scenario,
    make_diagram,
)
from drake_pregrasp.config.hand_description import Arm, Carrier
from drake_pregrasp.config.limits_config import BallReach, BoxReach, SectorReach
from drake_pregrasp.contacts.assignment import FREE_TURN
from drake_pregrasp.diagrams import hand_parsing
from drake_pregrasp.diagrams.hand_parsing import read_model
from drake_pregrasp.quality.force_closure import min_weight_margin
from drake_pregrasp.simulation import hand_file
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import load_resolved, resolve

BAD = yaml.safe_load((Path(__file__).parent / "bad_hands.yaml").read_text())
FIRST_RADIUS = "radius: 0.009"
FIRST_SECTOR = re.search(r"!SectorReach \{azimuth: 0.0,[^}]*\}", SHIPPED_TEXT).group()


def scenario_with(path, text=""):
    text = f"{{hand: {{file: '{path}'}}, {text}}}"
    return load_resolved("grasp_five_finger", text=text, folders=[path.parent])


def test_shipped_hands_are_what_their_files_say():
    hand = load_hand(SHIPPED)
    assert isinstance(hand.base, Carrier)
    assert [tip.radius for tip in hand.fingertips] == [0.009] * 5
    assert all(isinstance(tip.reach, SectorReach) for tip in hand.fingertips)
    hand.fingertips.clear()  # Whoever changes a description changes no other's.
    assert len(load_hand(SHIPPED).fingertips) == 5
    arm = load_hand("package://drake_pregrasp/allegro_panda.yaml")
    assert isinstance(arm.base, Arm)
    kinds = [type(tip.reach) for tip in arm.fingertips]
    assert kinds == [BallReach, BallReach, BallReach, BoxReach]
    assert arm.palm_height == arm.base.palm_position[2]


def test_a_model_is_found_from_the_folder_of_its_description(tmp_path, monkeypatch):
    path = write_hand(tmp_path, model=MODEL)
    monkeypatch.chdir(tmp_path.parent)
    hand = load_hand(path)
    assert hand.model == str(tmp_path / "own.sdf")
    np.testing.assert_array_equal(HandModel(hand).azimuths, HandModel(load_hand(SHIPPED)).azimuths)


def test_a_description_may_list_model_directives_as_its_model(tmp_path):
    text = re.sub("model: .*", "model: [add_model: {name: five, file: own.sdf}]", SHIPPED_TEXT)
    (tmp_path / "own.sdf").write_text(MODEL)
    (path := tmp_path / "hand.yaml").write_text(text)
    listed = HandModel(load_hand(path, folders=[]))
    np.testing.assert_array_equal(listed.p_HT, HandModel(load_hand(SHIPPED)).p_HT)


@pytest.mark.slow
def test_warnings_about_a_model_are_shown_once(tmp_path, caplog):
    text = re.sub("<ixx>.*?</ixx>", "<ixx>1.0</ixx>", MODEL, count=1)  # Of no rigid body.
    path = write_hand(tmp_path, model=text.replace("</model>", "<note/></model>"))
    make_diagram(scenario_with(path, "simulation_duration: 0.1"))
    shown = caplog.messages.copy()
    assert ["left out" in line for line in shown] == [True, False, False]
    assert len(set(shown)) == 3
    caplog.clear()
    add_hand_model(MultibodyPlant(0.01), hand := load_hand(path))
    assert caplog.messages == shown
    HandModel(hand, model=read_model(hand.model))
    assert caplog.messages == shown


def test_a_scenarios_hand_and_its_model_are_read_once(tmp_path, monkeypatch):
    read = []

    def counted(module, name):
        function = getattr(module, name)
        monkeypatch.setattr(
            module, name, lambda file, *rest: read.append(Path(file)) or function(file, *rest)
        )

    path = write_hand(tmp_path, model=MODEL)
    counted(hand_file, "read_text")
    counted(hand_parsing, "checked_copy")
    assert scenario_with(path).hand.model.files == (tmp_path / "own.sdf",)
    assert read == [path, tmp_path / "own.sdf"]


@pytest.mark.parametrize(
    ("kind", "keys"),
    [
        (BallReach, "{center: [0.07, 0.0, 0.0], radius: 0.05}"),
        (BoxReach, "{center: [0.07, 0.0, 0.0], size: [0.1, 0.1, 0.2]}"),
        (SectorReach, "{azimuth: 0.5, half_angle: 0.6}"),
    ],
)
def test_reach_may_be_a_ball_a_box_or_a_sector(tmp_path, kind, keys):
    hand = load_hand(write_hand(tmp_path, FIRST_SECTOR, f"!{kind.__name__} {keys}"))
    assert isinstance(hand.fingertips[0].reach, kind)
    HandModel(hand)


@pytest.mark.parametrize(("old", "new", "message"), BAD)
def test_a_hand_that_is_not_as_described_is_refused_in_one_line(tmp_path, old, new, message):
    path = write_hand(tmp_path, old, new)
    with pytest.raises(PregraspError, match=message) as alone:
        HandModel(load_hand(path))
    with pytest.raises(ScenarioError, match=message) as in_scenario:
        scenario_with(path)
    assert "hand.file: " in str(in_scenario.value)
    assert "\n" not in f"{alone.value}{in_scenario.value}"


def test_joints_without_a_finger_or_base_are_named(tmp_path):
    path = write_hand(tmp_path, text=re.sub(r".*finger_4_tip.*\n", "", SHIPPED_TEXT))
    with pytest.raises(PregraspError, match=r"finger_4_\w+, .*: neither of base.joints, nor of"):
        HandModel(load_hand(path))


def test_closing_limits_come_before_what_a_scenario_asks_for(tmp_path):
    limited = "closing: {force: 3.0, speed: 0.01}, radius: 0.009"
    path = write_hand(tmp_path, FIRST_RADIUS, limited)
    settings = scenario_with(path).scenario.grasp.make_settings(load_hand(path).fingertips)
    np.testing.assert_array_equal(settings.largest_force, [3, 12, 12, 12, 12])
    np.testing.assert_array_equal(settings.closing_speed, [0.01, 0.04, 0.04, 0.04, 0.04])
    path = write_hand(tmp_path, FIRST_RADIUS, limited.replace("3.0", "2.0"))
    with pytest.raises(ScenarioError, match=r"least_force: 2.5 must be at most 2.0"):
        scenario_with(path)


def test_faces_are_forbidden_by_the_scenario_and_by_the_hand(tmp_path):
    path = write_hand(tmp_path, FIRST_RADIUS, "forbidden_faces: [-z], radius: 0.009", count=5)
    own = [["+z"], [], ["-z"], [], ["+z", "-z"]]
    scenario = scenario_with(path, f"planner: {{limits: {{forbidden_faces: {own}}}}}")
    forbidden = [set(faces) for faces in scenario.planner.limits.forbidden_faces]
    assert forbidden == [{*faces, "-z"} for faces in own]
    path = write_hand(tmp_path, FIRST_RADIUS, "forbidden_faces: ['+x', '-y', '+y'], radius: 0.009")
    with pytest.raises(ScenarioError, match=r"nearest to finger_0_tip, to which [+-][xy] is for"):
        scenario_with(path)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["grasp_five_finger", "grasp_allegro_panda"])
def test_contacts_are_chosen_unless_given(request, name):
    if name == "grasp_allegro_panda":
        request.getfixturevalue("allegro_panda")
    margins = []
    for text in ("{}", "{initial_contacts: []}"):
        found = load_resolved(name, text=text)
        p_OC, surface, on = found.start.p_OC, found.surface, found.start.has_contact
        r, normals = p_OC[on] - surface.p_OCoM, surface.project(p_OC)[1][on]
        margins.append(min_weight_margin(r, normals, 0.5))
    assert margins[1] > margins[0] + 0.1
    given = load_scenario(name)
    assert not given.chooses_contacts
    mine = resolve(Scenario(object=given.object, hand=given.hand))
    assert mine.scenario.chooses_contacts  # The default contacts are for no hand.
    assert mine.plant_config.time_step == mine.scenario.grasp.period / 2
    assert mine.num_contacts == len(p_OC)


def test_limits_of_a_scenario_are_checked_with_those_of_its_hand():
    text = "{planner: {limits: {standoff: 0.03, tip_gap: 0.01}}}"
    limits = load_resolved("grasp_five_finger", text=text).planner.limits
    assert (limits.standoff, limits.tip_gap, limits.tip_radii) == (0.03, 0.01, [0.009] * 5)


MESH = "v 0 0 0\nv 0.01 0 0\nv 0 0.01 0\nv 0 0 0.01\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
VISUAL = """<visual name="own"><geometry><mesh><uri>package://{}/meshes/own.obj</uri></mesh></geometry>
</visual>"""


def test_a_mesh_is_found_in_the_package_of_its_model_or_in_one_of_ros(tmp_path, monkeypatch):
    hands = {}
    for name in ("mine", "elsewhere"):
        (tmp_path / name / "meshes").mkdir(parents=True)
        (tmp_path / name / "meshes" / "own.obj").write_text(MESH)
        xml = f'<package format="2"><name>{name}</name><version>0.0.1</version></package>'
        (tmp_path / name / "package.xml").write_text(xml)
        link = '<link name="palm">'
        model = MODEL.replace(link, link + VISUAL.format(name))
        assert model != MODEL
        hands[name] = load_hand(write_hand(tmp_path / "mine" / name, model=model))
    HandModel(hands["mine"])
    with pytest.raises(PregraspError, match=r"^[^\n]*own.sdf names .*elsewhere.*there are: .*mine"):
        HandModel(hands["elsewhere"])
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path))
    HandModel(hands["elsewhere"])
    xml = (tmp_path / "elsewhere" / "package.xml").read_text()
    (tmp_path / "elsewhere" / "package.xml").write_text(xml.replace("elsewhere", "another_name"))
    HandModel(hands["elsewhere"])  # By the name of the folder.


@pytest.mark.parametrize("count", [0, 2])
def test_a_file_has_to_hold_one_model(tmp_path, count):
    models = "".join(f'<model name="m{i}"><link name="a"/></model>' for i in range(count))
    path = write_hand(tmp_path, model=f'<sdf version="1.9">{models}</sdf>')
    with pytest.raises(PregraspError, match=r"own\.sdf (must hold one|is no model)"):
        HandModel(load_hand(path))


def limited_hand(folder, limit=0.1):
    wide = "<lower>-31.4</lower><upper>31.4</upper>"
    assert MODEL.count(wide) == 1
    limits = f"<lower>-{limit}</lower><upper>{limit}</upper>"
    return write_hand(folder, model=MODEL.replace(wide, limits))


def test_a_wrist_of_less_than_two_turns_is_limited_as_the_model_says(tmp_path):
    assert HandModel(load_hand(SHIPPED)).yaw_range() == (FREE_TURN)
    for limit, expected in ((6.2, (-6.2, 6.2)), (6.3, FREE_TURN)):
        assert HandModel(load_hand(limited_hand(tmp_path, limit))).yaw_range() == expected


@pytest.mark.slow
def test_a_model_that_limits_its_wrist_is_as_good_as_a_scenario_that_does(tmp_path):
    by_model = scenario_with(limited_hand(tmp_path))
    by_scenario = load_resolved("grasp_five_finger", text="{grasp: {wrist_range: [-0.1, 0.1]}}")
    turns, poses, contacts = [], [], []
    for scenario in (by_model, by_scenario):
        contacts.append(scenario.start.p_OC)
        diagram = make_diagram(scenario)
        controller = diagram.GetSubsystemByName("hand_controller")
        turns.append(controller.initial[3])
        context = controller.GetMyContextFromRoot(diagram.CreateDefaultContext())
        poses.append(controller.GetOutputPort("X_WH").Eval(context).GetAsMatrix34())
    np.testing.assert_array_equal(*contacts)
    np.testing.assert_array_equal(*poses)
    assert turns[0] == turns[1]
    assert abs(turns[0]) <= 0.1


def test_an_error_without_text_is_a_line_all_the_same(monkeypatch):
    def fail(*arguments):
        raise RuntimeError

    monkeypatch.setattr(hand_parsing.Parser, "AddModelsFromString", fail)
    with pytest.raises(PregraspError, match=r"five_finger_hand.sdf is no model .*: RuntimeError$"):
        HandModel(load_hand(SHIPPED))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('p="1e5"', 'p="nan"'),
        ("<radius>0.009</radius>", "<radius>inf</radius>"),
        ("<upper>2.4</upper>", "<upper>nan</upper>"),
    ],
)
def test_a_failed_demand_of_drakes_is_an_error_like_any_other(tmp_path, old, new):
    assert old in MODEL
    path = write_hand(tmp_path, model=MODEL.replace(old, new, 1))
    problem = r"hand.file: .*own.sdf is no model of a hand: (Fail|the lower limit)"
    with pytest.raises(ScenarioError, match=problem):
        scenario_with(path)
