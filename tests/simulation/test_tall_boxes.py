"""Fingers that squeeze a tall box do not drag it over the table, nor tip it."""

import pytest
from conftest import LACKING_HANDS
from simulation_runs import run_text

HANDS = ["five_finger_hand", "allegro_hand", "shadow_hand"]
STILL = "motion: {linear_velocity: 0.0, angular_velocity: 0.0}"
QUIET = "sensor: {position_std: 0.0, orientation_std: 0.0}"
BOXES = [(0.06, 0.05, 0.08), (0.06, 0.05, 0.12), (0.07, 0.05, 0.2)]
ABOVE, BELOW = -0.05, 0.05  # Height of the middle of the forbidden half over the centre of mass.
HALVES = [
    *[(hand, BOXES[1], ABOVE) for hand in HANDS],
    # From above, the other hands do not reach below the middle of so tall a box.
    ("five_finger_hand", BOXES[1], BELOW),
    ("shadow_hand", BOXES[0], 0.058),  # Its thumb does not press 11 mm below the centre of mass.
]


def check(hand, size, more, folder, mass=0.25):
    if lack := LACKING_HANDS.get(hand, ""):
        pytest.skip(lack)
    file = f"hand: {{file: package://drake_pregrasp/{hand}.yaml}}, initial_contacts: []"
    box = f"object: !Box {{size: {list(size)}, mass: {mass}}}"
    grasp = run_text("grasp_five_finger", f"{box}, {file}{more}", folder).summary["grasp"]
    assert grasp["phase"] == "hold"
    assert max(grasp["moved_closing_mm"], grasp["moved_squeeze_mm"]) < 5
    assert max(grasp["turned_closing_deg"], grasp["turned_squeeze_deg"]) < 5


@pytest.mark.slow
@pytest.mark.parametrize("size", BOXES)
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
@pytest.mark.parametrize(("hand", "size", "height"), HALVES)
def test_contacts_above_or_below_the_centre_of_mass_do_not_tip_it(hand, size, height, tmp_path):
    area = f"!InsideBox {{size: [0.1, 0.1, 0.1], center: [0.0, 0.0, {height}]}}"
    check(hand, size, f", {STILL}, {QUIET}, surface: {{no_touch: [{area}]}}", tmp_path)
