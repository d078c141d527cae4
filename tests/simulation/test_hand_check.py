"""The command `hand check` finds all problems of a description, and proposes one for a model."""

import shutil

import numpy as np
import pytest
from conftest import usable_hands
from own_arm import write_arm
from pages import DOCS, blocks

from drake_pregrasp import HandModel, load_hand, load_scenario, run
from drake_pregrasp.cli import main
from drake_pregrasp.config.hand_description import Arm
from drake_pregrasp.diagrams.hand_proposal import HOME_YAWS
from drake_pregrasp.diagrams.palm_meeting import palm_limits
from drake_pregrasp.grasping.finger_homes import OBJECT_RADIUS
from drake_pregrasp.resources import resource_folder
from drake_pregrasp.simulation.hand_check import check_hand, description_yaml

GRIPPER = str(DOCS / "own_hand" / "gripper.urdf")
SHIPPED = "package://drake_pregrasp/{}.yaml"


def palm_axis(model):
    """Direction from the object to the palm, in the frame of the link that carries finger 0."""
    first = model.instances.moving_joints()[model.kinematics.own_joints(0)[0]]
    plant = model.kinematics.plant
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, model.base.at_home(model.fingers_home))
    R_WP = first.parent_body().EvalPoseInWorld(context).rotation()
    return (model.base.X_AW.rotation() @ R_WP).matrix()[2]


@pytest.mark.slow
@pytest.mark.parametrize("name", usable_hands())
def test_a_proposal_is_close_to_the_shipped_description_and_loads(name, tmp_path):
    shipped = load_hand(SHIPPED.format(name))
    found = check_hand(shipped.model)
    assert found.problems == []
    (tmp_path / "own.yaml").write_text(description_yaml(found.description, tmp_path))
    assert main(["hand", "check", str(tmp_path / "own.yaml")]) == 0
    own = load_hand(tmp_path / "own.yaml")
    assert own == found.description
    assert type(own.base) is type(shipped.base)
    assert isinstance(own.base, Arm) or own.base.joints == shipped.base.joints
    # From its centre to the top of an object of medium size.
    up = OBJECT_RADIUS if getattr(shipped.base, "over_top", False) else 0.0
    most = 0.04 if isinstance(own.base, Arm) else 0.02
    assert own.palm_height == pytest.approx(shipped.palm_height + up, abs=most)
    # The model that two hands share has the drives of one of them.
    assert bool(own.drives) == (bool(shipped.drives) and name != "five_finger_fast")
    places = {tip.link or tip.frame: tip for tip in own.fingertips}
    for tip in shipped.fingertips:
        ours = places[tip.link or tip.frame]
        assert ours.radius == pytest.approx(tip.radius, abs=0.003)
        np.testing.assert_allclose(ours.center, tip.center, atol=0.003)
    axes = [palm_axis(HandModel(description)) for description in (own, shipped)]
    assert axes[0] @ axes[1] > 0.95


