"""How well an object is tracked."""

from enum import IntEnum


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
