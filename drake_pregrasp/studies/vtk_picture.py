"""What pictures by Drake's VTK renderer have in common: lights, coloured shapes, and the image."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    ColorRenderCamera,
    GeometryInstance,
    LightParameter,
    MakeRenderEngineVtk,
    PerceptionProperties,
    QueryObject,
    RenderEngine,
    RenderEngineVtkParams,
    Rgba,
    Shape,
)
from pydrake.math import RigidTransform

ByteArray = NDArray[np.uint8]

WHITE = (1.0, 1.0, 1.0)
"""The background of most pictures."""


class Light(NamedTuple):
    """Light from far away.

    Attributes:
        direction: Where it shines, in its frame, shape (3,); z of a camera is forward.
        intensity: 1 lights what it meets at a right angle fully.
        frame: `camera` or `world`.
    """

    direction: Sequence[float]
    intensity: float
    frame: str = "camera"


def lit_renderer(
    lights: Sequence[Light], background: tuple[float, float, float] = WHITE
) -> RenderEngine:
    """Returns a renderer.

    Args:
        lights: What shines.
        background: Its red, green and blue, from 0 to 1.
    """
    parameters = RenderEngineVtkParams()
    parameters.default_clear_color = list(background)
    parameters.lights = [
        LightParameter(type="directional", frame=frame, direction=direction, intensity=intensity)
        for direction, intensity, frame in lights
    ]
    return MakeRenderEngineVtk(parameters)


def coloured(X_FS: RigidTransform, shape: Shape, color: Rgba, name: str) -> GeometryInstance:
    """Returns a shape S for renderers only.

    Args:
        X_FS: Where it is in the frame that it is registered with.
        shape: What it is.
        color: Of all of it.
        name: Which no other geometry of that frame has.
    """
    properties = PerceptionProperties()
    properties.AddProperty("phong", "diffuse", color)
    instance = GeometryInstance(X_FS, shape, name)
    instance.set_perception_properties(properties)
    return instance


def take_picture(query: QueryObject, camera: ColorRenderCamera, X_WK: RigidTransform) -> ByteArray:
    """Returns a picture, shape (height, width, 3).

    Args:
        query: Of the scene.
        camera: Whose renderer the scene has.
        X_WK: Where the camera K is.
    """
    image = query.RenderColorImage(camera, query.inspector().world_frame_id(), X_WK)
    return np.array(image.data[:, :, :3])
