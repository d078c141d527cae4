"""What is compared: ways to choose where fingers go."""

from typing import NamedTuple


class Arm(NamedTuple):
    """One of the ways.

    Attributes:
        label: What tables and figures call it.
        text: What the hand does, in words.
        color: In figures, as hexadecimal RGB.
        marker: In figures, as matplotlib calls it.
    """

    label: str
    text: str
    color: str
    marker: str


# Colours of Okabe and Ito's colour-blind-safe set, without its yellow, which is pale on white.
ARMS = {
    "world": Arm("fixed in the world", "contacts stay where they are in the world", "#000000", "x"),
    "carried": Arm("carried", "random contacts are carried with the object", "#CC79A7", "v"),
    "frozen": Arm(
        "frozen plan", "contacts are planned at the start, then carried with it", "#E69F00", "s"
    ),
    "reassigned": Arm(
        "re-assigned plan",
        "as the frozen plan, but contacts go to other fingers, round the hand, as it turns",
        "#D55E00",
        "D",
    ),
    "still": Arm(
        "still hand",
        "the hand goes along with the object, doesn't turn, and just closes",
        "#56B4E9",
        "P",
    ),
    "dynamic": Arm(
        "dynamic without reach", "contacts are planned anew at every tick", "#009E73", "^"
    ),
    "dynamic_reach": Arm(
        "dynamic with reach",
        "contacts are planned anew at every tick, within the reach of each finger",
        "#0072B2",
        "o",
    ),
}
"""The arms by their keys, in the order in which they are shown."""

TESTED_ARM = "dynamic_reach"
"""The arm that each other one is tested against."""
