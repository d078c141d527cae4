"""The report of a study says what its rows say, and nothing from a file is taken for markup."""

import itertools
import re
import zlib

import numpy as np
import pandas as pd
import pytest
from conftest import slow
from made_up_jobs import write_study

from drake_pregrasp.studies import study_report
from drake_pregrasp.studies.measures import MEASURES
from drake_pregrasp.studies.paired_tests import share_interval
from drake_pregrasp.studies.runner import StudyRows
from drake_pregrasp.studies.study_file import load_study
from drake_pregrasp.studies.study_report import write_study_report

EVIL = "rate <script>alert(1)</script> $x^{$ [Hz]"
GRID = {
    "motion.linear_velocity": [0.0, 0.001, 0.1],
    EVIL: {"slow <b>": {"planner.period": 0.1}, "$fast": {"planner.period": 0.05}},
}
RANDOM = {"planner.power": {"uniform": [1, 2]}, "planner.strategy": {"choice": ["position", "msv"]}}
MADE_UP = ["q_gii_mean", "displacement", "position_error_mean", "ticks"]


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    changes = {"grid": GRID, "random": RANDOM, "seeds": 10, "measures": MADE_UP}
    folder = tmp_path_factory.mktemp("study")
    return load_study(write_study(folder, description="<script>", **changes))


@pytest.fixture(scope="module")
def rows(study):
    rows = pd.DataFrame(study.jobs())
    rows["q_gii_mean"], rows["displacement"] = 0.9 + rows["motion.linear_velocity"], np.nan
    return rows.assign(position_error_mean=10.0**rows.index % 50, ticks=rows.index)


GRASPS = {
    "scenario": "grasp_five_finger",
    "overrides": {},
    "conditions": {"calm": {"label": "no <b> wind"}, "windy": {}},
    "methods": {"old": {}, "new": {"label": "new <i>"}, "other": {}},
    "tests": [{"method": "new"}],
    "closing_times": [1.0, 2.0],
    "measures": ["held", "moved_hold_mm"],
    "grid": {"planner.period": [0.1, 0.05]},
    "seeds": 8,
}


@pytest.fixture(scope="module")
def grasps(tmp_path_factory):
    """A study of grasps, and rows of which none was simulated."""
    study = load_study(write_study(tmp_path_factory.mktemp("grasps"), **GRASPS))
    rows = []
    for job, time in itertools.product(study.jobs(), (1.0, 2.0)):
        luck = zlib.crc32(repr((*job.values(), time)).encode()) % 10
        held = bool(luck < {"old": 2, "new": 9}.get(job["method"], 5))
        row = {"close_at": time, "cause": "" if held else "met <nothing> & stopped", "held": held}
        rows.append(job | row | {"moved_hold_mm": luck if held else np.nan})
    return study, pd.DataFrame(rows)


def written(study, rows, folder, failed=None):
    failed = rows[:0] if failed is None else failed
    page = write_study_report(folder, study, StudyRows(rows, failed, 0, 0), {"k": "</pre>"})
    return page.read_text(encoding="utf-8")


@pytest.mark.slow
def test_all_that_a_study_names_is_escaped_and_the_page_is_self_contained(
    study, rows, grasps, tmp_path
):
    failed = rows[["seed"]].head(1).assign(error="ScenarioError: <script>alert(2)</script>")
    page = written(study, rows, tmp_path, failed) + written(*grasps, tmp_path)
    for markup in ("<script", "<b>", "<i>", "<nothing>", '"</pre>'):
        assert markup not in page
    for text in ("rate &lt;script&gt;", "slow &lt;b&gt;", "alert(2)", "<p>&lt;script&gt;</p>"):
        assert text in page
    assert "met &lt;nothing&gt; &amp; stopped" in page
    assert page.count("data:image/png;base64,") == 4 + 2
    assert not re.search(r'(?:src|href)="(?!data:)', page)
    assert "There are no rows yet." in written(study, rows[:0], tmp_path)


def test_a_table_has_medians_and_ranges_by_value_without_nan(study, rows):
    rows = study_report.labelled(study, rows)
    by_speed = study_report.measure_table(rows, ["motion.linear_velocity"], MADE_UP)
    assert by_speed.columns[:2].tolist() == ["motion.linear_velocity", "runs"]
    assert by_speed.iloc[:, 0].tolist() == ["0", "0.001", "0.1"]
    assert by_speed["Q_GII, mean"].tolist() == ["0.9", "0.901", "1"]
    ticks = rows.loc[rows["motion.linear_velocity"] == 0.1, "ticks"]
    said = f"{ticks.median():.4g} ({ticks.min():.4g} to {ticks.max():.4g})"
    assert by_speed[MEASURES["ticks"]].iloc[2] == said
    assert study_report.measure_table(rows, [EVIL], ["ticks"]).iloc[:, 0].tolist() == [
        "slow <b>",
        "$fast",
    ]
    assert study_report.measure_table(rows, [], ["ticks"])["runs"].tolist() == ["60"]


