"""Descriptions of hands: what is loaded, and what is refused in one line."""

import re
from pathlib import Path

import numpy as np
import pytest

from drake_pregrasp import HandModel, PregraspError, ScenarioError, load_hand, load_scenario
from drake_pregrasp.diagrams.hand_description import Arm, Carrier
from drake_pregrasp.diagrams.reach_config import BallReach, BoxReach, SectorReach
from drake_pregrasp.resources import resource_folder

MODELS = resource_folder("models")
FORBIDDEN = "forbidden_faces: ['+x', '-y', '+y'], radius: 0.009"
LIMITED = "closing: {force: 3.0, speed: 0.01}, radius: 0.009"


def shipped():
    return (MODELS / "five_finger_hand.yaml").read_text()


SECTOR = re.search(r"!SectorReach \{azimuth: 0.0,[^}]*\}", shipped()).group()


def write(folder: Path, text: str) -> Path:
    path = folder / "hand.yaml"
    path.write_text(text)
    return path


def test_shipped_hands_are_what_their_files_say():
    hand = load_hand("package://drake_pregrasp/five_finger_hand.yaml")
    assert isinstance(hand.base, Carrier)
    assert [tip.radius for tip in hand.fingertips] == [0.009] * 5
    assert all(isinstance(tip.reach, SectorReach) for tip in hand.fingertips)
    arm = load_hand("package://drake_pregrasp/allegro_panda.yaml")
    assert isinstance(arm.base, Arm)
    assert all(isinstance(tip.reach, BoxReach) for tip in arm.fingertips)
    assert arm.palm_height == arm.base.palm_position[2]


def test_a_model_is_found_from_the_folder_of_its_description(tmp_path, monkeypatch):
    (tmp_path / "own.sdf").write_text((MODELS / "five_finger_hand.sdf").read_text())
    path = write(tmp_path, shipped().replace("package://drake_pregrasp/five_finger_hand", "own"))
    monkeypatch.chdir(tmp_path.parent)
    hand = load_hand(path)
    assert hand.model == str(tmp_path / "own.sdf")
    np.testing.assert_array_equal(
        HandModel(hand).azimuths,
        HandModel(load_hand("package://drake_pregrasp/five_finger_hand.yaml")).azimuths,
    )


