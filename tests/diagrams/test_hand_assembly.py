"""Descriptions complete models that lack axes, drives and frames of fingertips."""

from dataclasses import replace

import numpy as np
import pytest
from five_finger_hand import HAND
from pages import DOCS, blocks
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant

from drake_pregrasp import HandDescription, HandModel, InvalidArgumentError, load_hand
from drake_pregrasp.config.hand_description import Drive, Fingertip, LockedJoint, Mount
from drake_pregrasp.diagrams.directive_files import checked_copy
from drake_pregrasp.diagrams.hand_instances import HandInstances
from drake_pregrasp.diagrams.hand_parsing import add_hand_model

MJCF = '<mujoco>{}<worldbody><body name="palm"><include file="{}"/></body></worldbody></mujoco>'
PART = '<mujoco><geom name="pad" type="sphere" size="0.01"/></mujoco>'


@pytest.fixture(scope="module")
def gripper(tmp_path_factory) -> HandDescription:
    """The gripper of the guide, whose URDF has no drives."""
    folder = tmp_path_factory.mktemp("hand")
    (folder / "gripper.urdf").write_bytes((DOCS / "own_hand" / "gripper.urdf").read_bytes())
    (folder / "gripper.yaml").write_text(blocks("own_hand.md", "yaml")[0])
    return load_hand(folder / "gripper.yaml")


def tips_at(description, **positions):
    """The fingertips' places with joints at some positions, and the plant."""
    plant = MultibodyPlant(0.0)
    (hand,) = add_hand_model(plant, description)
    for name, position in positions.items():
        plant.GetMutableJointByName(name).set_default_positions([position])
    plant.Finalize()
    context = plant.CreateDefaultContext()
    frames = [plant.GetFrameByName(tip.frame, hand) for tip in description.fingertips]
    return np.array([f.CalcPoseInWorld(context).translation() for f in frames]), plant


def test_axes_come_first_and_each_joint_has_its_drive(gripper):
    thumb = Drive(["curl_2"], stiffness=1.0, effort=0.5, speed=2.0, acceleration=30.0)
    axis = Drive(["x"], stiffness=2e5, damping=2000.0)
    hand = HandModel(replace(gripper, drives=[thumb, axis, *gripper.drives])).kinematics
    np.testing.assert_array_equal(hand.stiffness, [2e5, 1e5, 1e5, 400] + 8 * [4.0] + [1.0])
    np.testing.assert_array_equal(hand.efforts[4:], 8 * [1.0] + [0.5])
    np.testing.assert_array_equal(hand.rate_limit[4:], 8 * [5.0] + [2.0])
    assert hand.acceleration_limit[-1] == 30.0
    indices = hand.plant.GetJointIndices(hand.frames[0].model_instance())
    joints = [hand.plant.get_joint(index) for index in indices]
    assert not any(joint.default_damping_vector().any() for joint in joints)


@pytest.mark.parametrize("has_axes", [True, False])
def test_a_hand_that_pans_turns_about_the_vertical_as_its_palm_would(gripper, has_axes):
    """Both a hand whose model has its axes, and one that gets them."""
    own_axes = load_hand("package://drake_pregrasp/five_finger_hand.yaml")
    description = own_axes if has_axes else gripper
    X_LA = RigidTransform(RotationMatrix.MakeYRotation(np.pi / 2), [0.0, 0.0, 0.1])
    still, hand = (HandModel(description, X_LA=X_LA, pans=pans) for pans in (False, True))
    assert hand.kinematics.num_positions == still.kinematics.num_positions + 1
    p_WL, yaw, pan = np.array([0.3, -0.2, 0.1]), 0.4, 0.9
    turn = RotationMatrix.MakeZRotation(pan)
    q = hand.base.rest_posture(hand.fingers_home, p_WL, yaw, pan)
    before = still.base.rest_posture(still.fingers_home, turn.inverse() @ p_WL, yaw)
    np.testing.assert_allclose(hand.tips_at(q), still.tips_at(before) @ turn.matrix().T, atol=1e-12)
    goal = hand.base.palm_goal(p_WL, yaw, pan)
    around = goal.inverse() @ hand.tips_at(q).T
    np.testing.assert_allclose(around.T, hand.p_HT, atol=1e-9)


