"""Planners that random inputs are tried on: small, so that a tick takes a millisecond or two."""

import dataclasses
import functools
from collections.abc import Callable

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_pregrasp import PlannerConfig, PregraspPlanner, box_surface
from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.limits_config import BallReach, LimitsConfig, Pair, SectorReach
from drake_pregrasp.contacts.goal_limits import ContactLimits
from drake_pregrasp.geometry.mesh_surface import mesh_surface
from drake_pregrasp.geometry.shapes import revolved_shape
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.systems.centroid_selector import CentroidSelector
from drake_pregrasp.systems.safe_region_partitioner import SafeRegionPartitioner

PERIOD = 0.05

BOX_CONTACTS = np.array([[0.03, 0.005, 0.0], [-0.03, 0.01, 0.01], [0.0, 0.04, -0.01]])


@dataclasses.dataclass(frozen=True, eq=False)
class Variant:
    """A planner, or its stages without the estimator, and what its goals have to keep to."""

    diagram: Diagram
    selector: CentroidSelector
    partitioner: SafeRegionPartitioner
    surface: ObjectSurface
    p_OC: FloatArray
    limits: ContactLimits
    ports: tuple[str, ...]


class _Stages(Diagram):
    """Partitioner and selector, whose estimate comes from outside."""

    def __init__(self, config: PlannerConfig, surface: ObjectSurface, p_OC: FloatArray) -> None:
        super().__init__()
        builder = DiagramBuilder()
        partitioner = builder.AddNamedSystem(
            "safe_region_partitioner",
            SafeRegionPartitioner(config, surface=surface, num_contacts=len(p_OC)),
        )
        selector = builder.AddNamedSystem(
            "centroid_selector",
            CentroidSelector(config, surface=surface, p_OC=p_OC),
        )
        for name, systems in (
            ("X_WO_estimated", (partitioner, selector)),
            ("V_WO_estimated", (partitioner,)),
            ("p_WO_covariance", (selector,)),
            ("contact_weights", (partitioner,)),
            ("obstacles", (partitioner,)),
            ("X_WH", (partitioner,)),
            ("hold_contacts", (selector,)),
            ("tracking_status", (selector,)),
        ):
            builder.ExportInput(systems[0].GetInputPort(name), name)
            for system in systems[1:]:
                builder.ConnectInput(name, system.GetInputPort(name))
        for source, output, target, target_input in (
            (partitioner, "safe_regions", selector, "safe_regions"),
            (selector, "p_WC_previous", partitioner, "p_WC"),
        ):
            builder.Connect(source.GetOutputPort(output), target.GetInputPort(target_input))
        for system in (partitioner, selector):
            for index in range(system.num_output_ports()):
                builder.ExportOutput(
                    system.get_output_port(index), system.get_output_port(index).get_name()
                )
        builder.BuildInto(self)


_HAND_LIMITS = LimitsConfig(
    max_speed=0.1,
    deadband=0.0005,
    tip_radii=[0.006] * 3,
    tip_gap=0.002,
    standoff=0.01,
    horizon=0.2,
)


def _box() -> ObjectSurface:
    return box_surface([0.06, 0.08, 0.05], spacing=0.012)


def _config(**changes: object) -> PlannerConfig:
    return dataclasses.replace(
        PlannerConfig(period=PERIOD, static_duration=0.0),
        **changes,  # type: ignore[arg-type]
    )


def _mesh() -> ObjectSurface:
    profile = [[0.0, 0.0], [0.03, 0.0], [0.022, 0.04], [0.03, 0.08], [0.0, 0.08]]
    return mesh_surface(revolved_shape(profile), spacing=0.012)


def _on_mesh(surface: ObjectSurface) -> FloatArray:
    return surface.p_OQ[[0, len(surface.p_OQ) // 3, 2 * len(surface.p_OQ) // 3]]


_STAGES: dict[str, Callable[[], tuple[PlannerConfig, ObjectSurface]]] = {
    "plain": lambda: (_config(), _box()),
    "limits": lambda: (_config(limits=_HAND_LIMITS), _box()),
    "reach": lambda: (
        _config(
            limits=dataclasses.replace(
                _HAND_LIMITS,
                max_step=0.004,
                recover=True,
                reach=[
                    SectorReach(0.0),
                    SectorReach(3.1),
                    BallReach(center=[0.0, 0.05, 0.0], radius=0.06),
                ],
                forbidden_faces=[["-x"], [], ["+z"]],
            )
        ),
        _box(),
    ),
    "mesh": lambda: (
        _config(limits=dataclasses.replace(_HAND_LIMITS, recover=True), strategy="gii"),
        _mesh(),
    ),
    "coupled": lambda: (
        _config(
            limits=LimitsConfig(
                max_step=0.01,
                guard=["q_gii"],
                recover=True,
                pairs=[Pair(first=0, second=2, distance=0.05, tolerance=0.002)],
            ),
            strategy="margin",
            in_turns=True,
        ),
        _box(),
    ),
    "walls": lambda: (_config(wall_test="surface", strategy="vew", best_point=True), _box()),
}

VARIANTS = (*_STAGES, "planner")
"""Names of all variants; the last has an estimator of its own."""


@functools.cache
def make_variant(name: str) -> Variant:
    """Returns the variant of a name; each is built once."""
    if name == "planner":
        config, surface = _config(limits=_HAND_LIMITS), _box()
        diagram: Diagram = PregraspPlanner(config, surface, BOX_CONTACTS)
        p_OC = BOX_CONTACTS
    else:
        config, surface = _STAGES[name]()
        p_OC = _on_mesh(surface) if name == "mesh" else BOX_CONTACTS
        diagram = _Stages(config, surface, p_OC)
    ports = tuple(
        diagram.get_input_port(index).get_name() for index in range(diagram.num_input_ports())
    )
    return Variant(
        diagram=diagram,
        selector=diagram.GetSubsystemByName("centroid_selector"),
        partitioner=diagram.GetSubsystemByName("safe_region_partitioner"),
        surface=surface,
        p_OC=p_OC,
        limits=config.limits.make_limits(config.period, config.friction),
        ports=ports,
    )
