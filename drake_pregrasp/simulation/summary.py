"""`summary.json`: what a run comes to."""

import importlib.metadata
import platform
from typing import Any

import numpy as np

from drake_pregrasp.planning.contact_status import ContactStatus, describe_status, is_active
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
    `inactive_contacts` says which have no place at the last tick, and why.
    With damage, `max` and `mean` end before the first loss, and `after_damage` follows the last.
    """
    time = log.column("time")
    static, adapting = static_phase(scenario, time), adapting_phase(scenario, time)
    tick_ms = 1e3 * np.array([record.wall_seconds for record in log.records])
    return {
        "scenario": name,
        "seed": scenario.random_seed,
        "completed": completed,
        "versions": _versions(),
        "static": _measures(log, static, np.mean),
        "max": _measures(log, adapting, np.max),
        "mean": _measures(log, adapting, np.mean),
        "final": _measures(log, slice(-1, None), np.mean),
        "contact_model": scenario.measures.contact_model,
        **force_closure_summary(
            scenario, surface, static=log.records[static][-1:], final=log.records[-1:]
        ),
        **_after_damage(scenario, surface, log),
        "inactive_contacts": _inactive_contacts(log),
        "ticks": len(log.rows),
        "simulated_seconds": float(time[-1]) if len(time) else 0.0,
        "tick_time_p50_ms": float(np.percentile(tick_ms, 50)) if len(tick_ms) else None,
        "tick_time_p99_ms": float(np.percentile(tick_ms, 99)) if len(tick_ms) else None,
        "real_time_factor": float(time[-1]) / wall_seconds if len(time) else 0.0,
    }


def _inactive_contacts(log: RunLog) -> dict[str, str]:
    """Returns the contacts that are there at the last tick, but have nowhere to be, and why."""
    if not log.records:
        return {}
    record = log.records[-1]
    without = ~is_active(record.contact_status) & (record.contact_status != ContactStatus.LOST)
    return {
        str(contact): describe_status(
            record.contact_status[contact], record.contact_causes[contact]
        )
        for contact in np.flatnonzero(without).tolist()
    }


def _after_damage(
    scenario: Scenario, surface: ObjectSurface, log: RunLog
) -> dict[str, dict[str, dict[str, float | None]]]:
    """Returns the measures after the last loss: of the static contacts left, and the best."""
    if not scenario.damage:
        return {}
    static = remaining_static_quality(scenario, surface)
    return {
        "after_damage": {
            "static": {name: getattr(static, name) for name in MEASURES},
            "max": _measures(log, last_phase(scenario, log.column("time")), np.max),
        }
    }


def _measures(log: RunLog, ticks: slice, reduce: Any) -> dict[str, float | None]:
    values = {name: log.column(name)[ticks] for name in MEASURES}
    return {name: float(reduce(v)) if len(v) else None for name, v in values.items()}


def _versions() -> dict[str, str]:
    packages = ("drake", "numpy", "scipy", "trimesh")
    return {
        "drake_pregrasp": __version__,
        "python": platform.python_version(),
        **{package: importlib.metadata.version(package) for package in packages},
    }
