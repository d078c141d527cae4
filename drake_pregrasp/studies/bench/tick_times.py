"""Times of planning ticks through the planner's ports, by implementation and size."""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.limits_config import LimitsConfig
from drake_pregrasp.config.planner_config import PlannerConfig
from drake_pregrasp.contacts.centroids import select_contacts
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import make_strategy
from drake_pregrasp.diagrams.pregrasp_planner import PregraspPlanner
from drake_pregrasp.fast import SWITCH, numba_is_installed
from drake_pregrasp.geometry.box_surface import box_surface
from drake_pregrasp.geometry.surface import ForbiddenPoints, ObjectSurface
from drake_pregrasp.regions.constraints import Obstacles
from drake_pregrasp.regions.safe_regions import compute_safe_regions
from drake_pregrasp.simulation.scenario_file import load_scenario

Tick = Callable[[FloatArray], FloatArray]
"""A planning tick, which maps contacts to goals, both in O, shape (n, 3), in metres."""

WITHOUT_PORTS = "no ports"
"""Label of the reference's functions, called without systems and ports."""

CUBE = "cube"
EDGE = 0.1
"""Edge of the cube, in metres."""
MESH = "bowling_pin"
"""Shipped scenario whose object is the mesh."""

LARGEST_RADIUS = 0.005
"""Largest radius of a forbidden point on the cube, in metres."""

NUM_SETS = 10
"""Number of contact sets, from which ticks start in turn."""

_WARM_UP, _FEWEST = 3, 5  # Rounds before the measurement, and the least number of rounds.


class Scene(NamedTuple):
    """An object with forbidden points and initial contacts.

    Attributes:
        spacing: Distance between neighbouring candidates, in metres.
        contacts: Number of contacts n.
        forbidden: Number of forbidden points; on the mesh, at most those of its scenario.
        shape: Shape of the object, `CUBE` or the name of a shipped scenario, such as `MESH`.
        seed: Seed of the forbidden points and the contact sets.
    """

    spacing: float
    contacts: int = 5
    forbidden: int = 200
    shape: str = CUBE
    seed: int = 0


class TickJob(NamedTuple):
    """Ticks to time for all implementations.

    Attributes:
        series: Name of the series of measurements.
        scene: Scene of the ticks.
        strategy: Name of the planner's strategy.
        obstacles: Whether the forbidden points become obstacles in the world.
        rounds: Largest number of ticks of each implementation.
        seconds: Duration after which no further round begins.
    """

    series: str
    scene: Scene
    strategy: str
    obstacles: bool = False
    rounds: int = 200
    seconds: float = 3.0


def implementations() -> tuple[str, ...]:
    """Returns the names of the installed implementations."""
    return ("reference", "numba") if numba_is_installed() else ("reference",)


@contextmanager
def chosen(implementation: str) -> Iterator[None]:
    """Selects one of `implementations()` for planners that are built in this context."""
    before = os.environ.get(SWITCH, "")
    os.environ[SWITCH] = "0" if implementation == "reference" else "1"
    try:
        yield
    finally:
        os.environ[SWITCH] = before


def make_tick(
    surface: ObjectSurface,
    implementation: str,
    p_OC: FloatArray,
    config: PlannerConfig,
    *,
    obstacles: Obstacles | None = None,
) -> Tick:
    """Returns a tick through the ports of the planner's partitioner and selector.

    The object's pose is the identity and never changes, so that the estimator does not compute.

    Args:
        surface: Surface of the object O.
        implementation: Name of the implementation, one of `implementations()` or `WITHOUT_PORTS`.
        p_OC: Initial contacts in O, shape (n, 3), in metres.
        config: Settings of the planner; contacts adapt from the start.
        obstacles: Obstacles in the world.
    """
    if implementation == WITHOUT_PORTS:
        return _tick_without_ports(surface, config)
    config = replace(config, static_duration=0.0)
    with chosen(implementation):
        planner = PregraspPlanner(config, surface, p_OC)
    context = planner.CreateDefaultContext()
    pose = AbstractValue.Make(RigidTransform())
    planner.GetInputPort("X_WO_measured").FixValue(context, pose)
    if obstacles is not None:
        planner.GetInputPort("obstacles").FixValue(context, AbstractValue.Make(obstacles))
    selector = planner.GetSubsystemByName("centroid_selector")
    own = selector.GetMyMutableContextFromRoot(context)
    # Replaces the estimate's covariance, so that the spread is that of the settings.
    selector.GetInputPort("p_WO_covariance").FixValue(own, np.zeros(9))
    p_WC, goals_index = planner.GetOutputPort("p_WC"), 1  # The second group of discrete state.

    def tick(p_OC: FloatArray) -> FloatArray:
        own.SetDiscreteState(goals_index, p_OC.ravel())
        goals: FloatArray = p_WC.Eval(context).reshape(-1, 3)
        return goals

    return tick


