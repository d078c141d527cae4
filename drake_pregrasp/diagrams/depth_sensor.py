"""Depth cameras in a scene, and the points of the object that they see, as one diagram."""

import math

import numpy as np
import trimesh
from pydrake.geometry import (
    Capsule,
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    FrameId,
    GeometryFrame,
    GeometryInstance,
    MakeRenderEngineVtk,
    Mesh,
    RenderCameraCore,
    RenderEngineVtkParams,
    Role,
    SceneGraph,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.perception import BaseField, DepthImageToPointCloud
from pydrake.planning import RobotDiagram
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.sensors import CameraInfo, PixelType, RgbdSensor

from drake_pregrasp.config.camera_config import CameraConfig, DepthSensorConfig
from drake_pregrasp.diagrams.object_body import mesh_data
from drake_pregrasp.diagrams.wiring import connect, export_inputs, export_outputs
from drake_pregrasp.systems.object_points import ObjectPoints
from drake_pregrasp.systems.scene_frames import SceneFrames
from drake_pregrasp.visualization.drawing import camera_pose

_RENDERER = "depth_cameras"
_NEAREST, _FARTHEST = 0.05, 5.0  # Depths that a camera sees, in metres.
_SAG = 5e-4  # Largest distance of a facet from the curved surface that it replaces, in metres.


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
        - depth_image_0

    Port `query_object` accepts SceneGraph's `QueryObject`, with everything that the cameras see:
    geometries with the perception role. Drake's VTK renderer takes the pictures, with a
    `RgbdSensor` for each camera, of a copy of this scene. In the copy, spheres and capsules have no
    more facets than they need to be within 0.5 mm, since the time of a picture grows with facets.

    Port `depth_image_0` emits the depth picture of the first camera, an `ImageDepth32F` in metres.
    Further cameras have `depth_image_1` and so on.

    The other ports are those of `ObjectPoints`, which documents them; `hand_state` is only there
    with a hand.

    Args:
        config: The cameras.
        scene_graph: SceneGraph of `query_object`, with all its geometries.
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
        scene = _add_scene(builder, scene_graph.model_inspector())
        cameras = [_sensor(camera, scene) for camera in config.cameras]
        for index, sensor in enumerate(cameras):
            builder.AddNamedSystem(f"camera_{index}", sensor)
            builder.Connect(scene.get_query_output_port(), sensor.query_object_input_port())
            cloud = builder.AddNamedSystem(
                f"points_{index}",
                DepthImageToPointCloud(_seen_by(sensor), PixelType.kDepth32F, 1.0, BaseField.kXYZs),
            )
            connect(builder, sensor, "depth_image_32f:depth_image", cloud)
            connect(builder, sensor, "body_pose_in_world:camera_pose", cloud)
            connect(builder, cloud, f"point_cloud:camera_{index}", points)
        if hand is not None:
            export_inputs(builder, "hand_state", points)
        export_outputs(builder, points, "point_cloud measurement_time")
        for index, sensor in enumerate(cameras):
            builder.ExportOutput(sensor.depth_image_32F_output_port(), f"depth_image_{index}")
        builder.BuildInto(self)


def _add_scene(builder: DiagramBuilder, inspector: SceneGraphInspector) -> SceneGraph:
    """Adds a SceneGraph with a renderer and a copy of the geometries that cameras see.

    The diagram gets the input port `query_object`, with the poses of their frames.
    """
    scene = builder.AddNamedSystem("scene_graph", SceneGraph())
    scene.AddRenderer(_RENDERER, MakeRenderEngineVtk(RenderEngineVtkParams()))
    source = scene.RegisterSource("seen")
    frames: dict[FrameId, FrameId] = {}
    for geometry in inspector.GetAllGeometryIds(Role.kPerception):
        frame, name = inspector.GetFrameId(geometry), f"seen_{geometry.get_value()}"
        shape = _faceted(inspector.GetShape(geometry))
        instance = GeometryInstance(inspector.GetPoseInFrame(geometry), shape, name)
        instance.set_perception_properties(inspector.GetPerceptionProperties(geometry))
        if frame == inspector.world_frame_id():
            scene.RegisterAnchoredGeometry(source, instance)
            continue
        if frame not in frames:
            frames[frame] = scene.RegisterFrame(source, GeometryFrame(name))
        scene.RegisterGeometry(source, frames[frame], instance)
    poses = builder.AddNamedSystem("scene_frames", SceneFrames(frames))
    builder.Connect(poses.get_output_port(), scene.get_source_pose_port(source))
    export_inputs(builder, "query_object", poses)
    return scene


def _faceted(shape: Shape) -> Shape:
    """Returns a sphere or a capsule as a mesh of few facets, and another shape as it is."""
    if not isinstance(shape, Sphere | Capsule):
        return shape
    radius = shape.radius()
    turns = max(8, math.ceil(math.pi / math.acos(max(0.0, 1 - _SAG / radius))))
    if isinstance(shape, Sphere):
        mesh = trimesh.creation.uv_sphere(radius, count=[turns, turns])
    else:
        mesh = trimesh.creation.capsule(shape.length(), radius, count=[turns, turns])
        mesh.apply_translation(-mesh.bounds.mean(axis=0))
    return Mesh(mesh_data=mesh_data(mesh))


def _seen_by(sensor: RgbdSensor) -> CameraInfo:
    """Returns the intrinsics of a camera's depth pictures.

    The VTK renderer draws what is on the optical axis half a pixel before the principal point, in
    both directions.
    """
    info = sensor.default_depth_render_camera().core().intrinsics()
    center = info.center_x() - 0.5, info.center_y() - 0.5
    return CameraInfo(info.width(), info.height(), info.focal_x(), info.focal_y(), *center)


def _sensor(camera: CameraConfig, scene: SceneGraph) -> RgbdSensor:
    p_WK, p_WT = np.array(camera.position), np.array(camera.target)
    core = RenderCameraCore(
        _RENDERER,
        CameraInfo(camera.width, camera.height, camera.field_of_view),
        ClippingRange(_NEAREST, _FARTHEST),
        RigidTransform(),
    )
    return RgbdSensor(
        scene.world_frame_id(),
        camera_pose(p_WT, p_WK - p_WT),
        ColorRenderCamera(core),
        DepthRenderCamera(core, DepthRange(_NEAREST, _FARTHEST)),
    )
