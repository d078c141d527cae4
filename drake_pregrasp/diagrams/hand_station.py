"""The moving object and a hand over it, as one diagram."""

from collections.abc import Iterable

from pydrake.geometry import CollisionFilterDeclaration, GeometryId, GeometrySet, SceneGraph
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import ModelInstanceIndex, RigidBody
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_pregrasp.diagrams.conveyor_motion import add_conveyor
from drake_pregrasp.diagrams.hand_description import HandDescription
from drake_pregrasp.diagrams.hand_parsing import HAND, add_hand_model
from drake_pregrasp.diagrams.motion_config import Conveyor
from drake_pregrasp.diagrams.object_body import add_solid_collision
from drake_pregrasp.diagrams.object_config import Box
from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.assignment import FREE_TURN
from drake_pregrasp.systems.body_pose import BodyPose


class HandStation(Diagram):
    """A box that a conveyor carries, and a hand that can take it off.

    .. pydrake_system::

        name: HandStation
        input_ports:
        - desired_state
        output_ports:
        - X_WO
        - query_object
        - hand_state
        - net_actuation
        - X_WD

    Port `desired_state` accepts a vector of 2 nq: the positions that the hand's drives, with the
    gains of its model, are to hold, and velocities.

    Port `X_WO` emits a `RigidTransform`, `query_object` SceneGraph's `QueryObject`: as those of
    `ObjectPlant`.

    Port `hand_state` emits a vector of 2 nq: positions and velocities of the hand's joints.

    Port `net_actuation` emits a vector of nq: what its drives exert, in N m or N.

    Port `X_WD` emits a `RigidTransform`: the turntable D, which the box stands on.

    The box stands on its feet, and is a box for the hand. Of the hand's parts only the bodies that
    fingertips are on meet each other. It is without gravity, as if that were compensated.

    The attributes `plant` and `scene_graph` hold the model and what shows it.

    Args:
        object_config: The box.
        motion_config: How it moves.
        plant_config: Time step and contact model.
        hand: The hand.
        friction: Coulomb's coefficient of the box, for the hand.
        initial: The hand's positions at the start, shape (nq,).
        yaw_range: Of its wrist, as for `add_hand_model`.

    Raises:
        InvalidArgumentError: If the hand's model can't be loaded.
    """

    plant: MultibodyPlant
    scene_graph: SceneGraph

    def __init__(
        self,
        object_config: Box,
        motion_config: Conveyor,
        plant_config: MultibodyPlantConfig,
        hand: HandDescription,
        *,
        friction: float,
        initial: FloatArray,
        yaw_range: tuple[float, float] = FREE_TURN,
    ) -> None:
        super().__init__()
        builder = DiagramBuilder()
        solid: list[GeometryId] = []

        def add_hand(plant: MultibodyPlant, body: RigidBody) -> None:
            coefficients = CoulombFriction(static_friction=friction, dynamic_friction=friction)
            solid.extend(add_solid_collision(plant, body, object_config, friction=coefficients))
            add_hand_model(plant, hand, yaw_range)

        moving = add_conveyor(
            builder, object_config, motion_config, plant_config, add_more=add_hand
        )
        self.plant, self.scene_graph = moving.plant, moving.scene_graph
        instance = self.plant.GetModelInstanceByName(HAND)
        self.plant.SetDefaultPositions(instance, initial)
        self._filter_collisions(instance, solid, hand)
        turntable = self.plant.GetBodyByName("turntable")
        disc = builder.AddNamedSystem("turntable_pose", BodyPose(turntable.index()))
        builder.Connect(self.plant.get_body_poses_output_port(), disc.get_input_port())
        builder.ExportInput(self.plant.get_desired_state_input_port(instance), "desired_state")
        builder.ExportOutput(moving.X_WO, "X_WO")
        builder.ExportOutput(self.scene_graph.get_query_output_port(), "query_object")
        builder.ExportOutput(self.plant.get_state_output_port(instance), "hand_state")
        builder.ExportOutput(self.plant.get_net_actuation_output_port(instance), "net_actuation")
        builder.ExportOutput(disc.get_output_port(), "X_WD")
        builder.BuildInto(self)

    def _filter_collisions(
        self, instance: ModelInstanceIndex, solid: list[GeometryId], hand: HandDescription
    ) -> None:
        plant = self.plant

        def shapes(bodies: Iterable[RigidBody]) -> list[GeometryId]:
            return [g for body in bodies for g in plant.GetCollisionGeometriesForBody(body)]

        turntable = shapes([plant.GetBodyByName("turntable")])
        cube = plant.GetBodyByName("cube")
        feet = [geometry for geometry in shapes([cube]) if geometry not in solid]
        geometries = shapes(plant.get_body(index) for index in plant.GetBodyIndices(instance))
        frames = [plant.GetFrameByName(tip.frame, instance) for tip in hand.fingertips]
        tips = shapes(frame.body() for frame in frames)
        links = [geometry for geometry in geometries if geometry not in tips]
        manager = self.scene_graph.collision_filter_manager()
        # Its whole bottom on the table would be one hopping contact.
        for some, others in ((solid, turntable), (feet, geometries), (links, tips)):
            manager.Apply(
                CollisionFilterDeclaration().ExcludeBetween(GeometrySet(some), GeometrySet(others))
            )
        manager.Apply(CollisionFilterDeclaration().ExcludeWithin(GeometrySet(links)))
