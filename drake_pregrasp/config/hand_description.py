"""A hand in words: the schema of the files that `grasp.hand` of a scenario names.

Its model is a URDF or SDF; what a model doesn't say is here. docs/own_hand.md has an example.
"""

from dataclasses import dataclass, field

from drake_pregrasp.config.limits_config import ReachConfig, SectorReach
from drake_pregrasp.config.object_config import zeros
from drake_pregrasp.geometry.box_surface import BOX_FACES

_LENGTH = {"at_least": -10, "at_most": 10}
_ANGLE = {"at_least": -10, "at_most": 10}
_POINT = {"length": 3, **_LENGTH}


@dataclass
class Carrier:
    """Four axes that carry a palm over the object."""

    # The joints that slide along x, y and z of W, and turn about z.
    joints: list[str] = field(
        default_factory=lambda: ["x", "y", "z", "yaw"], metadata={"length": 4}
    )

    # Height of the carrier over the object's origin, in metres.
    palm_height: float = field(default=0.155, metadata={"at_least": 0, "at_most": 10})


@dataclass
class Arm:
    """An arm that carries a palm over the object."""

    # The palm's frame P.
    palm: str = field(default="", metadata={"required": True})

    # The arm's joints. All others are fingers'.
    joints: list[str] = field(default_factory=list, metadata={"required": True, "min_length": 6})

    # The positions that they are drawn to, as far as the palm leaves them free.
    home: list[float] = field(default_factory=list, metadata={"required": True, **_ANGLE})

    # Where the palm is over the object's origin at yaw 0: along W's axes, in metres...
    palm_position: list[float] = field(default_factory=zeros, metadata={"required": True, **_POINT})

    # ...and how it is oriented then, as roll, pitch and yaw in W, in radians.
    palm_rpy: list[float] = field(default_factory=zeros, metadata={"length": 3, **_ANGLE})


BaseConfig = Carrier | Arm


@dataclass
class Closing:
    """What a finger may do to close, whatever a scenario asks for."""

    # Largest speed of its tip, in m/s.
    speed: float = field(default=0.1, metadata={"above": 0, "at_most": 10})

    # Largest normal force, in newtons.
    force: float = field(default=12.0, metadata={"above": 0, "at_most": 1e4})

    # How far beyond the surface, as it is estimated, the tip goes to find it, in metres.
    depth: float = field(default=0.006, metadata={"above": 0, "at_most": 1})


@dataclass
class Fingertip:
    """A fingertip and the finger it is on."""

    # The frame at its centre.
    frame: str = field(default="", metadata={"required": True})

    # Its radius, in metres.
    radius: float = field(default=0.01, metadata={"required": True, "above": 0, "at_most": 0.1})

    # Home positions of the joints that move this tip only, in their order in the model, in radians
    # (or metres).
    home: list[float] = field(default_factory=list, metadata={"required": True, **_ANGLE})

    # What it reaches, in H: a frame with its origin in the object's, z up, whose axes are W's at
    # yaw 0. It turns with a palm that turns as far as it likes; with one of limited range it stays
    # at the middle of that.
    reach: ReachConfig = field(default_factory=SectorReach, metadata={"required": True})

    # How far from the object's z axis it waits, over the object's top, while it has no contact, in
    # metres. 0: as far as tips are at home on the average.
    withdrawn_radius: float = field(default=0.0, metadata={"at_least": 0, "at_most": 1})

    closing: Closing = field(default_factory=Closing)

    # Faces of the object, as +z, that it may not touch.
    forbidden_faces: list[str] = field(default_factory=list, metadata={"one_of": BOX_FACES})


@dataclass
class HandDescription:
    """A hand and what carries it."""

    # A URDF or SDF with one model, all of whose joints are driven with gains: a path from this
    # file's folder, package://drake_pregrasp/... for a model that is shipped, or
    # robots://allegro_panda.urdf for one that the extra `robots` brings.
    model: str = field(default="", metadata={"required": True, "path": True})

    # What carries the palm: !Carrier or !Arm.
    base: BaseConfig = field(default_factory=Carrier, metadata={"required": True})

    # One for each contact.
    fingertips: list[Fingertip] = field(
        default_factory=list, metadata={"required": True, "min_length": 2}
    )

    @property
    def palm_height(self) -> float:
        """Height of the palm over the object's origin, in metres."""
        if isinstance(self.base, Carrier):
            return self.base.palm_height
        return self.base.palm_position[2]
