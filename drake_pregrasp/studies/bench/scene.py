"""What the benchmark plans on: a cube or a mesh, forbidden points, and contact sets."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.geometry.box_surface import box_surface
from drake_pregrasp.geometry.surface import ForbiddenPoints, ObjectSurface
from drake_pregrasp.kernels import numba_is_installed
from drake_pregrasp.simulation.scenario_file import load_scenario
from drake_pregrasp.studies.bench.implemented_surface import implemented

NUM_CONTACTS = 5
NUM_FORBIDDEN = 200
NUM_SETS = 10
"""Contact sets that the ticks start from, in turn."""

CUBE = "cube"
MESH = "bowling_pin"
"""The shape that stands for meshes: the scenario of this name."""

EDGE = 0.1
"""Of the cube, in metres."""

LARGEST_RADIUS = 0.005
"""Of forbidden points, in metres."""


class SceneSpec(NamedTuple):
    """What to plan on.

    Attributes:
        shape: `CUBE` or `MESH`.
        spacing: Distance of neighbouring candidates, in metres.
        contacts: How many there are, n.
        forbidden: How many forbidden points there are; on the mesh as many at most as it has.
        seed: Of forbidden points and contact sets.
    """

    shape: str
    spacing: float
    contacts: int = NUM_CONTACTS
    forbidden: int = NUM_FORBIDDEN
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Scene:
    """A surface and contact sets to start from.

    Attributes:
        surfaces: The same surface with the kernel of each implementation, the fastest last.
        starts: Contact sets in O, shape (`NUM_SETS`, n, 3), in metres.
    """

    surfaces: Mapping[str, ObjectSurface]
    starts: FloatArray

    @property
    def surface(self) -> ObjectSurface:
        """The surface, with the fastest kernel."""
        return self.surfaces[implementations()[-1]]


def implementations() -> tuple[str, ...]:
    """Returns the names of the kernels that can be made here, the fastest last."""
    return ("numpy", "numba") if numba_is_installed() else ("numpy",)


def cube(per_edge: int, contacts: int = NUM_CONTACTS, forbidden: int = NUM_FORBIDDEN) -> SceneSpec:
    """Returns the cube with that many candidates squared on each of its four sides."""
    return SceneSpec(CUBE, EDGE / per_edge, contacts, forbidden)


@lru_cache(maxsize=1)
def make_scene(spec: SceneSpec) -> Scene:
    """Makes a scene. Contact sets are random candidates.

    On the cube, forbidden are the grid of the base case on top and bottom, and random points there;
    on the mesh, ground that its scenario forbids.
    """
    rng = np.random.default_rng(spec.seed)
    surface = _with_forbidden_points(_bare_surface(spec), spec, rng)
    surfaces = {name: implemented(surface, name) for name in implementations()}
    clear = np.flatnonzero(surface.is_clear_of_forbidden_points)
    chosen = np.array([rng.choice(clear, spec.contacts, replace=False) for _ in range(NUM_SETS)])
    starts = surface.p_OQ[chosen]
    if spec.shape == CUBE:
        # Off the grid, or candidates would be as near to one contact as to another.
        along = np.where(surface.nhat_OQ[chosen] == 0, spec.spacing, 0)
        starts = starts + along * rng.uniform(-0.5, 0.5, along.shape)
    return Scene(surfaces, starts)


def _bare_surface(spec: SceneSpec) -> ObjectSurface:
    if spec.shape == CUBE:
        return box_surface([EDGE] * 3, spacing=spec.spacing)
    return load_scenario(spec.shape).make_surface(spec.spacing)


def _with_forbidden_points(
    surface: ObjectSurface, spec: SceneSpec, rng: np.random.Generator
) -> ObjectSurface:
    own = surface.forbidden
    kept = np.sort(rng.permutation(len(own))[: spec.forbidden])
    forbidden = ForbiddenPoints(own.points[kept], own.radii[kept], own.normals[kept])
    count = spec.forbidden - len(own)
    if count > 0 and spec.shape == CUBE:
        points = rng.uniform(-EDGE / 2, EDGE / 2, (count, 3))
        points[:, 2] = rng.choice([-EDGE / 2, EDGE / 2], count)
        forbidden = forbidden.joined(ForbiddenPoints(points, rng.uniform(0, LARGEST_RADIUS, count)))
    return replace(surface, forbidden=forbidden)
