"""Rows of a sweep are the same whoever makes them, and survive whatever ends it."""

import csv
import functools
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from drake_pregrasp.studies.case_runs import CaseLog, CaseRun
from made_up_sweeps import DiesOnce, made_up_run, one_by_one, write_study

from drake_pregrasp import OutputError, load_scenario, run
from drake_pregrasp.cli import main
from drake_pregrasp.simulation.phases import adapting_phase
from drake_pregrasp.studies.failed_file import FAILED, FailedFile
from drake_pregrasp.studies.settings_file import claim
from drake_pregrasp.studies.sweep.engines import local_engine
from drake_pregrasp.studies.sweep.measures import MEASURES
from drake_pregrasp.studies.sweep.package_digest import package_digest
from drake_pregrasp.studies.sweep.rows_file import ROWS, RowsFile
from drake_pregrasp.studies.sweep.run_maker import RunMaker
from drake_pregrasp.studies.sweep.study_file import load_study
from drake_pregrasp.studies.sweep.sweep import SETTINGS, STUDY, make_missing, sweep

TWO = ["q_msv_mean", "q_gii_mean"]


def make(folder, study, maker=made_up_run, engine=one_by_one, **options):
    """Makes what is missing, without simulating, and returns the failures and the file."""
    folder.mkdir(parents=True, exist_ok=True)
    with RowsFile(folder / ROWS, study.plan, TWO) as rows:
        failures = make_missing(rows, folder / FAILED, study.plan, maker, engine, **options)
    return failures, (folder / ROWS).read_bytes()


@pytest.fixture
def study(tmp_path):
    return load_study(write_study(tmp_path / "files", measures=TWO))


def test_the_order_of_the_runs_leaves_no_trace(study, tmp_path):
    def forwards(maker, runs):
        return ((run, maker(run)) for run in runs)

    _, backwards = make(tmp_path / "a", study)
    assert make(tmp_path / "b", study, engine=forwards) == ({}, backwards)
    rows = list(csv.DictReader(backwards.decode().splitlines()))
    assert [int(row["index"]) for row in rows] == list(range(8))
    assert [row["seed"] for row in rows] == ["0", "1"] * 4
    assert {row["planner.period"] for row in rows if row["rate [Hz]"] == "20"} == {"0.05"}


def test_a_file_cut_anywhere_is_completed_to_the_same_bytes(study, tmp_path):
    _, whole = make(tmp_path, study)
    for end in (*range(0, len(whole), 23), len(whole) - 1):
        (tmp_path / ROWS).write_bytes(whole[:end])
        steps = []
        _, again = make(tmp_path, study, on_progress=lambda *step, to=steps: to.append(step))
        assert again == whole
        missing = 8 - max(0, whole[:end].count(b"\n") - 1)
        assert steps == [(done, missing) for done in range(missing + 1)]


def test_each_row_is_on_the_disk_when_its_run_has_ended(study, tmp_path):
    seen = []

    def watched(maker, runs):
        for run_ in runs:
            seen.append((tmp_path / ROWS).read_text().count("\n") - 1)
            yield run_, maker(run_)

    make(tmp_path, study, engine=watched)
    assert seen == list(range(8))


def test_one_seed_of_all_points_comes_before_the_next(study, tmp_path):
    order = []

    def noted(maker, runs):
        order.extend(run.seed for run in runs)
        return ((run, maker(run)) for run in runs)

    make(tmp_path, study, engine=noted)
    assert order == [0] * 4 + [1] * 4


def test_a_process_that_is_killed_costs_no_row(study, tmp_path):
    _, whole = make(tmp_path / "a", study)
    (tmp_path / "notes").mkdir()
    dying = DiesOnce(tmp_path / "notes", 2)
    assert make(tmp_path / "b", study, dying, local_engine(2)) == ({}, whole)
    assert (tmp_path / "notes" / "was_here").exists()


