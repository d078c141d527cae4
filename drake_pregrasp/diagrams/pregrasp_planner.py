"""The planner as one diagram: estimator, partitioner and selector."""

from collections.abc import Sequence

from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.planner_config import PlannerConfig
from drake_pregrasp.contacts.selection_input import WeightFunction
from drake_pregrasp.diagrams.wiring import connect, export_inputs, export_outputs
from drake_pregrasp.fast import default_kernels
from drake_pregrasp.fast.kernels import Kernels
from drake_pregrasp.geometry.mesh_solid import MeshSolid
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.regions.finger_measures import FingerMeasures
from drake_pregrasp.systems.centroid_selector import CentroidSelector
from drake_pregrasp.systems.pose_estimator import PoseEstimator
from drake_pregrasp.systems.safe_region_partitioner import SafeRegionPartitioner


class PregraspPlanner(Diagram):
    """Plans contact goals from pose measurements.

    .. pydrake_system::

        name: PregraspPlanner
        input_ports:
        - X_WO_measured
        - measurement_time
        - contact_weights
        - obstacles
        - X_WH
        - hold_contacts
        - V_WO_held
        - point_cloud
        - p_WT
        - touching
        - finger_coordinates
        - candidate_coordinates
        - X_WU
        - late_fingers
        output_ports:
        - p_WC
        - contact_status
        - fingertip_targets
        - X_WO_estimated
        - V_WO_estimated
        - p_WO_covariance
        - safe_regions
        - contact_causes
        - p_WC_previous
        - tracking_status
        - time_since_measurement
        - measurement_verdict
        - innovation_squared
        - camera_offset

    The ports are those of the systems inside, which document them: `X_WO_measured`,
    `measurement_time`, `V_WO_held`, `point_cloud`, `p_WT` and `touching` (all optional),
    `X_WO_estimated`, `V_WO_estimated`, `p_WO_covariance`, `tracking_status`,
    `time_since_measurement`, `measurement_verdict`, `innovation_squared` and `camera_offset` of
    `PoseEstimator`; `contact_weights`, `obstacles`, `X_WH`, `finger_coordinates`,
    `candidate_coordinates`, `X_WU`, `late_fingers` (all optional) and `safe_regions` of
    `SafeRegionPartitioner`;
    `hold_contacts` (optional), `p_WC`, `contact_status`, `contact_causes`, `fingertip_targets` and
    `p_WC_previous` of `CentroidSelector`.

    At a tick, all outputs are the same before and after the discrete update, except `safe_regions`
    and `p_WC_previous`, which change when the update stores the tick's new goals. If the poses at
    `X_WH` and `X_WU` depend on the goals, they must use those of `p_WC_previous`, because the goals
    of `p_WC` depend on these poses.

    Args:
        config: Configuration of the planner.
        surface: The object's surface.
        p_OC: Initial contact points on the surface, in O, shape (n, 3), in metres.
        fingertip_frames: Names for `fingertip_targets`; see `CentroidSelector`.
        weight_function: A strategy of your own; see `CentroidSelector`.
        finger_measures: Measures of a hand's fingers; see `SafeRegionPartitioner`.
        object_solid: The object in O, for `point_cloud`; None without.
        tip_radii: Radii of the fingertips of `p_WT`, in metres; see `PoseEstimator`.
        kernels: Implementation of what takes most of a tick; that of `default_kernels` by default.
    """

    def __init__(
        self,
        config: PlannerConfig,
        surface: ObjectSurface,
        p_OC: FloatArray,
        *,
        fingertip_frames: Sequence[str] | None = None,
        weight_function: WeightFunction | None = None,
        finger_measures: FingerMeasures | None = None,
        object_solid: MeshSolid | None = None,
        tip_radii: FloatArray | None = None,
        kernels: Kernels | None = None,
    ) -> None:
        super().__init__()
        kernels = kernels or default_kernels()
        builder, p_OCoM = DiagramBuilder(), surface.p_OCoM
        estimator = builder.AddNamedSystem(
            "pose_estimator",
            PoseEstimator(
                config.estimator,
                period=config.period,
                p_OCoM=p_OCoM,
                object_solid=object_solid,
                tip_radii=tip_radii,
                kernels=kernels,
            ),
        )
        partitioner = builder.AddNamedSystem(
            "safe_region_partitioner",
            SafeRegionPartitioner(
                config,
                surface=surface,
                num_contacts=len(p_OC),
                finger_measures=finger_measures,
                kernels=kernels,
            ),
        )
        selector = builder.AddNamedSystem(
            "centroid_selector",
            CentroidSelector(
                config,
                surface=surface,
                p_OC=p_OC,
                fingertip_frames=fingertip_frames,
                weight_function=weight_function,
                kernels=kernels,
            ),
        )
        _connect(builder, estimator, partitioner, selector)
        builder.BuildInto(self)