@pytest.mark.parametrize(
    "reach",
    [
        "!BallReach {center: [0.07, 0.0, 0.0], radius: 0.05}",
        "!BoxReach {center: [0.07, 0.0, 0.0], size: [0.1, 0.1, 0.2]}",
        "!SectorReach {azimuth: 0.5, half_angle: 0.6}",
    ],
)
def test_reach_may_be_a_ball_a_box_or_a_sector(tmp_path, reach):
    text = shipped().replace(SECTOR, reach)
    hand = load_hand(write(tmp_path, text))
    kinds = {kind.__name__: kind for kind in (BallReach, BoxReach, SectorReach)}
    assert isinstance(hand.fingertips[0].reach, kinds[reach.split()[0].removeprefix("!")])
    HandModel(hand)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("finger_0_tip", "thumb", r"hand has no frame thumb; there are: "),
        ("finger_0_tip", "palm", r"hand::palm has 0 joints of its own"),
        ("yaw]", "roll]", r"base.joints: there is no joint roll; there are: x, y, z, yaw"),
        ("[x, y, z, yaw]", "[yaw, x, y, z]", r"base.joints: yaw is revolute; three prismatic"),
        (
            "home: [0.0, 0.9, 1.35], reach: !SectorReach {azimuth: 0.0,",
            "home: [0.0, 0.9], reach: !SectorReach {azimuth: 0.0,",
            r"fingertips\[0\].home: 2 positions must be 3, for the joints that move finger_0_tip",
        ),
        (
            "home: [0.0, 0.9, 1.35], reach: !SectorReach {azimuth: 0.0,",
            "home: [0.0, 0.9, 4.35], reach: !SectorReach {azimuth: 0.0,",
            r"fingertips\[0\].home: 4.35 of .* must be from",
        ),
        (
            SECTOR,
            "!SectorReach {azimuth: 3.0, half_angle: 1.25}",
            r"fingertips\[0\].reach: it must hold the finger's own home, where finger_0_tip is at",
        ),
        (
            SECTOR,
            "!BallReach {center: [1, 0, 0], radius: 0.1}",
            r"fingertips\[0\].reach: it must hold the finger's own home",
        ),
        (
            SECTOR,
            "!BallReach {center: [0.07, 0, 0], radius: 0.1, incidence: 1.0}",
            r"fingertips\[0\].reach: a reach with an angle needs a direction",
        ),
        ("/five_finger_hand.sdf", "/nothing.sdf", r"model: .*nothing.sdf: there is no such file"),
        ("/five_finger_hand.sdf", "/package.xml", r"model: .* is no model of a hand"),
        ("/five_finger_hand.sdf", "/cube.sdf", r"base.joints: there is no joint x; there are: "),
        ("package://drake_pregrasp/five_finger_hand.sdf", "robots://me.urdf", r"no robot robots:"),
        ("!Carrier {joints: [x, y, z, yaw], palm_height: 0.155}", "!Leg {}", r"no such tag !Leg; "),
        ("radius: 0.009", "radius: 9", r"fingertips\[0\].radius: 9 must be a number above 0 and "),
        ("frame: finger_0_tip, ", "", r"fingertips\[0\]: lacks the key frame"),
        ("frame: finger_0_tip", "frames: a, frame: b", r"frames: unknown key .*mean frame\?"),
        ("model:", "model: [", r"is no YAML"),
    ],
)
def test_a_hand_that_is_not_as_described_is_refused_in_one_line(tmp_path, old, new, message):
    assert old in shipped()
    path = write(tmp_path, shipped().replace(old, new, 1))
    with pytest.raises(PregraspError, match=message) as error:
        HandModel(load_hand(path))
    assert "\n" not in str(error.value)
    with pytest.raises(ScenarioError, match=message) as error:
        load_scenario("grasp_five_finger", text=f"{{grasp: {{hand: '{path}'}}}}")
    assert "grasp.hand: " in str(error.value)
    assert "\n" not in str(error.value)


def test_joints_that_are_nobodys_are_named(tmp_path):
    text = "\n".join(line for line in shipped().splitlines() if "finger_4_tip" not in line)
    with pytest.raises(PregraspError, match=r"finger_4_\w+, .*: neither of base.joints, nor of"):
        HandModel(load_hand(write(tmp_path, text)))


def test_closing_limits_come_before_what_a_scenario_asks_for(tmp_path):
    text = shipped().replace("radius: 0.009", LIMITED, 1)
    path = write(tmp_path, text)
    scenario = load_scenario("grasp_five_finger", text=f"{{grasp: {{hand: '{path}'}}}}")
    settings = scenario.grasp.make_settings(load_hand(path).fingertips)
    np.testing.assert_array_equal(settings.largest_force, [3, 12, 12, 12, 12])
    np.testing.assert_array_equal(settings.closing_speed, [0.01, 0.04, 0.04, 0.04, 0.04])
    weak = path.read_text().replace("force: 3.0", "force: 2.0")
    path.write_text(weak)
    with pytest.raises(ScenarioError, match=r"least_force: 2.5 must be at most 2.0"):
        load_scenario("grasp_five_finger", text=f"{{grasp: {{hand: '{path}'}}}}")


def test_a_contact_on_a_face_that_is_forbidden_to_its_finger_is_refused(tmp_path):
    text = shipped().replace("radius: 0.009", FORBIDDEN, 1)
    path = write(tmp_path, text)
    with pytest.raises(ScenarioError, match=r"nearest to finger_0_tip, to which [+-][xy] is for"):
        load_scenario("grasp_five_finger", text=f"{{grasp: {{hand: '{path}'}}}}")