def _tick_without_ports(surface: ObjectSurface, config: PlannerConfig) -> Tick:
    weigh, covariance = make_strategy(config.strategy), config.position_spread**2 * np.eye(3)

    def tick(p_OC: FloatArray) -> FloatArray:
        regions = compute_safe_regions(surface.p_OQ, p_OC, np.zeros(len(p_OC)), surface.forbidden)
        return select_contacts(SelectionInput(surface, p_OC, regions, covariance), weigh).p_OC

    return tick


def cube(per_edge: int, contacts: int = 5, forbidden: int = 200, *, seed: int = 0) -> Scene:
    """Returns a cube scene with `per_edge` squared candidates on each of its four side faces."""
    return Scene(EDGE / per_edge, contacts, forbidden, CUBE, seed)


@lru_cache(maxsize=1)
def make_scene(scene: Scene) -> tuple[ObjectSurface, FloatArray]:
    """Returns a surface, and initial contact sets in O, shape (`NUM_SETS`, n, 3), in metres.

    Forbidden points of the cube are random points of its top and bottom.
    """
    rng = np.random.default_rng(scene.seed)
    if scene.shape == CUBE:
        surface = box_surface([EDGE] * 3, spacing=scene.spacing)
        points = rng.uniform(-EDGE / 2, EDGE / 2, (scene.forbidden, 3))
        points[:, 2] = EDGE / 2 * rng.choice([-1, 1], scene.forbidden)
        radii = rng.uniform(0, LARGEST_RADIUS, scene.forbidden)
        surface = replace(surface, forbidden=ForbiddenPoints(points, radii))
    else:
        surface = load_scenario(scene.shape).make_surface(scene.spacing)
        own = surface.forbidden
        kept = np.sort(rng.permutation(len(own))[: scene.forbidden])
        forbidden = ForbiddenPoints(own.points[kept], own.radii[kept], own.normals[kept])
        surface = replace(surface, forbidden=forbidden)
    clear = np.flatnonzero(surface.is_clear_of_forbidden_points)
    chosen = [rng.choice(clear, scene.contacts, replace=False) for _ in range(NUM_SETS)]
    starts: FloatArray = surface.p_OQ[np.array(chosen)]
    if scene.shape == CUBE:
        # Contacts off the grid: on it, candidates would be equally near to two contacts.
        along = np.where(surface.nhat_OQ[np.array(chosen)] == 0, scene.spacing, 0)
        starts = starts + along * rng.uniform(-0.5, 0.5, along.shape)
    return surface, starts


def make_ticks(job: TickJob) -> dict[str, Tick]:
    """Returns the tick of each implementation and of `WITHOUT_PORTS`, by name."""
    surface, starts = make_scene(job.scene)
    obstacles = None
    names = [*implementations(), WITHOUT_PORTS]
    if job.obstacles:
        obstacles, names = Obstacles(points=surface.forbidden), names[:-1]
        surface = replace(surface, forbidden=ForbiddenPoints.none())
    config = PlannerConfig(strategy=job.strategy, limits=LimitsConfig(clearance=0.0))
    return {
        name: make_tick(surface, name, starts[0], config, obstacles=obstacles) for name in names
    }


def time_ticks(job: TickJob) -> list[dict[str, Any]]:
    """Returns a row for each implementation; all tick in turn from the same contacts."""
    surface, starts = make_scene(job.scene)
    ticks = make_ticks(job)
    seconds: dict[str, list[float]] = {name: [] for name in ticks}
    begin = time.perf_counter()
    for round_ in range(-_WARM_UP, job.rounds):
        if round_ >= _FEWEST and time.perf_counter() - begin > job.seconds:
            break
        for name, tick in ticks.items():
            # The previous implementation has filled the processor's caches with its own data.
            tick(starts[(round_ - 1) % NUM_SETS])
            start = time.perf_counter()
            tick(starts[round_ % NUM_SETS])
            seconds[name].append(time.perf_counter() - start)
    kept = {name: 1e3 * np.array(values[_WARM_UP:]) for name, values in seconds.items()}
    return [
        {
            "series": job.series,
            "N": len(surface.p_OQ),
            "contacts": job.scene.contacts,
            "forbidden": job.scene.forbidden,
            "strategy": job.strategy,
            "implementation": name,
            "ticks": len(ms),
            "median [ms]": float(np.median(ms)),
            "99 % [ms]": float(np.percentile(ms, 99)),
        }
        for name, ms in kept.items()
    ]
