"""Drives and fingertips of a proposed description."""

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PdControllerGains, RevoluteJoint

from drake_pregrasp.config.hand_description import Drive
from drake_pregrasp.diagrams.hand_parsing import read_model
from drake_pregrasp.diagrams.hand_proposal import _drive, propose_hand


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
