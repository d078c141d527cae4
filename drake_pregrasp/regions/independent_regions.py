"""Independent contact regions: the share of choices in safe regions with force closure.

Regions are independent if every choice of one point in each has force closure (Nguyen, 1988). Safe
regions do not guarantee that, so this measures the share of choices that have it.
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

_LEAST_MARGIN = 1e-7  # The linear program returns a margin of zero up to this error.


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
    """Returns the share of sampled choices, one candidate per region, with force closure.

    Candidates are sampled with probabilities proportional to the areas that they represent. The
    lower bound in closed form decides the clear cases, and a linear program the others. Contacts
    without a region are ignored.

    Args:
        surface: The object's surface.
        regions: The contacts' safe regions over its candidates.
        friction: Coulomb's coefficient.
        generator: Random generator; its state advances.
        samples: Number of sampled choices.
        model: One of `CONE_MODELS`.
        torsional_friction: Torsional friction of the soft finger, in metres.

    Raises:
        InvalidArgumentError: As for `min_weight_margin`.
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
            p_CoMC[index], nhat[index], friction, model=model, torsional_friction=torsional_friction
        )
        closed[index] = margin > _LEAST_MARGIN
    return float(np.mean(closed))
