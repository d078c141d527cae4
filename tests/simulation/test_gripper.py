"""A parallel gripper: two pads that are opposite each other, and fingers with two joints."""

import numpy as np
import pytest
from conftest import LACKING_HANDS
from hand_files import write_hand
from simulation_runs import run_text

from drake_pregrasp import ScenarioError, load_resolved, load_scenario, run
from drake_pregrasp.quality.force_closure import torsional_friction_of
from drake_pregrasp.resources import resource_folder

GRIPPER = (resource_folder("models") / "gripper.yaml").read_text()
CYLINDER = "object: !Cylinder {radius: 0.03, length: 0.08, mass: 0.2}"


def resolved(text):
    return load_resolved("grasp_gripper", text=f"{{{text}}}")


# The middle of one face must not be touched: the pad on the other face must be beside it, too.
ONE_SIDED = (
    "surface: {spacing: 0.004, forbidden_faces: [+y, -y], no_touch: [!InsideBox {center:"
    " [0.04, -0.005, 0.0], size: [0.01, 0.03, 0.08]}]}"
)


@pytest.mark.slow
@pytest.mark.parametrize("text", ["object: {size: [0.08, 0.05, 0.06]}", ONE_SIDED, CYLINDER])
def test_pads_start_opposite_each_other_where_both_jaws_are(text):
    scenario = resolved(text)
    (a, b), (n_a, n_b) = scenario.start.p_OC, scenario.surface.project(scenario.start.p_OC)[1]
    np.testing.assert_allclose(n_a, -n_b, atol=0.1)
    np.testing.assert_allclose((a - b) / np.linalg.norm(a - b), n_a, atol=0.1)
    assert a[2] == pytest.approx(b[2], abs=3e-3)  # Jaws are at one height.
    jaws = scenario.start.yaw - np.arctan2(*(a - b)[1::-1])
    assert np.cos(jaws) == pytest.approx(1, abs=1e-3)
    assert scenario.start.margin > 0.5
    (pair,) = scenario.planner.limits.pairs
    assert (pair.first, pair.second, pair.distance) == (0, 1, 0.0)


@pytest.mark.slow
def test_jaws_are_not_closed_on_places_at_different_heights():
    """Friction would hold the box, but jaws cannot be where its sides may be touched."""
    areas = ", ".join(
        f"!InsideBox {{center: [{x}, 0.0, {-z}], size: [0.01, 0.06, 0.04]}}"
        for x, z in ((0.04, 0.012), (-0.04, -0.012))
    )
    with pytest.raises(ScenarioError, match="no grasp for lack of"):
        resolved(f"surface: {{spacing: 0.004, forbidden_faces: [+y, -y], no_touch: [{areas}]}}")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "object: {size: [0.13, 0.12, 0.06]}",
            "lack of opening: the jaws open 90 mm between their standoffs; the narrowest place"
            " between opposite sides is 120 mm wide",
        ),
        (
            "object: {size: [0.006, 0.12, 0.08]}, planner: {limits: {tip_gap: 0.01}}",
            "lack of room: at most 1 fingertips have room",
        ),
        ("object: {mass: 5}", "fingers of 35, 35 N hold 35 N with friction 0.5"),
    ],
)
def test_what_a_gripper_cannot_hold_is_refused_with_the_numbers(text, message):
    with pytest.raises(ScenarioError, match=message):
        resolved(text)


def test_two_fingers_need_soft_pads(tmp_path):
    path = write_hand(tmp_path, "patch_radius: 0.01", "patch_radius: 0", count=2, text=GRIPPER)
    with pytest.raises(ScenarioError, match="2 hard fingertips do not resist a moment about"):
        load_resolved("grasp_gripper", text=f"{{hand: {{file: '{path}'}}}}", folders=[tmp_path])


