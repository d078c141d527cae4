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

REFERENCE_SPACING = 0.00125
"""Spacing of the surface that stands for a continuous one, in metres."""


def discretisation_costs(
    scenario: Scenario, *, starts: int = 20, ticks: int = 12
) -> dict[float, FloatArray]:
    """Returns what each spacing costs: the largest loss of Q_GII in a step, shape (starts,).

    Position tracking is iterated on the reference surface, with neither noise nor physics. At each
    tick one step from the same contacts is made on each coarser surface as well; by how much its
    Q_GII stays below the reference's is what the candidates' finite number costs.

    Args:
        scenario: Object, surface and spread.
        starts: Number of random initial contact sets, the same for all spacings.
        ticks: Ticks for each.
    """
    fine = scenario.make_surface(REFERENCE_SPACING)
    coarse = {spacing: scenario.make_surface(spacing) for spacing in SPACINGS}
    half = np.array(scenario.object.size) / 2
    covariance = scenario.planner.position_spread**2 * np.eye(3)
    costs = {spacing: np.zeros(starts) for spacing in SPACINGS}
    for start in range(starts):
        p_OC, _ = fine.project(np.random.default_rng(start).uniform(-half, half, (5, 3)))
        for _ in range(ticks):
            p_OC_next = _step(fine, p_OC, covariance)
            reference = grasp_quality(p_OC_next).q_gii
            for spacing, surface in coarse.items():
                cost = reference - grasp_quality(_step(surface, p_OC, covariance)).q_gii
                costs[spacing][start] = max(costs[spacing][start], cost)
            p_OC = p_OC_next
    return costs


def _step(surface: ObjectSurface, p_OC: FloatArray, covariance: FloatArray) -> FloatArray:
    weights = np.zeros(len(p_OC))
    regions = compute_safe_regions(surface.p_OQ, p_OC, weights, surface.forbidden)
    return select_contacts(
        SelectionInput(surface, p_OC, regions, covariance), position_tracking
    ).p_OC
