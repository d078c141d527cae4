"""Reasons why a hand cannot meet a moving object."""

from enum import IntEnum


class CatchLimit(IntEnum):
    """Reason why a hand cannot meet an object.

    Attributes:
        NONE: A meeting within all limits was found for the predicted motion.
        SIGHT: The object is not tracked.
        REACH: The object, or each path to it that there is time for, is outside the palm's travel.
        SPEED: The palm would have to be faster than its axes are.
        ACCELERATION: The palm would have to accelerate more than its axes do.
        TIME: The object leaves the palm's travel before the hand has closed.
        GRIP: The fingers cannot hold the object while they stop it.
    """

    NONE = 0
    SIGHT = 1
    REACH = 2
    SPEED = 3
    ACCELERATION = 4
    TIME = 5
    GRIP = 6


_REASONS = {
    CatchLimit.SIGHT: "it is not in sight",
    CatchLimit.REACH: "it is out of reach",
    CatchLimit.SPEED: "the palm is too slow",
    CatchLimit.ACCELERATION: "the palm does not accelerate enough",
    CatchLimit.TIME: "it leaves too soon for the hand to close",
    CatchLimit.GRIP: "the fingers are too weak to stop it",
}


def describe_catch_limit(limit: float) -> str | None:
    """Describes what prevents a hand from meeting an object; None if nothing does.

    Args:
        limit: Value of `CatchLimit`.
    """
    return _REASONS.get(CatchLimit(int(limit)))
