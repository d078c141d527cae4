"""The thinking side: estimator, partitioner and selector as one diagram with exported ports."""

from collections.abc import Sequence
from dataclasses import asdict

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.planner_config import EstimatorConfig, PlannerConfig, filter_noise
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.systems.centroid_selector import CentroidSelector
from drake_pregrasp.systems.pose_estimator import PoseEstimator
from drake_pregrasp.systems.safe_region_partitioner import SafeRegionPartitioner


def make_estimator(config: EstimatorConfig, period: float, p_OCoM: FloatArray) -> PoseEstimator:
    """Returns the estimator that a configuration describes.

    Args:
        config: Its settings.
        period: Seconds between measurements.
        p_OCoM: The object's centre of mass in O, shape (3,), in metres.

    Raises:
        InvalidArgumentError: If settings don't go together.
    """
    return PoseEstimator(
        period=period,
        noise=filter_noise(config),
        p_OCoM=p_OCoM,
        lookahead=config.lookahead,
        gate=config.gate,
        reacquire_after=config.reacquire_after,
        refuse_repeats=config.refuse_repeats,
        late_measurements=config.late_measurements,
        coast_after=config.coast_after,
        lost_after=config.lost_after,
    )


class PregraspPlanner(Diagram):
    """From pose measurements to contact goals.

    .. pydrake_system::

        name: PregraspPlanner
        input_ports:
        - X_WO_measured
        - measurement_time
        - contact_weights
        - obstacles
        - X_WH
        - hold_contacts
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

    The ports are those of the systems inside, which document them: `X_WO_measured`,
    `measurement_time` (optional), `X_WO_estimated`, `V_WO_estimated`, `p_WO_covariance`,
    `tracking_status`, `time_since_measurement`, `measurement_verdict` and `innovation_squared` of
    `PoseEstimator`; `contact_weights`,
    `obstacles`, `X_WH` (all optional) and `safe_regions` of `SafeRegionPartitioner`;
    `hold_contacts` (optional), `p_WC`, `contact_status`, `contact_causes`, `fingertip_targets` and
    `p_WC_previous` of `CentroidSelector`. A hand whose pose at `X_WH` follows the goals has to
    follow `p_WC_previous`: the others depend on `X_WH`.

    Args:
        config: Planning rate and settings.
        surface: The object's surface.
        p_OC: Initial contact points on the surface, in O, shape (n, 3), in metres.
        fingertip_frames: Names for `fingertip_targets`; see `CentroidSelector`.
    """

    def __init__(
        self,
        config: PlannerConfig,
        surface: ObjectSurface,
        p_OC: FloatArray,
        *,
        fingertip_frames: Sequence[str] | None = None,
    ) -> None:
        super().__init__()
        builder = DiagramBuilder()
        estimator = builder.AddNamedSystem(
            "pose_estimator",
            make_estimator(config.estimator, config.period, surface.p_OCoM),
        )
        partitioner = builder.AddNamedSystem(
            "safe_region_partitioner",
            SafeRegionPartitioner(
                surface=surface,
                num_contacts=len(p_OC),
                tip_radii=np.array(config.limits.tip_radii),
                clearance=config.limits.clearance,
                tip_gap=config.limits.tip_gap,
                standoff=config.limits.standoff,
                horizon=config.limits.horizon,
                reach=[reach.make_reach() for reach in config.limits.reach],
                closed=config.limits.closed(),
                wall_test=config.wall_test,
                normal_length=config.normal_length,
            ),
        )
        selector = builder.AddNamedSystem(
            "centroid_selector",
            CentroidSelector(
                surface=surface,
                p_OC=p_OC,
                period=config.period,
                strategy=config.strategy,
                reading=config.reading,
                stretch=config.stretch,
                power=config.power,
                friction=config.friction,
                blend=asdict(config.blend),
                best_point=config.best_point,
                in_turns=config.in_turns,
                position_spread=config.position_spread,
                static_duration=config.static_duration,
                lost_standoff=config.lost_standoff,
                limits=config.limits.make_limits(config.period, config.friction),
                verify_contacts=config.verify_contacts,
                fingertip_frames=fingertip_frames,
            ),
        )
        for source, output, target, target_input in (
            (estimator, "X_WO_estimated", partitioner, "X_WO_estimated"),
            (estimator, "V_WO_estimated", partitioner, "V_WO_estimated"),
            (estimator, "X_WO_estimated", selector, "X_WO_estimated"),
            (estimator, "p_WO_covariance", selector, "p_WO_covariance"),
            (estimator, "tracking_status", selector, "tracking_status"),
            (partitioner, "safe_regions", selector, "safe_regions"),
            (selector, "p_WC_previous", partitioner, "p_WC"),
        ):
            builder.Connect(source.GetOutputPort(output), target.GetInputPort(target_input))

        for name in ("X_WO_measured", "measurement_time"):
            builder.ExportInput(estimator.GetInputPort(name), name)
        for name in ("contact_weights", "obstacles", "X_WH"):
            builder.ExportInput(partitioner.GetInputPort(name), name)
        builder.ExportInput(selector.GetInputPort("hold_contacts"), "hold_contacts")
        for name in ("p_WC", "contact_status", "fingertip_targets"):
            builder.ExportOutput(selector.GetOutputPort(name), name)
        for name in ("X_WO_estimated", "V_WO_estimated", "p_WO_covariance"):
            builder.ExportOutput(estimator.GetOutputPort(name), name)
        builder.ExportOutput(partitioner.GetOutputPort("safe_regions"), "safe_regions")
        for name in ("contact_causes", "p_WC_previous"):
            builder.ExportOutput(selector.GetOutputPort(name), name)
        for name in (
            "tracking_status",
            "time_since_measurement",
            "measurement_verdict",
            "innovation_squared",
        ):
            builder.ExportOutput(estimator.GetOutputPort(name), name)
        builder.BuildInto(self)


def AddPregraspPlanner(
    builder: DiagramBuilder,
    config: PlannerConfig,
    surface: ObjectSurface,
    p_OC: FloatArray,
    *,
    fingertip_frames: Sequence[str] | None = None,
    name: str = "pregrasp_planner",
) -> PregraspPlanner:
    """Adds a `PregraspPlanner` to anybody's diagram.

    Its input `X_WO_measured` must then be connected, the others may be.

    Args:
        builder: Where to add it.
        config: Planning rate and settings.
        surface: The object's surface, in the object frame O.
        p_OC: Initial contact points on the surface, in O, shape (n, 3), in metres.
        fingertip_frames: Names for `fingertip_targets`, one for each contact.
        name: Name of the system.
    """
    planner = PregraspPlanner(
        config, surface, np.asarray(p_OC, dtype=float), fingertip_frames=fingertip_frames
    )
    builder.AddNamedSystem(name, planner)
    return planner
