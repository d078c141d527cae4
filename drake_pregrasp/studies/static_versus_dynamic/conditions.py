"""Under what conditions arms are compared."""

from typing import NamedTuple


class Condition(NamedTuple):
    """One of them.

    Attributes:
        label: What tables and figures call it.
        text: What happens, in words.
        closing_times: When the hand is told to close, in seconds; all follow from one tracking.
    """

    label: str
    text: str
    closing_times: tuple[float, ...]


CONDITIONS = {
    "nominal": Condition("nominal", "an object moves, and all fingers work", (4.0, 7.0)),
    "one_lost": Condition("one finger lost", "a finger is lost on the way", (4.0, 7.0)),
    "two_lost": Condition("two fingers lost", "two fingers are lost on the way", (4.0, 7.0)),
    "turning": Condition(
        "turning", "the object turns, and the wrist turns little", (4.0, 8.0, 12.0)
    ),
    "wall": Condition(
        "wall", "the object turns beside a no-touch wall; the wrist is free", (3.0, 6.0, 9.0)
    ),
    "headline": Condition(
        "turning beside a wall",
        "the object turns beside a no-touch wall, and the wrist turns little",
        (4.0, 8.0, 12.0),
    ),
    "sphere": Condition("sphere", "a big no-touch sphere passes the object", (4.8, 6.0, 8.0)),
    "noise": Condition("noise", "poses are measured with much noise", (4.0, 7.0)),
}
"""The conditions by their keys, in the order in which they are shown."""
