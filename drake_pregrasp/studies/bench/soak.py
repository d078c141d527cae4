"""Whether a day leaves anything behind: memory and quality of the base case, hour by hour.

Run it as `python -m drake_pregrasp.studies.bench.soak`; 24 simulated hours take one.
"""

import argparse
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator

from drake_pregrasp.contacts.selection_input import is_active
from drake_pregrasp.simulation.scenario_file import load_scenario
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.studies.bench.memory import resident_bytes
from drake_pregrasp.systems.grasp_quality_monitor import GraspQualityView
from drake_pregrasp.systems.loggers import TickRecord

HOUR = 3600.0
"""Seconds."""


class SoakHour(NamedTuple):
    """What an hour was like: means over its ticks.

    Attributes:
        ticks: How many.
        q_msv: Smallest singular value.
        q_gii: Grasp isotropy index.
        q_vew: Volume of the ellipsoid.
        position_error: Of the estimate, in metres.
        active: Share of contacts that were.
        resident: Bytes in memory at its end.
    """

    ticks: int
    q_msv: float
    q_gii: float
    q_vew: float
    position_error: float
    active: float
    resident: int


class _Tally:
    """Sums over ticks; it keeps no record."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        self._count, self._sum = 0, np.zeros(5)

    def add(self, record: TickRecord) -> None:
        quality = GraspQualityView(record.grasp_quality)
        offset = record.X_WO_estimated.translation() - record.X_WO.translation()
        self._count += 1
        self._sum += [
            quality.q_msv,
            quality.q_gii,
            quality.q_vew,
            np.linalg.norm(offset),
            np.mean(is_active(record.contact_status)),
        ]

    def hour(self) -> SoakHour:
        msv, gii, vew, error, active = (self._sum / self._count).tolist()
        return SoakHour(self._count, msv, gii, vew, error, active, resident_bytes())


def soak(
    hours: int,
    *,
    scenario: str = "a_base",
    seconds: float = HOUR,
    on_hour: Callable[[int, SoakHour], None] = lambda index, hour: None,
) -> list[SoakHour]:
    """Simulates a shipped scenario without recording, and returns what each hour was like.

    Args:
        hours: How many.
        scenario: Its name.
        seconds: Length of an hour.
        on_hour: Called after each, with its index.
    """
    config = load_scenario(scenario)
    tally = _Tally()
    diagram = make_diagram(config, config.make_surface(), sink=tally.add)
    simulator = Simulator(diagram)
    ApplySimulatorConfig(config.simulator_config, simulator)
    simulator.Initialize()
    found = []
    for index in range(hours):
        tally.clear()
        simulator.AdvanceTo((index + 1) * seconds)
        found.append(tally.hour())
        on_hour(index, found[-1])
    return found


def drift(values: list[float]) -> tuple[float, float]:
    """Returns the slope of a straight line through the hours but the first, and its error.

    The first hour holds the static phase.

    Args:
        values: One an hour, three at least.
    """
    later = np.array(values[1:])
    index = np.arange(len(later))
    slope, offset = np.polyfit(index, later, 1)
    residual = later - (slope * index + offset)
    spread = np.sqrt(np.sum(residual**2) / max(1, len(later) - 2))
    return float(slope), float(spread / np.linalg.norm(index - np.mean(index)))


def main() -> None:
    """Prints the hours, and what drifts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=int, default=24)
    options = parser.parse_args()
    print("hour     ticks     Q_MSV     Q_GII       Q_VEW  error [mm]  active  memory [MiB]")

    def show(index: int, hour: SoakHour) -> None:
        print(
            f"{index + 1:4} {hour.ticks:9} {hour.q_msv:9.6f} {hour.q_gii:9.6f} {hour.q_vew:11.6f}"
            f" {1e3 * hour.position_error:11.6f} {hour.active:7.4f} {hour.resident / 2**20:13.3f}",
            flush=True,
        )

    hours = soak(options.hours, on_hour=show)
    for name in ("q_msv", "q_gii", "q_vew", "position_error", "resident"):
        slope, error = drift([getattr(hour, name) for hour in hours])
        print(f"{name}: {slope:+.3g} an hour, standard error {error:.2g}")


if __name__ == "__main__":
    main()
