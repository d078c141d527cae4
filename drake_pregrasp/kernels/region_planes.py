"""The half-spaces whose intersection is a region of Eq. 1."""

import numpy as np

from drake_pregrasp.arrays import FloatArray


def region_planes(
    contact: int, r: FloatArray, h: FloatArray, z: FloatArray, R: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Returns the planes n·q <= b of one contact's region, the other contacts' first.

    Between c_i and c_k both contacts' planes are each other's exact negatives, so that also after
    rounding each point is on one side. Of equals the lowest index has a point: against a contact
    before it, n·q < b, which is n·q <= the number before b.

    Args:
        contact: i, not lost.
        r: Contacts c_i relative to the centre of mass, shape (n, 3), in metres.
        h: Weights h_i, shape (n,), in m²; -inf for the lost, which have no planes.
        z: Forbidden points, as the contacts, shape (m, 3), in metres.
        R: Their radii, shape (m,), in metres.

    Returns:
        Normals, shape (k, 3), and bounds, shape (k,).
    """
    powers = np.einsum("ij,ij->i", r, r) - h
    others = np.flatnonzero(np.isfinite(h))
    others = others[others != contact]
    bounds = (powers[others] - powers[contact]) / 2
    bounds = np.where(others < contact, np.nextafter(bounds, -np.inf), bounds)
    normals, distances = forbidden_planes(r[[contact]], z, R)
    return (
        np.concatenate([r[others] - r[contact], normals[0]]),
        np.concatenate([bounds, distances[0]]),
    )


def forbidden_planes(r: FloatArray, z: FloatArray, R: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns the planes n·q <= b of all contacts against forbidden points (Eq. 2).

    Args:
        r: As of `region_planes`, and so the next two.
        z: Forbidden points.
        R: Their radii.

    Returns:
        Normals, shape (n, m, 3), and bounds, shape (n, m).
    """
    normals = z - r[:, None]
    d = np.sqrt(np.einsum("ijk,ijk->ij", normals, normals))
    return normals, np.einsum("ijk,ik->ij", normals, r) + d * (d - R)
