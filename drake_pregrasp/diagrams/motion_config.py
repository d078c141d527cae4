"""How the object can move."""

from dataclasses import dataclass, field


@dataclass
class Conveyor:
    """The twist of a table that carries the object by friction."""

    # Speed along x of W, in m/s.
    linear_velocity: float = field(default=0.001, metadata={"at_least": -10, "at_most": 10})

    # Turning rate about z of W, in rad/s.
    angular_velocity: float = field(default=0.0174, metadata={"at_least": -100, "at_most": 100})


MotionConfig = Conveyor
