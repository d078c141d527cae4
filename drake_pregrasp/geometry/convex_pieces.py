"""Convex pieces of a mesh (extra `mujoco`)."""

import trimesh

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.resources import require_packages

CONCAVITY = 0.05
"""Largest concavity of a piece as CoACD measures it, for a mesh that fits into a cube of edge 2."""

_SEARCH = {"mcts_iterations": 40, "mcts_nodes": 10}  # Half of the default time, and as many pieces.


def convex_pieces(mesh: trimesh.Trimesh) -> list[FloatArray]:
    """Returns the vertices of convex pieces that approximate a mesh, each of shape (k, 3).

    Pieces are found by CoACD (Wei et al. 2022, Approximate convex decomposition for 3D meshes with
    collision-aware concavity and tree search), which takes some seconds.

    Args:
        mesh: Watertight mesh, in metres.

    Raises:
        InvalidArgumentError: If the mesh is not convex, and coacd is not installed.
    """
    if mesh.is_convex:
        return [mesh.convex_hull.vertices]
    require_packages("coacd", extra="mujoco", purpose="a mesh that is not convex")
    import coacd

    coacd.set_log_level("error")
    given = coacd.Mesh(mesh.vertices, mesh.faces)
    pieces = coacd.run_coacd(given, CONCAVITY, preprocess_mode="off", **_SEARCH)
    return [vertices for vertices, _ in pieces]
