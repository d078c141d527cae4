"""The surface of any closed mesh, sampled evenly."""

from collections.abc import Sequence

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError, NoGroundError
from drake_pregrasp.geometry.no_touch import NoTouchArea, is_forbidden
from drake_pregrasp.geometry.sampling import Triangles, choose_evenly, split_triangles
from drake_pregrasp.geometry.shapes import Shape
from drake_pregrasp.geometry.surface import ForbiddenPoints, ObjectSurface

_DISTANCE = 0.75
"""Least distance of two candidates, as a share of the spacing: neighbours are 0.75 to 1.5 apart."""

EDGE = 0.5
"""Longest edge of the triangles that patches are made of, as a share of the spacing."""

_SLIVER = 1e-8
"""Area of triangles too thin to have a normal, as a share of their largest edge's square."""


def mesh_surface(
    shape: Shape,
    *,
    spacing: float,
    seed: int = 0,
    no_touch: Sequence[NoTouchArea] = (),
    forbidden_spacing: float = 0.02,
    forbidden_radius: float = 0.005,
) -> ObjectSurface:
    """Makes the surface of a homogeneous body out of its mesh.

    Candidates are spread evenly over the allowed ground, and each stands for the patch that is
    nearer to it than to the others. Forbidden ground becomes forbidden points.

    Args:
        shape: The closed mesh.
        spacing: Distance of neighbouring candidates, in metres, on the average.
        seed: Of the candidates' choice.
        no_touch: Ground that no contact may be on.
        forbidden_spacing: The same distance for forbidden points, in metres.
        forbidden_radius: R_j of each forbidden point, in metres.

    Raises:
        InvalidArgumentError: If a length is not above 0, or the spacing is so fine that the
            triangles would not fit into memory.
        NoGroundError: If no ground is left for contacts.
    """
    if not (spacing > 0 and forbidden_spacing > 0):
        raise InvalidArgumentError("spacings must be above 0 m")
    mesh = shape.mesh
    triangles = split_triangles(
        np.array(mesh.triangles), np.array(mesh.face_normals), EDGE * spacing
    )
    triangles = triangles.chosen(triangles.areas > _SLIVER * (EDGE * spacing) ** 2)
    forbidden = is_forbidden(triangles, shape.face_parts, no_touch)
    allowed = triangles.chosen(~forbidden)
    if len(allowed.faces) == 0:
        raise NoGroundError(
            "no ground is left for contacts: make the forbidden areas smaller, or the spacing,"
            " since small triangles that reach into an area are forbidden as a whole"
        )
    generator = np.random.default_rng(seed)
    samples, owners = choose_evenly(allowed, _DISTANCE * spacing, generator)
    order = np.argsort(owners, kind="stable")
    return ObjectSurface(
        p_OQ=allowed.centroids[samples],
        nhat_OQ=allowed.normals[samples],
        areas=np.bincount(owners, weights=allowed.areas).astype(float),
        forbidden=_forbidden_points(
            triangles.chosen(forbidden), forbidden_spacing, forbidden_radius, generator
        ),
        p_OCoM=shape.p_OCoM,
        mesh=mesh,
        patches=allowed.corners[order],
        patch_starts=np.concatenate([[0], np.cumsum(np.bincount(owners))]),
    )


def _forbidden_points(
    ground: Triangles, spacing: float, radius: float, generator: np.random.Generator
) -> ForbiddenPoints:
    if len(ground.faces) == 0:
        return ForbiddenPoints.none()
    samples, _ = choose_evenly(ground, _DISTANCE * spacing, generator)
    points: FloatArray = ground.centroids[samples]
    return ForbiddenPoints(points, np.full(len(points), radius), ground.normals[samples])
