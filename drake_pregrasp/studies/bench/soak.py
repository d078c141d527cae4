"""Memory and quality of the base case over long simulations, hour by hour.

`python -m drake_pregrasp.studies.bench.soak` simulates 24 hours. With
`--planning_period 0.001 --seconds 10 --hours 100` it measures the memory over a million ticks.
"""

import argparse
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.stats import linregress

from drake_pregrasp.contacts.selection_input import is_active
from drake_pregrasp.simulation.scenario_file import load_scenario
from drake_pregrasp.simulation.simulation_diagram import make_diagram, make_simulator
from drake_pregrasp.systems.grasp_quality_monitor import GraspQualityView
from drake_pregrasp.systems.loggers import TickRecord

_STATM = Path("/proc/self/statm")

Hour = dict[str, float]


def soak(
    hours: int,
    *,
    seconds: float = 3600.0,
    period: float | None = None,
    on_hour: Callable[[Hour], None] = lambda hour: None,
) -> list[Hour]:
    """Simulates the base case for hours without a recording.

    Args:
        hours: Number of hours.
        seconds: Simulated time of one hour, in seconds.
        period: Planning period in seconds; the scenario's period if None.
        on_hour: Called at the end of each hour with its values.

    Returns:
        A mapping for each hour: the number of ticks; the means over ticks of the three measures,
        of the position error in metres, and of the share of active contacts; and the resident
        memory of the process at the end of the hour, in bytes.
    """
    config = load_scenario("a_base")
    config.planner.period = period or config.planner.period
    total = np.zeros(6)

    def add(record: TickRecord) -> None:
        quality = GraspQualityView(record.grasp_quality)
        error = record.X_WO_estimated.translation() - record.X_WO.translation()
        active = np.mean(is_active(record.contact_status))
        measures = (quality.q_msv, quality.q_gii, quality.q_vew)
        total[:] += np.array([1, *measures, np.linalg.norm(error), active])

    simulator = make_simulator(make_diagram(config, sink=add), config)
    simulator.Initialize()  # The tick at time zero is of no hour.
    found = []
    for index in range(hours):
        total[:] = 0
        simulator.AdvanceTo((index + 1) * seconds)
        names = ("q_msv", "q_gii", "q_vew", "position_error", "active")
        means = dict(zip(names, (total[1:] / total[0]).tolist(), strict=True))
        found.append({"ticks": total[0], **means, "resident": float(resident_bytes())})
        on_hour(found[-1])
    return found


def resident_bytes() -> int:
    """Returns the resident memory of this process in bytes; 0 without Linux's `/proc`."""
    if not _STATM.exists():
        return 0
    return int(_STATM.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def drift(hours: list[Hour], name: str) -> tuple[float, float]:
    """Returns the slope of a quantity per hour, and the slope's standard error.

    The first quarter of the hours is left out: it has the static phase, and caches fill.

    Args:
        hours: Values of each hour, as `soak` returns them; four hours or more.
        name: Name of the quantity in `hours`.
    """
    values = [hour[name] for hour in hours[max(1, len(hours) // 4) :]]
    line = linregress(np.arange(len(values)), values)
    return float(line.slope), float(line.stderr)


def main() -> None:
    """Prints the values of each hour, and the drift of each quantity."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=int, default=24)
    parser.add_argument("--seconds", type=float, default=3600.0, help="seconds of an hour")
    parser.add_argument("--planning_period", type=float, help="planning period in seconds")
    options = parser.parse_args()

    def show(hour: Hour) -> None:
        print("  ".join(f"{name} {value:.9g}" for name, value in hour.items()), flush=True)

    hours = soak(
        options.hours, seconds=options.seconds, period=options.planning_period, on_hour=show
    )
    for name in hours[0]:
        slope, error = drift(hours, name)
        print(f"{name}: {slope:+.3g} an hour, standard error {error:.2g}")


if __name__ == "__main__":
    main()
