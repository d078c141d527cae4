import contextlib
import json
import os
import pty
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml
from threadpoolctl import threadpool_info, threadpool_limits

from drake_pregrasp import shipped_scenarios
from drake_pregrasp.cli import command, main
from drake_pregrasp.cli.run_command import grasp_in_words
from drake_pregrasp.grasping.held_criterion import PARTS
from drake_pregrasp.resources import resource_folder
from drake_pregrasp.simulation.smooth_file import CARRIED

HAND = "package://drake_pregrasp/five_finger_hand.yaml"
SHORT = ["--simulation_duration", "0.5", "--no-recording"]


def test_list_names_every_scenario(capsys):
    assert main(["list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(shipped_scenarios())


def test_a_command_uses_one_thread_for_matrices(monkeypatch):
    used = []

    def note(options):
        used.extend(each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas")
        return 0

    monkeypatch.setattr(command, "_list", note)
    with threadpool_limits(2, user_api="blas"):
        assert main(["list"]) == 0
    assert set(used) == {1}


@pytest.mark.slow
def test_run_says_where_the_results_are(tmp_path, capsys):
    assert main(["run", "a_base", "--out", str(tmp_path), *SHORT]) == 0
    captured = capsys.readouterr()
    assert str(tmp_path / "a_base") in captured.out
    assert captured.err == ""  # Quiet when it is no terminal.
    assert json.loads((tmp_path / "a_base" / "summary.json").read_text())["ticks"] == 11


@pytest.mark.slow
def test_run_from_a_file_with_drakes_flags(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("_hidden: &d {description: anchored}\none: {<<: *d}\ntwo: {<<: *d}\n")
    flags = ["two", "--scenario_file", str(file), "--out", str(tmp_path)]
    assert main(["run", *flags, "--scenario_text", "{random_seed: 8}", *SHORT]) == 0
    assert json.loads((tmp_path / "two" / "summary.json").read_text())["seed"] == 8
    assert main(["run", "one", *flags[1:], *SHORT]) == 0
    assert (tmp_path / "one" / "log.csv").exists()


def test_graphviz_writes_the_diagram_and_simulates_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["run", "a_base", "--graphviz", "diagram.dot"]) == 0
    before = Path("diagram.dot").read_text()
    assert "safe_region_partitioner" in before
    assert [file.name for file in tmp_path.iterdir()] == ["diagram.dot"]
    assert main(["run", "a_base", "--graphviz", "diagram.dot"]) == 2
    assert "diagram.dot is there already" in capsys.readouterr().err
    assert Path("diagram.dot").read_text() == before


BAD = yaml.safe_load((Path(__file__).parent / "bad_commands.yaml").read_text())


@pytest.mark.parametrize(("line", "problem"), BAD)
def test_bad_input_is_one_line_and_status_2(line, problem, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    try:
        status = main(shlex.split(line))
    except SystemExit as error:
        status = error.code
    captured = capsys.readouterr()
    assert status == 2
    assert captured.out == ""
    assert problem in captured.err
    assert captured.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_smooth_writes_a_stream_and_says_so(tmp_path, capsys):
    source = resource_folder("models") / "carried_by_hand.csv"
    target = tmp_path / "smoothed.csv"
    assert main(["smooth", str(source), str(target)]) == 0
    assert capsys.readouterr().out == f"121 poses smoothed into {target}\n"
    assert len(target.read_text().splitlines()) == 122
    assert main(["smooth", str(target), str(target)]) == 2
    assert f"{target} is there already" in capsys.readouterr().err
    assert len(target.read_text().splitlines()) == 122
    assert main(["smooth", str(source), "/dev/null/x"]) == 2
    assert "/dev/null/x: cannot be written" in capsys.readouterr().err


@pytest.mark.slow
def test_smooth_accepts_just_the_settings_that_change_what_it_writes(tmp_path, capsys):
    source = resource_folder("models") / "carried_by_hand.csv"

    def smoothed(**settings):
        target = tmp_path / "smoothed.csv"
        target.unlink(missing_ok=True)
        status = main(["smooth", str(source), str(target), "--estimator", json.dumps(settings)])
        return status or target.read_text()

    before = smoothed()
    for key, default in vars(CARRIED).items():
        value = [[0.0, 0.0, 1.5707963]] if key == "symmetry" else type(default)(2 * default or 1)
        after = smoothed(**{key: value})
        assert after != before, key
        if after == 2:
            assert f"--estimator: {key}: {value} has no effect" in capsys.readouterr().err


def test_a_working_directory_that_is_deleted_is_named(tmp_path, monkeypatch, capsys):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert main(["run", "a_base", *SHORT]) == 2
    said = "drake-pregrasp: the working directory cannot be used: No such file or directory\n"
    assert capsys.readouterr().err == said


COMMAND = [sys.executable, "-m", "drake_pregrasp", "run", "a_base", "--no-recording", "--out"]


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_keeps_its_log_and_says_so(tmp_path, number):
    folder = tmp_path / "a_base"
    log = folder / "partial-1" / "log.csv"
    with subprocess.Popen(
        [*COMMAND, str(tmp_path), "--simulation_duration", "100000"], stdout=subprocess.PIPE
    ) as process:
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and not (log.exists() and log.stat().st_size > 5000):
            time.sleep(0.05)
        assert log.stat().st_size > 5000  # Rows do not wait for the end.
        process.send_signal(number)
        output, _ = process.communicate(timeout=60)
    assert process.returncode == 130
    assert f"the log up to that tick is in {folder / 'log.csv'}" in output.decode()
    rows = (folder / "log.csv").read_text().splitlines()
    assert len({row.count(",") for row in rows}) == 1
    assert json.loads((folder / "summary.json").read_text())["completed"] is False


@pytest.mark.slow
def test_a_terminal_gets_a_progress_bar(tmp_path):
    ours, theirs = pty.openpty()
    command = [*COMMAND, str(tmp_path), "--simulation_duration", "2"]
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "120"}
    with subprocess.Popen(command, stderr=theirs, stdout=subprocess.DEVNULL, env=environment):
        os.close(theirs)
        parts = []
        with contextlib.suppress(OSError):  # The end of the process.
            while part := os.read(ours, 4096):
                parts.append(part)
    shown = b"".join(parts).decode(errors="replace")
    os.close(ours)
    assert "of 2 s" in shown
    assert "x real time" in shown
    assert "Q_GII 0.97" in shown


@pytest.mark.slow
def test_a_reader_who_has_enough_of_the_output_is_no_fault():
    command = [sys.executable, "-m", "drake_pregrasp", "list"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 141


def test_export_and_replay_refuse_options_without_effect(tmp_path, capsys):
    (tmp_path / "scenario.yaml").write_text("own: {}")
    for line, problem in (
        ("export {} --scenario_text {{}}", "--scenario_text: has no effect on a run folder"),
        ("export {} --scenario_file own.yaml", "--scenario_file: has no effect on a run folder"),
        ("export {} --simulation_duration 9", "--simulation_duration: has no effect on a run"),
        ("export {} --out other", "--out: has no effect on a run folder"),
        ("replay {} --postures --out other", "--out: has no effect on the test of postures"),
        ("replay {} --engine drake", "has no hand"),
    ):
        assert main(shlex.split(line.format(tmp_path))) == 2
        assert problem in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize(
    "text", ["[1]", "3", "{}", '{"grasp": 3}', '{"grasp": {"phase": "hold"}}', "{", 9999 * "["]
)
def test_replay_refuses_a_broken_summary_before_it_runs(tmp_path, capsys, text):
    own = f"own: {{engine: mujoco, hand: {{file: {HAND}}}, ring_contacts: 5}}"
    (tmp_path / "scenario.yaml").write_text(own)
    (tmp_path / "summary.json").write_text(text)
    assert main(["replay", str(tmp_path), "--engine", "drake"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "summary.json: is no summary of a run with a hand" in error


def a_grasp(phase, **measured):
    names = ["tracking_error_mean_mm", "lift_height_mm", "slips_after_s", "gave_up", "held"]
    names += [
        f"{what}_{part}_{unit}"
        for part in PARTS
        for what, unit in (("moved", "mm"), ("turned", "deg"))
    ]
    return dict.fromkeys(names) | {"phase": phase} | measured


def test_the_parts_in_which_an_object_was_not_held_are_named():
    still = {name: 1.0 for name in a_grasp("hold") if name.startswith(("moved", "turned"))}
    assert "off its place)" not in grasp_in_words(a_grasp("hold", held=True, **still))
    words = grasp_in_words(a_grasp("hold", held=False, **still | {"turned_lift_deg": 5.25}))
    assert "the object was not held (lift: 1.0 mm and 5.2° off its place)," in words
    words = grasp_in_words(
        a_grasp("hold", held=False, moved_closing_mm=6.0, turned_closing_deg=2.0)
    )
    assert "the object was not held (closing: 6.0 mm and 2.0° off its place)," in words


@pytest.mark.slow
def test_replay_compares_two_engines_and_whole_grasps_only(tmp_path, capsys):
    folder = tmp_path / "short"
    folder.mkdir()
    (folder / "scenario.yaml").write_text(f"own: {{hand: {{file: {HAND}}}, ring_contacts: 5}}")
    assert main(["replay", str(folder), "--engine", "drake"]) == 2
    assert f"drake made {folder}; give mujoco" in capsys.readouterr().err
    assert main(["replay", str(folder), "--postures"]) == 2
    assert f"`drake-pregrasp export {folder}` writes it" in capsys.readouterr().err
    own = f"engine: mujoco, hand: {{file: {HAND}}}, ring_contacts: 5, simulation_duration: 0.2"
    (folder / "scenario.yaml").write_text(f"own: {{{own}}}")
    (folder / "summary.json").write_text(json.dumps({"grasp": a_grasp("track")}))
    assert main(["replay", str(folder), "--engine", "drake", "--out", str(tmp_path)]) == 0
    words = capsys.readouterr().out.splitlines()
    assert words[-4].startswith("mujoco      at the end: track")
    assert words[-3].startswith("drake       at the end: ")
    assert words[-2] == "verdicts    none: a run ended before its hand held the object or gave up"


def test_replay_reads_files_of_allowed_folders(tmp_path, capsys):
    (folder := tmp_path / "run").mkdir()
    (tmp_path / "own.obj").write_text("no mesh")
    (folder / "scenario.yaml").write_text("own: {object: !Mesh {file: ../own.obj}}")
    assert main(["replay", str(folder)]) == 2
    assert f"--allow {tmp_path}" in capsys.readouterr().err
    assert main(["replay", str(folder), "--allow", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert "own.obj" in error
    assert "--allow" not in error
