"""A hand takes objects of any shape, however they come to rest on the table or move with it."""

import numpy as np
import pytest
from simulation_runs import points, run_log, run_text

from drake_pregrasp.grasping.grasp_state import GraspPhase

CASES = {
    "cylinder that is pushed": """
        object: !Cylinder {radius: 0.04, length: 0.12},
        motion: !Push {speed: 0.1, distance: 0.15, start_distance: 0.06}""",
    "ball on a conveyor": "object: !Ball {radius: 0.045}",
    "mug on a conveyor": """
        object: !Mesh {file: package://drake_pregrasp/mug.obj},
        surface: {no_touch: [!Part {name: inside}, !Part {name: handle}]}""",
    "bracket on a conveyor": """
        object: !Mesh {file: package://drake_pregrasp/bracket.obj, mass: 0.25},
        surface: {forbidden_faces: [-z]},
        planner: {wall_test: surface, strategy: margin}""",
    "box that tips over": """
        object: !Box {size: [0.07, 0.08, 0.1], mass: 0.3},
        surface: {forbidden_faces: []},
        motion: !Toss {position: [0, 0, 0.2], spin: [9, 0, 0], table: true}""",
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_it_is_lifted_and_nothing_but_fingertips_touches_it(name, tmp_path):
    result = run_text("grasp_five_finger", f"{CASES[name]}, initial_contacts: []", tmp_path)
    grasp, log = result.summary["grasp"], run_log(result, "grasp.csv")
    assert (grasp["phase"], grasp["gave_up"]) == ("hold", None)
    # A ball has rolled until then, because the belt starts to move.
    assert grasp["moved_squeeze_mm"] - (grasp["moved_before_mm"] or 0.0) < 1.5
    assert 95 < grasp["lift_height_mm"] < 105
    assert max(grasp["moved_lift_mm"], grasp["moved_hold_mm"]) < 1.5
    assert set(grasp["link_forces"].values()) == {0.0}
    # Before the hand closes, the object rests on the table.
    heights = points(log, "wo")[(log["time"] > 4) & (log["phase"] < GraspPhase.CLOSE), 2]
    assert np.ptp(heights) < 1e-4
