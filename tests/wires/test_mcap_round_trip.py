"""A run written as MCAP is shown by Foxglove, and replayed as a pose stream."""

import numpy as np
import pytest
from simulation_runs import contacts, points, run_log

from drake_pregrasp import load_scenario, run
from drake_pregrasp.config.object_config import PoseStream
from drake_pregrasp.wires.mcap_log import OBJECT_FRAME

pytest.importorskip("mcap")
pytest.importorskip("rosbags")


@pytest.mark.parametrize("name", ["a_base", "toss"])
def test_a_replayed_run_has_the_same_goals(name, tmp_path):
    text = "{planner: {period: 0.0333333, static_duration: 0.3}}"
    scenario = load_scenario(name, text=text)
    scenario.simulation_duration = 1.5
    first = run(scenario, name="first", out=tmp_path, recording=False, mcap=True)
    scenario.motion = PoseStream(file=str(first.folder / "run.mcap"), frame=OBJECT_FRAME)
    second = run(scenario, name="second", out=tmp_path, recording=False)
    logs = run_log(first), run_log(second)
    assert np.ptp(points(logs[0], "wo"), axis=0).max() > 1e-3
    for row in range(len(logs[0]["time"])):
        np.testing.assert_allclose(
            contacts(logs[0], row), contacts(logs[1], row), atol=1e-9, rtol=0
        )
