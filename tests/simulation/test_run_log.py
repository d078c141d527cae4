from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.math import RigidTransform

from drake_pregrasp.errors import OutputError
from drake_pregrasp.quality.grasp_quality import GraspQuality
from drake_pregrasp.simulation.run_log import RunLog
from drake_pregrasp.systems.loggers import TickRecord

CONTACTS = 2


def record(time, rng):
    return TickRecord(
        time,
        rng.normal(size=(CONTACTS, 3)),
        np.zeros(CONTACTS),
        -np.ones(CONTACTS),
        rng.normal(size=len(GraspQuality.names())),
        SimpleNamespace(sizes=lambda: np.array([3, 4])),
        RigidTransform(rng.normal(size=3)),
        RigidTransform(rng.normal(size=3)),
        1e-3,
    )


@pytest.fixture
def records():
    rng = np.random.default_rng(0)
    return [record(0.1 * k, rng) for k in range(5)]


@pytest.fixture
def log(tmp_path, records):
    with RunLog(tmp_path / "log.csv", CONTACTS) as log:
        for each in records:
            log.append(each)
    return log


def test_columns_are_read_back_to_the_last_digit(log, records):
    time, c1_y, x_wo = log.read("time", "c1_y", "x_wo")
    assert time.tolist() == [each.time for each in records]
    assert c1_y.tolist() == [each.p_WC[1, 1] for each in records]
    assert x_wo.tolist() == [each.X_WO.translation()[0] for each in records]


def test_a_log_that_cannot_be_read_is_not_called_unwritable(tmp_path, log):
    (tmp_path / "log.csv").unlink()
    with pytest.raises(OutputError, match=r"log\.csv: can't be read back: .*"):
        log.read("time")
    (tmp_path / "log.csv").mkdir()
    with pytest.raises(OutputError, match=r"log\.csv: can't be read back: .*"):
        log.read("time")


def test_no_ticks_are_read_from_no_file(tmp_path):
    with RunLog(tmp_path / "log.csv", CONTACTS) as log:
        pass
    (tmp_path / "log.csv").unlink()
    assert [column.shape for column in log.read("time", "c0_x")] == [(0,), (0,)]


def test_a_log_that_cannot_be_written_says_so(tmp_path):
    with pytest.raises(OutputError, match=r"log\.csv: can't be written: .*"):
        RunLog(tmp_path / "missing" / "log.csv", CONTACTS).__enter__()
