"""What the benchmark times: one planning tick on a cube, done in several ways."""

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.box_surface import box_surface
from drake_pregrasp.planning.contact_models import grasp_matrix
from drake_pregrasp.planning.contact_selection import select_contacts
from drake_pregrasp.planning.grasp_quality import grasp_quality
from drake_pregrasp.planning.kernels import make_kernel, numba_is_installed
from drake_pregrasp.planning.safe_regions import compute_safe_regions
from drake_pregrasp.planning.selection_input import SelectionInput
from drake_pregrasp.planning.strategies import make_strategy
from drake_pregrasp.planning.surface import ForbiddenPoints, ObjectSurface
from drake_pregrasp.systems.centroid_selector import CentroidSelector
from drake_pregrasp.systems.grasp_quality_monitor import GraspQualityMonitor
from drake_pregrasp.systems.safe_region_partitioner import SafeRegionPartitioner

NUM_CONTACTS = 5
NUM_FORBIDDEN = 200
NUM_SETS = 10
"""Contact sets that the ticks start from, in turn."""

DIRECT_SAMPLE = 2000
"""Points that the direct transcription is timed on, if there are more: its time is scaled."""

_EDGE = 0.1
_SPREAD = 0.04
_LARGEST_RADIUS = 0.005

Tick = Callable[[FloatArray], FloatArray]
"""Plans once, from contacts in O, shape (n, 3), and returns the goals' measures."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A surface and contact sets to start from.

    Attributes:
        surfaces: The same surface with the kernel of each implementation.
        starts: Contact sets in O, shape (`NUM_SETS`, n, 3), in metres.
    """

    surfaces: Mapping[str, ObjectSurface]
    starts: FloatArray

    @property
    def surface(self) -> ObjectSurface:
        """The surface, with one kernel or another."""
        return next(iter(self.surfaces.values()))


def implementations() -> tuple[str, ...]:
    """Returns the names of the kernels that can be made here."""
    return ("numpy", "numba") if numba_is_installed() else ("numpy",)


@lru_cache(maxsize=1)
def make_scene(per_edge: int) -> Scene:
    """Makes a cube of 0.1 m with that many candidates squared on each of its four sides.

    Forbidden are the grid of the base case on top and bottom, and random points there.
    """
    rng = np.random.default_rng(0)
    surface = box_surface([_EDGE] * 3, spacing=_EDGE / per_edge)
    count = NUM_FORBIDDEN - len(surface.forbidden)
    points = rng.uniform(-_EDGE / 2, _EDGE / 2, (count, 3))
    points[:, 2] = rng.choice([-_EDGE / 2, _EDGE / 2], count)
    extra = ForbiddenPoints(points, rng.uniform(0, _LARGEST_RADIUS, count))
    surface = replace(surface, forbidden=surface.forbidden.joined(extra))
    surfaces = {}
    for name in implementations():
        surfaces[name] = copy.copy(surface)
        kernel = make_kernel(
            surface.p_OQ, surface.nhat_OQ, surface.areas, surface.p_OCoM, implementation=name
        )
        surfaces[name].__dict__["kernel"] = kernel
    size = len(surface.p_OQ)
    chosen = np.array([rng.choice(size, NUM_CONTACTS, replace=False) for _ in range(NUM_SETS)])
    # Off the grid, or candidates would be as near to one contact as to another.
    along = np.where(surface.nhat_OQ[chosen] == 0, _EDGE / per_edge, 0)
    aside = along * rng.uniform(-0.5, 0.5, along.shape)
    return Scene(surfaces, surface.p_OQ[chosen] + aside)


def make_ticks(scene: Scene, strategy: str) -> dict[str, Tick]:
    """Returns the ways to plan one tick with a strategy, by their names."""
    ticks: dict[str, Tick] = {}
    for name, surface in scene.surfaces.items():
        ticks[name] = _kernel_tick(surface, strategy, use_kernel=True)
        ticks[f"{name} in Drake"] = _drake_tick(surface, strategy, scene.starts[0])
    ticks["BLAS"] = _kernel_tick(scene.surface, strategy, use_kernel=False)
    ticks["direct"] = _direct_tick(scene.surface, strategy)
    return ticks


