"""Plant with the moving object and a hand over it, as one diagram."""

from collections.abc import Sequence

from pydrake.geometry import GeometryId, SceneGraph
from pydrake.multibody.plant import MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import Joint, ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.config.object_config import MotionConfig, ObjectConfig
from drake_pregrasp.diagrams.hand_instances import (
    HandInstances,
    hand_ports,
    set_default_positions,
)
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.object_contact import make_compliant
from drake_pregrasp.diagrams.object_plant import DRAKE, ForceMakers, add_moving_object
from drake_pregrasp.diagrams.wiring import connect, export_inputs
from drake_pregrasp.estimation.recorded_poses import RecordedPoses
from drake_pregrasp.geometry.shapes import Shape
from drake_pregrasp.systems.hand_kinematics import HandLink
from drake_pregrasp.systems.link_contacts import LinkContacts
from drake_pregrasp.systems.mujoco_plant import MujocoPlant
from drake_pregrasp.systems.object_shake import ObjectShake
from drake_pregrasp.systems.sources import BodyPose, MovingSolid


class HandStation(Diagram):
    """Simulates a moving object and a hand that can lift it.

    .. pydrake_system::

        name: HandStation
        input_ports:
        - desired_state
        - grasp_report
        output_ports:
        - X_WO
        - query_object
        - hand_state
        - net_actuation
        - X_WD
        - link_forces

    Port `desired_state` accepts a vector of 2 nq: desired positions and velocities of the hand's
    joints, for actuators with the gains of its model.

    Port `grasp_report` (optional) accepts a vector of 4: that of `HandController`. If it is
    connected, the object is shaken once the hand has held it for some time (`ObjectShake`).

    Port `X_WO` emits a `RigidTransform`: the true pose of the object, as that of `ObjectPlant`.

    Port `query_object` emits SceneGraph's `QueryObject`, for visualizers.

    Port `hand_state` emits a vector of 2 nq: positions and velocities of the hand's joints.

    Port `net_actuation` emits a vector of nq: torques or forces of the actuators, in N m or N.

    Port `X_WD` emits a `RigidTransform`: the pose of the turntable D of a conveyor, or else W.

    Port `link_forces` emits a vector of 3, as `LinkContacts` does: the largest forces with which
    links that are not fingertips touched something since the last tick of the controller.

    All links of the hand collide with the object and the table, and fingers with each other. Links
    of one finger, and those of the base, do not collide with each other, nor fingers with the base.
    Gravity does not act on the hand, as if it were compensated.

    The attributes `plant` and `scene_graph` hold the plant and its SceneGraph, and `dynamics` the
    system that simulates the plant.

    Args:
        object_config: The object.
        motion_config: Motion of the object, which a plant simulates.
        plant_config: Time step and contact model.
        hand: Model of the hand.
        friction: Coulomb's coefficient of friction of the object.
        initial: Initial positions of the hand, shape (nq,).
        period: Seconds between ticks of the controller, for `link_forces`.
        shape: Shape of the object, if it has been made.
        obstacles: Obstacles that are bodies.
        forces: Further systems with forces on the object's body.
        engine: What simulates the plant, one of `ENGINES`.

    Raises:
        InvalidArgumentError: If the hand's model cannot be loaded, or MuJoCo is chosen but not
            installed.
    """

    plant: MultibodyPlant
    scene_graph: SceneGraph
    dynamics: MultibodyPlant | MujocoPlant

    def __init__(
        self,
        object_config: ObjectConfig,
        motion_config: MotionConfig | RecordedPoses,
        plant_config: MultibodyPlantConfig,
        hand: HandModel,
        *,
        friction: float,
        initial: FloatArray,
        period: float = GraspConfig.period,
        shape: Shape | None = None,
        obstacles: Sequence[MovingSolid] = (),
        forces: ForceMakers = (),
        engine: str = DRAKE,
    ) -> None:
        super().__init__()
        builder, models = DiagramBuilder(), list[ModelInstanceIndex]()
        links, joints = dict[GeometryId, HandLink](), list[Joint]()
        is_pad = hand.description.patch_radii > 0

        def separate(plant: MultibodyPlant, scene_graph: SceneGraph) -> None:
            instances = HandInstances(plant, models)
            joints.extend(instances.moving_joints())
            set_default_positions(joints, initial)
            links.update(hand.separate_links(instances, scene_graph))
            # At points of contact, friction would not resist twisting, as that of a pad does.
            pads = [g for g, link in links.items() if link.is_tip and is_pad[link.finger]]
            make_compliant(plant, scene_graph, pads)

        self.plant, self.scene_graph, X_WO, self.dynamics = add_moving_object(
            builder,
            shape or object_config.make_shape(),
            object_config.mass,
            motion_config,
            plant_config,
            friction=friction,
            obstacles=obstacles,
            add_more=lambda plant: models.extend(hand.add_to(plant)),
            separate_more=separate,
            holds_pose=True,
            forces=[("object_shake", ObjectShake), *forces],
            engine=engine,
        )
        contacts = self._add_link_contacts(builder, links, period)
        X_WD = self._add_turntable_pose(builder)
        desired, state, actuation = hand_ports(builder, self.plant, joints, self.dynamics)
        builder.ExportInput(desired, "desired_state")
        export_inputs(builder, "grasp_report", builder.GetSubsystemByName("object_shake"))
        builder.ExportOutput(X_WO, "X_WO")
        builder.ExportOutput(self.scene_graph.get_query_output_port(), "query_object")
        builder.ExportOutput(state, "hand_state")
        builder.ExportOutput(actuation, "net_actuation")
        builder.ExportOutput(X_WD, "X_WD")
        builder.ExportOutput(contacts.get_output_port(), "link_forces")
        builder.BuildInto(self)

    def _add_link_contacts(
        self, builder: DiagramBuilder, links: dict[GeometryId, HandLink], period: float
    ) -> LinkContacts:
        body = self.plant.GetBodyByName("object")
        contacts = LinkContacts(
            links,
            self.plant.GetCollisionGeometriesForBody(body),
            period=period,
            time_step=self.plant.time_step(),
            results=self.dynamics.GetOutputPort("contact_results").Allocate(),
        )
        builder.AddNamedSystem("link_contacts", contacts)
        connect(builder, self.dynamics, "contact_results", contacts)
        return contacts

    def _add_turntable_pose(self, builder: DiagramBuilder) -> OutputPort:
        """Adds the system that emits the pose of the turntable, or of the world without one."""
        body = self.plant.world_body()
        if self.plant.HasBodyNamed("turntable"):
            body = self.plant.GetBodyByName("turntable")
        pose = builder.AddNamedSystem("turntable_pose", BodyPose(body.index()))
        builder.Connect(self.dynamics.get_body_poses_output_port(), pose.get_input_port())
        return pose.get_output_port()
