"""Fingers that squeeze a tall box do not drag it over the table, nor tip it."""

import pytest
from conftest import LACKING_HANDS
from simulation_runs import run_text

# Each hand with the scenario of its settings.
HANDS = {
    "five_finger_hand": "grasp_five_finger",
    "allegro_hand": "grasp_five_finger",
    "shadow_hand": "grasp_five_finger",
    "gripper": "grasp_gripper",
}
STILL = "motion: {linear_velocity: 0.0, angular_velocity: 0.0}"
QUIET = "sensor: {position_std: 0.0, orientation_std: 0.0}"
BOXES = [(0.06, 0.05, 0.08), (0.06, 0.05, 0.12), (0.07, 0.05, 0.2)]
LOWER, UPPER = -0.1, 0.1  # Middle of the half that must not be touched, over the centre of mass.


def check(hand, size, more, folder, mass=0.25):
    if lack := LACKING_HANDS.get(hand, ""):
        pytest.skip(lack)
    file = f"hand: {{file: package://drake_pregrasp/{hand}.yaml}}, initial_contacts: []"
    box = f"object: !Box {{size: {list(size)}, mass: {mass}}}"
    grasp = run_text(HANDS[hand], f"{box}, {file}{more}", folder).summary["grasp"]
    assert grasp["phase"] == "hold"
    assert max(grasp["moved_closing_mm"], grasp["moved_squeeze_mm"]) < 5
    assert max(grasp["turned_closing_deg"], grasp["turned_squeeze_deg"]) < 5


@pytest.mark.slow
@pytest.mark.parametrize("size", [BOXES[0], BOXES[2]])
@pytest.mark.parametrize("hand", HANDS)
def test_a_box_on_a_still_table_stays_where_it_is(hand, size, tmp_path):
    check(hand, size, f", {STILL}, {QUIET}", tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("hand", HANDS)
def test_a_box_on_a_belt_moves_with_the_belt(hand, tmp_path):
    check(hand, BOXES[1], "", tmp_path)


@pytest.mark.slow
def test_fingers_in_a_row_do_not_cross_before_a_thin_box(tmp_path):
    check("allegro_hand", (0.1, 0.03, 0.15), "", tmp_path, mass=0.35)


@pytest.mark.slow
@pytest.mark.parametrize("height", [LOWER, UPPER])
@pytest.mark.parametrize("hand", HANDS)
def test_contacts_above_or_below_the_centre_of_mass_do_not_tip_it(hand, height, tmp_path):
    half = f"!InsideBox {{size: [0.1, 0.1, 0.2], center: [0.0, 0.0, {height}]}}"
    # From above, hands do not reach below the middle of so tall a box.
    side = ", grasp: {approaches: [above, side]}" * (height == UPPER)
    more = f", {STILL}, {QUIET}, surface: {{spacing: 0.004, no_touch: [{half}]}}{side}"
    check(hand, BOXES[2], more, tmp_path)
