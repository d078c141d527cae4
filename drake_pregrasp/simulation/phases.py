"""The phases of a run: contacts held, contacts adapting, and what follows a damage."""

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.goal_limits import hold_contacts
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.grasp_quality import GraspQuality, grasp_quality
from drake_pregrasp.regions.safe_regions import compute_safe_regions
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.ticks import SLACK


def ticks_from(scenario: Scenario, times: FloatArray, start: float) -> int:
    """Returns the index of the first of the ticks' times that is not before `start`."""
    return int(np.searchsorted(times, start - SLACK * scenario.planner.period))


def static_end(scenario: Scenario) -> float:
    """When initial contacts are no longer held, or no longer all there, in seconds.

    It is a trifle earlier, so that the first tick from then on is not before it by rounding.
    """
    first_loss = min((event.at for event in scenario.damage), default=np.inf)
    end = min(scenario.planner.static_duration, first_loss)
    return float(end - SLACK * scenario.planner.period)


def static_phase(scenario: Scenario, times: FloatArray) -> slice:
    """The ticks at which all initial contacts are held."""
    return slice(0, ticks_from(scenario, times, static_end(scenario)))


def adapting_phase(scenario: Scenario, times: FloatArray) -> slice:
    """The ticks at which all initial contacts adapt."""
    start = ticks_from(scenario, times, scenario.planner.static_duration)
    first_loss = min((event.at for event in scenario.damage), default=np.inf)
    return slice(start, max(start, ticks_from(scenario, times, first_loss)))


def last_phase(scenario: Scenario, times: FloatArray) -> slice:
    """The ticks at which contacts adapt and no more damage comes: what the paper's tables show."""
    last_loss = max((event.at for event in scenario.damage), default=0.0)
    start = max(scenario.planner.static_duration, last_loss)
    return slice(ticks_from(scenario, times, start), None)


def remaining_static_quality(scenario: Scenario, surface: ObjectSurface) -> GraspQuality:
    """Measures those of the initial contacts that no damage takes and that are active."""
    p_OC = scenario.initial_p_OC(surface)
    weights = np.full(len(p_OC), -np.inf)
    weights[scenario.remaining_contacts()] = 0.0
    regions = compute_safe_regions(surface.p_OQ, p_OC, weights, surface.forbidden)
    held = hold_contacts(SelectionInput(surface, p_OC, regions, np.eye(3)))
    return grasp_quality(p_OC[held.active] - surface.p_OCoM)