def test_a_failed_run_is_recorded_and_made_again(study, tmp_path, monkeypatch):
    _, whole = make(tmp_path / "sound", study)
    monkeypatch.setenv("FAIL_RUN_3", "yes")
    failures, rows = make(tmp_path, study)
    assert list(failures) == [3]
    assert rows.count(b"\n") == 8
    (failed,) = csv.DictReader((tmp_path / FAILED).read_text().splitlines())
    assert failed["index"] == "3"
    assert failed["rate [Hz]"] == "20"
    assert failed["seed"] == "1"
    assert failed["error"] == failures[3]
    monkeypatch.delenv("FAIL_RUN_3")
    assert make(tmp_path, study) == ({}, whole)
    assert not (tmp_path / FAILED).exists()


def test_what_has_failed_is_known_until_it_is_made_again(study, tmp_path, monkeypatch):
    monkeypatch.setenv("FAIL_RUN_3", "yes")
    failures, _ = make(tmp_path, study)
    known = (tmp_path / FAILED).read_bytes()

    def interrupted(maker, runs):
        raise KeyboardInterrupt
        yield

    with pytest.raises(KeyboardInterrupt):
        make(tmp_path, study, engine=interrupted)
    assert (tmp_path / FAILED).read_bytes() == known
    for _ in range(2):
        assert make(tmp_path, study)[0] == failures
        assert (tmp_path / FAILED).read_bytes() == known
    text = known.decode()
    for other in (
        b"nonsense\n",
        b"\xff\xfe\n",
        text.replace("\n3,", "\n99,").encode(),
        text.replace("\n3,", "\nx,").encode(),
        text.replace("\n3,", "\n" + "3" * 5000 + ",").encode(),
        text.replace("\n3,", "\n03,").encode(),
        text.replace(",20,", ",10,").encode(),
    ):
        (tmp_path / FAILED).write_bytes(other)
        with pytest.raises(OutputError, match=FAILED):
            make(tmp_path, study)
        assert (tmp_path / FAILED).read_bytes() == other


def test_a_list_of_failures_cut_while_it_was_written_is_completed(study, tmp_path, monkeypatch):
    def failing(run_):
        return f"OutputError: {run_.index}" if run_.index % 2 else made_up_run(run_)

    failures, _ = make(tmp_path, study, failing)
    assert list(failures) == [1, 3, 5, 7]
    whole = (tmp_path / FAILED).read_bytes()
    header = whole.index(b"\n") + 1
    for end in range(header, len(whole), 11):
        (tmp_path / FAILED).write_bytes(whole[:end])
        killed = FailedFile(tmp_path / FAILED, study.plan.cell_names, list).__enter__()
        killed.add(study.plan.run(1).cells, "OutputError: 1")
        killed.add(study.plan.run(3).cells, "OutputError: again")
        assert make(tmp_path, study, failing)[0] == failures
        assert (tmp_path / FAILED).read_bytes() == whole


def test_the_order_of_labels_counts(tmp_path):
    """Rows are found by their index, which is another if labels change places."""
    labels = {"slow": {"planner.period": 0.1}, "quick": {"planner.period": 0.05}}
    grid = {"rate": labels}
    turned = {"rate": {name: labels[name] for name in ("quick", "slow")}}
    study, other = (
        load_study(write_study(tmp_path / name, grid=g, measures=TWO))
        for name, g in (("one", grid), ("other", turned))
    )
    sweep(study, tmp_path, one_by_one)
    with pytest.raises(OutputError, match=r"other settings \(study.order\)"):
        sweep(other, tmp_path, one_by_one)
    with pytest.raises(OutputError, match="holds no rows of this study"):
        make(tmp_path / "mine", other)
    again = load_study(str(tmp_path / "mine" / STUDY))
    assert [run_.cells for run_ in map(again.plan.run, range(4))] == [
        run_.cells for run_ in map(study.plan.run, range(4))
    ]


def test_labels_may_be_texts_and_numbers(tmp_path):
    rates = {20: {"planner.period": 0.05}, "often": {"planner.period": 0.02}}
    study = load_study(write_study(tmp_path, grid={"rate": rates}, measures=TWO, seeds=1))
    assert sweep(study, tmp_path / "out", one_by_one).wanted == 2
    assert sweep(study, tmp_path / "out", one_by_one).wanted == 2


