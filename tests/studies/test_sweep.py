"""The command `sweep`: its rows agree with the runs, and its report with the rows."""

import itertools
import re

import numpy as np
import pandas as pd
import pytest
from made_up_jobs import write_study
from scipy.spatial.transform import Rotation

from drake_pregrasp import ScenarioError, load_scenario, run
from drake_pregrasp.cli import main
from drake_pregrasp.simulation.run_log import adapting_phase
from drake_pregrasp.simulation.summary import MARGINS
from drake_pregrasp.studies.runner import FAILED, JOURNAL, ROWS, SETTINGS, StudyRows
from drake_pregrasp.studies.sweep import sweep_report
from drake_pregrasp.studies.sweep.measures import MEASURES
from drake_pregrasp.studies.sweep.study_file import load_study
from drake_pregrasp.studies.sweep.sweep_command import STUDY, SweepRun, sweep
from drake_pregrasp.studies.sweep.sweep_report import axis_table, write_sweep_report


def sweep_run(study):
    measures = tuple(study.config.measures)
    return SweepRun(study.plan, study.scenario, study.source, study.folder, (), measures)


@pytest.mark.slow
def test_measures_are_those_of_a_run_folder(tmp_path):
    overrides = {"simulation_duration": 0.4, "planner.static_duration": 0.2}
    study = load_study(write_study(tmp_path, measures=list(MEASURES), overrides=overrides))
    values = sweep_run(study)(study.plan.job(7))
    text = (
        "{simulation_duration: 0.4, planner: {static_duration: 0.2, period: 0.05}, random_seed: 1"
        ", motion: {linear_velocity: 0.02}, plant_config: {time_step: 0.025}}"
    )
    scenario = load_scenario("a_base", text=text)
    result = run(scenario, name="one", out=tmp_path, recording=False)
    summary = result.summary
    for quality, kind in itertools.product(("q_msv", "q_gii", "q_vew"), ("mean", "max", "final")):
        assert values[f"{quality}_{kind}"] == summary[kind][quality]
    for name in MARGINS:
        assert values[name] == summary[name]["final"]
    assert values["ticks"] == summary["ticks"] == 9
    assert np.isnan(values["grasp_lift_height"])
    log = pd.read_csv(result.folder / "log.csv")
    phase = adapting_phase(scenario, log["time"].values)
    assert values["position_error_max"] == 1e3 * log["position_error"][phase].max()
    assert values["displacement"] == pytest.approx(1e3 * log["displacement"][phase].sum() / 0.25)
    assert values["active_share"] == 1
    R_OW = Rotation.from_quat(log[[f"q{c}_wo_estimated" for c in "xyzw"]]).inv()
    p_WO = log[[f"{a}_wo_estimated" for a in "xyz"]].values
    p_OC = [R_OW.apply(log[[f"c{i}_{a}" for a in "xyz"]].values - p_WO) for i in range(5)]
    steps = np.linalg.norm(np.diff(p_OC, axis=1), axis=2)[:, phase.start - 1 :]
    assert values["motion_on_object"] == pytest.approx(1e3 * steps.sum() / 0.25)


def test_a_run_whose_contacts_are_still_held_has_numbers_too(tmp_path):
    overrides = {"simulation_duration": 0.1}
    study = load_study(write_study(tmp_path, overrides=overrides, measures=list(MEASURES)))
    values = sweep_run(study)(study.plan.job(0))
    assert list(values) == list(MEASURES)
    assert values["ticks"] == 2
    assert values["q_msv_final"] > 2
    assert np.isnan([values[name] for name in ("q_msv_mean", "active_share", "displacement")]).all()


def test_one_seed_of_all_points_comes_before_the_next(tmp_path, monkeypatch):
    asked = []

    def noted(function, jobs, **options):
        asked.extend(jobs)
        raise ScenarioError("", "", "enough")

    monkeypatch.setattr("drake_pregrasp.studies.sweep.sweep_command.run_jobs", noted)
    with pytest.raises(ScenarioError, match="enough"):
        sweep(load_study(write_study(tmp_path)), tmp_path)
    assert [job["seed"] for job in asked] == [0] * 4 + [1] * 4
    assert sorted(job["index"] for job in asked) == list(range(8))


@pytest.mark.slow
def test_the_command_sweeps_and_goes_on(tmp_path, capsys):
    grid = {"planner.period": [0.1, -1.0], "motion.linear_velocity": [0.0, 0.02]}
    file = write_study(tmp_path, grid=grid, seeds=1, overrides={"simulation_duration": 0.2})
    arguments = ["sweep", file, "--out", str(tmp_path), "--processes", "1"]
    assert main(arguments) == 1
    captured = capsys.readouterr()
    folder = tmp_path / "mine"
    assert "2 of 4 runs are complete" in captured.out
    assert f"2 runs failed: see {folder / FAILED}" in captured.err
    failed = pd.read_csv(folder / FAILED)
    assert failed["index"].tolist() == [2, 3]
    said = f"{file}: planner.period: -1.0 must be a number at least"
    assert failed["error"].str.startswith(said).all()
    files = {ROWS, JOURNAL, FAILED, SETTINGS, STUDY, "report.html"}
    assert {path.name for path in folder.iterdir()} == files
    before = (folder / ROWS).read_bytes()
    assert main(arguments) == 1
    assert (folder / ROWS).read_bytes() == before
    assert load_study(str(folder / STUDY)).plan == load_study(file).plan
    write_study(tmp_path, grid={**grid, "motion.linear_velocity": [0.1]}, seeds=1)
    capsys.readouterr()
    assert main(arguments) == 2
    assert "has rows of other settings (study.grid.motion" in capsys.readouterr().err
    assert (folder / ROWS).read_bytes() == before