def _connect(
    builder: DiagramBuilder,
    estimator: PoseEstimator,
    partitioner: SafeRegionPartitioner,
    selector: CentroidSelector,
) -> None:
    """Connects the systems to each other, and exports the ports of `PregraspPlanner` in order."""
    connect(builder, estimator, "X_WO_estimated V_WO_estimated", partitioner)
    connect(builder, estimator, "X_WO_estimated p_WO_covariance tracking_status", selector)
    connect(builder, partitioner, "safe_regions", selector)
    connect(builder, selector, "p_WC_previous:p_WC", partitioner)
    export_inputs(builder, "X_WO_measured measurement_time", estimator)
    export_inputs(builder, "contact_weights obstacles X_WH", partitioner)
    export_inputs(builder, "hold_contacts", selector)
    export_inputs(builder, "V_WO_held point_cloud p_WT touching", estimator)
    export_inputs(builder, "finger_coordinates candidate_coordinates X_WU", partitioner)
    export_inputs(builder, "late_fingers", partitioner)
    export_outputs(builder, selector, "p_WC contact_status fingertip_targets")
    export_outputs(builder, estimator, "X_WO_estimated V_WO_estimated p_WO_covariance")
    export_outputs(builder, partitioner, "safe_regions")
    export_outputs(builder, selector, "contact_causes p_WC_previous")
    export_outputs(builder, estimator, "tracking_status time_since_measurement")
    export_outputs(builder, estimator, "measurement_verdict innovation_squared camera_offset")


def AddPregraspPlanner(
    builder: DiagramBuilder,
    config: PlannerConfig,
    surface: ObjectSurface,
    p_OC: FloatArray,
    *,
    fingertip_frames: Sequence[str] | None = None,
    weight_function: WeightFunction | None = None,
    finger_measures: FingerMeasures | None = None,
    object_solid: MeshSolid | None = None,
    tip_radii: FloatArray | None = None,
    kernels: Kernels | None = None,
) -> PregraspPlanner:
    """Adds a `PregraspPlanner` to a diagram, and returns it.

    Its input `X_WO_measured` or `point_cloud` must then be connected; the others are optional.

    Args:
        builder: Builder of the diagram.
        config: Configuration of the planner.
        surface: The object's surface, in the object frame O.
        p_OC: Initial contact points on the surface, in O, shape (n, 3), in metres.
        fingertip_frames: Names for `fingertip_targets`, one for each contact.
        weight_function: A strategy of your own, in place of `config.strategy`; see
            `CentroidSelector`.
        finger_measures: Measures of a hand's fingers; see `SafeRegionPartitioner`.
        object_solid: The object in O, for `point_cloud`; None without.
        tip_radii: Radii of the fingertips of `p_WT`, in metres; see `PoseEstimator`.
        kernels: As for `PregraspPlanner`.
    """
    planner = PregraspPlanner(
        config,
        surface,
        p_OC,
        fingertip_frames=fingertip_frames,
        weight_function=weight_function,
        finger_measures=finger_measures,
        object_solid=object_solid,
        tip_radii=tip_radii,
        kernels=kernels,
    )
    builder.AddNamedSystem("pregrasp_planner", planner)
    return planner
