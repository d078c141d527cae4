"""Hysteresis in quality: goals that move only as far as a measure of the grasp allows."""

from collections.abc import Callable, Sequence

import numpy as np

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.planning.arrays import BoolArray, FloatArray
from drake_pregrasp.planning.force_closure import min_weight_margin
from drake_pregrasp.planning.grasp_quality import grasp_quality
from drake_pregrasp.planning.surface import ObjectSurface

GUARDS = ("none", "q_msv", "q_gii", "q_vew", "margin")
"""What may not become worse: nothing, a measure of the complete grasp matrix, the margin."""

Measure = Callable[[FloatArray, FloatArray], float]
"""Maps lever arms and normals of active contacts, shapes (n, 3), to a quality."""


def guard_measure(name: str, friction: float) -> Measure | None:
    """Returns the measure of that name.

    Args:
        name: One of `GUARDS`.
        friction: Coulomb's coefficient, for the margin.

    Raises:
        InvalidArgumentError: If there is none of that name.
    """
    if name not in GUARDS:
        raise InvalidArgumentError(f"no guard {name!r}; there are: {', '.join(GUARDS)}")
    if name == "none":
        return None
    if name == "margin":
        return lambda p_CoMC, nhat: min_weight_margin(p_CoMC, nhat, friction)
    return lambda p_CoMC, nhat: float(getattr(grasp_quality(p_CoMC), name))


def keep_quality(
    surface: ObjectSurface,
    goals: FloatArray,
    p_OC_before: FloatArray,
    active: BoolArray,
    measure: Measure,
    groups: Sequence[Sequence[int]],
) -> FloatArray:
    """Lets contacts move one after another, each only if the grasp doesn't become worse by it.

    Args:
        surface: The object's surface.
        goals: Where the contacts would go, shape (n, 3), in metres.
        p_OC_before: Where they are, shape (n, 3).
        active: Those that take part in the grasp, shape (n,); the others move freely.
        measure: Of the active contacts.
        groups: Contacts that move together; each contact is in one group.

    Returns:
        Shape (n, 3). The measure is at least that of `p_OC_before`.
    """
    accepted = np.where(active[:, None], p_OC_before, goals)
    quality = _quality(surface, accepted, active, measure)
    for group in groups:
        members = [contact for contact in group if active[contact]]
        if not members or np.all(goals[members] == accepted[members]):
            continue
        proposal = accepted.copy()
        proposal[members] = goals[members]
        proposed_quality = _quality(surface, proposal, active, measure)
        if proposed_quality >= quality:
            accepted, quality = proposal, proposed_quality
    return accepted


def _quality(
    surface: ObjectSurface, p_OC: FloatArray, active: BoolArray, measure: Measure
) -> float:
    if not np.any(active):
        return 0.0
    _, normals = surface.project(p_OC[active])
    return measure(p_OC[active] - surface.p_OCoM, normals)
