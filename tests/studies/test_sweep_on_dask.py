"""A Dask cluster makes the same rows as processes do."""

import os

import pytest
from made_up_sweeps import DiesOnce, made_up_run, write_study

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.cli import main
from drake_pregrasp.studies.sweep import dask_engine
from drake_pregrasp.studies.sweep.rows_file import ROWS
from drake_pregrasp.studies.sweep.study_file import load_study

distributed = pytest.importorskip("distributed")
dask = pytest.importorskip("dask")
# What the cluster itself warns of is not ours.
pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.fixture(scope="module")
def cluster():
    few = dask.config.set({"distributed.scheduler.allowed-failures": 1})
    with (
        few,
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
        ) as running,
    ):
        yield running


def test_both_engines_make_identical_rows(cluster, tmp_path, capsys):
    file = write_study(tmp_path)
    on_cluster = ["sweep", file, "--scheduler", cluster.scheduler_address, "--out"]
    assert main([*on_cluster, str(tmp_path / "cluster")]) == 0
    assert "8 of 8 runs are there" in capsys.readouterr().out
    assert main(["sweep", file, "--processes", "2", "--out", str(tmp_path / "here")]) == 0
    rows = [(tmp_path / where / "mine" / ROWS).read_bytes() for where in ("cluster", "here")]
    assert rows[0] == rows[1]
    assert rows[0].count(b"\n") == 9
    assert main([*on_cluster, str(tmp_path / "here")]) == 0  # Another engine goes on.


def test_a_worker_that_is_killed_costs_no_run(cluster, tmp_path):
    runs = [plan.run(k) for plan in [load_study(write_study(tmp_path)).plan] for k in range(8)]
    engine = dask_engine.dask_engine(cluster.scheduler_address)
    found = {run.index: values for run, values in engine(DiesOnce(tmp_path, 2), runs)}
    assert (tmp_path / "was_here").exists()
    assert sorted(found) == list(range(8))
    assert found[2] == made_up_run(runs[2])


def test_a_run_that_always_kills_its_worker_is_given_up(cluster, tmp_path):
    runs = [load_study(write_study(tmp_path)).plan.run(1)]
    engine = dask_engine.dask_engine(cluster.scheduler_address)
    ((run, words),) = engine(AlwaysDies(), runs)
    assert run.index == 1
    assert "KilledWorker" in words


class AlwaysDies:
    def __call__(self, run):
        os._exit(7)


def test_workers_with_another_package_are_refused(cluster, monkeypatch):
    ours = dask_engine.package_digest()
    monkeypatch.setattr(dask_engine, "differences", lambda theirs, _: f"source {theirs['source']}")
    with pytest.raises(InvalidArgumentError, match=r"has another package: source [0-9a-f]+$"):
        dask_engine.dask_engine(cluster.scheduler_address)
    assert len(ours["source"]) == 16


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nowhere", "tcp://no.such.host:1"])
def test_a_scheduler_that_does_not_answer_is_one_line(address, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(dask_engine, "TIMEOUT", 0.5)
    assert main(["sweep", write_study(tmp_path), "--scheduler", address]) == 2
    captured = capsys.readouterr()
    assert f"--scheduler: {address}: no scheduler answers within 0.5 s" in captured.err
    assert captured.err.count("\n") == 1


def test_a_scheduler_without_workers_is_said_to_have_none(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(dask_engine, "TIMEOUT", 0.5)
    with distributed.LocalCluster(
        n_workers=0, processes=False, dashboard_address=None, silence_logs=50
    ) as empty:
        address = empty.scheduler_address
        assert main(["sweep", write_study(tmp_path), "--scheduler", address]) == 2
    assert f"{address} has no workers; start some: dask worker" in capsys.readouterr().err
