"""Rows of a study are the same in all processes, and survive interruptions."""

import functools
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest
from conftest import contents
from made_up_jobs import JOBS, Deadly, constant_row, row, write_study

from drake_pregrasp.cli import main
from drake_pregrasp.errors import InvalidArgumentError, OutputError
from drake_pregrasp.simulation.output import claimed
from drake_pregrasp.studies import workers
from drake_pregrasp.studies.runner import FAILED, JOURNAL, ROWS, SETTINGS, run_jobs

distributed = pytest.importorskip("distributed")
dask = pytest.importorskip("dask")

QUIET = {"dashboard_address": None, "silence_logs": 50}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    run_jobs(constant_row, JOBS, folder=folder, settings={"a": {"b": 1}}, processes=1)
    return contents(folder)


@pytest.fixture
def again(whole, tmp_path):
    """Goes on in a folder, after its files were changed."""

    def go_on(*, cut=None, function=constant_row, **options):
        folder = tmp_path / "study"
        folder.mkdir(exist_ok=True)
        for name, content in whole.items():
            (folder / name).write_bytes(content[:cut] if name == JOURNAL else content)
        options = {"jobs": JOBS, "settings": {"a": {"b": 1}}, **options}
        return run_jobs(function, folder=folder, **options), folder

    return go_on