EVIL = "rate <script>alert(1)</script> $x^{$ [Hz]"
GRID = {
    "motion.linear_velocity": [0.0, 0.001, 0.1],
    EVIL: {"slow <b>": {"planner.period": 0.1}, "$fast": {"planner.period": 0.05}},
}
RANDOM = {"planner.power": {"uniform": [1, 2]}, "planner.strategy": {"choice": ["position", "msv"]}}
MADE_UP = ["q_gii_mean", "displacement", "position_error_mean", "ticks"]


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    changes = {"grid": GRID, "random": RANDOM, "samples": 10, "measures": MADE_UP}
    folder = tmp_path_factory.mktemp("study")
    return load_study(write_study(folder, description="<script>", **changes))


@pytest.fixture(scope="module")
def rows(study):
    jobs = [study.plan.job(index) for index in range(len(study.plan))]
    rows = pd.DataFrame(jobs)
    rows["q_gii_mean"], rows["displacement"] = 0.9 + rows["motion.linear_velocity"], np.nan
    return rows.assign(position_error_mean=10.0 ** rows["index"] % 50, ticks=rows["index"])


@pytest.mark.slow
def test_all_that_a_study_names_is_escaped_and_missing_rows_are_said_to_be(study, rows, tmp_path):
    failed = rows[["index"]].head(1).assign(error="ScenarioError: <script>alert(2)</script>")
    page = write_sweep_report(tmp_path, study, StudyRows(rows, failed, 120, 120)).read_text()
    assert "<script" not in page
    assert "<b>" not in page
    for text in ("rate &lt;script&gt;", "slow &lt;b&gt;", "alert(2)", "<p>&lt;script&gt;</p>"):
        assert text in page
    assert page.count("data:image/png;base64,") == 4
    assert not re.search(r'(?:src|href)="(?!data:)', page)
    page = write_sweep_report(tmp_path, study, StudyRows(rows[:0], rows[:0], 120, 0)).read_text()
    assert "There are no rows yet." in page


def test_a_table_has_medians_and_ranges_by_value_without_nan(study, rows):
    axes = study.plan.axes
    rows = sweep_report.with_categories(rows, axes)
    by_speed = axis_table(rows, axes[0], MADE_UP)
    assert by_speed.columns[:2].tolist() == ["motion.linear_velocity [m/s]", "runs"]
    assert by_speed.iloc[:, 0].tolist() == ["0", "0.001", "0.1"]
    assert by_speed["Q_GII, mean"].tolist() == [
        f"{v:.5g} ({v:.4g} to {v:.4g})" for v in (0.9, 0.901, 1.0)
    ]
    assert by_speed[MEASURES["displacement"]].isna().all()
    ticks = rows.loc[rows["motion.linear_velocity"] == 0.1, "ticks"]
    said = f"{ticks.median():.5g} ({ticks.min():.4g} to {ticks.max():.4g})"
    assert by_speed[MEASURES["ticks"]].iloc[2] == said
    assert axis_table(rows, axes[1], MADE_UP).iloc[:, 0].tolist() == ["slow <b>", "$fast"]
    quarters = axis_table(rows, axes[2], MADE_UP)
    assert len(quarters) == 4
    assert quarters["runs"].sum() == len(rows)


@pytest.mark.slow
def test_random_numbers_are_shown_run_by_run_and_never_joined_or_used_for_colours(study, rows):
    axes = study.plan.axes
    rows = sweep_report.with_categories(rows, axes)
    assert [sweep_report.is_scattered(rows, axis) for axis in axes] == [False, False, True, False]
    colors = [sweep_report.color_axis(rows, axes, axis).name for axis in axes]
    assert colors == [EVIL, "planner.strategy", "planner.strategy", "motion.linear_velocity"]
    # Few samples are no values of an axis either: they differ in all other random fields.
    few = rows[rows["planner.power"].isin(rows["planner.power"].unique()[:3])]
    assert sweep_report.is_scattered(few, axes[2])
    for axis, color in itertools.product(axes[:3], (None, axes[1])):
        figure = sweep_report.plot_axis(few, axis, MADE_UP[:1], color)
        joined = [line for line in figure.axes[0].lines if line.get_linestyle() == "-"]
        curves = [line for line in joined if len(line.get_xdata()) > 2]
        assert len(curves) == (axis is axes[0]) * (1 if color is None else 2)


def test_axes_have_the_units_of_their_fields():
    assert sweep_report.axis_label("motion.linear_velocity") == "motion.linear_velocity [m/s]"
    assert sweep_report.axis_label("object.size[0]") == "object.size[0] [m]"
    assert sweep_report.axis_label("planner.strategy") == "planner.strategy"
    assert sweep_report.axis_label("the period [ms]") == "the period [ms]"
