"""Conditions of the study, with scenarios from `conditions.yaml`, and starts of trials."""

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.assignment import assign_fingers_round
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.solids import Solid
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.simulation.obstacle_config import moving_solid
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import load_scenario
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
    def scenario(self) -> Scenario:
        """Scenario with object, motion, sensor noise, hand, obstacles and lost fingers."""
        return load_scenario(self.key, file=Path(__file__).with_name("conditions.yaml"))


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
        p_OC: Contacts in the order of the fingers, in O, shape (n, 3), in metres.
        yaw: Angle of the palm for the contacts, in radians.
        misplacement: Offset of the object on the table, shape (3,): x and y in metres, angle about
            z in radians.
        losses: Times of losses in seconds, each with the indices of the lost fingers.
        noise_seed: Seed of the measurement noise.
    """

    p_OC: FloatArray
    yaw: float
    misplacement: FloatArray
    losses: list[tuple[float, list[int]]]
    noise_seed: int


def random_start(
    scenario: Scenario, surface: ObjectSurface, hand: HandModel, *, seed: int
) -> Start:
    """Returns the start of the trials with a seed.

    Contacts are drawn on the surface, apart from each other and at a middle height, until the
    fingers can be assigned to them. The scenario sets the number of lost fingers, and the seed
    selects them.

    Args:
        scenario: Scenario of the trial.
        surface: Surface of the object.
        hand: Model of the hand.
        seed: Seed of all random values of the trial.
    """
    n = len(hand.azimuths)
    rng = np.random.default_rng([seed, n])
    misplacement = rng.normal(size=3) * _MISPLACEMENT_STD
    fingers = rng.permutation(n).tolist()
    losses = [(event.at, fingers[: len(event.contacts)]) for event in scenario.damage]
    noise_seed = int(rng.integers(2**31))
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
        return Start(p_OC[order], yaw, misplacement, losses, noise_seed)
