"""What the object can be."""

from dataclasses import dataclass, field


@dataclass
class Box:
    """A homogeneous box whose frame O is at its centre."""

    # Edge lengths along x, y and z of O, in metres.
    size: list[float] = field(
        default_factory=lambda: [0.1, 0.1, 0.1],
        metadata={"length": 3, "at_least": 0.005, "at_most": 0.25},
    )

    # Mass, in kg.
    mass: float = field(default=0.4, metadata={"above": 0, "at_most": 1000})


ObjectConfig = Box
