"""Colours, solids and text boards for pictures and Meshcat."""

import numpy as np
import trimesh
from PIL import Image, ImageDraw, ImageFont
from pydrake.common import MemoryFile
from pydrake.geometry import Box, InMemoryMesh, Mesh, Rgba, Shape, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from drake_pregrasp.geometry.solids import BallSolid, BoxSolid, HalfSpace, Solid

# Colours of Okabe and Ito (2008) without black, ordered so that neighbours differ strongly.
_CONTACT_COLORS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#F0E442")

NO_REGION_COLOR = Rgba(0.72, 0.73, 0.75)

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


def contact_color(contact: int) -> Rgba:
    """Returns the colour of a contact by its index; colours repeat after seven contacts."""
    hex_color = _CONTACT_COLORS[contact % len(_CONTACT_COLORS)]
    return Rgba(*(int(hex_color[k : k + 2], 16) / 255 for k in (1, 3, 5)))


def tint(color: Rgba, share_of_white: float) -> Rgba:
    """Returns a colour mixed with white."""
    return Rgba(
        *(share_of_white + (1 - share_of_white) * c for c in (color.r(), color.g(), color.b()))
    )


def linear_rgb(color: Rgba) -> list[float]:
    """Returns the linear RGB triple of an sRGB colour, as a recording animates it."""
    return [
        c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4
        for c in (color.r(), color.g(), color.b())
    ]


_FONT_PIXELS = 40
_MARGIN = 16
_FRAME = 9


def text_board(text: str, *, height: float, frame_color: Rgba) -> Mesh:
    """Returns a board with a line of text, visible from both sides.

    The board is upright in the x-z plane of its frame, with the middle of its lower edge at the
    origin, and is read from the side of -y.

    Args:
        text: Text of one line.
        height: Height of the board, in metres.
        frame_color: Colour of the board's frame.
    """
    image = _picture(text, frame_color)
    width = height * image.width / image.height
    corners = np.array([[-1, 0, 0], [1, 0, 0], [1, 0, 1], [-1, 0, 1]]) * [width / 2, 1, height]
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    material = trimesh.visual.material.PBRMaterial(
        baseColorTexture=image, metallicFactor=0.0, roughnessFactor=1.0, doubleSided=True
    )
    board = trimesh.Trimesh(
        corners,
        [[0, 1, 2], [0, 2, 3]],
        visual=trimesh.visual.TextureVisuals(uv=uv, material=material),
        process=False,
    )
    # Drake rotates glTF files so that their y axis becomes z; the file therefore swaps the axes.
    board.apply_transform([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(board), embed_buffers=True)
    memory = MemoryFile(files["model.gltf"], ".gltf", "text.gltf")
    return Mesh(mesh_data=InMemoryMesh(mesh_file=memory), scale=1.0)


def _picture(text: str, frame_color: Rgba) -> Image.Image:
    font = ImageFont.load_default(_FONT_PIXELS)
    left, top, right, bottom = font.getbbox(text)
    size = int(right - left) + 2 * _MARGIN, _FONT_PIXELS + 2 * _MARGIN
    image = Image.new("RGB", size, "white")
    draw = ImageDraw.Draw(image)
    rgb = (frame_color.r(), frame_color.g(), frame_color.b())
    outline = tuple(round(255 * channel) for channel in rgb)
    draw.rectangle((0, 0, size[0] - 1, size[1] - 1), outline=outline, width=_FRAME)
    draw.text((_MARGIN - left, (size[1] - bottom - top) / 2), text, fill="black", font=font)
    return image
