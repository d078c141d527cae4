"""The status of the tracker, on short random motions of each kind and with each fault."""

import pandas as pd
import pytest

from drake_pregrasp.cli import main
from drake_pregrasp.studies import tracking
from drake_pregrasp.studies.tracking import FAULTS, MOTIONS, NO_FAULT, RATES, TrackingJob

KINDS = [(motion, NO_FAULT) for motion in MOTIONS] + [(None, fault) for fault in list(FAULTS)[1:]]


def rows_of(motion, fault, seeds):
    """Rows of each motion, or of all motions in turn, at all rates in turn."""
    jobs = [
        TrackingJob(motion or list(MOTIONS)[seed % len(MOTIONS)], fault, RATES[seed % 3], seed)
        for seed in seeds
    ]
    return pd.DataFrame([tracking.track_motion(job) for job in jobs])


@pytest.mark.slow
@pytest.mark.parametrize(("motion", "fault"), KINDS)
def test_errors_are_within_the_covariance_while_the_object_is_tracked(motion, fault):
    """99 % of the coordinates are within 3 standard deviations, and no error is 10 mm beyond."""
    rows = rows_of(motion, fault, range(24))
    assert rows.violations.sum() == 0
    # The first measurements do not tell how large the noise is.
    assert rows.beyond.mean() < (0.05 if "noise" in fault else 0.01)
    if fault == NO_FAULT:
        assert rows.locked.max() <= 5
        assert rows.tracking.min() > (0.94 if motion.startswith("constant") else 0.8)
        assert rows.settled.max() < (0.0022 if motion.startswith("constant") else 0.0032)
        assert rows.nees_position.mean() < 5
    if "180" in fault:
        assert rows.locked.max() <= 5
        assert rows.settled.max() < 0.0032


def test_the_report_counts_what_contradicts_the_status(monkeypatch):
    job = TrackingJob(next(iter(MOTIONS)), NO_FAULT, 20, 0)
    errors = tracking._errors
    sure = lambda offset, theta, P: errors(offset + 0.02, theta, P)  # noqa: E731
    assert tracking.track_motion(job)["violations"] == 0
    monkeypatch.setattr(tracking, "_errors", sure)
    row = tracking.track_motion(job)
    assert row["violations"] == round(row["tracking"] * 60)
    assert row["beyond"] == 1


@pytest.mark.slow
def test_the_command_writes_rows_and_a_report(tmp_path, capsys):
    flags = ["--count", "40", "--first_seed", "7", "--processes", "1"]
    assert main(["tracking", "--out", str(tmp_path), *flags]) == 0
    rows = pd.read_csv(tmp_path / "rows.csv")
    assert sorted(rows["seed"]) == list(range(7, 47))
    assert (rows["fault"] == NO_FAULT).mean() >= 0.5
    text = (tmp_path / "tracking.md").read_text(encoding="utf-8")
    assert "40 random motions" in text
    assert all(f"| {motion} " in text for motion in MOTIONS)
    assert capsys.readouterr().out.startswith("40 of 40 runs are complete\n")
