"""Checks of the arguments with which a hand is added to a diagram of one's own."""

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import DiagramBuilder

from drake_pregrasp.arrays import FloatArray, number_or_nan
from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.config.hand_description import HandDescription
from drake_pregrasp.config.planner_config import PlannerConfig
from drake_pregrasp.diagrams.hand_instances import check_inertias
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.solids import Solid
from drake_pregrasp.geometry.surface import ObjectSurface

_DEEPEST = 1e-3  # Largest depth of an object in fixed solids, in metres: contact is deep by less.


def check_grasp_arguments(
    hand: HandDescription,
    surface: ObjectSurface,
    planner: PlannerConfig,
    config: GraspConfig,
    *,
    mass: float,
    X_WO: RigidTransform,
    p_OC: FloatArray | None,
    fixed: Sequence[Solid],
) -> None:
    """Checks the arguments of a grasp, as for `AddHandController`.

    Raises:
        InvalidArgumentError: If one has another type, a number is out of its range, or the object
            is inside of `fixed`.
    """
    for name, value, kind in (
        ("hand", hand, HandDescription),
        ("surface", surface, ObjectSurface),
        ("planner", planner, PlannerConfig),
        ("config", config, GraspConfig),
        ("X_WO", X_WO, RigidTransform),
    ):
        _check_kind(name, value, kind)
    if not number_or_nan(mass) > 0:
        raise InvalidArgumentError(f"mass must be a number greater than 0, in kg, not {mass!r}")
    if p_OC is not None and not (np.shape(p_OC)[1:] == (3,) and np.all(np.isfinite(p_OC))):
        raise InvalidArgumentError("p_OC must be an array of finite numbers, of shape (n, 3)")
    if not isinstance(fixed, Sequence) or not all(hasattr(solid, "distance") for solid in fixed):
        raise InvalidArgumentError(f"fixed must be a list of solids, not {fixed!r}")
    p_WV = (X_WO @ np.asarray(surface.mesh.vertices).T).T
    deepest = max((-float(np.min(solid.distance(p_WV))) for solid in fixed), default=0.0)
    if deepest > _DEEPEST:
        problem = f"the object is {1e3 * deepest:.3g} mm deep in the table or another fixed solid"
        raise InvalidArgumentError(f"X_WO: {problem}; place it on top")


def check_plant(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    scene_graph: SceneGraph | None,
    body: RigidBody | None,
) -> None:
    """Checks that a plant can have a hand added, and warns if its outputs are late.

    Raises:
        InvalidArgumentError: If it is not finalized, not in the builder, a link that moves has no
            inertia, or the SceneGraph or the body is that of another plant.
    """
    _check_kind("plant", plant, MultibodyPlant)
    if not plant.is_finalized():
        raise InvalidArgumentError("plant: it is not finalized; call plant.Finalize() before")
    if not any(system is plant for system in builder.GetSystems()):
        raise InvalidArgumentError("plant: it is not in this builder; add it by AddMultibodyPlant")
    check_inertias(plant, "plant: ")
    if scene_graph is not None:
        _check_kind("scene_graph", scene_graph, SceneGraph)
        source = plant.get_source_id()
        if source is None or not scene_graph.model_inspector().SourceIsRegistered(source):
            raise InvalidArgumentError("scene_graph: the plant has its geometries in another one")
    if body is not None and (body is plant.world_body() or body.GetParentPlant() is not plant):
        raise InvalidArgumentError(
            f"body: {body.name()} is the world or of another plant; pass that of the object"
        )
    if plant.has_sampled_output_ports():
        problem = "the controller sees the joints one time step late, and may throw the object over"
        warnings.warn(f"plant: use_sampled_output_ports is set: {problem}", stacklevel=3)


def _check_kind(name: str, value: Any, kind: type) -> None:
    if not isinstance(value, kind):
        there = type(value).__name__
        raise InvalidArgumentError(f"{name} must be of type {kind.__name__}, not {there}")
