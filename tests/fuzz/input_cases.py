"""Random sequences of inputs for the ports of a planner, as printable plain data."""

import random
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from input_variants import VARIANTS, make_variant
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.math import SpatialVelocity

from drake_pregrasp.geometry.solids import BallSolid, BoxSolid, HalfSpace
from drake_pregrasp.geometry.surface import ForbiddenPoints
from drake_pregrasp.regions.constraints import Obstacles

NASTY = (float("nan"), float("inf"), float("-inf"), 1e300, -1e300, 1e6, -1e6, 1e-300, 0.0)
"""Numbers that break programs that expect others."""

WILD = 0.35  # Share of values that are nasty.
CHANGED = 0.4  # Share of ports that change at a tick.
LONGEST = 4  # Ticks of a sequence.

Value = tuple[Any, ...]


@dataclass
class Tick:
    """The changes of inputs at a tick.

    Attributes:
        steps: Planning periods since the last one.
        between: Whether there are changes after the tick, before the next one, too.
        values: By the ports' names.
    """

    steps: int
    values: dict[str, Value] = field(default_factory=dict)
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
    ports = make_variant(name).ports
    wild_poses = "X_WO_measured" not in ports or "measurement_time" in ports
    ticks = []
    for index in range(rng.randint(1, LONGEST)):
        chosen = [port for port in ports if rng.random() < (1.0 if index == 0 else CHANGED)]
        needed = ("X_WO_estimated", "p_WO_covariance", "X_WO_measured")
        optional = [port for port in chosen if port not in needed and rng.random() < CHANGED]
        values = {
            port: _value(rng, port, wild_poses=wild_poses)
            for port in chosen
            if port in needed or port in optional
        }
        steps = rng.choice((1, 1, 1, 1, 2, 7, 1000)) if index else 0
        ticks.append(Tick(steps, values, between=rng.random() < WILD))
    return Case(name, ticks)


def _number(rng: random.Random, scale: float, *, wild: bool) -> float:
    return rng.choice(NASTY) if wild and rng.random() < WILD else rng.uniform(-scale, scale)


def _value(rng: random.Random, port: str, *, wild_poses: bool) -> Value:
    wild = rng.random() < WILD
    if port in ("X_WO_estimated", "X_WO_measured", "X_WH", "X_WU"):
        if port == "X_WO_measured" and not wild_poses:
            far = rng.choice((0.0, 0.0, 1.0, 1e6))
            return ("pose", *(rng.uniform(-3, 3) for _ in range(3)), *_place(rng, far))
        if wild and rng.random() < WILD:
            return ("matrix", rng.choice((2.0, -1.0, 0.0, float("nan"), float("inf"))))
        numbers = [_number(rng, 0.3, wild=wild) for _ in range(3)]
        return ("pose", *(rng.uniform(-3, 3) for _ in range(3)), *numbers)
    if port == "V_WO_estimated":
        return ("velocity", *(_number(rng, 0.5, wild=wild) for _ in range(6)))
    if port == "V_WO_held":
        return ("velocity", *(_number(rng, 0.5, wild=wild) for _ in range(6)))
    if port == "p_WO_covariance":
        if not wild:
            return ("vector", *(np.diag([10 ** rng.uniform(-8, 1)] * 3).ravel().tolist()))
        return ("vector", *(_number(rng, 1e-3, wild=True) for _ in range(9)))
    if port == "contact_weights":
        return ("vector", *(_number(rng, 1e-3, wild=wild) for _ in range(3)))
    if port == "finger_coordinates":
        return ("vector", *(_number(rng, 0.05, wild=wild) for _ in range(6)))
    if port == "candidate_coordinates":
        count = 2 * len(make_variant("coordinates").surface.p_OQ)
        return ("repeated", count, *(_number(rng, 0.05, wild=wild) for _ in range(7)))
    if port == "obstacles":
        return ("obstacles", *(_solid(rng) for _ in range(rng.randint(0, 3))))
    if port == "tracking_status":
        return ("vector", rng.choice((0.0, 1.0, 1.0, 2.0, 3.0, 17.0, float("nan"))))
    return ("vector", rng.choice((0.0, 0.0, 1.0, *NASTY)))


def _place(rng: random.Random, far: float) -> list[float]:
    return [rng.uniform(-0.3, 0.3) + far * rng.choice((-1, 0, 1)) for _ in range(3)]


def _solid(rng: random.Random) -> Value:
    place = [rng.uniform(-0.3, 0.3) for _ in range(3)]
    kind = rng.choice(("ball", "box", "half", "points"))
    velocity = [rng.choice((0.0, rng.uniform(-1, 1), 1e5)) for _ in range(3)]
    # Spoilt after it is made, since it is refused otherwise.
    spoilt = rng.choice(NASTY) if rng.random() < WILD / 2 else None
    return (kind, *place, *velocity, rng.choice((0.0, 0.02, 0.2, 1e6)), spoilt)


def make_value(value: Value) -> Any:
    """Returns what a port is fixed to."""
    kind, *numbers = value
    if kind == "pose":
        return RigidTransform(RollPitchYaw(numbers[:3]), numbers[3:])
    if kind == "matrix":
        matrix = np.full((3, 3), numbers[0]) if np.isnan(numbers[0]) else np.zeros((3, 3))
        matrix[np.diag_indices(3)] = numbers[0]
        return RigidTransform(RotationMatrix.MakeUnchecked(matrix), np.zeros(3))
    if kind == "velocity":
        return SpatialVelocity(w=numbers[:3], v=numbers[3:])
    if kind == "repeated":
        return np.resize(numbers[1:], numbers[0])
    if kind == "obstacles":
        return AbstractValue.Make(_obstacles(numbers))
    return np.array(numbers)


def _obstacles(descriptions: list[Value]) -> Obstacles:
    solids, velocities, points, radii, spoils = [], [], [], [], []
    for kind, x, y, z, vx, vy, vz, size, spoilt in descriptions:
        center = np.array([x, y, z])
        if kind == "points":
            points.append(center)
            radii.append(size)
            continue
        if kind == "ball":
            solids.append(BallSolid(center, size))
        elif kind == "box":
            solids.append(BoxSolid(center, np.eye(3), np.full(3, size)))
        else:
            solids.append(HalfSpace(center, np.array([x, y, z + 1.0])))
        velocities.append([vx, vy, vz])
        spoils.append((center, spoilt))
    made = Obstacles(
        tuple(solids),
        ForbiddenPoints(np.array(points).reshape(-1, 3), np.array(radii)),
        np.array(velocities).reshape(-1, 3),
    )
    for center, spoilt in spoils:
        if spoilt is not None:
            center[0] = spoilt
    return made
