"""Times of planning ticks through the planner's ports, by implementation and size."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import trimesh
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.limits_config import LimitsConfig
from drake_pregrasp.config.planner_config import PlannerConfig
from drake_pregrasp.contacts.centroids import select_contacts
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import make_strategy
from drake_pregrasp.diagrams.pregrasp_planner import PregraspPlanner
from drake_pregrasp.fast import installed_kernels, numba_is_installed
from drake_pregrasp.fast.kernels import Kernels
from drake_pregrasp.geometry.box_surface import box_surface
from drake_pregrasp.geometry.mesh_surface import mesh_surface
from drake_pregrasp.geometry.shapes import Shape
from drake_pregrasp.geometry.surface import ForbiddenPoints, ObjectSurface
from drake_pregrasp.regions.constraints import Obstacles
from drake_pregrasp.regions.safe_regions import SafeRegions, safe_region_labels

Tick = Callable[[FloatArray], FloatArray]
"""A planning tick, which maps contacts to goals, both in O, shape (n, 3), in metres."""

PRINTED = "printed"
"""Label of `safe_region_labels` with the goals of the reference, without ports."""

LENGTH = 0.1
"""Edge of the cube, and diameter of the meshed ball, in metres."""

LARGEST_RADIUS = 0.005
"""Largest radius of a point on the cube, in metres."""

NUM_SETS = 10
"""Number of contact sets, from which ticks start in turn."""

PLAIN = PlannerConfig(limits=LimitsConfig(clearance=0.0))
"""Settings of the timed planners; all others differ from these by what their names say."""

_WARM_UP, _FEWEST = 3, 5  # Rounds before the measurement, and the least number of rounds.


class Scene(NamedTuple):
    """An object with initial contacts.

    Attributes:
        per_length: Number of candidates along the length of the object.
        contacts: Number of contacts n.
        points: Number of points on the top and bottom of a cube, which no contact may touch.
        obstacles: Whether the points are obstacles in the world, not forbidden points.
        subdivisions: If above zero, the object is a ball: an icosahedron, so often subdivided.
    """

    per_length: int
    contacts: int = 5
    points: int = 200
    obstacles: bool = False
    subdivisions: int = 0


class TickJob(NamedTuple):
    """Ticks to time for all implementations.

    Attributes:
        series: Name of the series of measurements.
        size: What grows in the series, a whole number.
        scene: Scene of the ticks.
        config: Settings of the planner.
        seconds: Processor time after which no further round begins, in seconds.
        rounds: Largest number of ticks of each implementation.
    """

    series: str
    size: int
    scene: Scene
    config: PlannerConfig
    seconds: float = 3.0
    rounds: int = 200


def implementations() -> tuple[str, ...]:
    """Returns the names of the installed implementations."""
    return ("reference", "fast") if numba_is_installed() else ("reference",)


def kernels_of(implementation: str) -> Kernels:
    """Returns the functions of one of `implementations()`."""
    return installed_kernels()[implementations().index(implementation)]


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
        implementation: Name of the implementation, one of `implementations()`.
        p_OC: Initial contacts in O, shape (n, 3), in metres.
        config: Settings of the planner; contacts adapt from the start.
        obstacles: Obstacles in the world.
    """
    config = replace(config, static_duration=0.0)
    planner = PregraspPlanner(config, surface, p_OC, kernels=kernels_of(implementation))
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


def _printed_tick(surface: ObjectSurface, config: PlannerConfig) -> Tick:
    weigh, covariance = make_strategy(config.strategy), config.position_spread**2 * np.eye(3)
    points, radii = surface.forbidden.points, surface.forbidden.radii

    def tick(p_OC: FloatArray) -> FloatArray:
        n = len(p_OC)
        labels = safe_region_labels(surface.p_OQ, p_OC, np.zeros(n), points, radii)
        regions = SafeRegions.unlimited(labels, n)
        return select_contacts(SelectionInput(surface, p_OC, regions, covariance), weigh).p_OC

    return tick


