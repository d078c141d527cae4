"""Configuration of the sampling of the object's surface, and of no-touch areas."""

from dataclasses import dataclass, field

import numpy as np

from drake_pregrasp.config.object_config import POINT, Box, BoxFields, ObjectConfig, zeros
from drake_pregrasp.geometry.box_surface import BOX_FACES, box_surface
from drake_pregrasp.geometry.mesh_surface import (
    AxisArea,
    FacingArea,
    NoTouchArea,
    PartArea,
    TipSize,
    mesh_surface,
)
from drake_pregrasp.geometry.shapes import Shape
from drake_pregrasp.geometry.solids import BallSolid, HalfSpace
from drake_pregrasp.geometry.surface import ObjectSurface


@dataclass
class Facing:
    """No-touch area: all surface that faces a direction."""

    # Direction in O, of any length.
    direction: list[float] = field(default_factory=zeros, metadata={"required": True, **POINT})

    # Largest angle between the direction and the outward normal, in radians.
    angle: float = field(default=0.785, metadata={"above": 0, "at_most": 3.1416})

    def make_area(self, shape: Shape) -> NoTouchArea:
        """Returns the no-touch area on a shape."""
        return FacingArea(np.array(self.direction), self.angle)


@dataclass
class InsideBox(BoxFields):
    """No-touch area: all surface inside a box in O."""

    def make_area(self, shape: Shape) -> NoTouchArea:
        """Returns the no-touch area on a shape."""
        return self.make_solid()


@dataclass
class InsideBall:
    """No-touch area: all surface inside a ball."""

    # Centre in O, in metres.
    center: list[float] = field(default_factory=zeros, metadata=POINT)

    # Radius, in metres.
    radius: float = field(default=0.0, metadata={"required": True, "above": 0, "at_most": 10})

    def make_area(self, shape: Shape) -> NoTouchArea:
        """Returns the no-touch area on a shape."""
        return BallSolid(np.array(self.center), self.radius)


@dataclass
class BehindPlane:
    """No-touch area: all surface on one side of a plane."""

    # A point of the plane in O, in metres.
    point: list[float] = field(default_factory=zeros, metadata={"required": True, **POINT})

    # Normal of the plane in O; it points away from the no-touch area.
    normal: list[float] = field(default_factory=zeros, metadata={"required": True, **POINT})

    def make_area(self, shape: Shape) -> NoTouchArea:
        """Returns the no-touch area on a shape."""
        return HalfSpace(np.array(self.point), np.array(self.normal))


@dataclass
class Part:
    """No-touch area: a named part of a mesh file, such as an object of an OBJ."""

    # Name of the part.
    name: str = field(default="", metadata={"required": True})

    def make_area(self, shape: Shape) -> NoTouchArea:
        """Returns the no-touch area on a shape."""
        return PartArea(shape.part(self.name))


MAX_BOX_POINTS = 200_000
"""Largest number of candidates of a box in a scenario, and of its forbidden points."""


@dataclass
class SurfaceConfig:
    """Configuration of the sampling of the object's surface, and of no-touch areas."""

    # Distance between neighbouring candidate points Y, in metres: the largest on a box, the mean
    # on other shapes.
    spacing: float = field(default=0.005, metadata={"at_least": 0.0005})

    # Seed of the sampling; a box has a regular grid and needs none.
    seed: int = field(default=0, metadata={"at_least": 0, "at_most": 2**32})

    # Forbidden faces: all surface whose outward normal is closest to one of these axes of O.
    forbidden_faces: list[str] = field(
        default_factory=lambda: ["-z", "+z"], metadata={"one_of": BOX_FACES}
    )

    # Further no-touch areas, in O.
    no_touch: list[Facing | InsideBox | InsideBall | BehindPlane | Part] = field(
        default_factory=list
    )

    # Distance between neighbouring forbidden points Z, in metres.
    forbidden_spacing: float = field(default=0.02, metadata={"at_least": 0.0005})

    # Radius R_j of each forbidden point, in metres.
    forbidden_radius: float = field(default=0.005, metadata={"at_least": 0, "at_most": 10})

    def make_surface(
        self,
        config: ObjectConfig,
        *,
        shape: Shape,
        spacing: float | None = None,
        tip: TipSize | None = None,
    ) -> ObjectSurface:
        """Returns the sampled surface of an object.

        Args:
            config: The object.
            shape: Shape of the object.
            spacing: Distance between candidate points, in metres; that of this configuration by
                default.
            tip: Size of the fingertips of a hand, which need a place. On a box they have it.

        Raises:
            InvalidArgumentError: If a length is out of range, or no allowed surface is left.
        """
        lengths = {
            "spacing": self.spacing if spacing is None else spacing,
            "forbidden_spacing": self.forbidden_spacing,
            "forbidden_radius": self.forbidden_radius,
        }
        if isinstance(config, Box) and config.is_aligned and not self.no_touch:
            return box_surface(
                config.size,
                forbidden_faces=self.forbidden_faces,
                max_points=MAX_BOX_POINTS,
                **lengths,
            )
        areas: list[NoTouchArea] = [AxisArea(face) for face in self.forbidden_faces]
        areas += [area.make_area(shape) for area in self.no_touch]
        return mesh_surface(shape, seed=self.seed, no_touch=areas, tip=tip, **lengths)
