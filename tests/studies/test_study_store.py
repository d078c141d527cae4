"""A study's outcomes survive whatever ends it, and the same study leaves the same bytes."""

import contextlib
import dataclasses
import functools
import math
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up_trials import at_once, dying_trial, failing_trial, made_up_trial

from drake_pregrasp import OutputError
from drake_pregrasp.studies.settings_file import digest
from drake_pregrasp.studies.static_versus_dynamic import outcome_csv, trials
from drake_pregrasp.studies.static_versus_dynamic.arms import ARMS
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.outcome import (
    MAX_PUSHED_MM,
    MAX_SLIP_MM,
    MAX_TURNED_DEG,
    Outcome,
    TrialJob,
)
from drake_pregrasp.studies.static_versus_dynamic.store import OUTCOMES, OutcomeStore
from drake_pregrasp.studies.static_versus_dynamic.study import trial_jobs
from drake_pregrasp.studies.static_versus_dynamic.trials import run_missing

TIMES = {key: condition.closing_times for key, condition in CONDITIONS.items()}
JOBS = trial_jobs(["nominal", "sphere"], ["frozen", "still", "dynamic_reach"], range(2))
SETTINGS = {"speed": 0.02, "wrist": {"range": 30}}


def run(folder, jobs=JOBS, trial=made_up_trial, settings=SETTINGS, *, processes=None, **options):
    """Runs what is missing, without processes if their number isn't given."""
    with OutcomeStore(folder, settings, TIMES) as store, pytest.MonkeyPatch.context() as patch:
        if processes is None:
            patch.setattr(trials, "as_they_end", at_once)
        failures = run_missing(store, folder, jobs, trial, processes=processes, **options)
    return failures, (folder / OUTCOMES).read_bytes()


def fill(folder, jobs=JOBS):
    """Fills a store without processes, in the order of the jobs."""
    with OutcomeStore(folder, SETTINGS, TIMES) as store:
        for job in jobs:
            store.append(job, made_up_trial(job))
        return (folder / OUTCOMES).read_text()


texts = st.text(st.characters(codec="utf-8", categories=("L", "N", "P", "S", "Zs")), max_size=20)
outcomes = st.builds(
    Outcome,
    **{
        field.name: {str: texts, bool: st.booleans(), int: st.integers(0, 99)}.get(
            field.type, st.floats()
        )
        for field in dataclasses.fields(Outcome)
    },
)


@given(st.lists(outcomes, max_size=3))
def test_rows_come_back_as_they_were(rows):
    text = outcome_csv.HEADER + outcome_csv.to_lines(rows)
    assert text.count("\n") == 1 + len(rows)
    for row, back in zip(rows, outcome_csv.from_text(text, Path("x")), strict=True):
        for name, value in dataclasses.asdict(row).items():
            if isinstance(value, str):
                assert getattr(back, name) == " ".join(value.split())
            else:
                np.testing.assert_equal(getattr(back, name), value)


def test_numbers_of_numpy_are_written_as_numbers():
    (row, *_) = made_up_trial(JOBS[0])
    of_numpy = dataclasses.replace(
        row, lifted=np.True_, slip_mm=np.float64(row.slip_mm), fingers=np.int64(row.fingers)
    )
    same = dataclasses.replace(row, lifted=True)
    assert outcome_csv.to_lines([of_numpy]) == outcome_csv.to_lines([same])


def test_the_order_of_the_trials_leaves_no_trace(tmp_path):
    shuffled = random.Random(1).sample(JOBS, len(JOBS))
    fill(tmp_path / "in_order")
    fill(tmp_path / "shuffled", shuffled)
    _, as_they_ended = run(tmp_path / "as_they_ended")
    for name in ("in_order", "shuffled"):
        assert (tmp_path / name / OUTCOMES).read_bytes() == as_they_ended
    keys = [row.key for row in outcome_csv.from_text(as_they_ended.decode(), tmp_path)]
    assert keys == sorted(keys)
    assert len(keys) == sum(len(TIMES[job.condition]) for job in JOBS)