def make_scene(scene: Scene) -> tuple[ObjectSurface, Obstacles | None, FloatArray]:
    """Returns a surface, obstacles, and initial contacts in O, shape (`NUM_SETS`, n, 3)."""
    rng = np.random.default_rng(0)
    spacing, obstacles = LENGTH / scene.per_length, None
    if scene.subdivisions:
        ball = trimesh.creation.icosphere(scene.subdivisions, LENGTH / 2)
        parts = np.zeros(len(ball.faces), dtype=np.intp)
        surface = mesh_surface(Shape(ball, ("ball",), parts), spacing=spacing)
    else:
        surface = box_surface([LENGTH] * 3, spacing=spacing)
        points = rng.uniform(-LENGTH / 2, LENGTH / 2, (scene.points, 3))
        points[:, 2] = LENGTH / 2 * rng.choice([-1, 1], scene.points)
        both = ForbiddenPoints(points, rng.uniform(0, LARGEST_RADIUS, scene.points))
        obstacles = Obstacles(points=both) if scene.obstacles else None
        forbidden = ForbiddenPoints.none() if scene.obstacles else both
        surface = replace(surface, forbidden=forbidden)
    clear = np.flatnonzero(surface.is_clear_of_forbidden_points)
    chosen = np.array([rng.choice(clear, scene.contacts, replace=False) for _ in range(NUM_SETS)])
    starts: FloatArray = surface.p_OQ[chosen]
    if not scene.subdivisions:
        # Contacts off the grid: on it, candidates would be equally near to two contacts.
        along = np.where(surface.nhat_OQ[chosen] == 0, spacing, 0)
        starts = starts + along * rng.uniform(-0.5, 0.5, along.shape)
    return surface, obstacles, starts


def make_ticks(scene: Scene, config: PlannerConfig) -> dict[str, Tick]:
    """Returns the tick of each implementation, and of `PRINTED` if it has all that is asked."""
    surface, obstacles, starts = make_scene(scene)
    ticks = {
        name: make_tick(surface, name, starts[0], config, obstacles=obstacles)
        for name in implementations()
    }
    if obstacles is None and config == replace(PLAIN, strategy=config.strategy):
        ticks[PRINTED] = _printed_tick(surface, config)
    return ticks


def time_ticks(job: TickJob) -> list[dict[str, Any]]:
    """Returns a row for each implementation; all tick in turn from the same contacts."""
    surface, _, starts = make_scene(job.scene)
    ticks = make_ticks(job.scene, job.config)
    seconds: dict[str, list[float]] = {name: [] for name in ticks}
    begin = time.thread_time()
    for round_ in range(-_WARM_UP, job.rounds):
        if round_ >= _FEWEST and time.thread_time() - begin > job.seconds:
            break
        for name, tick in ticks.items():
            # The previous implementation has filled the processor's caches with its own data.
            tick(starts[(round_ - 1) % NUM_SETS])
            start = time.thread_time()
            tick(starts[round_ % NUM_SETS])
            seconds[name].append(time.thread_time() - start)
    return [
        {
            "series": job.series,
            "size": job.size,
            "N": len(surface.p_OQ),
            "implementation": name,
            **tick_columns(own[_WARM_UP:]),
        }
        for name, own in seconds.items()
    ]


def tick_columns(seconds: list[float] | FloatArray) -> dict[str, float]:
    """Returns the number of ticks, their median and 99th percentile, and the ratio of both.

    Ticks of NaN seconds do not count.
    """
    seconds = np.array(seconds)[np.isfinite(seconds)]
    median, high = 1e3 * np.percentile(seconds, [50, 99])
    columns = ("ticks", "median [ms]", "99 % [ms]", "99 % / median")
    return dict(zip(columns, (len(seconds), median, high, high / median), strict=True))
