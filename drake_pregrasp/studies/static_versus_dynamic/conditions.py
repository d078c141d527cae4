"""Conditions of the study, with scenarios from `conditions.yaml`, and starts of trials."""

import functools
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.assignment import assign_fingers_round
from drake_pregrasp.contacts.start_contacts import StartContacts
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.solids import Solid
from drake_pregrasp.simulation.obstacle_config import moving_solid
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import load_resolved
from drake_pregrasp.systems.sources import MovingSolid

_LEAST_DISTANCE = 0.024  # Least distance between random contacts, in metres.
_HEIGHTS = (-0.030, 0.035)  # Heights of random contacts above the object's centre, in metres.
_MISPLACEMENT_STD = (0.005, 0.005, float(np.radians(4)))  # x and y in m, angle about z in rad.


@dataclass(frozen=True)
class Condition:
    """One condition under which the methods are compared.

    Attributes:
        key: Name of the condition's scenario.
        label: Name of the condition in tables and figures.
        closing_times: Times at which the hand is commanded to close, in seconds. All grasps of a
            trial start from one tracking run.
    """

    key: str
    label: str
    closing_times: tuple[float, ...]

    @functools.cached_property
    def scenario(self) -> ResolvedScenario:
        """Scenario with object, motion, sensor noise, hand, obstacles and lost fingers."""
        return load_resolved(self.key, file=Path(__file__).with_name("conditions.yaml"))


def area(scenario: Scenario) -> list[MovingSolid]:
    """Returns the obstacles of a scenario at time zero, in W, with their velocities."""
    return [moving_solid(obstacle) for obstacle in scenario.obstacles]


def area_at(scenario: Scenario, time: float) -> list[Solid]:
    """Returns the solids of the obstacles at a time in seconds, in W."""
    return [moving.at(time) for moving in area(scenario)]


# The conditions by their keys, in the order of tables and figures.
CONDITIONS = {
    condition.key: condition
    for condition in (
        Condition("nominal", "nominal", (4.0, 7.0)),
        Condition("one_lost", "one finger lost", (4.0, 7.0)),
        Condition("two_lost", "two fingers lost", (4.0, 7.0)),
        Condition("turning", "turning", (4.0, 8.0, 12.0)),
        Condition("wall", "wall", (3.0, 6.0, 9.0)),
        Condition("headline", "turning beside a wall", (4.0, 8.0, 12.0)),
        Condition("passage", "passage", (2.0, 6.0, 8.0)),
        Condition("sphere", "sphere", (4.8, 6.0, 8.0)),
        Condition("noise", "noise", (4.0, 7.0)),
    )
}


class Start(NamedTuple):
    """Start of a trial, the same for all methods.

    Attributes:
        resolved: Scenario with random start contacts, lost fingers and seed of the noise.
        misplacement: Offset of the object on the table, shape (3,): x and y in metres, angle about
            z in radians.
    """

    resolved: ResolvedScenario
    misplacement: FloatArray


def random_start(resolved: ResolvedScenario, *, seed: int) -> Start:
    """Returns the start of the trials with a seed.

    Contacts are drawn on the surface, apart from each other and at a middle height, until the
    fingers can be assigned to them. The scenario sets the number of lost fingers, and the seed
    selects them.

    Args:
        resolved: Scenario of the condition.
        seed: Seed of all random values of the trial.
    """
    scenario, surface, hand = resolved.scenario, resolved.surface, resolved.hand
    assert hand is not None
    n = len(hand.azimuths)
    rng = np.random.default_rng([seed, n])
    misplacement = rng.normal(size=3) * _MISPLACEMENT_STD
    fingers = rng.permutation(n).tolist()
    damage = [replace(e, contacts=fingers[: len(e.contacts)]) for e in scenario.damage]
    scenario = replace(scenario, damage=damage, random_seed=int(rng.integers(2**31)))
    low, high = _HEIGHTS
    choices = surface.p_OQ[(surface.p_OQ[:, 2] >= low) & (surface.p_OQ[:, 2] <= high)]
    while True:
        p_OC: FloatArray = choices[rng.permutation(len(choices))[:n]]
        distances = np.linalg.norm(p_OC[:, None] - p_OC, axis=2) + np.eye(n)
        if np.min(distances) < _LEAST_DISTANCE:
            continue
        try:
            order, yaw = assign_fingers_round(
                hand.azimuths,
                np.arctan2(p_OC[:, 1], p_OC[:, 0]),
                largest_offset=hand.largest_offsets,
                yaw_range=scenario.grasp.yaw_range,
            )
        except InvalidArgumentError:
            continue
        everywhere = np.ones(n, dtype=bool)
        start = StartContacts(p_OC[order], everywhere, yaw, np.nan, np.nan)
        return Start(replace(resolved, scenario=scenario, start=start), misplacement)
