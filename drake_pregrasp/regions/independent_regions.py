"""Independent contact regions: the share of choices in safe regions with force closure.

Regions are independent if every choice of one point in each has force closure (Nguyen, 1988). Safe
regions do not guarantee that, so this measures the share of choices that have it, and how far each
contact may slip, with the others fixed, until the bound of `least_norm_margin` no longer proves
force closure. Slips are straight distances, so a contact that slips over the surface, or around an
edge, slips farther. Candidates sample the places where it may slip to.
"""

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality import force_closure
from drake_pregrasp.quality.force_closure import LEAST_MARGIN
from drake_pregrasp.quality.margin_bounds import least_norm_margin
from drake_pregrasp.regions.safe_regions import SafeRegions


def force_closed_share(
    surface: ObjectSurface,
    regions: SafeRegions,
    friction: float,
    *,
    generator: np.random.Generator,
    samples: int = 100,
    model: str = "hard_finger",
    torsional_friction: float = force_closure.TORSIONAL_FRICTION,
) -> float:
    """Returns the share of sampled choices, one candidate per region, with force closure.

    Candidates are sampled with probabilities proportional to the areas that they represent. The
    lower bound in closed form decides the clear cases, and the margin itself the others. Contacts
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
    closed = bound > LEAST_MARGIN
    for index in np.flatnonzero(~closed & np.isfinite(bound)):
        margin = force_closure.min_weight_margin(
            p_CoMC[index], nhat[index], friction, model=model, torsional_friction=torsional_friction
        )
        closed[index] = margin > LEAST_MARGIN
    return float(np.mean(closed))


def slip_radii(surface: ObjectSurface, is_closed: BoolArray, places: IntArray) -> FloatArray:
    """Returns how far a contact may slip from candidates until force closure is lost, shape (k,).

    It is the distance of the nearest candidate without force closure, in metres; zero for a
    candidate that has none itself.

    Args:
        surface: The object's surface.
        is_closed: Mask of the candidates at which the contact leaves force closure, shape (N,).
        places: Indices of the candidates, shape (k,).
    """
    if is_closed.all():
        return np.full(len(places), 2 * surface.longest_lever_arm)  # No slip is longer.
    radii, closed = np.zeros(len(places)), is_closed[places]
    if closed.any():
        radii[closed] = cKDTree(surface.p_OQ[~is_closed]).query(surface.p_OQ[places[closed]])[0]
    return radii


def slip_radii_within(
    surface: ObjectSurface,
    p_OC: FloatArray,
    nhat_OC: FloatArray,
    radius: float,
    friction: float,
    *,
    model: str = "hard_finger",
    torsional_friction: float = force_closure.TORSIONAL_FRICTION,
) -> FloatArray:
    """Returns how far each of n contacts may slip until force closure is lost, shape (n,).

    Args:
        surface: The object's surface.
        p_OC: Contacts in O, shape (n, 3), in metres.
        nhat_OC: Outward unit normals at the contacts, shape (n, 3).
        radius: Radius up to which slips are examined, the largest result, in metres.
        friction: Coulomb's coefficient.
        model: One of `CONE_MODELS`.
        torsional_friction: Torsional friction of the soft finger, in metres.
    """
    slips, places, normals = [], [], []
    for i, p_OCi in enumerate(p_OC):
        near = surface.candidates_within(p_OCi, radius)
        distances = np.linalg.norm(surface.p_OQ[near] - p_OCi, axis=1)
        near, distances = near[distances < radius], distances[distances < radius]
        slips.append(np.append(0.0, distances))  # The contact itself comes first.
        places.append(np.repeat(p_OC[None], len(near) + 1, axis=0))
        normals.append(np.repeat(nhat_OC[None], len(near) + 1, axis=0))
        places[i][1:, i], normals[i][1:, i] = surface.p_OQ[near], surface.nhat_OQ[near]
    if not slips:
        return np.empty(0)
    bound = least_norm_margin(
        np.concatenate(places) - surface.p_OCoM,
        np.concatenate(normals),
        friction,
        model=model,
        torsional_friction=torsional_friction,
    )
    own = np.split(bound > LEAST_MARGIN, np.cumsum([len(slip) for slip in slips])[:-1])
    return np.array(
        [np.min(slip[~closed], initial=radius) for slip, closed in zip(slips, own, strict=True)]
    )


SlipRadii = Callable[[ObjectSurface, FloatArray, FloatArray, float, float], FloatArray]
"""An implementation of `slip_radii_within` for hard fingers."""
