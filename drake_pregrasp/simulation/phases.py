"""Former place of the phases of a run."""

from drake_pregrasp.simulation.run_log import (
    adapting_phase,
    last_phase,
    static_end,
    static_phase,
    ticks_from,
)
from drake_pregrasp.simulation.summary import remaining_static_quality

__all__ = [
    "adapting_phase",
    "last_phase",
    "remaining_static_quality",
    "static_end",
    "static_phase",
    "ticks_from",
]
