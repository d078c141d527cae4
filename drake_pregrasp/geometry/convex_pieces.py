"""Convex pieces of a body, for links: what a hand must keep clear of is convex to its solver."""

import importlib.util

import numpy as np
import trimesh

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError

_CONCAVITY = 0.03
"""Largest concavity of a piece, as CoACD measures it, relative to the size of the body."""


def convex_pieces(mesh: trimesh.Trimesh) -> list[FloatArray]:
    """Returns the vertices of convex pieces that cover a body, each of shape (k, 3), in metres.

    A convex body is one piece. Others are divided by CoACD, of the extra `objects`.

    Args:
        mesh: Closed mesh of the body.

    Raises:
        InvalidArgumentError: If the body is not convex, and the extra is not installed.
    """
    if mesh.is_convex:
        return [np.array(mesh.convex_hull.vertices)]
    check_pieces(mesh)
    import coacd  # type: ignore[import-untyped]

    coacd.set_log_level("error")
    whole = coacd.Mesh(mesh.vertices, mesh.faces)
    pieces = coacd.run_coacd(whole, threshold=_CONCAVITY, seed=0)
    return [np.array(vertices) for vertices, _ in pieces]


def check_pieces(mesh: trimesh.Trimesh) -> None:
    """Checks that a body can be divided into convex pieces.

    Args:
        mesh: Closed mesh of the body.

    Raises:
        InvalidArgumentError: See `convex_pieces`.
    """
    if not mesh.is_convex and importlib.util.find_spec("coacd") is None:
        raise InvalidArgumentError(
            "a hand needs the convex pieces of an object that is not convex, from the extra"
            " objects: pip install 'drake_pregrasp[objects]'"
        )
