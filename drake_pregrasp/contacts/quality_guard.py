"""Hysteresis in quality: goals that move only as far as a measure of the grasp allows."""

from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.force_closure import LargestMinimum, min_weight_margin
from drake_pregrasp.quality.grasp_quality import QUALITY_MEASURES, grasp_quality
from drake_pregrasp.regions.independent_regions import SlipRadii, slip_radii_within

GUARDS = (*QUALITY_MEASURES, "margin")
"""Measures that can be guarded: those of the complete grasp matrix, and the margin."""

_ACCURACY = 1e-9  # Of measures: where they are equal, rounding decides nothing.

Measure = Callable[[ObjectSurface, FloatArray, FloatArray], Iterable[float]]
"""Maps a surface, and active contacts on it and their normals in O, shapes (n, 3), to measures.
They are computed one by one, so that a caller can stop at the first one that is too low."""


def guard_measure(
    names: Sequence[str],
    friction: float,
    independent_radius: float = 0.0,
    slip_radii: SlipRadii = slip_radii_within,
    solve: LargestMinimum | None = None,
) -> Measure | None:
    """Returns the named measures as one function, or None if there are none.

    The margin comes last, because it is the slowest: it solves a second-order cone program.

    Args:
        names: Names from `GUARDS`.
        friction: Coulomb's coefficient, for the margin.
        independent_radius: If above 0, how far each contact may slip is a measure, too, up to this
            radius, in metres.
        slip_radii: Implementation of `slip_radii_within`.
        solve: Implementation of `largest_minimum`.

    Raises:
        InvalidArgumentError: If a name is not in `GUARDS`.
    """
    for name in names:
        if name not in GUARDS:
            raise InvalidArgumentError(f"no guard {name!r}; there are: {', '.join(GUARDS)}")
    if not names and not independent_radius > 0:
        return None

    def measure(surface: ObjectSurface, p_OC: FloatArray, nhat: FloatArray) -> Iterator[float]:
        p_CoMC = p_OC - surface.p_OCoM
        of_the_matrix = [name for name in names if name != "margin"]
        if of_the_matrix:
            quality = grasp_quality(p_CoMC)
            yield from (getattr(quality, name) for name in of_the_matrix)
        if independent_radius > 0:
            yield from slip_radii(surface, p_OC, nhat, independent_radius, friction)
        if "margin" in names:
            yield min_weight_margin(p_CoMC, nhat, friction, solve=solve)

    return measure


def keep_quality(
    selection: SelectionInput,
    goals: FloatArray,
    may_stay: BoolArray,
    measure: Measure,
    groups: Sequence[Sequence[int]],
) -> FloatArray:
    """Moves contacts one after another, each only if no measure of the grasp falls.

    Contacts that have to move do so first. The grasp has all contacts with a region: without one
    that moves, the others would be free to lose force closure.

    Args:
        selection: Surface, contacts and regions of this tick.
        goals: Goals of the contacts, shape (n, 3), in metres.
        may_stay: Mask of the contacts that need not move, shape (n,), each with a region.
        measure: Measures of the grasp, none of which may fall.
        groups: Groups of contacts that move together; each contact is in one group.

    Returns:
        Contacts, shape (n, 3), in metres. Each measure is at least that with `selection.p_OC` for
        those that may stay, up to rounding.
    """
    # Each contact is either where it was or at its goal, so that its normal is one of two.
    surface, p_OC_before = selection.surface, selection.p_OC
    normals_before, normals_there = surface.project(p_OC_before)[1], surface.project(goals)[1]
    steps, grasp = ~may_stay, selection.active

    def quality_after(steps: BoolArray) -> Iterable[float]:
        if not np.any(grasp):
            return [0.0]
        p_OC = np.where(steps[:, None], goals, p_OC_before)[grasp]
        normals = np.where(steps[:, None], normals_there, normals_before)[grasp]
        return measure(surface, p_OC, normals)

    quality = list(quality_after(steps))
    for group in groups:
        members = [contact for contact in group if may_stay[contact]]
        if not members or np.all(goals[members] == p_OC_before[members]):
            continue
        proposal = steps.copy()
        proposal[members] = True
        proposed_quality = []
        for value, least in zip(quality_after(proposal), quality, strict=False):
            if not value >= least - _ACCURACY:
                break
            proposed_quality.append(value)
        if len(proposed_quality) == len(quality):
            steps, quality = proposal, proposed_quality
    accepted: FloatArray = np.where(steps[:, None], goals, p_OC_before)
    return accepted
