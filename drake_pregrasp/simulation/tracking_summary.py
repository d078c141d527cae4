"""How well the object was tracked: the entry `tracking` of `summary.json`."""

from typing import Any

import numpy as np

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.tracking_status import TrackingStatus


def tracking_summary(status: FloatArray, time_since_measurement: FloatArray) -> dict[str, Any]:
    """Returns how well the object was tracked; null where there is no tick.

    - `share`: of the ticks, for each `TrackingStatus` by its name.
    - `longest_without_measurement`: age of the newest measurement in an estimate, at most, in
      seconds.

    Args:
        status: A `TrackingStatus` a tick, shape (k,).
        time_since_measurement: Shape (k,), in seconds.
    """
    there = len(status) > 0
    return {
        "share": {
            kind.name.lower(): float(np.mean(status == kind)) if there else None
            for kind in TrackingStatus
        },
        "longest_without_measurement": float(np.max(time_since_measurement)) if there else None,
    }