def test_a_file_cut_anywhere_keeps_all_trials_but_the_last(tmp_path):
    text = fill(tmp_path, JOBS[:3])
    path = tmp_path / OUTCOMES
    ends = {k for k in range(len(text) + 1) if "\n" in text[max(0, k - 1) : k + 1]}
    for end in sorted({*range(1, len(text) + 1, 29), *ends}):
        path.write_text(text[:end])
        whole = [job for job in JOBS[:3] if outcome_csv.to_lines(made_up_trial(job)) in text[:end]]
        with OutcomeStore(tmp_path, SETTINGS, TIMES) as store:
            assert [job for job in JOBS[:3] if job in store] == whole
            assert store.outcomes == sorted(store.outcomes, key=lambda row: row.key)
        assert path.read_text().count("\n") == 1 + sum(len(TIMES[job.condition]) for job in whole)


@pytest.mark.parametrize("end", [0, 5, -1, -200])
def test_a_resumed_study_does_what_is_missing_and_ends_in_the_same_bytes(tmp_path, end):
    text = fill(tmp_path)
    whole = (tmp_path / OUTCOMES).read_bytes()
    (tmp_path / OUTCOMES).write_text(text[:end])
    steps = []
    _, resumed = run(tmp_path, on_progress=lambda *step: steps.append(step))
    assert resumed == whole
    missing = len(JOBS) if end in (0, 5) else 1
    assert steps == [(done, missing) for done in range(missing + 1)]


def test_rows_of_other_settings_are_not_mixed(tmp_path):
    _, before = run(tmp_path, JOBS[:1])
    other = {"speed": 0.03, "wrist": {"range": 40}, "new": 1}
    with pytest.raises(OutputError, match=r"other settings \(new, speed, wrist.range\); choose an"):
        run(tmp_path, settings=other)
    assert (tmp_path / OUTCOMES).read_bytes() == before
    reordered = dict(reversed(SETTINGS.items()))
    run(tmp_path, JOBS[:1], settings=reordered)
    assert digest(reordered) == digest(SETTINGS) != digest(other)


def test_two_studies_do_not_share_a_folder(tmp_path):
    with (
        OutcomeStore(tmp_path, SETTINGS, TIMES),
        pytest.raises(OutputError, match="another process works on this study"),
    ):
        OutcomeStore(tmp_path, SETTINGS, TIMES)
    with OutcomeStore(tmp_path, SETTINGS, TIMES) as store:
        assert store.outcomes == []


@pytest.mark.parametrize(
    ("file", "text", "problem"),
    [
        ("outcomes.csv", "a,b\n1,2\n", "outcomes.csv: its columns are not those of"),
        ("outcomes.csv", outcome_csv.HEADER + "nominal,still\n", "line 2 is no outcome: 'nominal"),
        ("study.json", "{", "study.json: can't be read as a study's settings"),
        ("failed.csv", "nonsense\n", "failed.csv: is no list of what has failed"),
    ],
)
def test_files_of_something_else_are_refused(tmp_path, file, text, problem):
    (tmp_path / file).write_text(text)
    with pytest.raises(OutputError, match=problem):
        run(tmp_path)
    assert (tmp_path / file).read_text() == text


def interrupt(done, total):
    raise KeyboardInterrupt


def test_trials_that_fail_do_not_stop_the_others_and_are_tried_again(tmp_path):
    failures, _ = run(tmp_path, trial=failing_trial, processes=2)
    known = (tmp_path / "failed.csv").read_bytes()
    assert {(job.arm, job.seed) for job in failures} == {
        ("frozen", 0),
        ("still", 0),
        ("dynamic_reach", 1),
    }
    message = "somewhere: key: doesn't fit,\\nnot at all"
    assert failures[TrialJob("nominal", "frozen", 0)] == message
    assert (
        "not one for each closing time: sphere, still, seed 0 at 4.8 s; sphere, still"
        in (failures[TrialJob("sphere", "still", 0)])
    )
    with OutcomeStore(tmp_path, SETTINGS, TIMES) as store:
        assert {job for job in JOBS if job not in store} == set(failures)
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, on_progress=interrupt)
    assert (tmp_path / "failed.csv").read_bytes() == known
    assert run(tmp_path, jobs=[])[0] == failures
    left, _ = run(tmp_path, [job for job in JOBS if job.arm == "frozen"])
    assert left == {job: why for job, why in failures.items() if job.arm != "frozen"}
    cured, after = run(tmp_path)
    assert cured == {}
    assert not (tmp_path / "failed.csv").exists()
    assert run(tmp_path / "sound")[1] == after