def _kernel_tick(surface: ObjectSurface, strategy: str, *, use_kernel: bool) -> Tick:
    weigh, h = make_strategy(strategy), np.zeros(NUM_CONTACTS)
    kernel = surface.kernel if use_kernel else None

    def tick(p_OC: FloatArray) -> FloatArray:
        regions = compute_safe_regions(surface.p_OQ, p_OC, h, surface.forbidden, kernel=kernel)
        goals = select_contacts(
            SelectionInput(surface, p_OC, regions, _SPREAD**2 * np.eye(3)), weigh
        )
        return grasp_quality(goals.p_OC[goals.active] - surface.p_OCoM).to_vector()

    return tick


def _drake_tick(surface: ObjectSurface, strategy: str, p_OC: FloatArray) -> Tick:
    """Returns the tick through the ports of partitioner, selector and monitor."""
    builder = DiagramBuilder()
    partitioner = builder.AddSystem(
        SafeRegionPartitioner(surface=surface, num_contacts=NUM_CONTACTS)
    )
    selector = builder.AddSystem(
        CentroidSelector(
            surface=surface,
            p_OC=p_OC,
            period=1.0,
            strategy=strategy,
            position_spread=_SPREAD,
        )
    )
    monitor = builder.AddSystem(GraspQualityMonitor(surface=surface, num_contacts=NUM_CONTACTS))
    for source, output, target, name in (
        (selector, "p_WC_previous", partitioner, "p_WC"),
        (partitioner, "safe_regions", selector, "safe_regions"),
        (selector, "p_WC", monitor, "p_WC"),
        (selector, "contact_status", monitor, "contact_status"),
    ):
        builder.Connect(source.GetOutputPort(output), target.GetInputPort(name))
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


def _direct_tick(surface: ObjectSurface, strategy: str) -> Tick:
    """Returns the equations as they are printed: broadcast distances, one decomposition a point."""
    size = len(surface.p_OQ)
    sample = np.random.default_rng(1).permutation(size)[:DIRECT_SAMPLE]
    q, areas, r_Q = surface.p_OQ[sample], surface.areas[sample], surface.p_OQ[sample]
    z, R = surface.forbidden.points, surface.forbidden.radii

    def weight(contact: int, point: int, p_OC: FloatArray) -> float:
        if strategy == "position":
            return float(np.exp(-(r_Q[point] @ r_Q[point]) / _SPREAD**2 / 2))
        moved = p_OC.copy()
        moved[contact] = q[point]
        sigma = np.linalg.svd(grasp_matrix(moved, None, "complete"), compute_uv=False)
        if strategy == "vew":
            return float(np.prod(sigma))
        return float(sigma[-1] / (sigma[0] if strategy == "gii" else 1))

    def tick(p_OC: FloatArray) -> FloatArray:
        own = np.sum((q[:, None] - p_OC) ** 2, axis=2)
        other = np.sum((q[:, None] - z) ** 2, axis=2)
        d = np.sqrt(np.sum((p_OC[:, None] - z) ** 2, axis=2))
        w = 2 * R * d - d**2
        cells = np.argmin(own, axis=1)
        goals = p_OC.copy()
        for contact in range(len(p_OC)):
            free = np.all(own[:, [contact]] <= other - w[contact], axis=1)
            members = np.flatnonzero((cells == contact) & free)
            if len(members):
                b = np.array([weight(contact, point, p_OC) for point in members.tolist()])
                if strategy != "position":
                    b -= np.min(b)
                b = b * areas[members] + np.finfo(float).tiny
                goals[contact] = b @ q[members] / np.sum(b)
        return grasp_quality(surface.project(goals)[0] - surface.p_OCoM).to_vector()

    return tick


def direct_scale(size: int) -> float:
    """Returns by what the direct transcription's time on its sample is multiplied."""
    return max(1.0, size / DIRECT_SAMPLE)
