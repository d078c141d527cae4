"""Random sequences of inputs for the ports of a planner."""

import random
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from broken_values import BAD_NUMBERS, broken_values
from input_variants import VARIANTS, make_variant
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialVelocity

from drake_pregrasp.geometry.solids import BallSolid, BoxSolid, HalfSpace
from drake_pregrasp.geometry.surface import ForbiddenPoints
from drake_pregrasp.regions.constraints import Obstacles

EXTREME = (*BAD_NUMBERS, 1e6, -1e6, 1e-300, 0.0)
"""Numbers of a status or a switch that break programs that expect others."""

BROKEN = 0.25  # Share of values that are broken.
CHANGED = 0.4  # Share of ports that change at a tick.
LONGEST = 4  # Ticks of a sequence.
NEEDED = ("X_WO_estimated", "p_WO_covariance", "X_WO_measured")


@dataclass
class Tick:
    """The changes of inputs at a tick.

    Attributes:
        steps: Planning periods since the last one.
        between: Whether there are changes after the tick, before the next one, too.
        values: By the ports' names.
    """

    steps: int
    values: dict[str, Any] = field(default_factory=dict)
    between: bool = False


@dataclass
class Case:
    """A sequence of ticks of a variant."""

    variant: str
    ticks: list[Tick]


def make_case(seed: int, number: int) -> Case:
    """Returns the sequence of a number; the same ones always come out of a seed."""
    rng = random.Random(f"{seed} {number}")
    name = VARIANTS[number % len(VARIANTS)]
    ticks = []
    for index in range(rng.randint(1, LONGEST)):
        values = {}
        for port in make_variant(name).ports:
            share = CHANGED if index else 1.0
            if rng.random() < (share if port in NEEDED else share * CHANGED):
                sound = _sound(rng, port)
                is_broken = rng.random() < BROKEN
                values[port] = rng.choice([*broken_values(sound)]) if is_broken else sound
        steps = rng.choice((1, 1, 1, 1, 2, 7, 1000)) if index else 0
        ticks.append(Tick(steps, values, between=rng.random() < CHANGED))
    return Case(name, ticks)


def make_value(value: Any) -> Any:
    """Returns what a port is fixed to."""
    return AbstractValue.Make(value) if isinstance(value, Obstacles) else value


def _sound(rng: random.Random, port: str) -> Any:
    def numbers(count: int, scale: float) -> np.ndarray:
        return np.array([rng.uniform(-scale, scale) for _ in range(count)])

    if port.startswith("X_"):
        far = rng.choice((0.0, 0.0, 1.0, 1e6))
        return RigidTransform(RollPitchYaw(numbers(3, 3.0)), numbers(3, 0.3) + far)
    if port.startswith("V_"):
        return SpatialVelocity(numbers(6, rng.choice((0.0, 0.5))))
    if port == "p_WO_covariance":
        return np.diag(10 ** (numbers(3, 4.5) - 3.5)).ravel()
    if port == "contact_weights":
        return numbers(3, 1e-3)
    if port == "late_fingers":
        return np.array([rng.choice((0.0, 0.0, 0.0, 1.0, np.nan)) for _ in range(3)])
    if port == "finger_coordinates":
        return numbers(6, 0.05)
    if port == "candidate_coordinates":
        return numbers(2 * len(make_variant("coordinates").surface.p_OQ), 0.05)
    if port == "obstacles":
        return _obstacles(rng, numbers)
    if port == "tracking_status":
        return np.array([rng.choice((0.0, 1.0, 1.0, 2.0, 3.0, 17.0))])
    return np.array([rng.choice((0.0, 0.0, 1.0, *EXTREME))])


def _obstacles(rng: random.Random, numbers: Any) -> Obstacles:
    solids = []
    for _ in range(rng.randint(1, 3)):
        center, size = numbers(3, 0.3), rng.choice((0.0, 0.02, 0.2, 1e6))
        normal = np.append(center[:2], center[2] + 1.0)
        ball, box = BallSolid(center, size), BoxSolid(center, np.eye(3), np.full(3, size))
        solids.append(rng.choice((ball, box, HalfSpace(center, normal))))
    points = ForbiddenPoints(numbers(6, 0.3).reshape(-1, 3), np.array([0.02, 0.2]))
    velocities = numbers(3 * len(solids), rng.choice((0.0, 1.0, 1e5))).reshape(-1, 3)
    return Obstacles(tuple(solids), rng.choice((points, ForbiddenPoints.none())), velocities)
