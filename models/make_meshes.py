"""Writes mug.obj, bracket.obj and turntable.obj into this folder.

It needs the packages manifold3d and trimesh. The files are kept; this script says how they were
made.
"""

from pathlib import Path

import numpy as np
import trimesh

FOLDER = Path(__file__).parent

# Of the mug, in metres.
RADIUS, INNER_RADIUS = 0.040, 0.0365
HEIGHT, FLOOR = 0.095, 0.005
HANDLE_RADIUS, HANDLE_HALF_HEIGHT, HANDLE_THICKNESS = 0.028, 0.030, 0.0055
HANDLE_REACHES_IN = 0.003
HANDLE_AZIMUTH = 2.97  # In radians.
SECTIONS = 72

# Of the turntable, in metres.
DISC_RADIUS, DISC_THICKNESS = 0.16, 0.03
DISC_SECTIONS = 48


def mug() -> tuple[trimesh.Trimesh, dict[str, np.ndarray]]:
    """Returns a mug that stands on z = 0, its handle near -x, and masks of its parts."""
    outer = trimesh.creation.cylinder(
        RADIUS, segment=[[0, 0, 0], [0, 0, HEIGHT]], sections=SECTIONS
    )
    inner = trimesh.creation.cylinder(
        INNER_RADIUS, segment=[[0, 0, FLOOR], [0, 0, 2 * HEIGHT]], sections=SECTIONS
    )
    handle = trimesh.creation.torus(1.0, HANDLE_THICKNESS, major_sections=48, minor_sections=20)
    # Stretch the ring, not the rod: move each vertex with the ring's own line.
    along = np.arctan2(handle.vertices[:, 1], handle.vertices[:, 0])
    line = np.stack([np.cos(along), np.sin(along), np.zeros_like(along)], axis=1)
    handle.vertices += line * [HANDLE_RADIUS, HANDLE_HALF_HEIGHT, 0] - line
    handle.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    handle.apply_translation([RADIUS - HANDLE_REACHES_IN, 0, HEIGHT / 2])
    mesh = trimesh.boolean.union([outer, handle], engine="manifold")
    mesh = trimesh.boolean.difference([mesh, inner], engine="manifold")

    centers = mesh.triangles_center
    radius = np.hypot(centers[:, 0], centers[:, 1])
    up = mesh.face_normals[:, 2]
    rim = (np.abs(centers[:, 2] - HEIGHT) < 1e-6) & (up > 0.9)
    inside = (radius < INNER_RADIUS + 1e-6) & (centers[:, 2] > FLOOR / 2) & ~rim
    on_wall = np.abs(np.linalg.norm(mesh.triangles[:, :, :2], axis=2) - RADIUS) < 1e-6
    handle_faces = (centers[:, 0] > 0) & (radius > RADIUS - 1e-3) & ~np.all(on_wall, axis=1)
    handle_faces &= ~rim & (centers[:, 2] > 1e-6)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(HANDLE_AZIMUTH, [0, 0, 1]))
    return mesh, {"inside": inside, "handle": handle_faces, "body": ~inside & ~handle_faces}


def bracket() -> tuple[trimesh.Trimesh, dict[str, np.ndarray]]:
    """Returns an angle bracket of two plates, 4 mm thick, and masks of its parts."""
    length, width, thickness = 0.09, 0.07, 0.004
    base = trimesh.creation.box(bounds=[[0, -width / 2, 0], [length, width / 2, thickness]])
    wall = trimesh.creation.box(bounds=[[0, -width / 2, 0], [thickness, width / 2, length]])
    mesh = trimesh.boolean.union([base, wall], engine="manifold")
    mesh.apply_translation([-0.03, 0, 0])
    upright = mesh.triangles_center[:, 2] > thickness + 1e-6
    return mesh, {"wall": upright, "base": ~upright}


def turntable() -> tuple[trimesh.Trimesh, dict[str, np.ndarray]]:
    """Returns a disc with its top in z = 0, and the mask of all its triangles.

    Each triangle of its top is as large as possible. An object near the middle then touches few of
    them, and few patches of contact take little time.
    """
    around = np.arange(DISC_SECTIONS)
    angles = 2 * np.pi * around / DISC_SECTIONS
    ring = DISC_RADIUS * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    top = []

    def fill(first: int, last: int) -> None:
        if last - first > 1:
            middle = (first + last) // 2
            top.append([first, middle, last % DISC_SECTIONS])
            fill(first, middle)
            fill(middle, last)

    third = DISC_SECTIONS // 3
    top.append([0, third, 2 * third])
    for first in top[0]:
        fill(first, first + third)
    after, below = (around + 1) % DISC_SECTIONS, DISC_SECTIONS
    bottom = below + np.array(top)[:, ::-1]
    side = [*np.c_[around, below + around, below + after], *np.c_[around, below + after, after]]
    vertices = np.vstack([np.c_[ring, 0 * angles], np.c_[ring, 0 * angles - DISC_THICKNESS]])
    mesh = trimesh.Trimesh(vertices, np.vstack([top, bottom, side]), process=False)
    return mesh, {"disc": np.ones(len(mesh.faces), dtype=bool)}


def write(name: str, mesh: trimesh.Trimesh, parts: dict[str, np.ndarray]) -> None:
    """Writes a mesh as OBJ, one object for each part, over the same vertices."""
    lines = [f"# {name}, in metres; made by make_meshes.py."]
    lines += [f"v {x:.7f} {y:.7f} {z:.7f}" for x, y, z in mesh.vertices]
    for part, mask in parts.items():
        lines.append(f"o {part}")
        lines += [f"f {a} {b} {c}" for a, b, c in mesh.faces[mask] + 1]
    (FOLDER / f"{name}.obj").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write("mug", *mug())
    write("bracket", *bracket())
    write("turntable", *turntable())
