"""What pictures by Drake's renderers are drawn with: triangles as meshes, and a camera's pose."""

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh, Mesh
from pydrake.math import RigidTransform, RotationMatrix

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.geometry.sampling import unit_normals


def drawn_mesh(triangles: FloatArray, lift: float = 0.0) -> Mesh:
    """Returns triangles as a mesh with flat normals.

    Args:
        triangles: Shape (k, 3, 3), in metres.
        lift: How far along their normals they are moved, in metres.
    """
    normals = unit_normals(triangles)
    corners = (triangles + lift * normals[:, None]).reshape(-1, 3)
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in corners.tolist()]
    lines += [f"vn {x:.6f} {y:.6f} {z:.6f}" for x, y, z in normals.tolist()]
    lines += [
        f"f {3 * k + 1}//{k + 1} {3 * k + 2}//{k + 1} {3 * k + 3}//{k + 1}"
        for k in range(len(normals))
    ]
    text = ("\n".join(lines) + "\n").encode()
    memory = MemoryFile(text, ".obj", "drawn.obj")
    return Mesh(mesh_data=InMemoryMesh(mesh_file=memory), scale=1.0)


def camera_pose(p_FT: FloatArray, p_TK: FloatArray) -> RigidTransform:
    """Returns X_FK of an upright camera K (z forward, y down) that looks at a target T.

    Args:
        p_FT: The target in a frame F whose z points up, shape (3,), in metres.
        p_TK: Where the camera is from there, in F, shape (3,), in metres; not along z.
    """
    z = -p_TK / np.linalg.norm(p_TK)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    R_FK = RotationMatrix(np.column_stack([x, np.cross(z, x), z]))
    return RigidTransform(R_FK, p_FT + p_TK)
