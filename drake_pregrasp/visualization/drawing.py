"""Colours and solids for pictures and Meshcat."""

import numpy as np
import trimesh
from pydrake.geometry import (
    Box,
    Cylinder,
    FrameId,
    GeometryFrame,
    GeometryInstance,
    MakePhongIllustrationProperties,
    Rgba,
    SceneGraph,
    Shape,
    SourceId,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.geometry.solids import BallSolid, BoxSolid, HalfSpace, Solid
from drake_pregrasp.regions.safe_regions import NO_REGION

# Colours of Okabe and Ito (2008) without black, ordered so that neighbours differ strongly.
_CONTACT_COLORS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#F0E442")

_NO_REGION_COLOR = Rgba(0.72, 0.73, 0.75)
_PALER = 0.3  # Share of white in the colour of a region.

BODY_COLOR = np.array([0.45, 0.42, 0.38, 1.0])
"""Colour of obstacles that are bodies, which are opaque."""

VOLUME_COLOR = Rgba(0.84, 0.37, 0.0, 0.3)
"""Colour of no-touch volumes, which are translucent."""

_PLATE = 0.36  # Edge of the plate that represents a half-space, in metres.
_THICKNESS = 0.004  # Of the plate, in metres.
_DEPTH = 0.004  # Depth of its middle below the plane, so that it does not hide a table, in metres.


def drawn_solid(solid: Solid) -> tuple[Shape, RigidTransform]:
    """Returns the shape that represents a solid, and the pose of its frame.

    A plate just below its plane represents a half-space.
    """
    if isinstance(solid, BallSolid):
        return Sphere(solid.radius), RigidTransform(np.array(solid.center))
    if isinstance(solid, BoxSolid):
        R_FB = RotationMatrix.ProjectToRotationMatrix(solid.R_FB)
        return Box(*solid.size), RigidTransform(R_FB, solid.center)
    assert isinstance(solid, HalfSpace)
    R_FP = RotationMatrix.MakeFromOneVector(solid.normal, axis_index=2)
    X_FP = RigidTransform(R_FP, solid.point - _DEPTH * solid.normal)
    return Box(_PLATE, _PLATE, _THICKNESS), X_FP


def draw_giver(scene_graph: SceneGraph, mesh: trimesh.Trimesh) -> tuple[SourceId, FrameId]:
    """Draws a small plate below an object for the hand of a person who hands it over.

    Args:
        scene_graph: SceneGraph in which the plate is registered; nothing collides with it.
        mesh: Mesh of the object in O.

    Returns:
        Source and frame of the plate, whose pose is that of O.
    """
    source, frame = scene_graph.RegisterSource("giver"), GeometryFrame("giver")
    scene_graph.RegisterFrame(source, frame)
    low, high = mesh.bounds
    x, y, _ = (low + high) / 2
    plate = Cylinder(float(np.min(high - low)) / 4, _THICKNESS)
    drawn = GeometryInstance(RigidTransform([x, y, low[2] - _THICKNESS / 2]), plate, "plate")
    drawn.set_illustration_properties(MakePhongIllustrationProperties(BODY_COLOR))
    scene_graph.RegisterGeometry(source, frame.id(), drawn)
    return source, frame.id()


def camera_pose(p_FT: FloatArray, p_TK_F: FloatArray) -> RigidTransform:
    """Returns the pose X_FK of an upright camera K (z forward, y down) that looks at a target T.

    Args:
        p_FT: Position of T in a frame F whose z axis points up, shape (3,), in metres.
        p_TK_F: Position of K relative to T, in F, shape (3,), in metres; not along z.
    """
    z = -p_TK_F / np.linalg.norm(p_TK_F)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    R_FK = RotationMatrix(np.column_stack([x, np.cross(z, x), z]))
    return RigidTransform(R_FK, p_FT + p_TK_F)


def contact_color(contact: int) -> Rgba:
    """Returns the colour of a contact by its index; colours repeat after seven contacts."""
    hex_color = _CONTACT_COLORS[contact % len(_CONTACT_COLORS)]
    return Rgba(*(int(hex_color[k : k + 2], 16) / 255 for k in (1, 3, 5)))


def hex_color(color: Rgba) -> str:
    """Returns a colour as HTML writes it."""
    return "#" + bytes(round(255 * c) for c in (color.r(), color.g(), color.b())).hex()


def region_color(contact: int) -> Rgba:
    """Returns the colour of a contact's region, which is pale, or of `NO_REGION`, which is grey."""
    if contact == NO_REGION:
        return _NO_REGION_COLOR
    color = contact_color(contact)
    return Rgba(*(_PALER + (1 - _PALER) * c for c in (color.r(), color.g(), color.b())))


def linear_rgb(color: Rgba) -> list[float]:
    """Returns the linear RGB triple of an sRGB colour, as a recording animates it."""
    return [
        c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4
        for c in (color.r(), color.g(), color.b())
    ]
