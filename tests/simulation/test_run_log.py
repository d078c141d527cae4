"""The log of a run is read back as it was written, or says why it cannot be."""

from contextlib import suppress

import numpy as np
import pytest

from drake_pregrasp import load_scenario, resolve
from drake_pregrasp.errors import OutputError
from drake_pregrasp.simulation.run import LoggedRun
from drake_pregrasp.simulation.run_log import CsvLog, RunLog

ACTUAL = ("x_wo", "y_wo", "z_wo")
ESTIMATED = ("x_wo_estimated", "y_wo_estimated", "z_wo_estimated")


def test_columns_are_read_back_to_the_last_digit(tmp_path):
    ticks, scenario = [], load_scenario("a_base", text="{simulation_duration: 0.2}")
    logged = LoggedRun(resolve(scenario), tmp_path, on_tick=ticks.append)
    logged.simulate()
    time, c1_y, x_wo = logged.log.read("time", "c1_y", "x_wo")
    assert time.tolist() == [tick.time for tick in ticks]
    assert c1_y.tolist() == [tick.p_WC[1, 1] for tick in ticks]
    assert x_wo.tolist() == [tick.X_WO.translation()[0] for tick in ticks]
    for spoil in ((tmp_path / "log.csv").unlink, (tmp_path / "log.csv").mkdir):
        spoil()
        with pytest.raises(OutputError, match=r"log\.csv: cannot be read back: .*"):
            logged.log.read("time")


def test_measures_are_those_of_contacts_that_are_active_at_both_ticks(tmp_path):
    text = """
        planner: {static_duration: 0.3}
        simulation_duration: 1.0
        damage: [{at: 0.4, contacts: [1], until: 0.7}]
    """
    scenario = load_scenario("returning_finger", text=text)
    logged = LoggedRun(resolve(scenario), tmp_path)
    logged.simulate()
    n, read = resolve(scenario).num_contacts, logged.log.read
    points = np.array([read(*(f"c{i}_{axis}" for axis in "xyz")) for i in range(n)])
    active = np.array(read(*(f"c{i}_active" for i in range(n)))) > 0
    steps = np.linalg.norm(np.diff(points), axis=1)
    counts = active[:, 1:] & active[:, :-1]
    assert np.any(steps[~counts] > 1e-4), "no contact moves while it is lost or returns"
    time, displacement, energy = read("time", "displacement", "energy")
    np.testing.assert_allclose(displacement[1:], np.sum(steps * counts, axis=0))
    squares = np.sum((steps * counts) ** 2, axis=0)
    np.testing.assert_allclose(energy[1:], squares / (2 * np.diff(time) ** 2))
    assert displacement[0] == energy[0] == 0
    error, *poses = read("position_error", *ACTUAL, *ESTIMATED)
    actual, estimated = np.array(poses).reshape(2, 3, -1)
    np.testing.assert_allclose(error, np.linalg.norm(estimated - actual, axis=0))


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
