"""Former place of `interruptible`."""

from drake_pregrasp.simulation.output import INTERRUPTED_STATUS, interruptible

__all__ = ["INTERRUPTED_STATUS", "interruptible"]
