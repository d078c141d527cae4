"""The same scenario in MuJoCo, and refusals in one line."""

import sys

import pytest
from conftest import LACKING_HANDS
from simulation_runs import run_text

from drake_pregrasp import ScenarioError, load_resolved, load_scenario
from drake_pregrasp.cli import main

HANDS = {
    "grasp_five_finger": "",
    "grasp_allegro_panda": LACKING_HANDS["allegro_panda"],
    "grasp_shadow": LACKING_HANDS["shadow_hand"],
}


def test_a_missing_mujoco_is_one_line_that_names_the_extra(monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    command = ["run", "a_base", "--scenario_text", "{engine: mujoco}", "--out", str(tmp_path)]
    assert main(command) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "engine" in line
    assert "pip install 'drake_pregrasp[mujoco]'" in line


def test_an_unknown_engine_is_refused():
    with pytest.raises(ScenarioError, match="engine"):
        load_scenario("a_base", text="{engine: bullet}")


def test_recorded_poses_have_no_engine():
    with pytest.raises(ScenarioError, match=r"engine.*recorded"):
        load_resolved("pose_stream", text="{engine: mujoco}")


@pytest.mark.slow
@pytest.mark.parametrize("name", HANDS)
def test_hands_hold_what_they_hold_in_drake(name, tmp_path):
    pytest.importorskip("mujoco", reason="needs the extra mujoco")
    if HANDS[name]:
        pytest.skip(HANDS[name])
    grasp = run_text(name, "engine: mujoco", tmp_path).summary["grasp"]
    assert grasp["phase"] == "hold"
    assert grasp["lift_height_mm"] == pytest.approx(100, abs=2)
    assert grasp["moved_before_mm"] < 0.2
    assert max(grasp["moved_lift_mm"], grasp["moved_hold_mm"]) < 5
    assert max(grasp["link_forces"].values()) < 0.3
