"""The guide to pose streams is true."""

import re
from pathlib import Path

import numpy as np

from drake_pregrasp import load_scenario
from drake_pregrasp.cli import main
from drake_pregrasp.estimation.recorded_poses import MAX_ROWS

GUIDE = (Path(__file__).parent.parent / "docs" / "pose_stream.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    (text,) = re.findall(rf"```{language}\n(.*?)```", GUIDE, flags=re.DOTALL)
    return text


def test_the_file_and_the_scenario_run(tmp_path):
    (tmp_path / "poses.csv").write_text(block("csv"))
    scenario = tmp_path / "mine.yaml"
    scenario.write_text(block("yaml"))
    assert load_scenario(file=scenario).motion.file == str(tmp_path / "poses.csv")
    command = ["run", "--scenario_file", str(scenario), "--out", str(tmp_path), "--no-recording"]
    assert main([*command, "--simulation_duration", "0.2"]) == 0
    assert main(["smooth", str(tmp_path / "poses.csv"), str(tmp_path / "smoothed.csv")]) == 0
    assert f"{MAX_ROWS:,}" in GUIDE


def test_the_python_lines_run_and_goals_follow(capsys):
    names: dict[str, object] = {}
    exec(compile(block("python"), "pose_stream.md", "exec"), names)
    assert capsys.readouterr().out.startswith("goals in W, 50 ms ahead:")
    ahead = names["measure"](names["time"] + names["estimator"].lookahead)
    p_OC = (ahead.inverse() @ names["p_WC"].T).T
    assert np.max(names["surface"].distance(p_OC)) < 2e-3
