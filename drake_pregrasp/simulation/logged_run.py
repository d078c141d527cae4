"""Former place of `LoggedRun`."""

from drake_pregrasp.simulation.run import LoggedRun

__all__ = ["LoggedRun"]
