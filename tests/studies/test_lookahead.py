"""The study of look-ahead."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from drake_pregrasp.studies.lookahead import (
    CASES,
    PERIOD,
    LookaheadRun,
    lookahead_scenario,
    run_lookahead,
)
from pydrake.math import RigidTransform, RotationMatrix

from drake_pregrasp.contacts.selection_input import ContactStatus
from drake_pregrasp.studies import lookahead


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_look_ahead_leaves_at_most_a_third_of_the_error(case):
    delay, start = 8, 8
    without, ahead = (run_lookahead(lookahead_scenario(case, t, 3)) for t in (0.0, delay * PERIOD))
    errors = [run.goal_errors(delay, start) for run in (without, ahead)]
    assert np.median(errors[1]) < lookahead.WANTED_SHARE * np.median(errors[0])
    squares = ahead.normalised_errors(delay, start)
    assert 0.1 < np.mean(squares) / 3 < 2
    assert np.mean(squares < 7.815) > 0.85


def test_errors_are_those_of_the_same_point_of_the_object_later():
    """The object moves by 1 m along x and turns by a right angle a tick."""
    turn = RotationMatrix.MakeZRotation(np.pi / 2)
    X_WO = [RigidTransform([k, 0, 0]) for k in range(4)]
    for k in range(1, 4):
        X_WO[k].set_rotation(turn @ X_WO[k - 1].rotation())
    ticks = [
        SimpleNamespace(
            p_WC=np.array([X @ [0.1, 0, 0]]),
            contact_status=np.array([float(ContactStatus.ACTIVE)]),
            X_WO=X,
            X_WO_estimated=X,
        )
        for X in X_WO
    ]
    run = LookaheadRun(ticks, np.tile(np.diag([4.0, 1, 1]), (4, 1, 1)))
    np.testing.assert_allclose(run.goal_errors(0, 0), 0, atol=1e-15)
    late = run.goal_errors(1, 0)
    np.testing.assert_allclose(late[0], np.hypot(0.9, 0.1))  # (1, 0.1) instead of (0.1, 0).
    assert len(late) == 3
    np.testing.assert_allclose(run.normalised_errors(1, 1), [1 / 4, 1 / 4])
    ticks[1].contact_status[:] = ContactStatus.LOST
    assert len(run.goal_errors(1, 0)) == 2


@pytest.mark.slow
def test_the_report_says_what_the_rows_say(tmp_path):
    steps = []
    report = lookahead.study_lookahead(
        tmp_path / "study",
        seeds=(0,),
        cases=("toss",),
        delays=(0, 4),
        on_progress=lambda *step: steps.append(step),
    )
    text = report.read_text(encoding="utf-8")
    rows = pd.read_csv(report.parent / "rows.csv")
    np.testing.assert_allclose(rows["lookahead"], [0, 0, 0.0375, 0.05, 0.0625])
    np.testing.assert_allclose(rows["delay"], [0, 0.05, 0.05, 0.05, 0.05])
    (shares,) = lookahead.remaining_shares(rows).to_numpy()
    median, p95 = (f"{100 * share:.1f} %" for share in shares)
    lines = [" ".join(line.split()) for line in text.splitlines()]
    assert f"| toss | 50 | {median} | {p95} | yes |" in lines
    assert max(shares) < lookahead.WANTED_SHARE
    assert "![Goal error" in text
    assert (report.parent / "lookahead.png").stat().st_size > 10_000
    assert steps[-1] == (4, 4)
