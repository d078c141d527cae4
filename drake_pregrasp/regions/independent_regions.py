"""Independent contact regions: does it matter where in its region each contact ends up?

Regions are independent if every choice of one point a region is force-closed (Nguyen, 1988). Safe
regions are not made that way; what can be said of them is the share of choices that are.
"""

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.force_closure import (
    TORSIONAL_FRICTION,
    least_norm_margin,
    min_weight_margin,
)
from drake_pregrasp.regions.safe_regions import SafeRegions

_LEAST_MARGIN = 1e-7  # What the linear programme returns for nothing may differ from zero by less.


def force_closed_share(
    surface: ObjectSurface,
    regions: SafeRegions,
    friction: float,
    *,
    generator: np.random.Generator,
    samples: int = 100,
    model: str = "hard_finger",
    torsional_friction: float = TORSIONAL_FRICTION,
) -> float:
    """Returns which share of sampled choices, one candidate a region, has force closure, in [0, 1].

    Candidates are drawn by the areas they stand for. The bound in closed form decides the good
    choices; the linear programme is run for what is left. Contacts without a region take no part.

    Args:
        surface: The object's surface.
        regions: The contacts' safe regions over its candidates.
        friction: Coulomb's coefficient.
        generator: What draws; it is left advanced.
        samples: Number of choices.
        model: One of `CONE_MODELS`.
        torsional_friction: Of the soft finger, in metres.

    Raises:
        InvalidArgumentError: As of `min_weight_margin`.
    """
    chosen = []
    for contact in np.flatnonzero(regions.sizes() > 0):
        q = regions.members(int(contact))
        share = surface.areas[q] / np.sum(surface.areas[q])
        chosen.append(generator.choice(q, size=samples, p=share))
    if not chosen:
        return 0.0
    picks = np.stack(chosen, axis=1)
    p_CoMC: FloatArray = surface.p_OQ[picks] - surface.p_OCoM
    nhat = surface.nhat_OQ[picks]
    bound = least_norm_margin(
        p_CoMC, nhat, friction, model=model, torsional_friction=torsional_friction
    )
    closed = bound > _LEAST_MARGIN
    for index in np.flatnonzero(~closed & np.isfinite(bound)):
        margin = min_weight_margin(
            p_CoMC[index],
            nhat[index],
            friction,
            model=model,
            torsional_friction=torsional_friction,
        )
        closed[index] = margin > _LEAST_MARGIN
    return float(np.mean(closed))