def test_rows_of_another_study_are_no_rows(study, tmp_path):
    make(tmp_path, study)
    other = load_study(write_study(tmp_path / "files", grid={"planner.power": [1.0]}, measures=TWO))
    with pytest.raises(OutputError, match="holds no rows of this study"):
        make(tmp_path, other)


def maker_of(study, **changes):
    parts = {"measures": tuple(study.config.measures), "package": package_digest(), **changes}
    return RunMaker(study.scenario, study.source, study.folder, **parts)


def test_measures_are_those_of_a_run_folder(tmp_path):
    measures = [*TWO, "q_vew_final", "position_error_max", "displacement", "active_share", "ticks"]
    file = write_study(
        tmp_path,
        measures=[*measures, "force_closure_margin", "motion_on_object", "grasp_lift_height"],
        overrides={"simulation_duration": 0.4, "planner.static_duration": 0.2},
    )
    study = load_study(file)
    sweep_run = study.plan.run(7)
    values = dict(zip(study.config.measures, maker_of(study)(sweep_run), strict=True))
    text = (
        "{simulation_duration: 0.4, planner: {static_duration: 0.2, period: 0.05}, random_seed: 1"
    )
    text += ", motion: {linear_velocity: 0.02}, plant_config: {time_step: 0.025}}"
    result = run(load_scenario("a_base", text=text), name="one", out=tmp_path, recording=False)
    summary = result.summary
    assert values["q_msv_mean"] == summary["mean"]["q_msv"]
    assert values["q_gii_mean"] == summary["mean"]["q_gii"]
    assert values["q_vew_final"] == summary["final"]["q_vew"]
    assert values["ticks"] == summary["ticks"] == 9
    assert values["force_closure_margin"] == summary["force_closure_margin"]["final"]
    log = CaseLog(CaseRun("one", 1, result.folder))
    phase = adapting_phase(log.scenario, log.time)
    assert values["position_error_max"] == 1e3 * log.columns["position_error"][phase].max()
    moved = 1e3 * log.columns["displacement"][phase].sum()
    assert values["displacement"] == pytest.approx(moved / 0.25)
    assert values["active_share"] == 1
    steps = [abs(log.p_OC(k) - log.p_OC(k - 1)) for k in range(phase.start, 9)]
    over_object = sum(((step**2).sum(axis=1) ** 0.5).sum() for step in steps)
    assert values["motion_on_object"] == pytest.approx(1e3 * over_object / 0.25)
    assert values["grasp_lift_height"] != values["grasp_lift_height"]


def test_all_measures_have_units_or_none_and_a_run_without_ticks_has_numbers_too(tmp_path):
    file = write_study(
        tmp_path, overrides={"simulation_duration": 0.1}, measures=list(MEASURES), seeds=1
    )
    study = load_study(file)
    values = dict(zip(MEASURES, maker_of(study)(study.plan.run(0)), strict=True))
    assert values["ticks"] == 2
    assert values["q_msv_final"] > 2
    # Contacts are still held.
    assert {values[name] == values[name] for name in (*TWO, "active_share", "displacement")} == {
        False
    }


def test_another_package_makes_no_rows(study):
    others = {**package_digest(), "source": "0123", "drake": "1.0"}
    words = maker_of(study, package=others)(study.plan.run(0))
    assert "this worker's package is another one: source" in words
    assert "drake" in words


