"""The ways to plan one tick that the benchmark compares."""

from collections.abc import Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.planner_config import PlannerConfig
from drake_pregrasp.contacts.centroids import select_contacts
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import make_strategy
from drake_pregrasp.geometry.surface import ForbiddenPoints, ObjectSurface
from drake_pregrasp.quality.grasp_quality import grasp_quality
from drake_pregrasp.regions.constraints import Obstacles, RegionConstraints
from drake_pregrasp.regions.safe_regions import compute_safe_regions
from drake_pregrasp.studies.bench.direct_tick import SPREAD, STRATEGIES, Tick, direct_tick
from drake_pregrasp.studies.bench.scene import Scene, implementations
from drake_pregrasp.systems.centroid_selector import CentroidSelector
from drake_pregrasp.systems.grasp_quality_monitor import GraspQualityMonitor
from drake_pregrasp.systems.safe_region_partitioner import SafeRegionPartitioner

OF_THE_HAND = ("position", "msv", "gii", "vew")
"""Those of the paper in the reading that `STRATEGIES` doesn't spell out."""

IN_DRAKE = " in Drake"
"""How the names of ways through Drake's ports end."""

AS_OBSTACLES = "as obstacles"
"""The way in which forbidden points are obstacles in the world instead."""

SLOW = ("BLAS", "direct", AS_OBSTACLES)
"""What takes much longer than the kernels."""


def all_ways(strategy: str) -> tuple[str, ...]:
    """Returns the names of the ways to plan with a strategy; no equation is printed for margins."""
    kernels = [way for name in implementations() for way in (name, name + IN_DRAKE)]
    return (*kernels, "BLAS", *(["direct"] if strategy != "margin" else []))


def make_ticks(scene: Scene, strategy: str, ways: Sequence[str]) -> dict[str, Tick]:
    """Returns some ways to plan a tick with a strategy, by their names."""
    ticks: dict[str, Tick] = {}
    for way in ways:
        if way == "direct":
            ticks[way] = direct_tick(scene.surface, strategy)
        elif way in SLOW:
            as_obstacles = way == AS_OBSTACLES
            ticks[way] = _tick(
                scene.surface, strategy, use_kernel=as_obstacles, obstacles=as_obstacles
            )
        elif way.endswith(IN_DRAKE):
            surface = scene.surfaces[way.removesuffix(IN_DRAKE)]
            ticks[way] = _drake_tick(surface, strategy, scene.starts[0])
        else:
            ticks[way] = _tick(scene.surfaces[way], strategy, use_kernel=True)
    return ticks


def _tick(
    surface: ObjectSurface, strategy: str, *, use_kernel: bool = False, obstacles: bool = False
) -> Tick:
    name, reading = STRATEGIES[strategy]
    weigh = make_strategy(name, reading=reading)
    kernel = surface.kernel if use_kernel else None
    forbidden, constraints = surface.forbidden, RegionConstraints()
    if obstacles:
        constraints = RegionConstraints(obstacles=Obstacles(points=forbidden))
        forbidden = ForbiddenPoints.none()

    def tick(p_OC: FloatArray) -> FloatArray:
        regions = compute_safe_regions(
            surface.p_OQ, p_OC, np.zeros(len(p_OC)), forbidden, constraints, kernel=kernel
        )
        goals = select_contacts(
            SelectionInput(surface, p_OC, regions, SPREAD**2 * np.eye(3)), weigh
        )
        return grasp_quality(goals.p_OC[goals.active] - surface.p_OCoM).to_vector()

    return tick


def _drake_tick(surface: ObjectSurface, strategy: str, p_OC: FloatArray) -> Tick:
    """Returns the tick through the ports of partitioner, selector and monitor."""
    name, reading = STRATEGIES[strategy]
    builder = DiagramBuilder()
    partitioner = builder.AddSystem(SafeRegionPartitioner(surface=surface, num_contacts=len(p_OC)))
    selector = builder.AddSystem(
        CentroidSelector(
            PlannerConfig(
                period=1.0,
                static_duration=0.0,
                strategy=name,
                reading=reading,
                position_spread=SPREAD,
            ),
            surface=surface,
            p_OC=p_OC,
        )
    )
    monitor = builder.AddSystem(GraspQualityMonitor(surface=surface, num_contacts=len(p_OC)))
    for source, output, target, port in (
        (selector, "p_WC_previous", partitioner, "p_WC"),
        (partitioner, "safe_regions", selector, "safe_regions"),
        (selector, "p_WC", monitor, "p_WC"),
        (selector, "contact_status", monitor, "contact_status"),
    ):
        builder.Connect(source.GetOutputPort(output), target.GetInputPort(port))
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    pose = AbstractValue.Make(RigidTransform())
    for system, port in (
        (partitioner, "X_WO_estimated"),
        (selector, "X_WO_estimated"),
        (monitor, "X_WO"),
    ):
        system.GetInputPort(port).FixValue(system.GetMyContextFromRoot(context), pose)
    own = selector.GetMyMutableContextFromRoot(context)
    selector.GetInputPort("p_WO_covariance").FixValue(own, np.zeros(9))
    quality = monitor.GetOutputPort("grasp_quality")
    monitor_context = monitor.GetMyContextFromRoot(context)
    goals_index = 1  # The selector's second group of discrete state.

    def tick(p_OC: FloatArray) -> FloatArray:
        own.SetDiscreteState(goals_index, p_OC.ravel())
        values: FloatArray = quality.Eval(monitor_context)
        return values

    return tick
