"""What the object can be: a primitive, a surface of revolution, or a mesh file."""

from dataclasses import dataclass, field
from pathlib import Path

from drake_pregrasp.planning.shapes import (
    Shape,
    ball_shape,
    box_shape,
    cylinder_shape,
    load_shape,
    revolved_shape,
)
from drake_pregrasp.resources import resolve_path

_LENGTH = {"at_least": 0.001, "at_most": 1}
_MASS = {"above": 0, "at_most": 1000}


@dataclass
class Box:
    """A homogeneous box whose frame O is at its centre."""

    # Edge lengths along x, y and z of O, in metres.
    size: list[float] = field(
        default_factory=lambda: [0.1, 0.1, 0.1],
        metadata={"length": 3, "at_least": 0.005, "at_most": 0.25},
    )

    # Mass, in kg.
    mass: float = field(default=0.4, metadata=_MASS)

    def make_shape(self) -> Shape:
        """Returns its surface in O."""
        return box_shape(self.size)


@dataclass
class Cylinder:
    """A homogeneous cylinder, as a can, whose frame O is at its centre, with z along its axis."""

    # Radius, in metres.
    radius: float = field(default=0.033, metadata=_LENGTH)

    # Length, in metres.
    length: float = field(default=0.12, metadata=_LENGTH)

    # Mass, in kg.
    mass: float = field(default=0.35, metadata=_MASS)

    def make_shape(self) -> Shape:
        """Returns its surface in O."""
        return cylinder_shape(self.radius, self.length)


@dataclass
class Ball:
    """A homogeneous ball whose frame O is at its centre."""

    # Radius, in metres.
    radius: float = field(default=0.04, metadata=_LENGTH)

    # Mass, in kg.
    mass: float = field(default=0.15, metadata=_MASS)

    def make_shape(self) -> Shape:
        """Returns its surface in O."""
        return ball_shape(self.radius)


@dataclass
class Revolved:
    """A homogeneous body of revolution about z of O, as a bottle, a cup or a bowling pin."""

    # Points (r, z) of its outline in metres, r >= 0, with z rising along the outside, from the axis
    # back to the axis. One that doesn't end there is closed into a ring.
    profile: list[list[float]] = field(
        default_factory=list,
        metadata={
            "required": True,
            "min_length": 3,
            "max_length": 256,
            "elements": {"length": 2, "at_least": -1, "at_most": 1},
        },
    )

    # Mass, in kg.
    mass: float = field(default=0.3, metadata=_MASS)

    def make_shape(self) -> Shape:
        """Returns its surface in O."""
        return revolved_shape(self.profile)


@dataclass
class Mesh:
    """A homogeneous body with the surface of a mesh file, whose frame is O."""

    # An OBJ, STL, PLY or glTF file with a watertight mesh, from the folder of the scenario's file;
    # or package://drake_pregrasp/..., for those that are shipped.
    file: str = field(default="", metadata={"required": True, "path": True})

    # Metres for each unit of the file.
    scale: float = field(default=1.0, metadata={"above": 0, "at_most": 1000})

    # Mass, in kg.
    mass: float = field(default=0.3, metadata=_MASS)

    def make_shape(self) -> Shape:
        """Returns its surface in O."""
        return load_shape(resolve_path(self.file, Path.cwd()), scale=self.scale)


ObjectConfig = Box | Cylinder | Ball | Revolved | Mesh
