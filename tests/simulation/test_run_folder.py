"""A run folder is whole, belongs to one run, and is not replaced silently."""

import resource
import signal
import subprocess
import sys

import numpy as np
import pytest

from drake_pregrasp import OutputError, load_scenario, run
from drake_pregrasp.cli import main
from drake_pregrasp.simulation.output import claimed, write_text
from drake_pregrasp.simulation.run import RUN_FILES
from drake_pregrasp.simulation.run_log import CsvLog

SHORT = "{simulation_duration: 0.2}"
OTHER = "{simulation_duration: 0.2, random_seed: 1}"
COMMAND = ["run", "a_base", "--no-recording", "--scenario_text"]


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def short_run(out, text=SHORT, **options):
    return run(load_scenario("a_base", text=text), name="a", out=out, recording=False, **options)


@pytest.mark.slow
def test_the_same_scenario_replaces_its_run_and_nothing_else(tmp_path):
    first = short_run(tmp_path)
    (first.folder / "notes.txt").write_text("mine")
    log = (first.folder / "log.csv").read_bytes()
    again = short_run(tmp_path)
    assert (first.replaced, again.replaced) == (False, True)
    assert (again.folder / "log.csv").read_bytes() == log
    assert (again.folder / "notes.txt").read_text() == "mine"


@pytest.mark.slow
def test_another_scenario_replaces_a_run_only_on_request(tmp_path, capsys):
    out = ["--out", str(tmp_path)]
    assert main([*COMMAND, SHORT, *out]) == 0
    folder = tmp_path / "a_base"
    before = contents(folder)
    capsys.readouterr()
    assert main([*COMMAND, OTHER, *out]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"drake-pregrasp: {folder}: holds a run of another scenario")
    assert "--out" in said
    assert "--overwrite" in said
    assert said.count("\n") == 1
    assert contents(folder) == before
    assert main([*COMMAND, OTHER, *out, "--overwrite"]) == 0
    assert capsys.readouterr().out.startswith("replaced    the earlier run")
    assert contents(folder) != before


@pytest.mark.parametrize("name", ["log.csv", "scenario.yaml"])
def test_files_of_someone_else_are_not_replaced(tmp_path, name):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / name).write_text("precious")
    with pytest.raises(OutputError, match="--overwrite"):
        short_run(tmp_path)
    assert contents(tmp_path / "a") == {name: b"precious"}


@pytest.mark.slow
def test_two_runs_into_one_folder_exclude_each_other(tmp_path):
    folder = short_run(tmp_path).folder
    before = contents(folder)
    with claimed(folder), pytest.raises(OutputError, match="another run is writing into it"):
        short_run(tmp_path)
    assert contents(folder) == before
    short_run(tmp_path)


@pytest.mark.slow
def test_the_lock_of_a_killed_run_does_not_block_other_runs(tmp_path):
    code = f"""
import os, pathlib
from drake_pregrasp.simulation.output import claimed
with claimed(pathlib.Path({str(tmp_path / "a")!r})):
    os.kill(os.getpid(), {int(signal.SIGKILL)})
"""
    (tmp_path / "a").mkdir()
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == -signal.SIGKILL
    assert contents(tmp_path / "a") == {".lock": b""}
    assert set(contents(short_run(tmp_path).folder)) <= set(RUN_FILES)


@pytest.fixture
def small_disk():
    """Files of at most 10 kB can be written."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.usefixtures("small_disk")
def test_a_full_disk_leaves_the_old_file_or_none(tmp_path):
    write_text(tmp_path / "old.txt", "old")
    for name in ("old.txt", "new.txt"):
        with pytest.raises(OutputError, match=rf"{name}: cannot be written: File too large"):
            write_text(tmp_path / name, "x" * 20_000)
    assert contents(tmp_path) == {"old.txt": b"old"}


@pytest.mark.usefixtures("small_disk")
def test_a_full_disk_leaves_whole_rows_in_a_log(tmp_path):
    def write_rows():
        with CsvLog(tmp_path / "log.csv", [f"c{i}" for i in range(100)]) as log:
            for _ in range(10):
                log.write(np.full(100, 1 / 3))

    with pytest.raises(OutputError, match=r"log\.csv: cannot be written"):
        write_rows()
    lines = (tmp_path / "log.csv").read_text().splitlines()
    assert 1 < len(lines) < 10
    assert {line.count(",") for line in lines} == {99}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "status", "problem"),
    [
        ("list > /dev/full", 2, "standard output: cannot be written: No space left on device"),
        ("list >&-", 2, "standard output: cannot be written: it is closed"),
        (f"{' '.join(COMMAND)} '{SHORT}' --out runs > /dev/full", 2, "No space left on device"),
        (f"{' '.join(COMMAND)} '{SHORT}' --out runs <&- >&- 2>&-", 0, ""),
        ("run z_none <&- >&- 2>&-", 2, ""),
    ],
)
def test_full_or_closed_standard_streams_cause_no_traceback(line, status, problem, tmp_path):
    command = ["sh", "-c", f"exec {sys.executable} -m drake_pregrasp {line}"]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert result.returncode == status
    said = [line for line in result.stderr.splitlines() if not line.startswith("numba compiles")]
    assert problem in result.stderr
    assert len(said) == bool(problem)
    assert result.stdout == ""
    if "runs" in line:
        assert set(contents(tmp_path / "runs" / "a_base")) <= set(RUN_FILES)
