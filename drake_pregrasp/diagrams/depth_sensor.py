"""Depth cameras in a scene, and the points of the object that they see, as one diagram."""

import numpy as np
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    MakeRenderEngineVtk,
    RenderCameraCore,
    RenderEngineVtkParams,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.perception import BaseField, DepthImageToPointCloud
from pydrake.planning import RobotDiagram
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.sensors import CameraInfo, PixelType, RgbdSensor

from drake_pregrasp.config.camera_config import CameraConfig, DepthSensorConfig
from drake_pregrasp.diagrams.wiring import connect, export_inputs, export_outputs
from drake_pregrasp.systems.object_points import ObjectPoints
from drake_pregrasp.visualization.drawing import camera_pose

_RENDERER = "depth_cameras"
_NEAREST, _FARTHEST = 0.05, 5.0  # Depths that a camera sees, in metres.


class DepthSensor(Diagram):
    """Sees the object with depth cameras, instead of `NoisyPoseSensor`.

    .. pydrake_system::

        name: DepthSensor
        input_ports:
        - query_object
        - hand_state
        output_ports:
        - point_cloud
        - measurement_time

    Port `query_object` accepts SceneGraph's `QueryObject`, with everything that the cameras see.
    Drake's VTK renderer takes the pictures, with a `RgbdSensor` for each camera.

    The other ports are those of `ObjectPoints`, which documents them; there is no `hand_state`
    without a hand.

    Args:
        config: The cameras.
        scene_graph: SceneGraph of `query_object`, which gets a renderer.
        hand: Plant with only the hand, and its SceneGraph; None without a hand.
        seed: Seed of the noise, an integer from 0 to 2**53.

    Raises:
        InvalidArgumentError: If the configuration or the seed is out of its range.
    """

    def __init__(
        self,
        config: DepthSensorConfig,
        scene_graph: SceneGraph,
        *,
        hand: RobotDiagram | None = None,
        seed: int = 0,
    ) -> None:
        super().__init__()
        builder = DiagramBuilder()
        points = builder.AddNamedSystem("object_points", ObjectPoints(config, hand=hand, seed=seed))
        scene_graph.AddRenderer(_RENDERER, MakeRenderEngineVtk(RenderEngineVtkParams()))
        cameras = [_sensor(camera, scene_graph) for camera in config.cameras]
        for index, sensor in enumerate(cameras):
            builder.AddNamedSystem(f"camera_{index}", sensor)
            cloud = builder.AddNamedSystem(
                f"points_{index}",
                DepthImageToPointCloud(_seen_by(sensor), PixelType.kDepth32F, 1.0, BaseField.kXYZs),
            )
            connect(builder, sensor, "depth_image_32f:depth_image", cloud)
            connect(builder, sensor, "body_pose_in_world:camera_pose", cloud)
            connect(builder, cloud, f"point_cloud:camera_{index}", points)
        first, *others = (sensor.query_object_input_port() for sensor in cameras)
        builder.ExportInput(first, "query_object")
        for port in others:
            builder.ConnectInput("query_object", port)
        if hand is not None:
            export_inputs(builder, "hand_state", points)
        export_outputs(builder, points, "point_cloud measurement_time")
        builder.BuildInto(self)


def _seen_by(sensor: RgbdSensor) -> CameraInfo:
    """Returns the intrinsics of a camera's depth pictures.

    The VTK renderer draws what is on the optical axis half a pixel before the principal point, in
    both directions.
    """
    info = sensor.default_depth_render_camera().core().intrinsics()
    center = info.center_x() - 0.5, info.center_y() - 0.5
    return CameraInfo(info.width(), info.height(), info.focal_x(), info.focal_y(), *center)


def _sensor(camera: CameraConfig, scene_graph: SceneGraph) -> RgbdSensor:
    p_WK, p_WT = np.array(camera.position), np.array(camera.target)
    core = RenderCameraCore(
        _RENDERER,
        CameraInfo(camera.width, camera.height, camera.field_of_view),
        ClippingRange(_NEAREST, _FARTHEST),
        RigidTransform(),
    )
    return RgbdSensor(
        scene_graph.world_frame_id(),
        camera_pose(p_WT, p_WK - p_WT),
        ColorRenderCamera(core),
        DepthRenderCamera(core, DepthRange(_NEAREST, _FARTHEST)),
    )
