"""Writes mug.obj, bracket.obj, turntable.obj and household shapes into this folder, or another.

It needs the packages manifold3d and trimesh. The files are kept; this script says how they were
made.
"""

import sys
from collections.abc import Callable
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


def round_body(*profile: tuple[float, float], sections: int = SECTIONS) -> trimesh.Trimesh:
    """Returns the body of revolution of a profile (r, z) about z, in millimetres."""
    return trimesh.creation.revolve(1e-3 * np.array(profile), sections=sections)


def rod(radius: float, start: float, end: float, *, sections: int = 24) -> trimesh.Trimesh:
    """Returns a rod along x, one of whose faces is below if it has few, in millimetres."""
    body = round_body((0, start), (radius, start), (radius, end), (0, end), sections=sections)
    body.apply_transform(trimesh.transformations.rotation_matrix(np.pi / sections, [0, 0, 1]))
    return body.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))


def block(*bounds: tuple[float, float]) -> trimesh.Trimesh:
    """Returns a box with bounds along x, y and z, in millimetres."""
    return trimesh.creation.box(bounds=1e-3 * np.array(bounds).T)


def united(*parts: trimesh.Trimesh) -> trimesh.Trimesh:
    """Returns the union of bodies."""
    return trimesh.boolean.union(parts, engine="manifold")


def bottle() -> trimesh.Trimesh:
    """Returns a bottle of half a litre, closed by its cap."""
    side = [(29, 0), (33, 5), (33, 120), (31, 137), (24, 155), (15, 170), (13, 178), (13, 184)]
    return round_body((0, 0), *side, (15, 184), (15, 200), (0, 200))


def bowl() -> trimesh.Trimesh:
    """Returns a bowl with a foot, whose wall is 5 mm thick."""
    outside = [(28, 0), (29, 5), (38, 11), (46, 22), (51, 38), (53, 55)]
    inside = [(48, 55), (46, 38), (41, 24), (34, 15), (24, 10)]
    return round_body((0, 0), *outside, *inside, (0, 9))


def can() -> trimesh.Trimesh:
    """Returns a drinking can."""
    side = [(24, 0), (27, 3), (33, 9), (33, 106), (27, 115), (25, 115)]
    return round_body((0, 2), *side, (24, 111), (0, 111))


def pan() -> trimesh.Trimesh:
    """Returns a small pan, whose wall and bottom are 4 mm thick, with its handle along x."""
    wall = [(44, 0), (50, 38), (46, 38), (41, 4)]
    handle = block((45, 165), (-9, 9), (24, 36))
    return united(round_body((0, 0), *wall, (0, 4)), handle)


def screwdriver() -> trimesh.Trimesh:
    """Returns a screwdriver that lies on a face of its collar, with its round handle just above.

    The handle is 5 um above the table, so that no faces coincide.
    """
    return united(rod(15.718, -100, 0), rod(18, -14, 0, sections=6), rod(3.5, -10, 95))


def hammer() -> trimesh.Trimesh:
    """Returns a hammer that lies on its side."""
    head = united(block((-14, 14), (-50, 50), (0, 28)), block((-11, 11), (-58, -45), (3, 25)))
    return united(head, block((-20, 240), (-15, 15), (0, 22)))


def drill() -> trimesh.Trimesh:
    """Returns a cordless drill that stands on its battery."""
    motor, chuck = rod(26, -60, 75), rod(15, 70, 115)
    for part in (motor, chuck):
        part.apply_translation([0, 0, 0.165])
    return united(
        block((-45, 40), (-32, 32), (0, 32)), block((-22, 18), (-17, 17), (25, 155)), motor, chuck
    )


def torus() -> trimesh.Trimesh:
    """Returns a ring that lies flat."""
    return trimesh.creation.torus(0.040, 0.013, major_sections=48, minor_sections=20)


def wedge() -> trimesh.Trimesh:
    """Returns a wedge for doors, which rises along x."""
    corners = [(-55, y, z) for y in (-22, 22) for z in (0, 4)]
    corners += [(45, y, z) for y in (-22, 22) for z in (0, 40)]
    return trimesh.convex.convex_hull(1e-3 * np.array(corners, dtype=float))


def carton() -> trimesh.Trimesh:
    """Returns a carton of milk without its cap."""
    return block((-32, 32), (-32, 32), (0, 160))


def ball() -> trimesh.Trimesh:
    """Returns a ball that lies on a face, and does not roll by itself."""
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.037)
    turn = trimesh.geometry.align_vectors(mesh.face_normals[0], [0, 0, -1])
    return mesh.apply_transform(turn)


# Their frames O are at the centres of their bounding boxes.
HOUSEHOLD: tuple[Callable[[], trimesh.Trimesh], ...] = (
    bottle, bowl, can, pan, screwdriver, hammer, drill, torus, wedge, carton, ball,
)  # fmt: skip


def centred(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, dict[str, np.ndarray]]:
    """Returns a mesh about its own middle, and the mask of all its triangles."""
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    return mesh, {"body": np.ones(len(mesh.faces), dtype=bool)}


def write(folder: Path, name: str, mesh: trimesh.Trimesh, parts: dict[str, np.ndarray]) -> None:
    """Writes a mesh as OBJ, one object for each part, over the same vertices."""
    lines = [f"# {name}, in metres; made by make_meshes.py."]
    lines += [f"v {x:.7f} {y:.7f} {z:.7f}" for x, y, z in mesh.vertices]
    for part, mask in parts.items():
        lines.append(f"o {part}")
        lines += [f"f {a} {b} {c}" for a, b, c in mesh.faces[mask] + 1]
    (folder / f"{name}.obj").write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_all(folder: Path) -> None:
    """Writes all meshes into a folder."""
    for make in (mug, bracket, turntable):
        write(folder, make.__name__, *make())
    for shape in HOUSEHOLD:
        write(folder, shape.__name__, *centred(shape()))


if __name__ == "__main__":
    write_all(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
