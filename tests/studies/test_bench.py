import json

import numpy as np
import pytest

from drake_pregrasp.studies import bench as bench_module
from drake_pregrasp.studies.bench import STRATEGIES, bench
from drake_pregrasp.studies.bench_report import bench_markdown
from drake_pregrasp.studies.bench_runs import TickTimes
from drake_pregrasp.studies.bench_scene import implementations, make_scene, make_ticks


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_all_ways_plan_the_same(strategy):
    scene = make_scene(12)
    ticks = make_ticks(scene, strategy)
    for p_OC in scene.starts[:4]:
        measures = {way: tick(p_OC) for way, tick in ticks.items()}
        for way, found in measures.items():
            # The direct way projects onto all ground, the others onto the region's own.
            tolerance = 2e-3 if way == "direct" else 1e-9
            np.testing.assert_allclose(found, measures["BLAS"], rtol=tolerance, err_msg=way)


def test_writes_its_three_files(tmp_path, monkeypatch):
    monkeypatch.setattr(bench_module, "ROUNDS", {4: 12, 100: 12})
    monkeypatch.setattr(bench_module, "STRATEGIES", ("vew",))
    monkeypatch.setattr(bench_module, "PERIODS", {0.05: 0.4})
    steps = []
    report = bench(tmp_path / "b", quick=True, on_progress=lambda *step: steps.append(step))
    assert steps[-1] == (1 + len(implementations()),) * 2
    assert (tmp_path / "b" / "bench.png").stat().st_size > 1000
    content = json.loads((tmp_path / "b" / "bench.json").read_text())
    assert {row["size"] for row in content["ticks"]} == {64}  # Quick leaves the large one out.
    assert all(0 < row["p50"] <= row["p99"] for row in content["ticks"])
    assert all(run["factor"] > 0 for run in content["runs"])
    assert "## vew" in report.read_text()


def test_says_what_was_scaled_and_how_much_faster():
    rows = [
        TickTimes(5000, "msv", way, 10, p50, 2 * p50, scaled)
        for way, p50, scaled in (("numpy", 1e-3, 1), ("BLAS", 8e-3, 1), ("direct", 0.3, 2.5))
    ]
    line = next(x for x in bench_markdown(rows, [], "here").splitlines() if x.startswith("| 5,000"))
    assert line == "| 5,000 | 10, 10 | 1 / 2 | 8 / 16 | 300 / 600* | 8 | 300 |"
