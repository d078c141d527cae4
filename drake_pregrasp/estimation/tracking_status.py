"""How well an object is tracked."""

import math
from enum import IntEnum

from drake_pregrasp.ticks import SLACK


class TrackingStatus(IntEnum):
    """What an estimate of an object's pose rests on.

    Attributes:
        WAITING: On nothing: there was no measurement yet.
        TRACKING: On a recent measurement.
        COASTING: On a prediction that is still good enough to follow.
        LOST: On a prediction that is too old to follow: the estimate stands still.
    """

    WAITING = 0
    TRACKING = 1
    COASTING = 2
    LOST = 3

    @property
    def is_followed(self) -> bool:
        """Whether goals may follow the estimate."""
        return self in (TrackingStatus.TRACKING, TrackingStatus.COASTING)


def tracking_status(
    since_measurement: float, period: float, coast_after: float, lost_after: float
) -> TrackingStatus:
    """Returns the status by how long the next measurement is overdue.

    Args:
        since_measurement: Seconds since the newest measurement that was used; inf if none was.
        period: Seconds between measurements, when all is well.
        coast_after: Seconds overdue beyond which the object isn't tracked any more.
        lost_after: Seconds overdue beyond which it is lost.
    """
    if since_measurement == math.inf:
        return TrackingStatus.WAITING
    overdue = since_measurement - (1 + SLACK) * period
    if overdue <= coast_after:
        return TrackingStatus.TRACKING
    return TrackingStatus.COASTING if overdue <= lost_after else TrackingStatus.LOST


_STATUS_OF = {float(status): status for status in TrackingStatus}


def usable_status(number: float) -> TrackingStatus:
    """Returns the status that a number of a port stands for; `LOST` if it stands for none."""
    return _STATUS_OF.get(float(number), TrackingStatus.LOST)
