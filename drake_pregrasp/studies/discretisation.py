"""What the discretisation of Y does to the measures, apart from everything else."""

import numpy as np

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.contact_selection import SelectionInput, select_contacts
from drake_pregrasp.planning.grasp_quality import grasp_quality
from drake_pregrasp.planning.safe_regions import compute_safe_regions
from drake_pregrasp.planning.strategies import position_tracking
from drake_pregrasp.planning.surface import ObjectSurface
from drake_pregrasp.simulation.scenario import Scenario

SPACINGS = (0.01, 0.005, 0.0025)
"""Spacings to compare, in metres."""


def largest_drops(
    scenario: Scenario, spacing: float, *, starts: int = 60, ticks: int = 40, settle: int = 5
) -> FloatArray:
    """Returns the largest fall of Q_GII from one tick to the next, shape (starts,).

    Position tracking is iterated on the object at rest, with neither noise nor physics: what is
    left of ups and downs once the contacts are near their places comes from the candidates' finite
    number.

    Args:
        scenario: Object, surface and spread.
        spacing: Spacing of the candidates, in metres.
        starts: Number of random initial contact sets, the same for all spacings.
        ticks: Ticks for each.
        settle: First ticks, in which contacts travel, to leave out.
    """
    surface = scenario.make_surface(spacing)
    half = np.array(scenario.object.size) / 2
    covariance = scenario.planner.position_spread**2 * np.eye(3)
    drops = []
    for start in range(starts):
        p_OC, _ = surface.project(np.random.default_rng(start).uniform(-half, half, (5, 3)))
        values = []
        for _ in range(ticks):
            p_OC = _step(surface, p_OC, covariance)
            values.append(grasp_quality(p_OC).q_gii)
        drops.append(max(0.0, -float(np.min(np.diff(values[settle:])))))
    return np.array(drops)


def _step(surface: ObjectSurface, p_OC: FloatArray, covariance: FloatArray) -> FloatArray:
    weights = np.zeros(len(p_OC))
    regions = compute_safe_regions(surface.p_OQ, p_OC, weights, surface.forbidden)
    return select_contacts(
        SelectionInput(surface, p_OC, regions, covariance), position_tracking
    ).p_OC
