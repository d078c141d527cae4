"""`summary.json`: what a run comes to."""

import importlib.metadata
import platform
from typing import Any

import numpy as np

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.contact_status import ContactStatus, describe_status, is_active
from drake_pregrasp.planning.kernels import numba_is_installed
from drake_pregrasp.planning.surface import ObjectSurface
from drake_pregrasp.simulation.force_closure_summary import force_closure_summary
from drake_pregrasp.simulation.phases import (
    adapting_phase,
    last_phase,
    remaining_static_quality,
    static_phase,
)
from drake_pregrasp.simulation.run_log import RunLog
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.tracking_summary import tracking_summary
from drake_pregrasp.version import __version__

MEASURES = ("q_msv", "q_gii", "q_vew")
"""The measures of Table II, by their columns in `log.csv`."""


def summarize(
    name: str,
    scenario: Scenario,
    surface: ObjectSurface,
    log: RunLog,
    *,
    wall_seconds: float,
    completed: bool,
) -> dict[str, Any]:
    """Returns the content of `summary.json`.

    `static` holds means over the phase in which the initial contacts are held, `max` and `mean` are
    over the phase in which they adapt, and `final` is the last tick; null where there is no tick.
    `inactive_contacts` says which have no place at the last tick, and why. `tracking` is of all
    ticks, and `deadline_overruns` are those that took longer to compute than the planning period.
    With damage, `max` and `mean` end before the first loss, and `after_damage` follows the last.
    """
    time, *values = log.read("time", *MEASURES)
    measured = dict(zip(MEASURES, values, strict=True))
    static, adapting = static_phase(scenario, time), adapting_phase(scenario, time)
    return {
        "scenario": name,
        "seed": scenario.random_seed,
        "completed": completed,
        "versions": _versions(),
        "static": _measures(measured, static, np.mean),
        "max": _measures(measured, adapting, np.max),
        "mean": _measures(measured, adapting, np.mean),
        "final": _measures(measured, slice(-1, None), np.mean),
        "contact_model": scenario.measures.contact_model,
        **force_closure_summary(scenario, surface, static=log.last_static, final=log.last),
        **_after_damage(scenario, surface, measured, time),
        "inactive_contacts": inactive_contacts(scenario, log),
        "tracking": tracking_summary(*log.read("tracking_status", "time_since_measurement")),
        "ticks": log.num_ticks,
        "simulated_seconds": float(time[-1]) if len(time) else 0.0,
        "tick_time_p50_ms": log.tick_times.percentile_ms(50),
        "tick_time_p99_ms": log.tick_times.percentile_ms(99),
        "deadline_overruns": log.tick_times.overruns,
        "real_time_factor": float(time[-1]) / wall_seconds if len(time) else 0.0,
    }


def inactive_contacts(scenario: Scenario, log: RunLog) -> dict[str, str]:
    """Returns the contacts that are there at the last tick, but have nowhere to be, and why."""
    record = log.last
    if record is None:
        return {}
    without = ~is_active(record.contact_status) & (record.contact_status != ContactStatus.LOST)
    return {
        str(contact): describe_status(
            record.contact_status[contact],
            record.contact_causes[contact],
            scenario.obstacle_names,
        )
        for contact in np.flatnonzero(without).tolist()
    }


def _after_damage(
    scenario: Scenario,
    surface: ObjectSurface,
    measured: dict[str, FloatArray],
    time: FloatArray,
) -> dict[str, dict[str, dict[str, float | None]]]:
    """Returns the measures after the last loss: of the static contacts left, and the best."""
    if not scenario.damage:
        return {}
    static = remaining_static_quality(scenario, surface)
    return {
        "after_damage": {
            "static": {name: getattr(static, name) for name in MEASURES},
            "max": _measures(measured, last_phase(scenario, time), np.max),
        }
    }


def _measures(
    measured: dict[str, FloatArray], ticks: slice, reduce: Any
) -> dict[str, float | None]:
    chosen = {name: values[ticks] for name, values in measured.items()}
    return {name: float(reduce(v)) if len(v) else None for name, v in chosen.items()}


def _versions() -> dict[str, str]:
    # Kernels differ in last digits, so that a log is the same with the same kernel only.
    packages = ("drake", "numpy", "scipy", "trimesh", *(["numba"] if numba_is_installed() else []))
    return {
        "drake_pregrasp": __version__,
        "python": platform.python_version(),
        **{package: importlib.metadata.version(package) for package in packages},
    }