def test_a_process_that_dies_is_said_to_have(tmp_path):
    with pytest.raises(OutputError, match="its process ended without a word; the outcomes so far"):
        run(tmp_path, trial=dying_trial, processes=1)
    with OutcomeStore(tmp_path, SETTINGS, TIMES) as store:
        assert [job for job in JOBS if job in store] == [job for job in JOBS if job.seed == 0]


@contextlib.contextmanager
def start_slow_study(out):
    """Starts a study in a process of its own, and waits for its first outcomes."""
    command = [sys.executable, str(Path(__file__).with_name("made_up_trials.py")), "--seeds", "4"]
    command += ["--out", str(out), "--conditions", "nominal", "--processes", "1"]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    # Whoever runs the tests in the background may have had interrupts ignored.
    heed = functools.partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    with subprocess.Popen(command, env=environment, preexec_fn=heed, **pipes) as process:
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and not holds_a_row(study_rows(out)):
            time.sleep(0.02)
        try:
            yield process
        finally:
            process.kill()


def study_rows(out: Path) -> Path:
    return out / "static-versus-dynamic" / OUTCOMES


def test_an_interrupted_study_keeps_what_is_done_and_says_how_to_go_on(tmp_path):
    path = study_rows(tmp_path)
    with start_slow_study(tmp_path) as process:
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert output == ""
    assert f"interrupted: the trials so far are in {path}; the same command" in errors
    assert errors.count("\n") == 1
    jobs = trial_jobs(["nominal"], list(ARMS), range(4))
    with OutcomeStore(path.parent, {"closing_times": TIMES}, TIMES) as store:
        done = sum(job in store for job in jobs)
    assert 0 < done < len(jobs)


def holds_a_row(path: Path) -> bool:
    return path.exists() and path.read_bytes().count(b"\n") > 1


def test_each_bound_of_a_clean_grasp_counts():
    good = dataclasses.replace(
        next(row for seed in range(9) for row in made_up_trial(TrialJob("nominal", "still", seed))),
        lifted=True,
        level=True,
        pushed_before_mm=MAX_PUSHED_MM - 0.01,
        turned_before_deg=MAX_TURNED_DEG - 0.01,
        pushed_closing_mm=MAX_PUSHED_MM - 0.01,
        slip_mm=MAX_SLIP_MM - 0.01,
    )
    assert good.clean
    for name, value in {
        "lifted": False,
        "level": False,
        "pushed_before_mm": MAX_PUSHED_MM,
        "turned_before_deg": MAX_TURNED_DEG,
        "pushed_closing_mm": MAX_PUSHED_MM,
        "slip_mm": math.nan,
    }.items():
        assert not dataclasses.replace(good, **{name: value}).clean, name
    assert not dataclasses.replace(good, slip_mm=MAX_SLIP_MM).clean


def test_processes_end_with_a_study_that_is_killed(tmp_path):
    with start_slow_study(tmp_path) as process:
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
        if not children.exists():
            pytest.skip("children of a process are not listed here")
        workers = [Path("/proc") / child for child in children.read_text().split()]
        assert workers
        process.kill()
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline and any(is_running(worker) for worker in workers):
        time.sleep(0.02)
    assert not any(is_running(worker) for worker in workers)


def is_running(process: Path) -> bool:
    try:
        return " Z " not in (process / "stat").read_text()
    except OSError:
        return False
