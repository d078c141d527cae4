"""A run folder is whole, belongs to one run, and is not replaced silently."""

import os
import resource
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import contents

from drake_pregrasp import OutputError, load_scenario, run
from drake_pregrasp.cli import main
from drake_pregrasp.simulation.output import claimed, write_named_text, write_text
from drake_pregrasp.simulation.run import RUN_FILES
from drake_pregrasp.simulation.run_log import CsvLog

SHORT = "{simulation_duration: 0.2}"
OTHER = "{simulation_duration: 0.2, random_seed: 1}"
COMMAND = ["run", "a_base", "--no-recording", "--scenario_text"]


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
    first, second, *_ = capsys.readouterr().out.splitlines()
    assert first.startswith("kernels     ")
    assert second == "replaced    the earlier run in this folder"
    assert contents(folder) != before


@pytest.mark.parametrize("name", ["log.csv", "scenario.yaml"])
def test_files_of_someone_else_are_not_replaced(tmp_path, name):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / name).write_text("precious")
    with pytest.raises(OutputError, match="--overwrite"):
        short_run(tmp_path)
    assert contents(tmp_path / "a") == {name: b"precious"}


@pytest.fixture
def victim(tmp_path):
    """A file and a folder outside of the run folder `runs/a`, whose run is another one."""
    folder = tmp_path / "home"
    folder.mkdir()
    (folder / "file").write_text("precious")
    (tmp_path / "runs" / "a").mkdir(parents=True)
    yield folder
    assert contents(folder) == {"file": b"precious"}


@pytest.mark.parametrize(
    ("name", "target"),
    [(".lock", "file"), (".lock", "none"), (".lock", "."), ("scenario.yaml", "file")],
)
def test_links_in_a_run_folder_lead_nowhere(tmp_path, victim, name, target):
    (tmp_path / "runs" / "a" / name).symlink_to(victim / target)
    with pytest.raises(OutputError, match="runs/a"):
        short_run(tmp_path / "runs")


@pytest.mark.slow
def test_a_run_replaces_links_and_pipes_by_files(tmp_path, victim):
    folder = tmp_path / "runs" / "a"
    for name in ("scenario.yaml", "log.csv", "partial-1"):
        (folder / name).symlink_to(victim / name)
    (folder / "summary.json").symlink_to(victim / "file")
    os.mkfifo(folder / "metrics.png")
    short_run(tmp_path / "runs", overwrite=True)
    found = {path.name for path in folder.iterdir() if path.is_file() and not path.is_symlink()}
    assert {"scenario.yaml", "log.csv", "summary.json", "metrics.png"} <= found <= set(RUN_FILES)


def test_a_run_folder_is_no_link(tmp_path, victim):
    (tmp_path / "runs" / "a").rmdir()
    (tmp_path / "runs" / "a").symlink_to(victim)
    with pytest.raises(OutputError, match="runs/a: is a link"):
        short_run(tmp_path / "runs")


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir])
def test_a_lock_is_a_file_and_not_waited_for(tmp_path, make):
    (tmp_path / "a").mkdir()
    make(tmp_path / "a" / ".lock")
    with pytest.raises(OutputError, match=r"\.lock: cannot be written"):
        short_run(tmp_path)


def test_the_lock_leaves_what_is_in_it(tmp_path):
    """It may be another name of a file outside."""
    (tmp_path / "a").mkdir()
    (tmp_path / "file").write_text("precious")
    os.link(tmp_path / "file", tmp_path / "a" / ".lock")
    with claimed(tmp_path / "a"):
        pass
    assert (tmp_path / "file").read_text() == "precious"


@pytest.mark.slow
def test_a_run_that_fails_or_is_stopped_leaves_the_earlier_one(tmp_path):
    folder = short_run(tmp_path).folder
    before = contents(folder)

    def fail(record):
        if record.time > 0.09:
            raise ArithmeticError

    def fail_to_read(record):
        raise FileNotFoundError("of the caller")

    for options in ({"on_tick": fail}, {"mcap": True, "on_tick": fail}):
        with pytest.raises(ArithmeticError):
            short_run(tmp_path, **options)
    with pytest.raises(FileNotFoundError, match="of the caller"):  # No matter of the log.
        short_run(tmp_path, mcap=True, on_tick=fail_to_read)
    stopped = short_run(tmp_path, should_stop=lambda: True)
    assert stopped.folder == folder / "partial-4"
    assert not stopped.replaced
    for number in (1, 2, 3, 4):
        assert (folder / f"partial-{number}" / "log.csv").read_text().startswith("time,")
        shutil.rmtree(folder / f"partial-{number}")
    assert contents(folder) == before


@pytest.mark.slow
@pytest.mark.parametrize("kilobytes", [1, 5, 20])
def test_a_full_disk_leaves_the_earlier_run_and_names_the_file(tmp_path, kilobytes):
    text = "{simulation_duration: 2.0}"
    folder = short_run(tmp_path, text).folder
    before = contents(folder)
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000 * kilobytes, limit[1]))
    try:
        with pytest.raises(OutputError, match=r"/[a-z]+\.[a-z]+: cannot be written"):
            short_run(tmp_path, text)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    shutil.rmtree(folder / "partial-1", ignore_errors=True)
    assert contents(folder) == before


@pytest.mark.slow
@pytest.mark.parametrize("program", ["no program", "#!/bin/sh\nexec sleep 60\n"])
def test_a_run_needs_no_picture_of_its_diagram(tmp_path, monkeypatch, program):
    dot = tmp_path / "dot"
    dot.write_text(program)
    dot.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    monkeypatch.setattr("drake_pregrasp.simulation.run._DRAWING", 0.2)
    result = short_run(tmp_path)
    assert result.completed
    assert not (result.folder / "diagram.svg").exists()


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


def test_a_device_that_the_user_names_is_written_and_a_link_followed(tmp_path):
    read, write = os.pipe()
    write_named_text(Path(f"/dev/fd/{write}"), "shown")
    assert os.read(read, 9) == b"shown"
    os.close(read)
    os.close(write)
    (tmp_path / "link").symlink_to(tmp_path / "file")
    write_named_text(tmp_path / "link", "text")
    assert (tmp_path / "file").read_text() == "text"
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(OutputError, match="file: cannot be written: Too many levels"):
        write_named_text(tmp_path / "loop" / "file", "text")
    (tmp_path / "loop").unlink()
    write_text(tmp_path / "link", "other")
    assert contents(tmp_path) == {"file": b"text", "link": b"other"}


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
