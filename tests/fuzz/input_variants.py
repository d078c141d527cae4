"""Small planners for random inputs, with ticks of one or two milliseconds."""

import dataclasses
import functools
from typing import Any

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_pregrasp import CoordinateConfig, PlannerConfig, PregraspPlanner, box_surface
from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.limits_config import BallReach, LimitsConfig, Pair, SectorReach
from drake_pregrasp.contacts.goal_limits import ContactLimits
from drake_pregrasp.diagrams.wiring import connect, export_inputs, export_outputs
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
        partitioner = SafeRegionPartitioner(config, surface=surface, num_contacts=len(p_OC))
        selector = CentroidSelector(config, surface=surface, p_OC=p_OC)
        builder.AddNamedSystem("safe_region_partitioner", partitioner)
        builder.AddNamedSystem("centroid_selector", selector)
        inputs = "X_WO_estimated V_WO_estimated contact_weights obstacles X_WH"
        inputs += " finger_coordinates candidate_coordinates"
        export_inputs(builder, inputs, partitioner)
        export_inputs(builder, "p_WO_covariance hold_contacts tracking_status", selector)
        builder.ConnectInput("X_WO_estimated", selector.GetInputPort("X_WO_estimated"))
        connect(builder, partitioner, "safe_regions", selector)
        connect(builder, selector, "p_WC_previous:p_WC", partitioner)
        export_outputs(builder, partitioner, "safe_regions")
        outputs = "p_WC contact_status fingertip_targets p_WC_previous contact_causes"
        export_outputs(builder, selector, outputs)
        builder.BuildInto(self)


_HAND_LIMITS = LimitsConfig(
    max_speed=0.1, deadband=0.0005, tip_radii=[0.006] * 3, tip_gap=0.002, standoff=0.01, horizon=0.2
)


def _box() -> ObjectSurface:
    return box_surface([0.06, 0.08, 0.05], spacing=0.012)


def _mesh() -> ObjectSurface:
    profile = [[0.0, 0.0], [0.03, 0.0], [0.022, 0.04], [0.03, 0.08], [0.0, 0.08]]
    return mesh_surface(revolved_shape(profile), spacing=0.012)


_REACH = [SectorReach(0.0), SectorReach(3.1), BallReach(center=[0.0, 0.05, 0.0], radius=0.06)]
_COUPLED = LimitsConfig(
    max_step=0.01,
    guard=["q_gii"],
    recover=True,
    pairs=[Pair(first=0, second=2, distance=0.05, tolerance=0.002)],
)
_STAGES: dict[str, dict[str, Any]] = {
    "plain": {},
    "limits": {"limits": _HAND_LIMITS},
    "reach": {
        "limits": dataclasses.replace(
            _HAND_LIMITS,
            max_step=0.004,
            recover=True,
            reach=_REACH,
            forbidden_faces=[["-x"], [], ["+z"]],
        )
    },
    "mesh": {"limits": dataclasses.replace(_HAND_LIMITS, recover=True), "strategy": "gii"},
    "coupled": {"limits": _COUPLED, "strategy": "margin", "in_turns": True},
    "coordinates": {
        "limits": _HAND_LIMITS,
        "coordinates": [
            CoordinateConfig(scale=1.0, candidates="height", fingers=[0.01, 0.02, -0.03]),
            CoordinateConfig(scale=0.1),
        ],
    },
    "walls": {"wall_test": "surface", "strategy": "vew", "best_point": True},
}
"""Fields of the planner's configuration, by the names of the variants."""

_OF_CAMERAS = ("point_cloud", "p_WT", "touching")
_OF_COORDINATES = ("finger_coordinates", "candidate_coordinates")

VARIANTS = (*_STAGES, "planner")
"""Names of all variants; the last has an estimator of its own."""


@functools.cache
def make_variant(name: str) -> Variant:
    """Returns the variant of a name; each is built once."""
    fields = _STAGES["limits" if name == "planner" else name]
    config = PlannerConfig(period=PERIOD, static_duration=0.0, **fields)
    surface, p_OC = _box(), BOX_CONTACTS
    if name == "mesh":
        surface = _mesh()
        p_OC = surface.p_OQ[[0, len(surface.p_OQ) // 3, 2 * len(surface.p_OQ) // 3]]
    diagram = (PregraspPlanner if name == "planner" else _Stages)(config, surface, p_OC)
    names = [diagram.get_input_port(k).get_name() for k in range(diagram.num_input_ports())]
    unused = _OF_CAMERAS if config.coordinates else (*_OF_CAMERAS, *_OF_COORDINATES)
    ports = tuple(name for name in names if name not in unused)
    return Variant(
        diagram=diagram,
        selector=diagram.GetSubsystemByName("centroid_selector"),
        partitioner=diagram.GetSubsystemByName("safe_region_partitioner"),
        surface=surface,
        p_OC=p_OC,
        limits=config.limits.make_limits(config.period, config.friction),
        ports=ports,
    )
