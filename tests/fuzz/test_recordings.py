"""A few hundred broken recordings; `tests.fuzz.recordings` reads as many as asked."""

import pytest

pytest.importorskip("mcap")
pytest.importorskip("rosbags")
from recordings import results
from scenario_files import GOOD


@pytest.mark.slow
def test_recordings_are_read_or_refused_in_one_line():
    found = list(results(0, 0, 400))
    assert [result.failure for result in found if result.failure] == []
    assert {(result.kind, result.outcome) for result in found} == {
        (kind, outcome) for kind in ("csv", "mcap", "db3") for outcome in GOOD
    }
