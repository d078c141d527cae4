"""What every motion of the object is made of."""

from typing import NamedTuple

from pydrake.geometry import SceneGraph
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, RigidBody
from pydrake.systems.framework import DiagramBuilder, OutputPort

from drake_pregrasp.resources import resource_folder
from drake_pregrasp.systems.body_pose import BodyPose


class MovingObject(NamedTuple):
    """An object that moves, in a diagram that is being built.

    Attributes:
        plant: The plant whose body it is.
        scene_graph: What shows it.
        X_WO: The port that emits its pose.
    """

    plant: MultibodyPlant
    scene_graph: SceneGraph
    X_WO: OutputPort


def add_model(plant: MultibodyPlant, file: str) -> ModelInstanceIndex:
    """Adds the model of one of the package's files to a plant."""
    parser = Parser(plant)
    parser.package_map().AddPackageXml(str(resource_folder("models") / "package.xml"))
    (model,) = parser.AddModelsFromUrl(f"package://drake_pregrasp/{file}")
    return model


def add_pose_output(builder: DiagramBuilder, plant: MultibodyPlant, body: RigidBody) -> OutputPort:
    """Adds a system that emits a body's pose in W, and returns its port."""
    pose = builder.AddNamedSystem("object_pose", BodyPose(body.index()))
    builder.Connect(plant.get_body_poses_output_port(), pose.get_input_port())
    return pose.get_output_port()