@pytest.mark.slow
def test_a_journal_cut_anywhere_is_completed_to_the_same_bytes(again, whole):
    assert set(whole) == {ROWS, JOURNAL, SETTINGS}
    journal = whole[JOURNAL]
    for cut in (len(journal) // 2, len(journal) - 1, len(journal)):
        steps = []
        found, folder = again(
            cut=cut, jobs=JOBS[::-1], on_progress=lambda *step, to=steps: to.append(step)
        )
        assert contents(folder) == whole
        missing = 8 - journal[:cut].count(b"\n")
        assert steps == [(done, missing) for done in range(missing + 1)]
        assert (found.wanted, found.made, len(found.failed)) == (8, 8, 0)
    pd.testing.assert_frame_equal(found.rows, pd.read_csv(folder / ROWS), check_dtype=False)
    assert list(zip(found.rows["name"], found.rows["seed"], strict=True)) == sorted(
        (job["name"], job["seed"]) for job in JOBS
    )


@pytest.mark.slow
def test_the_same_job_is_done_once_however_it_is_written(again, whole):
    rewritten = [dict(sorted(job.items(), reverse=True)) for job in JOBS]
    rewritten = [{**job, "seed": float(job["seed"])} for job in rewritten]
    found, folder = again(jobs=rewritten)
    assert (found.wanted, found.made, len(found.rows)) == (8, 8, 8)
    assert sorted(contents(folder)[JOURNAL].splitlines()) == sorted(whole[JOURNAL].splitlines())


@pytest.mark.slow
def test_a_failed_job_is_noted_stops_no_other_and_runs_again(again, whole, monkeypatch):
    monkeypatch.setenv("FAIL", "a2")
    found, folder = again(cut=0, processes=2)
    (failed,) = found.failed.to_dict("records")
    assert (failed["name"], failed["seed"], found.made) == ("a", 2, 7)
    assert "ZeroDivisionError: no <b>luck, none at all (made_up_jobs.py:" in failed["error"]
    assert pd.read_csv(folder / FAILED).to_dict("records") == [failed]
    # It is known until it has a row, also if others are asked for.
    options = {"folder": folder, "settings": {"a": {"b": 1}}}
    assert len(run_jobs(constant_row, JOBS[:1], **options).failed) == 1
    monkeypatch.delenv("FAIL")
    run_jobs(constant_row, JOBS, **options)
    assert contents(folder) == whole


@pytest.mark.slow
def test_without_a_folder_rows_are_returned_and_a_failed_job_is_an_error(monkeypatch):
    monkeypatch.setattr(workers, "JOBS_A_WORKER", 2)
    count_rows = functools.partial(rows_of, count=2)
    rows = run_jobs(count_rows, JOBS[:5:2], processes=1).rows
    assert rows["value"].tolist() == [0, 1] * 3
    one, two, three = rows["process"][::2]  # Which is renewed after two jobs.
    assert one == two != three
    monkeypatch.setenv("FAIL", "b0")
    for function, problem in ((row, "no <b>luck"), (unpicklable, "unpicklable")):
        with pytest.raises(OutputError, match=problem):
            run_jobs(function, JOBS[:1])


def rows_of(job, count):
    return [{"value": value, "process": os.getpid()} for value in range(count)]


def unpicklable(job):
    return {"value": lambda: job}


@pytest.mark.slow
def test_a_killed_process_costs_no_row_and_a_job_that_always_kills_is_given_up(again, tmp_path):
    found, _ = again(cut=0, jobs=JOBS[:4], function=Deadly(tmp_path, {0: 1, 1: 99}))
    assert found.made == 3
    (failed,) = found.failed.to_dict("records")
    assert (failed["name"], failed["seed"]) == ("a", 1)
    assert failed["error"] == f"its process was killed, {workers.ATTEMPTS} times"
    assert len(list(tmp_path.glob("1_*"))) >= workers.ATTEMPTS


@pytest.mark.slow
def test_rows_of_other_settings_are_never_mixed(again, whole):
    with pytest.raises(OutputError, match=r"other settings \(study\.a\.b, study\.c\); choose"):
        again(settings={"a": {"b": 2}, "c": 1})
    _, folder = again()
    (folder / SETTINGS).write_bytes(whole[SETTINGS].replace(b'"source": "', b'"source": "0'))
    with pytest.raises(OutputError, match=r"\(package\.source\)"):
        run_jobs(constant_row, JOBS, folder=folder, settings={"a": {"b": 1}})
    for name in (SETTINGS, JOURNAL):
        for content in (b"nonsense\n", b"[1]\n", b'{"job": 1}\n', b"\xff\xfe\n"):
            again()
            (folder / name).write_bytes(content)
            with pytest.raises(OutputError, match=name):
                run_jobs(constant_row, JOBS, folder=folder, settings={"a": {"b": 1}})
            assert (folder / name).read_bytes() == content


def test_a_folder_in_use_is_refused(tmp_path):
    with claimed(tmp_path), pytest.raises(OutputError, match="another run is writing into it"):
        run_jobs(constant_row, JOBS, folder=tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "rows", "delay"),
    [
        (signal.SIGINT, 0, 0.0),
        (signal.SIGINT, 0, 0.8),
        (signal.SIGTERM, 3, 0.0),
        (signal.SIGKILL, 3, 0.0),
    ],
)
def test_a_study_that_is_ended_keeps_its_rows_and_says_so(tmp_path, number, rows, delay):
    """A terminal interrupts all processes, those too that have only just begun."""
    command = [sys.executable, "-m", "drake_pregrasp", "study", write_study(tmp_path, seeds=10)]
    folder = tmp_path / "out" / "mine"
    journal = folder / JOURNAL
    with subprocess.Popen(
        [*command, "--processes", "2", "--out", str(folder.parent)],
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        # Whoever runs the tests in the background may have had interrupts ignored.
        preexec_fn=functools.partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        deadline = time.monotonic() + 100
        while time.monotonic() < deadline and not (
            journal.exists() and journal.read_text().count("\n") >= rows
        ):
            time.sleep(0.02)
        time.sleep(delay)
        (os.killpg if number == signal.SIGINT else os.kill)(process.pid, number)
        output, errors = process.communicate(timeout=100)
    assert output == ""
    if number != signal.SIGKILL:
        assert process.returncode == 130
        assert errors == (
            f"drake-pregrasp: interrupted: the runs so far are in {folder / ROWS};"
            " the same command resumes the study\n"
        )
    assert rows <= journal.read_text().count("\n") < 40


@pytest.fixture(scope="module")
def cluster():
    few = dask.config.set({"distributed.scheduler.allowed-failures": 1})
    with few, distributed.LocalCluster(n_workers=2, threads_per_worker=1, **QUIET) as running:
        yield running


# What the cluster itself warns of is not ours.
on_dask = pytest.mark.filterwarnings("ignore")


@pytest.mark.slow
@on_dask
def test_a_cluster_makes_the_same_bytes_and_goes_on(again, whole, cluster):
    _, folder = again(cut=len(whole[JOURNAL]) // 2, scheduler=cluster.scheduler_address)
    assert contents(folder) == whole


@pytest.mark.slow
@on_dask
def test_a_killed_worker_costs_no_row_and_a_job_that_always_kills_is_given_up(
    again, cluster, tmp_path
):
    options = {"cut": 0, "scheduler": cluster.scheduler_address}
    found, _ = again(function=Deadly(tmp_path, {0: 1}), **options)
    assert (found.made, len(list(tmp_path.glob("0_*")))) == (8, 2)
    found, _ = again(function=Deadly(tmp_path, {2: 99}), jobs=JOBS[5:6], **options)
    assert found.failed["error"].str.contains("KilledWorker").tolist() == [True]


@pytest.mark.slow
@on_dask
def test_workers_with_another_package_are_refused(again, cluster, monkeypatch):
    monkeypatch.setattr(workers, "differences", lambda theirs, ours: f"source {theirs['source']}")
    with pytest.raises(InvalidArgumentError, match=r"has another package: source [0-9a-f]{16}$"):
        again(scheduler=cluster.scheduler_address)


@pytest.mark.slow
@on_dask
@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nowhere", "tcp://no.such.host:1"])
def test_a_scheduler_that_does_not_answer_is_one_line(address, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(workers, "TIMEOUT", 0.5)
    command = ["study", write_study(tmp_path), "--scheduler", address, "--out", str(tmp_path)]
    assert main(command) == 2
    captured = capsys.readouterr()
    assert f"--scheduler: {address}: no scheduler answers within 0.5 s" in captured.err
    assert captured.err.count("\n") == 1


@pytest.mark.slow
@on_dask
def test_a_scheduler_without_workers_is_said_to_have_none(again, monkeypatch):
    monkeypatch.setattr(workers, "TIMEOUT", 0.5)
    with (
        distributed.LocalCluster(n_workers=0, processes=False, **QUIET) as empty,
        pytest.raises(InvalidArgumentError, match="has no workers; start some: dask worker"),
    ):
        again(scheduler=empty.scheduler_address)