@pytest.mark.slow
def test_measures_are_those_of_soft_fingers_unless_others_are_asked_for():
    measures, half = resolved("").measures, 0.005  # Of the radius of a pad.
    torsional = float(torsional_friction_of(measures.friction, np.array(half)))
    assert (measures.contact_model, measures.torsional_friction) == ("soft_finger", torsional)
    asked = resolved("measures: {contact_model: hard_finger, torsional_friction: 0.001}").measures
    assert (asked.contact_model, asked.torsional_friction) == ("hard_finger", 0.001)
    asked = resolved("measures: {contact_model: complete}").measures
    assert asked.contact_model == "complete"
    assert load_resolved("grasp_five_finger").measures.contact_model == "complete"


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        "object: {size: [0.08, 0.05, 0.06]}",
        CYLINDER,
        # Pads beside the middle resist the turn about the line through them.
        "object: {size: [0.08, 0.05, 0.06]}, surface: {no_touch: [!BehindPlane {point: [0.0,"
        " -0.008, 0.0], normal: [0.0, 1.0, 0.0]}]}",
    ],
)
def test_in_a_gripper_objects_neither_slip_nor_turn(text, tmp_path):
    result = run_text("grasp_gripper", text, tmp_path)
    grasp = result.summary["grasp"]
    assert (grasp["phase"], grasp["gave_up"]) == ("hold", None)
    assert grasp["lift_height_mm"] > 99.5
    parts = ("before", "closing", "squeeze", "lift", "hold")
    assert max(grasp[f"moved_{part}_mm"] for part in parts) < 1
    assert max(grasp[f"turned_{part}_deg"] for part in parts) < 1
    assert max(grasp["link_forces"].values()) == 0
    assert result.summary["force_closure_margin"]["final"] > 0.5


TWO_JOINTS = """
model: package://drake_pregrasp/three_finger_hand.sdf
base: !Carrier {joints: [x, y, z, yaw], palm_height: 0.155}
locked: [{joint: finger_0_swing}, {joint: finger_1_swing}, {joint: finger_2_swing}]
fingertips:
""" + "".join(
    f"  - {{frame: finger_{k}_tip, radius: 0.009, home: [0.9, 1.35],"
    f" reach: !SectorReach {{azimuth: {2.0944 * k}, half_angle: 1.13}}}}\n"
    for k in range(3)
)


def check_two_joints(thing, folder):
    """Checks that the hand in a folder follows an object, and lifts it."""
    text = f"{{{thing}, initial_contacts: [], hand: {{file: '{folder}/hand.yaml'}}}}"
    scenario = load_scenario("grasp_five_finger", text=text, folders=[folder])
    grasp = run(scenario, name="two_joints", out=folder, recording=False).summary["grasp"]
    assert (grasp["phase"], grasp["gave_up"]) == ("hold", None)
    assert grasp["tracking_error_mean_mm"] < 0.5
    assert grasp["lift_height_mm"] > 95


@pytest.mark.slow
@pytest.mark.parametrize("thing", [CYLINDER, "object: !Box {size: [0.07, 0.07, 0.07], mass: 0.2}"])
def test_fingers_with_two_joints_follow_with_the_carrier_and_lift(thing, tmp_path):
    (tmp_path / "hand.yaml").write_text(TWO_JOINTS)
    check_two_joints(thing, tmp_path)


@pytest.mark.slow
def test_fingers_with_two_joints_on_an_arm_lift(tmp_path):
    if lack := LACKING_HANDS.get("five_finger_panda", ""):
        pytest.skip(lack)
    text = (resource_folder("models") / "five_finger_panda.yaml").read_text()
    head, tips = text.replace("home: [0.0, 0.9", "home: [0.9").split("fingertips:\n")
    swings = [f"{{joint: finger_{k}_swing}}" for k in (0, 2, 3)]
    parts = "swing", "pitch", "curl"
    others = [f"{{joint: finger_{k}_{part}}}" for k in (1, 4) for part in parts]
    used = [line for line in tips.splitlines() if "finger_1" not in line and "finger_4" not in line]
    locked = f"locked: [{', '.join(swings + others)}]"
    (tmp_path / "hand.yaml").write_text("\n".join([head + locked, "fingertips:", *used]))
    check_two_joints(CYLINDER, tmp_path)