def test_the_axes_move_a_hand_from_where_it_is_mounted(gripper):
    mount = Mount("palm", position=[0.1, 0.2, 0.3], rpy=[0.0, 0.0, np.pi / 2])
    turned = replace(gripper, base=replace(gripper.base, mount=mount))
    p_WT, p_WT_turned = tips_at(gripper)[0], tips_at(turned, x=1.0, yaw=-np.pi / 2)[0]
    # First turned about z by the mount, then shifted, then turned back by the wrist.
    np.testing.assert_allclose(p_WT_turned, p_WT + np.array([1.2, -0.1, 0.3]), atol=1e-12)


def test_a_locked_joint_stays_at_its_position(gripper):
    p_WT, plant = tips_at(gripper, swing_0=0.3)
    p_WT_locked, locked = tips_at(replace(gripper, locked=[LockedJoint("swing_0", 0.3)]))
    assert locked.num_positions() == locked.num_actuators() == plant.num_positions() - 1
    np.testing.assert_allclose(p_WT_locked, p_WT, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"locked": [LockedJoint("wrist")]}, "locked: there is no joint wrist"),
        ({"locked": [LockedJoint("palm_to_wrist")]}, "locked: there is no joint palm_to_wrist"),
        ({"locked": [LockedJoint("swing_0", 9.0)]}, "locked: 9 of swing_0 must be from"),
        ({"drives": [Drive(["wrist"])]}, "drives: there is no joint wrist"),
        ({"drives": [Drive(), Drive()]}, "must have one drive only"),
        ({"drives": [Drive(["swing_0"])]}, "drives: none for joint"),
        ({"link": "thumb"}, "link: there is no link thumb"),
        ({"mount": "wrist"}, "link: there is no link wrist"),
        ({"mount": "distal_0"}, "mount.link: distal_0 hangs on proximal_0"),
    ],
)
def test_what_the_model_lacks_is_named(gripper, change, problem):
    if link := change.pop("link", ""):
        tips = [replace(gripper.fingertips[0], link=link), *gripper.fingertips[1:]]
        change = {"fingertips": tips}
    if link := change.pop("mount", ""):
        change = {"base": replace(gripper.base, mount=Mount(link))}
    with pytest.raises(InvalidArgumentError, match=problem):
        HandModel(replace(gripper, **change))


def test_included_parts_of_an_mjcf_are_read_once_from_allowed_folders(tmp_path):
    folder = tmp_path / "a"
    folder.mkdir()
    (model := folder / "hand.xml").write_text(MJCF.format("", "part.xml"))
    (folder / "part.xml").write_text(PART)
    (tmp_path / "secret.xml").write_text("no XML, so reading it is another error")
    copy = checked_copy(model, [folder])
    assert '<body name="palm"><geom name="pad"' in copy.text
    assert set(copy.files) == {model, folder / "part.xml"}
    for text, problem in (
        (MJCF.format("", "../secret.xml"), "is outside of"),
        (MJCF.format('<include file="part.xml"/>', "part.xml"), "twice"),
        (MJCF.format("", "package://no_such_package/part.xml"), "no such package is here"),
    ):
        (other := folder / "other.xml").write_text(text)
        with pytest.raises(InvalidArgumentError, match=problem):
            checked_copy(other, [folder])
        other.unlink()


@pytest.mark.parametrize(("joints", "pairs"), [([1, 1], 1), ([1, 1, 3], 0), ([1, 2], 0)])
def test_two_fingers_with_a_joint_each_are_jaws_if_there_are_no_others(joints, pairs):
    tips = [Fingertip(home=[0.0] * count) for count in joints]
    assert len(HandDescription(fingertips=tips).jaws) == pairs


def test_a_model_of_a_name_must_exist_in_the_description_but_not_in_a_plant():
    tips = [replace(tip) for tip in HAND.description.fingertips]
    tips[0].frame = f"typo::{tips[0].frame}"
    typo = replace(HAND.description, fingertips=tips)
    with pytest.raises(
        InvalidArgumentError, match=r"there is no model typo with a frame .*: hand$"
    ):
        HandModel(typo)
    plant = MultibodyPlant(0.01)
    robot = HandInstances(plant, add_hand_model(plant, HAND.description))
    assert robot.body("renamed::palm", "key") is robot.body("palm", "key")
    tips[0].frame = tips[0].frame.replace("typo", "hand")
    HandModel(typo)