@pytest.mark.slow
def test_random_numbers_are_shown_run_by_run_and_never_joined_or_used_for_colours(study, rows):
    axes = study.axes
    rows = study_report.labelled(study, rows)
    assert [study_report.is_scattered(rows, axis) for axis in axes] == [False, False, True, False]
    colors = [study_report.color_column(study, rows, axis) for axis in axes]
    assert colors == [EVIL, "planner.strategy", "planner.strategy", "motion.linear_velocity"]
    for axis, color in itertools.product(axes[:3], (None, EVIL)):
        figure = study_report.plot_axis(rows, axis, MADE_UP[:1], color)
        joined = [line for line in figure.axes[0].lines if line.get_linestyle() == "-"]
        curves = [line for line in joined if len(line.get_xdata()) > 2]
        assert len(curves) == (axis is axes[0]) * (1 if color is None else 2)


@pytest.mark.slow
@pytest.mark.parametrize("outcome", [False, True])
def test_a_figure_shows_the_interval_of_a_share_and_the_quartiles_of_numbers(grasps, outcome):
    study, rows = grasps
    rows = study_report.labelled(study, rows.assign(held=outcome, moved_hold_mm=100.0 * outcome))
    figure = study_report.plot_axis(rows, study.axes[0], ["held", "moved_hold_mm"], None)
    ends = 100 * share_interval(pd.Series([96 * outcome]), pd.Series([96])).iloc[0]
    for panel, expected in zip(figure.axes, (ends, [100.0 * outcome] * 2), strict=True):
        bars = [line for line in panel.lines if len(line.get_xdata()) == 2]
        drawn = [sorted(line.get_ydata()) for line in bars if np.ptp(line.get_xdata()) == 0]
        bands = [part.get_paths()[0].get_extents() for part in panel.collections]
        drawn += [[box.ymin, box.ymax] for box in bands]
        assert drawn
        np.testing.assert_allclose(drawn, np.tile(expected, (len(drawn), 1)), atol=1e-6)


@pytest.mark.slow
def test_a_wide_scale_from_zero_shows_all_numbers(grasps):
    study, rows = grasps
    rows = rows.assign(moved_hold_mm=np.resize([0.0, 0.01, 30.0, 40.0], len(rows)))
    rows = study_report.labelled(study, rows)
    (panel,) = study_report.plot_axis(rows, study.axes[0], ["moved_hold_mm"], None).axes
    low, high = panel.get_ylim()
    assert panel.get_yscale() == "symlog"
    assert low == 0
    assert high > 32.5  # The upper quartile.


def test_counts_and_intervals_are_those_of_the_rows(grasps):
    study, rows = grasps
    table = study_report.share_table(study_report.labelled(study, rows), "held")
    labels = ["old", "new <i>", "other"]
    assert list(table) == ["condition", "closes at [s]", *labels]
    assert table["condition"].tolist() == ["no <b> wind"] * 2 + ["windy"] * 2
    counts = rows.groupby(["condition", "close_at", "method"])["held"].sum()
    for line, (condition, time) in zip(
        table.to_dict("records"), itertools.product(("calm", "windy"), (1.0, 2.0)), strict=True
    ):
        for key, label in zip(("old", "new", "other"), labels, strict=True):
            held = counts[condition, time, key]
            ends = 100 * share_interval(pd.Series([held]), pd.Series([16])).round(3)
            low, high = ends["low"][0], ends["high"][0]
            assert line[label] == f"{held} of 16 ({low:g}–{high:g} %)"


@pytest.mark.parametrize("method", ["old", slow("other")])
def test_tests_compare_the_same_runs_of_each_cell(grasps, method):
    study, rows = grasps
    page = study_report._test_parts(study, rows)[1]
    table = page.data.data
    own = table[table["against"] == method]
    assert own["condition"].tolist() == ["no <b> wind"] * 2 + ["windy"] * 2
    keys = ["condition", "close_at", "method", "planner.period", "seed"]
    held = rows.set_index(keys)["held"].sort_index()
    for line, (condition, time) in zip(
        own.to_dict("records"), itertools.product(("calm", "windy"), (1.0, 2.0)), strict=True
    ):
        new, other = held[condition, time, "new"], held[condition, time, method]
        assert line["pairs"] == "16"
        assert line["only it, or larger"] == str((new & ~other).sum())
        assert line["both the same"] == str((new == other).sum())
        assert line["only the other, or smaller"] == str((other & ~new).sum())


def test_every_failure_has_its_cause_in_the_table(grasps):
    study, rows = grasps
    (table,) = study_report._causes(study_report.labelled(study, rows))
    counts = table.data[["old", "new <i>", "other"]].astype(int).to_numpy()
    assert counts.sum() == (~rows["held"]).sum()


def test_runs_that_do_not_count_are_left_out_of_shares(grasps):
    study, rows = grasps
    rows = rows.astype({"held": object})
    rows.loc[rows["seed"] == 3, "held"] = np.nan
    shown = study_report.labelled(study, rows)
    table = study_report.share_table(shown[shown["held"].notna()], "held")
    assert table["old"].str.contains(" of 14 ").all()
