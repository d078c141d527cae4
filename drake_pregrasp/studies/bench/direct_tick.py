"""A planning tick as the paper prints it: broadcast distances, one decomposition a point."""

from collections.abc import Callable

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.contact_models import grasp_matrix
from drake_pregrasp.quality.grasp_quality import grasp_quality

STRATEGIES = {
    "position": ("position", "hand"),
    "msv": ("msv", "hand"),
    "gii": ("gii", "hand"),
    "vew": ("vew", "hand"),
    "msv of the contact": ("msv", "contact"),
    "gii of the contact": ("gii", "contact"),
    "vew of the contact": ("vew", "contact"),
    "margin": ("margin", "hand"),
}
"""Strategy and reading by what reports call them; of a measure without more, the hand's."""

DIRECT_SAMPLE = 2000
"""Points that the direct transcription is timed on, if there are more: its time is scaled."""

SPREAD = 0.04
"""Standard deviation of Eq. 3, in metres, as `planner.position_spread`."""

Tick = Callable[[FloatArray], FloatArray]
"""Plans once, from contacts in O, shape (n, 3), and returns the goals' measures."""


def direct_tick(surface: ObjectSurface, strategy: str) -> Tick:
    """Returns a tick of Eq. 1-7 with one of `STRATEGIES`, on a sample of the candidates."""
    size = len(surface.p_OQ)
    sample = np.random.default_rng(1).permutation(size)[:DIRECT_SAMPLE]
    q, areas = surface.p_OQ[sample], surface.areas[sample]
    r_Q = q - surface.p_OCoM
    z, R = surface.forbidden.points, surface.forbidden.radii
    measure, reading = STRATEGIES[strategy]

    def weight(contact: int, point: int, r: FloatArray) -> float:
        if measure == "position":
            return float(np.exp(-(r_Q[point] @ r_Q[point]) / SPREAD**2 / 2))
        moved = r_Q[[point]] if reading == "contact" else r.copy()
        if reading == "hand":
            moved[contact] = r_Q[point]
        sigma = np.linalg.svd(grasp_matrix(moved, None, "complete"), compute_uv=False)
        if measure == "vew":
            return float(np.prod(sigma))
        return float(sigma[-1] / (sigma[0] if measure == "gii" else 1))

    def tick(p_OC: FloatArray) -> FloatArray:
        own = np.sum((q[:, None] - p_OC) ** 2, axis=2)
        other = np.sum((q[:, None] - z) ** 2, axis=2)
        d = np.sqrt(np.sum((p_OC[:, None] - z) ** 2, axis=2))
        w = 2 * R * d - d**2
        cells = np.argmin(own, axis=1)
        r = p_OC - surface.p_OCoM
        centroids, regions = [], []
        for contact in range(len(p_OC)):
            free = np.all(own[:, [contact]] <= other - w[contact], axis=1)
            members = np.flatnonzero((cells == contact) & free)
            if len(members):
                b = np.array([weight(contact, point, r) for point in members.tolist()])
                if measure != "position":
                    b -= np.min(b)
                b = b * areas[members] + np.finfo(float).tiny
                centroids.append(b @ q[members] / np.sum(b))
                regions.append(sample[members])
        goals, _ = surface.project_into(np.array(centroids).reshape(-1, 3), regions)
        return grasp_quality(goals - surface.p_OCoM).to_vector()

    return tick


def direct_scale(size: int) -> float:
    """Returns by what the direct transcription's time on its sample is multiplied."""
    return max(1.0, size / DIRECT_SAMPLE)
