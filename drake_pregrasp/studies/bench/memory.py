"""Whether planning ticks leave anything behind: the process's memory over many of them.

Run it as `python -m drake_pregrasp.studies.bench.memory`; a million ticks take a quarter of an
hour.
"""

import argparse
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource

from drake_pregrasp.config.planner_config import PlannerConfig
from drake_pregrasp.diagrams.pregrasp_planner import AddPregraspPlanner
from drake_pregrasp.geometry.box_surface import box_surface
from drake_pregrasp.kernels import numba_is_installed
from drake_pregrasp.quality.grasp_quality import GraspQuality
from drake_pregrasp.systems.grasp_quality_monitor import GraspQualityMonitor
from drake_pregrasp.systems.loggers import TickLogger, TickRecord
from drake_pregrasp.systems.pose_sensor import NoiseSource, NoisyPoseSensor

SAMPLES = 100
"""Readings of the memory in use, in equal distances."""

WARM_UP = 10_000
"""Ticks that don't count, of more than that: caches and pools fill first."""

_PERIOD = 0.001
_SPACING = 0.01  # 400 candidates on the cube: ticks count here, not points.
_STRATEGY = "gii"
_STATM = Path("/proc/self/statm")


class MemoryJob(NamedTuple):
    """How many planning ticks to make."""

    ticks: int


class MemoryUse(NamedTuple):
    """Memory in use over planning ticks.

    Attributes:
        implementation: Of the kernel.
        ticks: Ticks made by each reading.
        resident: Bytes in memory then.
        slope: Bytes a tick of the straight line through the readings after the warm-up.
    """

    implementation: str
    ticks: list[int]
    resident: list[int]
    slope: float


def measure_memory(
    job: MemoryJob, on_sample: Callable[[int], None] = lambda ticks: None
) -> MemoryUse:
    """Plans many ticks through the ports of one diagram and reads the memory in use on the way.

    Args:
        job: How many.
        on_sample: Called with the number of ticks made, after each reading.
    """
    simulator = Simulator(_diagram())
    simulator.Initialize()
    ticks = np.linspace(0, job.ticks, SAMPLES + 1).astype(int)[1:].tolist()
    resident = []
    for count in ticks:
        simulator.AdvanceTo(count * _PERIOD)
        resident.append(resident_bytes())
        on_sample(count)
    implementation = "numba" if numba_is_installed() else "numpy"
    return MemoryUse(implementation, ticks, resident, slope(ticks, resident))


def slope(ticks: Sequence[int], resident: Sequence[int]) -> float:
    """Returns the slope of the straight line through the readings after the warm-up.

    Args:
        ticks: Of each reading, rising.
        resident: Bytes in memory then.
    """
    first = first_settled(ticks)
    return float(np.polyfit(ticks[first:], resident[first:], 1)[0])


def first_settled(ticks: Sequence[int]) -> int:
    """Returns the index of the first reading that counts; of fewer ticks than that, the first."""
    return int(np.searchsorted(ticks, WARM_UP)) if ticks[-1] > 2 * WARM_UP else 0


def resident_bytes() -> int:
    """Returns the memory that this process has, in bytes; 0 where Linux's `/proc` isn't there."""
    if not _STATM.exists():
        return 0
    return int(_STATM.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def _diagram() -> Diagram:
    """Returns estimator, partitioner, selector, monitor and logger behind a noisy measurement."""
    surface = box_surface([0.1] * 3, spacing=_SPACING)
    p_OC = surface.p_OQ[:: len(surface.p_OQ) // 5][:5]
    builder = DiagramBuilder()
    pose = builder.AddSystem(ConstantValueSource(AbstractValue.Make(RigidTransform())))
    noise = builder.AddSystem(NoiseSource(size=NoisyPoseSensor.NOISE_SIZE, period=_PERIOD))
    sensor = builder.AddSystem(NoisyPoseSensor())
    config = PlannerConfig(period=_PERIOD, static_duration=0.0, strategy=_STRATEGY)
    planner = AddPregraspPlanner(builder, config, surface, p_OC)
    monitor = builder.AddSystem(GraspQualityMonitor(surface=surface, num_contacts=len(p_OC)))
    logger = builder.AddSystem(
        TickLogger(
            num_contacts=len(p_OC),
            quality_size=len(GraspQuality.names()),
            period=_PERIOD,
            sink=_forget,
        )
    )
    for source, output, target, name in (
        (pose, "y0", sensor, "X_WO"),
        (noise, "noise", sensor, "noise"),
        (sensor, "X_WO_measured", planner, "X_WO_measured"),
        (pose, "y0", monitor, "X_WO"),
        (planner, "p_WC", monitor, "p_WC"),
        (planner, "contact_status", monitor, "contact_status"),
        (pose, "y0", logger, "X_WO"),
        (monitor, "grasp_quality", logger, "grasp_quality"),
        *(
            (planner, port, logger, port)
            for port in (
                "p_WC",
                "contact_status",
                "contact_causes",
                "safe_regions",
                "X_WO_estimated",
            )
        ),
    ):
        builder.Connect(source.GetOutputPort(output), target.GetInputPort(name))
    return builder.Build()


def _forget(record: TickRecord) -> None:
    """Keeps nothing: what logs hold is theirs, not the planner's."""


def main() -> None:
    """Prints the readings and their slope."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ticks", type=int, default=1_000_000)
    options = parser.parse_args()

    def show(ticks: int) -> None:
        print(f"{ticks:>9,} ticks  {resident_bytes() / 2**20:8.2f} MiB", flush=True)

    use = measure_memory(MemoryJob(options.ticks), show)
    print(f"{use.implementation}: {use.slope:+.3f} bytes a tick after the warm-up")


if __name__ == "__main__":
    main()
