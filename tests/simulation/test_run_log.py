"""The log of a run is read back as it was written, or says why it cannot be."""

from contextlib import suppress

import pytest

from drake_pregrasp import load_scenario
from drake_pregrasp.errors import OutputError
from drake_pregrasp.simulation.run import LoggedRun
from drake_pregrasp.simulation.run_log import CsvLog, RunLog


def test_columns_are_read_back_to_the_last_digit(tmp_path):
    ticks, scenario = [], load_scenario("a_base", text="{simulation_duration: 0.2}")
    logged = LoggedRun(scenario, tmp_path, on_tick=ticks.append)
    logged.simulate()
    time, c1_y, x_wo = logged.log.read("time", "c1_y", "x_wo")
    assert time.tolist() == [tick.time for tick in ticks]
    assert c1_y.tolist() == [tick.p_WC[1, 1] for tick in ticks]
    assert x_wo.tolist() == [tick.X_WO.translation()[0] for tick in ticks]
    for spoil in ((tmp_path / "log.csv").unlink, (tmp_path / "log.csv").mkdir):
        spoil()
        with pytest.raises(OutputError, match=r"log\.csv: cannot be read back: .*"):
            logged.log.read("time")


def test_no_ticks_are_read_from_no_file(tmp_path):
    with RunLog(tmp_path / "log.csv", 2) as log:
        pass
    (tmp_path / "log.csv").unlink()
    assert [column.shape for column in log.read("time", "c0_x")] == [(0,), (0,)]


def test_a_run_that_fails_keeps_its_rows(tmp_path):
    with suppress(InterruptedError), CsvLog(tmp_path / "log.csv", ["a", "b"]) as log:
        log.write(1 / 3, [float("nan")])
        raise InterruptedError
    assert (tmp_path / "log.csv").read_bytes() == b"a,b\n0.3333333333333333,nan\n"


def test_a_log_that_cannot_be_written_says_so(tmp_path):
    with pytest.raises(OutputError, match=r"log\.csv: cannot be written: .*"):
        RunLog(tmp_path / "missing" / "log.csv", 2).__enter__()
