"""Summary of the tracking, in shares of ticks."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_pregrasp.estimation.pose_track import TrackingStatus
from drake_pregrasp.simulation.summary import tracking_summary


@given(st.lists(st.sampled_from(TrackingStatus), min_size=1), st.randoms(use_true_random=False))
def test_shares_are_those_of_the_ticks_in_any_order(statuses, rng):
    ages = np.array([rng.uniform(0, 9) for _ in statuses])
    summary = tracking_summary(np.array(statuses, dtype=float), ages)
    for kind in TrackingStatus:
        share = summary["share"][kind.name.lower()]
        assert share == pytest.approx(statuses.count(kind) / len(statuses))
    assert sum(summary["share"].values()) == pytest.approx(1)
    assert summary["longest_without_measurement"] == max(ages)


def test_without_ticks_there_is_no_share():
    summary = tracking_summary(np.empty(0), np.empty(0))
    assert set(summary["share"].values()) == {None}
    assert summary["longest_without_measurement"] is None
