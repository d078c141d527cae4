"""Drives and fingertips of a proposed description."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.geometry import SceneGraph
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, PdControllerGains, RevoluteJoint

from drake_pregrasp.config.hand_description import Drive
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.hand_parsing import read_model
from drake_pregrasp.diagrams.hand_proposal import _drive, propose_hand
from drake_pregrasp.errors import InvalidArgumentError


def test_the_inertia_of_a_rotor_is_that_behind_its_gears():
    plant = MultibodyPlant(0.01)
    frames = plant.world_frame(), plant.AddRigidBody("link").body_frame()
    joint = plant.AddJoint(RevoluteJoint("joint", *frames, np.array([0.0, 0.0, 1.0])))
    actuator = plant.AddJointActuator("joint", joint, 2.0)
    actuator.set_default_rotor_inertia(1e-6)
    actuator.set_default_gear_ratio(100.0)
    actuator.set_controller_gains(PdControllerGains(p=4.0, d=0.0))
    stiffness, damping, inertia, effort = _drive(actuator, Drive(), is_arm=False)
    assert (stiffness, effort) == (4.0, 2.0)
    assert inertia == pytest.approx(0.01)
    assert damping == pytest.approx(2 * np.sqrt(4.0 * 0.01))


LINK = """<link name="{name}"><inertial><mass value="{mass}"/>
<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>{parts}</link>"""
PART = """<collision><origin xyz="{place}"/><geometry><box size="{size}"/></geometry></collision>"""
SLIDE = """<joint name="{name}_slide" type="prismatic"><parent link="base"/><child link="{name}"/>
<origin xyz="0 0 0.06"/><axis xyz="0 {side} 0"/>
<limit lower="0" upper="0.06" velocity="0.2"/></joint>"""


def jaws_urdf():
    """Two jaws, each a finger with a pad of 20 x 20 mm whose face is in the middle of both."""
    base = LINK.format(name="base", mass=0.7, parts=PART.format(place="0 0 0", size="0.1 0.1 0.06"))
    parts = [base]
    for name, side in (("left", 1), ("right", -1)):
        finger = PART.format(place=f"0 {side * 0.015} 0.05", size="0.02 0.014 0.1")
        pad = PART.format(place=f"0 {side * 0.006} 0.09", size="0.02 0.012 0.02")
        parts.append(LINK.format(name=name, mass=0.1, parts=finger + pad))
        parts.append(SLIDE.format(name=name, side=side))
    return f"<robot name='jaws'>{''.join(parts)}</robot>"


def test_jaws_touch_with_the_middle_of_their_faces_and_press_with_newtons(tmp_path, caplog):
    (tmp_path / "jaws.urdf").write_text(jaws_urdf())
    model = str(tmp_path / "jaws.urdf")
    hand = propose_hand(model, read_model(model))
    for tip, side in zip(hand.fingertips, (1, -1), strict=True):
        np.testing.assert_allclose(tip.center, [0.0, side * 0.01, 0.09], atol=1e-4)
        assert tip.radius == tip.patch_radius == pytest.approx(0.01, abs=1e-4)
        assert tip.reach.incidence < 0.3
    (drive,) = {(d.stiffness, d.effort) for d in hand.drives}
    assert drive == (1000.0, 40.0)
    assert "left_slide, right_slide: effort 40 N by default" in caplog.text


KNUCKLE = """<joint name="{name}_bend" type="{kind}"><parent link="{parent}"/><child link="{name}"/>
<origin xyz="{place}"/><axis xyz="{axis}"/>{limit}</joint>"""


def fingers_urdf(kind="revolute", names=("l0", "l1", "l2")):
    """Three fingers of two joints each, beside each other on a palm."""
    limit = '<limit lower="-0.5" upper="1.2"/>' if kind == "revolute" else ""
    parts = [
        LINK.format(name="palm", mass=0.3, parts=PART.format(place="0 0 0", size="0.1 0.1 0.02"))
    ]
    for k, name in enumerate(names):
        angle, link = 2 * np.pi / 3 * k, PART.format(place="0 0 0.02", size="0.01 0.01 0.04")
        place = f"{0.04 * np.cos(angle):.4f} {0.04 * np.sin(angle):.4f} 0.02"
        axis = f"{-np.sin(angle):.4f} {np.cos(angle):.4f} 0"
        for parent, child, at in (
            ("palm", f"{name}_near", place),
            (f"{name}_near", name, "0 0 0.04"),
        ):
            parts.append(LINK.format(name=child, mass=0.02, parts=link))
            parts.append(
                KNUCKLE.format(
                    name=child, kind=kind, parent=parent, place=at, axis=axis, limit=limit
                )
            )
    return f"<robot name='hand'>{''.join(parts)}</robot>"


def proposed(tmp_path, **changes):
    (tmp_path / "hand.urdf").write_text(fingers_urdf(**changes))
    model = str(tmp_path / "hand.urdf")
    return propose_hand(model, read_model(model))


def test_joints_without_limits_turn_once_around(tmp_path):
    hand = HandModel(proposed(tmp_path, kind="continuous"))
    for tree, chain in zip(hand.fingers.workspaces, hand.fingers.chains, strict=True):
        assert np.isfinite(tree.data).all()
        np.testing.assert_allclose(chain.upper - chain.lower, 2 * np.pi)


def test_a_slide_without_limits_is_refused_by_name(tmp_path):
    with pytest.raises(InvalidArgumentError, match=r"joint .*l0_near.* slides without limits"):
        proposed(tmp_path, kind="prismatic")


def test_names_of_frames_are_those_that_the_model_has_left(tmp_path):
    hand = proposed(tmp_path, names=("tip_0", "tip_1", "tip_2"))
    assert [tip.frame for tip in hand.fingertips] == [f"fingertip_{k}" for k in range(3)]
    # A frame may have a name that begins with that of a joint.
    first, *others = hand.fingertips
    named = replace(hand, fingertips=[replace(first, frame="tip_0_bend_pad"), *others])
    assert np.isfinite(HandModel(named).p_HT).all()


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        (
            "sdf",
            """<sdf version="1.11"><model name="m" placement_frame="b">
            <link name="a"/><link name="b">
            <pose relative_to="a" degrees="true">0 0.1 0.3 0 0 90</pose>
            <inertial auto="true"><density>500</density></inertial><collision name="c">
            <geometry><box><size>0.1 0.1 0.1</size></box></geometry></collision></link>
            <link name="c"><pose rotation_format="quat_xyzw">0 0 1 0 0.6 0 0.8</pose></link>
            </model></sdf>""",
        ),
        (
            "urdf",
            """<robot name="m"><link name="a"/><link name="b" drake_ignore="true"/></robot>""",
        ),
    ],
)
def test_the_checked_copy_of_a_model_is_the_model(tmp_path, kind, text):
    (tmp_path / f"m.{kind}").write_text(text)
    bodies = []
    for read in (text, read_model(str(tmp_path / f"m.{kind}")).text):
        plant, graph = MultibodyPlant(0.0), SceneGraph()
        plant.RegisterAsSourceForSceneGraph(graph)
        Parser(plant).AddModelsFromString(read, kind)
        plant.Finalize()
        context = plant.CreateDefaultContext()
        models = [plant.get_body(BodyIndex(i)) for i in range(plant.num_bodies())]
        poses = [body.EvalPoseInWorld(context).GetAsMatrix34() for body in models]
        bodies.append(([b.name() for b in models], [b.default_mass() for b in models], poses))
    (names, masses, poses), copied = bodies
    assert names == copied[0]
    np.testing.assert_allclose(masses, copied[1])
    np.testing.assert_allclose(poses, copied[2], atol=1e-12)
