"""What the discretisation of Y does to the measures, and the paper's claims about it."""

from collections.abc import Mapping

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.centroids import select_contacts
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import position_tracking
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.grasp_quality import grasp_quality
from drake_pregrasp.regions.safe_regions import compute_safe_regions
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.studies.case_runs import CaseLog
from drake_pregrasp.studies.claims import Claim

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
    half = fine.mesh.extents / 2
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


def spacing_costs_quality(costs: Mapping[float, FloatArray]) -> Claim:
    """Sec. IV.B: the discretisation of Y costs quality.

    Args:
        costs: From `discretisation_costs`.
    """
    means = {spacing: float(np.mean(costs[spacing])) for spacing in sorted(costs, reverse=True)}
    return Claim(
        "The discretisation of Y costs quality, the less the finer it is",
        holds=bool(np.all(np.diff(list(means.values())) < 0)),
        numbers={"largest_loss_of_q_gii_in_a_step": _by_spacing(means)},
        remark="Against one step on a much finer surface from the same contacts.",
    )


def drops_come_from_spacing(logs: Mapping[float, CaseLog]) -> Claim:
    """Sec. IV.B: the drops of the measures over time come from the discretisation of Y.

    Args:
        logs: For each spacing, a run of the base case without measurement noise.
    """
    drops = {}
    for spacing in sorted(logs, reverse=True):
        log = logs[spacing]
        q_gii = log.columns["q_gii"][log.settled]
        drops[spacing] = float(max(0.0, -np.min(np.diff(q_gii))))
    holds = bool(np.all(np.diff(list(drops.values())) < 0))
    return Claim(
        "Drops of the measures over time come from the discretisation of Y",
        holds=holds,
        numbers={"largest_drop_of_q_gii_between_ticks": _by_spacing(drops)},
        remark=""
        if holds
        else f"Without measurement noise the largest drop is {max(drops.values()):.1g}: candidates"
        " are fixed on the object, so that contacts, once at rest, stay so at any spacing. The"
        " paper's candidates may have been drawn anew as the object moved.",
    )


def _by_spacing(values: Mapping[float, float]) -> dict[str, float]:
    return {f"{1e3 * spacing:g} mm": value for spacing, value in values.items()}
