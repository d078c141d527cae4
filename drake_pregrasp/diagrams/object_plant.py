"""The object on its moving table, as one diagram."""

from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_pregrasp.diagrams.box_model import resized_box_sdf
from drake_pregrasp.diagrams.motion_config import MotionConfig
from drake_pregrasp.diagrams.object_config import ObjectConfig
from drake_pregrasp.resources import resource_folder
from drake_pregrasp.systems.body_pose import BodyPose
from drake_pregrasp.systems.object_motion import ObjectMotion

FIRST_TOUCH = 1e-6
"""Depth in metres by which the object starts in the table: without any contact, it would fall
freely for one time step, and start with a bounce."""


class ObjectPlant(Diagram):
    """A free box on a conveyor and turntable that carries it by friction.

    .. pydrake_system::

        name: ObjectPlant
        output_ports:
        - X_WO
        - query_object

    Port `X_WO` emits a `RigidTransform`: the true pose of the object O in the world W. The table's
    top is the plane z = 0 of W; the object starts at its centre, at rest, with the axes of W.

    Port `query_object` emits SceneGraph's `QueryObject`, for visualizers.

    The attributes `plant` and `scene_graph` are the systems inside.

    Args:
        object_config: The object.
        motion_config: The table's motion.
        plant_config: Time step and contact model.
    """

    plant: MultibodyPlant
    scene_graph: SceneGraph

    def __init__(
        self,
        object_config: ObjectConfig,
        motion_config: MotionConfig,
        plant_config: MultibodyPlantConfig,
    ) -> None:
        super().__init__()
        builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlant(plant_config, builder)
        models = resource_folder("models")
        parser = Parser(self.plant)
        parser.package_map().AddPackageXml(str(models / "package.xml"))
        cube_sdf = resized_box_sdf(models / "cube.sdf", object_config.size, object_config.mass)
        (cube,) = parser.AddModelsFromString(cube_sdf, "sdf")
        (table,) = parser.AddModelsFromUrl("package://drake_pregrasp/conveyor_table.sdf")
        self.plant.Finalize()
        body = self.plant.GetBodyByName("cube", cube)
        z_WO = object_config.size[2] / 2 - FIRST_TOUCH
        self.plant.SetDefaultFloatingBaseBodyPose(body, RigidTransform([0.0, 0.0, z_WO]))

        motion = builder.AddNamedSystem(
            "object_motion",
            ObjectMotion(
                linear_velocity=motion_config.linear_velocity,
                angular_velocity=motion_config.angular_velocity,
            ),
        )
        builder.Connect(motion.get_output_port(), self.plant.get_desired_state_input_port(table))
        pose = builder.AddNamedSystem("object_pose", BodyPose(body.index()))
        builder.Connect(self.plant.get_body_poses_output_port(), pose.get_input_port())
        builder.ExportOutput(pose.get_output_port(), "X_WO")
        builder.ExportOutput(self.scene_graph.get_query_output_port(), "query_object")
        builder.BuildInto(self)
