"""One run of a scenario with faults, and what came of it."""

import math
from typing import NamedTuple

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator

from drake_pregrasp.contacts.selection_input import is_active
from drake_pregrasp.estimation.pose_track import TrackingStatus
from drake_pregrasp.geometry.surface import CONTACT_TOLERANCE, ObjectSurface
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import load_scenario
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.systems.loggers import TickRecord

RECOVERED = 4.0
"""Standard deviations of the sensor within which an estimate has recovered."""


class FaultJob(NamedTuple):
    """A run to make: a shipped scenario, and a seed."""

    scenario: str
    seed: int


class FaultRun(NamedTuple):
    """What came of a run.

    Attributes:
        valid: Share of all ticks at which each active contact was on the allowed surface of the
            estimated object, all outputs were finite, and at least one contact was active.
        position_error: Largest error of the estimated position while faults acted, in metres.
        orientation_error: Largest error of its orientation then, in radians.
        recovery: From the end of the faults until the errors stayed within `RECOVERED` standard
            deviations of the sensor, in seconds; inf if they never did.
        tracked: Share of the ticks, while faults acted, at which the object was tracked.
        lost: Share of them at which it was lost.
    """

    valid: float
    position_error: float
    orientation_error: float
    recovery: float
    tracked: float
    lost: float


def run_faults(job: FaultJob, text: str | None = None) -> FaultRun:
    """Makes a run.

    Args:
        job: Which.
        text: YAML that overrides single keys of the scenario.
    """
    scenario = load_scenario(job.scenario, text=text)
    scenario.random_seed = job.seed
    surface = scenario.make_surface()
    records: list[TickRecord] = []
    simulator = Simulator(make_diagram(scenario, surface, sink=records.append))
    ApplySimulatorConfig(scenario.simulator_config, simulator)
    simulator.Initialize()
    simulator.AdvanceTo(scenario.simulation_duration)
    return summarize_faults(scenario, surface, records)


def summarize_faults(
    scenario: Scenario, surface: ObjectSurface, records: list[TickRecord]
) -> FaultRun:
    """Returns what came of a run, from the records of its ticks."""
    faults, sensor = scenario.sensor.faults, scenario.sensor
    time = np.array([record.time for record in records])
    slack = scenario.planner.period / 2  # Times of ticks are rounded.
    acting = (time > faults.start - slack) & (time < faults.end - slack)
    after = np.flatnonzero(time > faults.end - slack)
    position, orientation = np.array([_errors(record) for record in records]).T
    is_off = (position > RECOVERED * sensor.position_std) | (
        orientation > RECOVERED * sensor.orientation_std
    )
    off = after[is_off[after]]
    recovery = 0.0
    if len(off):
        is_over = off[-1] + 1 < len(time)
        recovery = float(time[off[-1] + 1] - faults.end) if is_over else math.inf
    status = np.array([record.tracking_status for record in records])[acting]
    return FaultRun(
        valid=float(np.mean([_is_valid(record, surface) for record in records])),
        position_error=float(np.max(position[acting])),
        orientation_error=float(np.max(orientation[acting])),
        recovery=recovery,
        tracked=float(np.mean(status == TrackingStatus.TRACKING)),
        lost=float(np.mean(status == TrackingStatus.LOST)),
    )


def _errors(record: TickRecord) -> tuple[float, float]:
    """Returns how far the estimate is off, in metres and radians."""
    offset = record.X_WO_estimated.translation() - record.X_WO.translation()
    turn = record.X_WO.rotation().InvertAndCompose(record.X_WO_estimated.rotation())
    return float(np.linalg.norm(offset)), abs(turn.ToAngleAxis().angle())


def _is_valid(record: TickRecord, surface: ObjectSurface) -> bool:
    active = is_active(record.contact_status)
    if not (np.all(np.isfinite(record.p_WC)) and np.any(active)):
        return False
    p_OC = (record.X_WO_estimated.inverse() @ record.p_WC[active].T).T
    nearest, _ = surface.project(p_OC)
    return bool(np.all(np.linalg.norm(nearest - p_OC, axis=1) <= CONTACT_TOLERANCE))