@pytest.mark.slow
def test_a_proposal_for_a_plain_urdf_grasps(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(GRIPPER, tmp_path)
    assert main(["hand", "check", "gripper.urdf", "-o", "own.yaml", "--page", "own.html"]) == 0
    page = (tmp_path / "own.html").read_text()
    assert "<html" in page
    text = """{object: !Cylinder {radius: 0.025, length: 0.08, mass: 0.2}, initial_contacts: [],
        hand: {file: own.yaml}}"""
    scenario = load_scenario("grasp_five_finger", text=text)
    grasp = run(scenario, name="own", out=tmp_path, recording=False).summary["grasp"]
    assert (grasp["phase"], grasp["gave_up"]) == ("hold", None)


@pytest.mark.slow
def test_an_arm_and_a_hand_with_equal_names_are_proposed_over_an_object(tmp_path, caplog, capsys):
    directives = write_arm(tmp_path)
    out = tmp_path / "robot.yaml"
    assert main(["hand", "check", str(directives), "-o", str(out)]) == 0
    assert capsys.readouterr().err == ""
    own = load_hand(out)
    assert own.base.palm == "hand::palm"
    arm, fingers = caplog.messages[:2]
    assert arm.startswith("joint_0, joint_1")
    assert "effort 50 N m by default" in arm
    assert "curl_2: effort 1 N m by default" in fingers
    model = HandModel(own)
    places = [model.base.palm_goal(np.array([0.0, 0.0, 0.05]), yaw) for yaw in HOME_YAWS]
    context = model.kinematics.plant.CreateDefaultContext()
    model.kinematics.plant.SetPositions(context, model.base.at_home(model.fingers_home))
    palm = model.base.palm_pose(context)
    assert any(palm.IsNearlyEqualTo(place, 2e-3) for place in places)
    # Without limits of joints' accelerations, the fingertips limit that of the palm.
    limits = palm_limits(model, model.base.at_home(model.fingers_home), tip_acceleration=5.0)
    np.testing.assert_allclose(limits.acceleration, 3.0)


@pytest.mark.slow
def test_an_arm_that_holds_its_palm_nowhere_over_an_object_is_said_with_its_proposal(tmp_path):
    found = check_hand(str(write_arm(tmp_path, base=(-1.5, 0.0, 0.0))))
    assert found.is_proposal
    assert found.description is not None
    (problem,) = found.problems
    for words in ("it stays", "at no other yaw", "move the base"):
        assert words in problem


def test_a_second_joint_to_the_world_is_named(tmp_path, capsys):
    joint = '<joint name="fix" type="fixed"><parent link="world"/><child link="base"/></joint>'
    directives = write_arm(tmp_path, more=f'<link name="world"/>{joint}')
    assert main(["hand", "check", str(directives)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "a link is joined twice to another; a link named world is Drake's world" in line
    assert "AddJoint" not in line


def test_a_palm_named_world_is_refused(tmp_path, capsys):
    text = (DOCS / "own_hand" / "gripper.urdf").read_text()
    (tmp_path / "hand.urdf").write_text(text.replace('"palm"', '"world"'))
    assert main(["hand", "check", str(tmp_path / "hand.urdf")]) == 2
    assert "fingers hang on the world" in capsys.readouterr().err


def test_a_file_that_is_there_is_refused_before_the_search(tmp_path, capsys):
    (out := tmp_path / "own.yaml").write_text("mine")
    assert main(["hand", "check", "nothing.urdf", "-o", str(out)]) == 2
    assert "own.yaml is there already" in capsys.readouterr().err
    assert out.read_text() == "mine"


@pytest.mark.slow
def test_fingertips_of_a_proposal_stay_apart(tmp_path):
    text = (DOCS / "own_hand" / "gripper.urdf").read_text()
    for old, new in (("0.025 0", "0.011 0"), ("0.3500", "0.05")):  # Side by side.
        text = text.replace(f"0.035 {old}", f"0.035 {new}").replace(
            f"0.035 -{old}", f"0.035 -{new}"
        )
        text = text.replace(f"0 0 {old}", f"0 0 {new}").replace(f"0 0 -{old}", f"0 0 -{new}")
    (tmp_path / "hand.urdf").write_text(text)
    found = check_hand(str(tmp_path / "hand.urdf"))
    assert found.problems == []
    p_HT = found.model.p_HT
    assert np.linalg.norm(p_HT[0] - p_HT[1]) > 2 * found.description.fingertips[0].radius


def test_fingertips_that_overlap_at_home_are_named_with_their_distance(tmp_path, capsys):
    (tmp_path / "own.yaml").write_text(SHIPPED_TEXT.replace("radius: 0.009", "radius: 0.065"))
    assert main(["hand", "check", str(tmp_path / "own.yaml")]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3
    assert "finger_0_tip and finger_1_tip are 126 mm apart; they must be 130 mm" in lines[0]


def refused(text, changes, tmp_path, capsys):
    """Returns what is said of a shipped description with changes, line by line."""
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    (tmp_path / "own.yaml").write_text(text)
    assert main(["hand", "check", str(tmp_path / "own.yaml")]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    return [line.split("own.yaml: ")[1] for line in err.splitlines()]


SHIPPED_TEXT = (resource_folder("models") / "three_finger_hand.yaml").read_text()


def test_all_problems_of_keys_are_said_at_once(tmp_path, capsys):
    changes = [("radius: 0.009", "radius: 9"), ("home:", "hom:"), ("[x, y, z, yaw]", "[x]")]
    lines = refused(SHIPPED_TEXT, changes, tmp_path, capsys)
    assert [line.split(":")[0] for line in lines] == [
        "base.joints",
        "fingertips[0]",
        "fingertips[0].radius",
        "fingertips[0].hom",
    ]


def test_all_problems_of_homes_and_frames_are_said_at_once(tmp_path, capsys):
    homes = [("[0.0, 0.9, 1.35]", "[0.0, 0.9]"), ("[0.0, 0.9, 1.35]", "[0.0, 0.9, 4.35]")]
    lines = refused(SHIPPED_TEXT, homes, tmp_path, capsys)
    assert [line.split(":")[0] for line in lines] == ["fingertips[0].home", "fingertips[1].home"]
    frames = [("frame: finger_0_tip", "frame: thumb"), ("frame: finger_2_tip", "frame: toe")]
    lines = refused(SHIPPED_TEXT, frames, tmp_path, capsys)
    assert [line.split(";")[0] for line in lines] == [
        "fingertips[0].frame: there is no frame thumb",
        "fingertips[2].frame: there is no frame toe",
    ]


def test_all_links_and_joints_that_a_model_lacks_are_said_at_once(tmp_path, capsys):
    shutil.copy(GRIPPER, tmp_path)
    changes = [
        ("link: distal_0", "link: thumb"),
        ("drives: [", "locked: [{joint: wrist}]\ndrives: [{joints: [elbow]}, "),
    ]
    lines = refused(blocks("own_hand.md", "yaml")[0], changes, tmp_path, capsys)
    assert [line.split(";")[0] for line in lines] == [
        "locked: there is no joint wrist",
        "fingertips[0].link: there is no link thumb",
        "drives: there is no joint elbow",
    ]


@pytest.mark.parametrize(
    ("model", "problem"),
    [
        ("package://drake_pregrasp/table.sdf", "0 chains of links end in a fingertip"),
        ("nothing.urdf", "there is no such file"),
    ],
)
def test_a_model_without_fingers_is_refused(model, problem, capsys):
    assert main(["hand", "check", model]) == 2
    assert problem in capsys.readouterr().err


@pytest.mark.slow
def test_files_elsewhere_are_read_only_if_their_folder_is_allowed(tmp_path, capsys):
    (own := tmp_path / "own").mkdir()
    shutil.copy(GRIPPER, tmp_path)
    description = blocks("own_hand.md", "yaml")[0]
    (own / "hand.yaml").write_text(description.replace("gripper.urdf", "../gripper.urdf"))
    directives = "directives: [add_model: {name: hand, file: ../gripper.urdf}]"
    for name in ("hand.dmd.yaml", "hand.dmd.yml"):
        (own / name).write_text(directives)
    for file in own.iterdir():
        assert main(["hand", "check", str(file)]) == 2
        assert f"--allow {tmp_path}" in capsys.readouterr().err
        allowed = main(["hand", "check", str(file), "--allow", str(tmp_path)])
        assert allowed == 0, capsys.readouterr().err
