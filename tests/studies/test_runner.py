"""Rows of a study are the same whoever makes them, and survive whatever ends it."""

import os
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import pytest

from drake_pregrasp.studies.runner import JOURNAL, ROWS, SETTINGS, run_jobs

JOBS = [{"name": name, "seed": seed} for seed in range(4) for name in ("b", "a")]


def row(job):
    if os.environ.get("FAIL") == f"{job['name']}{job['seed']}":
        raise ZeroDivisionError("no <b>luck")
    return {"third": job["seed"] / 3, "nothing": float("nan"), "process": "one"}


def two_rows(job):
    return [{"time": time, "value": time * job["seed"]} for time in (1.0, 2.0)]


def process_of(job):
    return {"process": os.getpid()}


@dataclass(frozen=True)
class Deadly:
    """Ends its process the first few times that it gets one of the jobs."""

    folder: Path
    seed: int
    times: int

    def __call__(self, job):
        if job["seed"] == self.seed and job["name"] == "a":
            before = len(list(self.folder.iterdir()))
            (self.folder / str(before)).touch()
            if before < self.times:
                os._exit(9)
        return row(job)


def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture
def whole(tmp_path):
    run_jobs(row, JOBS, folder=tmp_path / "whole", settings={"a": 1}, processes=1)
    return files(tmp_path / "whole")


def test_a_file_cut_anywhere_is_completed_to_the_same_bytes(whole, tmp_path):
    assert set(whole) == {ROWS, JOURNAL, SETTINGS}
    assert pd.read_csv(tmp_path / "whole" / ROWS)["name"].tolist() == ["a"] * 4 + ["b"] * 4
    journal = whole[JOURNAL]
    for end in (0, 1, len(journal) // 2, journal.rindex(b"{", 0, -60), len(journal) - 1):
        (tmp_path / "whole" / JOURNAL).write_bytes(journal[:end])
        steps = []
        found = run_jobs(
            row,
            list(reversed(JOBS)),
            folder=tmp_path / "whole",
            settings={"a": 1},
            processes=2,
            on_progress=lambda *step, to=steps: to.append(step),
        )
        assert files(tmp_path / "whole") == whole
        missing = 8 - journal[:end].count(b"\n")
        assert steps == [(done, missing) for done in range(missing + 1)]
        assert (found.wanted, found.made, len(found.failed)) == (8, 8, 0)
