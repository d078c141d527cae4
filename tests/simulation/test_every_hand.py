"""One line of a scenario puts another hand or object in."""

import pytest
from conftest import LACKING_HANDS, usable_hands
from simulation_runs import run_text

from drake_pregrasp import ScenarioError, load_resolved
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.errors import Lack
from drake_pregrasp.simulation.hand_file import load_hand

OBJECTS = {
    "box": "!Box {size: [0.05, 0.05, 0.06], mass: 0.2}",
    "cylinder": "!Cylinder {radius: 0.025, length: 0.08, mass: 0.2}",
    "ball": "!Ball {radius: 0.03, mass: 0.1}",
    "torus": '!Mesh {file: "package://drake_pregrasp/torus.obj", mass: 0.15}',
}
TEXT = "initial_contacts: [], hand: {file: package://drake_pregrasp/%s.yaml}, object: %s"

HELD = [
    ("allegro_hand", "box"),
    ("gripper", "box"),
    ("three_finger_hand", "cylinder"),
    ("four_finger_hand", "box"),
    ("shadow_hand", "cylinder"),
    ("allegro_ur5", "box"),
    ("allegro_xarm7", "box"),
    ("five_finger_panda", "box"),
    ("gripper_panda", "box"),
    ("shadow_panda", "cylinder"),
]
OTHERS = [
    pytest.param(*hand.values, name, marks=hand.marks)
    for hand in usable_hands()
    for name in OBJECTS
    if (*hand.values, name) not in HELD
]


@pytest.mark.parametrize("hand", usable_hands())
def test_every_shipped_hand_is_driven_and_reaches_its_home(hand, capfd):
    model = HandModel(load_hand(f"package://drake_pregrasp/{hand}.yaml"))
    assert (model.kinematics.stiffness > 0).all()
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
@pytest.mark.parametrize(("hand", "name"), OTHERS)
def test_each_hand_takes_each_object_or_says_what_is_missing(hand, name):
    try:
        resolved = load_resolved("grasp_five_finger", text=f"{{{TEXT % (hand, OBJECTS[name])}}}")
    except ScenarioError as error:
        problem = str(error)
    else:
        assert resolved.num_contacts == len(resolved.hand.azimuths)
        return
    assert any(f"no grasp for lack of {lack}" in problem for lack in Lack)
    # All hands have grasps on these, if the arm reaches over them.
    assert name not in ("box", "cylinder") or "lack of arm reach" in problem


@pytest.mark.slow
@pytest.mark.parametrize(("hand", "name"), HELD)
def test_hands_hold_what_they_lift(hand, name, tmp_path):
    if lack := LACKING_HANDS.get(hand, ""):
        pytest.skip(lack)
    base = "grasp_shadow" if hand.startswith("shadow") else "grasp_five_finger"
    grasp = run_text(base, TEXT % (hand, OBJECTS[name]), tmp_path).summary["grasp"]
    assert (grasp["phase"], grasp["gave_up"]) == ("hold", None)
    assert grasp["lift_height_mm"] > 95
