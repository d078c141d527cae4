"""The report of a sweep says what its rows say."""

import itertools
import re

import numpy as np
import pytest
from made_up_sweeps import write_study

from drake_pregrasp.studies.sweep.axis_figure import axis_label, plot_axis
from drake_pregrasp.studies.sweep.report import SHOWN, color_axis, write_report
from drake_pregrasp.studies.sweep.results import SweepResults
from drake_pregrasp.studies.sweep.rows_file import SweepRow
from drake_pregrasp.studies.sweep.study_file import load_study

EVIL = "rate <script>alert(1)</script> $x^{$ [Hz]"
GRID = {
    "motion.linear_velocity": [0.0, 0.001, 0.1],
    EVIL: {"slow <b>": {"planner.period": 0.1}, "$fast": {"planner.period": 0.05}},
}
RANDOM = {
    "planner.power": {"uniform": [1, 2]},
    "planner.strategy": {"choice": ["position", "msv"]},
}
MEASURES = ["q_gii_mean", "displacement", "position_error_mean", "ticks"]


@pytest.fixture
def study(tmp_path):
    changes = {"grid": GRID, "random": RANDOM, "samples": 10, "measures": MEASURES}
    return load_study(write_study(tmp_path, description="<script>", **changes))


def made_up_rows(study):
    rows = []
    for index in range(len(study.plan)):
        speed = study.plan.run(index).changes["motion.linear_velocity"]
        values = (0.9 + speed, float("nan"), 10.0**speed, float(index))
        rows.append(SweepRow(index, values))
    return rows


def test_all_that_a_study_names_is_escaped(study, tmp_path):
    path = tmp_path / "report.html"
    failures = {3: "ScenarioError: <script>alert(2)</script>"}
    write_report(path, study, made_up_rows(study), failures=failures, settings={"a": "<script>"})
    page = path.read_text()
    assert "<script" not in page
    assert "<b>" not in page
    for text in ("rate &lt;script&gt;", "slow &lt;b&gt;", "alert(2)", "<p>&lt;script&gt;</p>"):
        assert text in page
    assert page.count("data:image/png;base64,") == 4
    assert not re.search(r'(?:src|href)="(?!data:)', page)


def test_a_report_without_rows_says_so(study, tmp_path):
    path = tmp_path / "report.html"
    write_report(path, study, [], failures={}, settings={})
    assert "There are no rows yet." in path.read_text()


def test_groups_are_all_rows_by_what_they_have_in_common(study):
    rows = made_up_rows(study)
    results = SweepResults(study.plan, MEASURES, rows)
    assert results.axes == ["motion.linear_velocity", EVIL, "planner.power", "planner.strategy"]
    for axis in results.axes:
        places = np.concatenate([group.places for group in results.groups(axis)])
        assert sorted(places) == list(range(len(rows)))
    speeds = results.groups("motion.linear_velocity")
    assert [group.value for group in speeds] == [0.0, 0.001, 0.1]
    for group in speeds:
        spread = results.spread("q_gii_mean", group.places)
        assert spread.low == spread.median == spread.high == 0.9 + group.value
        assert np.isnan(results.spread("displacement", group.places).median)
    assert results.is_continuous("planner.power")
    assert len(results.groups("planner.power")) == 4
    ends = [results.numbers("planner.power")[g.places] for g in results.groups("planner.power")]
    assert all(one.max() <= next_.min() for one, next_ in itertools.pairwise(ends))


def test_median_and_range_leave_out_what_is_no_number(study):
    rows = [SweepRow(k, (v, v, v, v)) for k, v in enumerate([3.0, 1.0, float("nan"), 2.0])]
    spread = SweepResults(study.plan, MEASURES, rows).spread("ticks", np.arange(4))
    assert (spread.low, spread.median, spread.high) == (1, 2, 3)
    assert (spread.first_quartile, spread.third_quartile) == (1.5, 2.5)


def test_colours_show_another_axis_of_few_values(study):
    results = SweepResults(study.plan, MEASURES, made_up_rows(study))
    assert color_axis(results, "motion.linear_velocity") == EVIL
    assert color_axis(results, EVIL) == "planner.strategy"
    assert color_axis(results, "planner.strategy") == "motion.linear_velocity"
    assert color_axis(results, "planner.power") == "planner.strategy"


def test_a_single_axis_is_plotted_without_colours(tmp_path):
    grid = {"planner.strategy": ["position", "msv"]}
    study = load_study(write_study(tmp_path, grid=grid, measures=MEASURES))
    results = SweepResults(study.plan, MEASURES, [SweepRow(k, (1.0,) * 4) for k in range(4)])
    assert color_axis(results, "planner.strategy") is None
    plot_axis(tmp_path / "one.png", results, "planner.strategy", MEASURES, None)
    assert (tmp_path / "one.png").stat().st_size > 1000


def test_axes_have_the_units_of_their_fields():
    assert axis_label("motion.linear_velocity") == "motion.linear_velocity [m/s]"
    assert axis_label("object.size[0]") == "object.size[0] [m]"
    assert axis_label("planner.strategy") == "planner.strategy"
    assert axis_label("the period [ms]") == "the period [ms]"
    assert axis_label("period [ms]") == "period [ms]"
    assert "q_gii_mean" in SHOWN
