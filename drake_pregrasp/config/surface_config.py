"""Configuration of the sampling of the object's surface, and of no-touch areas."""

import contextlib
import functools
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pydrake.math import RollPitchYaw

from drake_pregrasp.config.object_config import Box, Mesh, ObjectConfig, zeros
from drake_pregrasp.errors import InvalidArgumentError, NoSurfaceError, ScenarioError
from drake_pregrasp.geometry.box_surface import BOX_FACES, box_surface
from drake_pregrasp.geometry.mesh_surface import (
    AxisArea,
    FacingArea,
    NoTouchArea,
    PartArea,
    mesh_surface,
)
from drake_pregrasp.geometry.shapes import Shape
from drake_pregrasp.geometry.solids import BallSolid, BoxSolid, HalfSpace
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.resources import resolve_path

_KEPT = 2  # Number of cached surfaces: one for planning and one for drawing.

_POINT = {"length": 3, "at_least": -10, "at_most": 10}
_ANGLES = {"length": 3, "at_least": -10, "at_most": 10}
_SIZE = {"length": 3, "above": 0, "at_most": 10}


@dataclass
class Facing:
    """No-touch area: all surface that faces a direction."""

    # Direction in O, of any length.
    direction: list[float] = field(default_factory=zeros, metadata={"required": True, **_POINT})

    # Largest angle between the direction and the outward normal, in radians.
    angle: float = field(default=0.785, metadata={"above": 0, "at_most": 3.1416})

    def make_area(self, shape: Shape) -> NoTouchArea:
        """Returns the no-touch area on a shape."""
        return FacingArea(np.array(self.direction), self.angle)


@dataclass
class InsideBox:
    """No-touch area: all surface inside a box."""

    # Edge lengths, in metres.
    size: list[float] = field(default_factory=zeros, metadata={"required": True, **_SIZE})

    # Centre in O, in metres.
    center: list[float] = field(default_factory=zeros, metadata=_POINT)

    # Orientation in O, as roll, pitch and yaw, in radians.
    rpy: list[float] = field(default_factory=zeros, metadata=_ANGLES)

    def make_area(self, shape: Shape) -> NoTouchArea:
        """Returns the no-touch area on a shape."""
        R_OB = RollPitchYaw(self.rpy).ToRotationMatrix().matrix()
        return BoxSolid(np.array(self.center), R_OB, np.array(self.size))


@dataclass
class InsideBall:
    """No-touch area: all surface inside a ball."""

    # Centre in O, in metres.
    center: list[float] = field(default_factory=zeros, metadata=_POINT)

    # Radius, in metres.
    radius: float = field(default=0.0, metadata={"required": True, "above": 0, "at_most": 10})

    def make_area(self, shape: Shape) -> NoTouchArea:
        """Returns the no-touch area on a shape."""
        return BallSolid(np.array(self.center), self.radius)


@dataclass
class BehindPlane:
    """No-touch area: all surface on one side of a plane."""

    # A point of the plane in O, in metres.
    point: list[float] = field(default_factory=zeros, metadata={"required": True, **_POINT})

    # Normal of the plane in O; it points away from the no-touch area.
    normal: list[float] = field(default_factory=zeros, metadata={"required": True, **_POINT})

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

    def make_surface(self, config: ObjectConfig, spacing: float | None = None) -> ObjectSurface:
        """Returns the sampled surface of an object.

        The last few surfaces are cached, and made anew if the configuration or the file changes.

        Args:
            config: The object.
            spacing: Distance between candidate points, in metres; that of this configuration by
                default.

        Raises:
            InvalidArgumentError: If the object cannot be made, or no allowed surface is left.
        """
        changed: tuple[int, ...] = ()
        if isinstance(config, Mesh):
            with contextlib.suppress(OSError, InvalidArgumentError):
                status = resolve_path(config.file, Path.cwd()).stat()
                changed = (status.st_mtime_ns, status.st_size, status.st_ino)
        key = repr((Path.cwd(), self, config, spacing, changed))
        return _kept_surface(_Request(key, self, config, spacing))

    def _make(self, config: ObjectConfig, spacing: float | None) -> ObjectSurface:
        lengths = {
            "spacing": self.spacing if spacing is None else spacing,
            "forbidden_spacing": self.forbidden_spacing,
            "forbidden_radius": self.forbidden_radius,
        }
        if isinstance(config, Box) and not self.no_touch:
            return box_surface(
                config.size,
                forbidden_faces=self.forbidden_faces,
                max_points=MAX_BOX_POINTS,
                **lengths,
            )
        shape = config.make_shape()
        areas: list[NoTouchArea] = [AxisArea(face) for face in self.forbidden_faces]
        areas += [area.make_area(shape) for area in self.no_touch]
        return mesh_surface(shape, seed=self.seed, no_touch=areas, **lengths)


@dataclass(frozen=True)
class _Request:
    """Arguments of a cached surface, compared by their key."""

    key: str
    surface: SurfaceConfig = field(compare=False)
    object: ObjectConfig = field(compare=False)
    spacing: float | None = field(compare=False)


@functools.lru_cache(maxsize=_KEPT)
def _kept_surface(request: _Request) -> ObjectSurface:
    return request.surface._make(request.object, request.spacing)


def check_surface(source: str, config: ObjectConfig, surface: SurfaceConfig) -> ObjectSurface:
    """Returns the sampled surface of an object.

    Args:
        source: Where the scenario is from, for the message.
        config: The object.
        surface: Configuration of the sampling.

    Raises:
        ScenarioError: If the object cannot be made, or no allowed surface is left.
    """
    try:
        shape = config.make_shape()
    except InvalidArgumentError as error:
        key = "file" if isinstance(config, Mesh) else "profile"
        raise ScenarioError(source, f"object.{key}", str(error)) from error
    for index, area in enumerate(surface.no_touch):
        try:
            area.make_area(shape)
        except InvalidArgumentError as error:
            raise ScenarioError(source, f"surface.no_touch[{index}]", str(error)) from error
    try:
        return surface.make_surface(config)
    except NoSurfaceError as error:
        key = "no_touch" if surface.no_touch else "forbidden_faces"
        raise ScenarioError(source, f"surface.{key}", str(error)) from error
    except InvalidArgumentError as error:
        key = "forbidden_spacing" if "forbidden_spacing" in str(error) else "spacing"
        raise ScenarioError(source, f"surface.{key}", str(error)) from error