def test_the_command_sweeps_and_goes_on(tmp_path, capsys):
    grid = {"planner.period": [0.1, -1.0], "motion.linear_velocity": [0.0, 0.02]}
    file = write_study(tmp_path, grid=grid, seeds=1, overrides={"simulation_duration": 0.2})
    arguments = ["sweep", file, "--out", str(tmp_path), "--processes", "1"]
    assert main(arguments) == 1
    captured = capsys.readouterr()
    folder = tmp_path / "mine"
    assert "2 of 4 runs are there" in captured.out
    assert f"2 runs failed: {folder / FAILED} says why" in captured.err
    failed = list(csv.DictReader((folder / FAILED).read_text().splitlines()))
    assert [row["index"] for row in failed] == ["2", "3"]
    said = f"{file}: planner.period: -1.0 must be a number at least"
    assert all(row["error"].startswith(said) for row in failed)
    assert {p.name for p in folder.iterdir()} == {ROWS, FAILED, SETTINGS, STUDY, "report.html"}
    before = (folder / ROWS).read_bytes()
    assert main(arguments) == 1
    assert (folder / ROWS).read_bytes() == before
    write_study(tmp_path, grid={**grid, "motion.linear_velocity": [0.1]}, seeds=1)
    capsys.readouterr()
    assert main(arguments) == 2
    assert "is of a study with other settings (study.grid.motion" in capsys.readouterr().err
    assert (folder / ROWS).read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["none.yaml"], "none.yaml: can't be read"),
        (["trakking"], "trakking: no such sweep"),
        (["{study}", "--processes", "0"], "--processes: 0 must be 1 or more"),
        (["{study}", "--processes", "2", "--scheduler", "x"], "--processes: a cluster has its own"),
        (["{study}", "--out", "/dev/null/x"], "/dev/null/x/mine: can't be written"),
    ],
)
def test_bad_input_is_one_line_and_status_2(arguments, problem, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    file = write_study(tmp_path)
    assert main(["sweep", *(argument.format(study=file) for argument in arguments)]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert problem in captured.err
    assert captured.err.count("\n") == 1


def test_without_the_extra_a_scheduler_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main(["sweep", write_study(tmp_path), "--scheduler", "tcp://localhost:1"]) == 2
    assert "needs the extra sweep: pip install 'drake_pregrasp[sweep]'" in capsys.readouterr().err


def test_a_folder_in_use_is_refused(study, tmp_path):
    (tmp_path / "mine").mkdir()
    with (
        claim(tmp_path / "mine" / SETTINGS, {}),
        pytest.raises(OutputError, match="another process works on this study"),
    ):
        sweep(study, tmp_path, one_by_one)


@pytest.mark.parametrize("delay", [0.0, 0.4, 0.8])
def test_an_interrupt_from_the_terminal_is_said_once(tmp_path, delay):
    """It reaches all processes, those too that have only just begun."""
    file = write_study(tmp_path, seeds=30)
    command = [sys.executable, "-m", "drake_pregrasp", "sweep", file, "--processes", "2", "--out"]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    heed = functools.partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    with subprocess.Popen(
        [*command, str(tmp_path / "out")],
        env=environment,
        preexec_fn=heed,
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and not (tmp_path / "out" / "mine" / ROWS).exists():
            time.sleep(0.02)
        time.sleep(delay)
        os.killpg(process.pid, signal.SIGINT)
        output, errors = process.communicate(timeout=60)
    assert (process.returncode, output) == (130, "")
    assert errors.count("\n") == 1
    assert "interrupted: the runs so far are in" in errors


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_sweep_that_is_ended_keeps_its_rows_and_goes_on(tmp_path, number):
    file = write_study(tmp_path, seeds=30)
    command = [sys.executable, "-m", "drake_pregrasp", "sweep", file, "--processes", "1", "--out"]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    rows = tmp_path / "out" / "mine" / ROWS
    # Whoever runs the tests in the background may have had interrupts ignored.
    heed = functools.partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(
        [*command, str(tmp_path / "out")], env=environment, preexec_fn=heed, **pipes
    ) as process:
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and not (
            rows.exists() and rows.read_text().count("\n") > 3
        ):
            time.sleep(0.02)
        process.send_signal(number)
        output, errors = process.communicate(timeout=60)
    assert output == ""
    if number != signal.SIGKILL:
        assert process.returncode == 130
        assert f"interrupted: the runs so far are in {rows}; the same command goes on" in errors
        assert errors.count("\n") == 1
    study = load_study(file)
    measures = study.config.measures
    with RowsFile(rows, study.plan, measures) as kept:
        there = [row.index for row in kept.rows]
        assert 3 <= len(there) < len(study.plan)
        remade = maker_of(study)(study.plan.run(there[1]))
        # With numba, the process that has compiled the kernels may differ in last digits: this one.
        assert kept.rows[1].values == pytest.approx(tuple(remade), rel=1e-12)


def holds_rows(path):
    return path.exists() and path.read_text().count("\n") > 3
