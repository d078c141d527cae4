"""Kinematic model of a hand, from its model file and its description."""

from collections.abc import Sequence

import numpy as np
from pydrake.geometry import GeometryId, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.planning import RobotDiagram, RobotDiagramBuilder

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.hand_description import Carrier, Fingertip, HandDescription
from drake_pregrasp.contacts.assignment import FREE_TURN
from drake_pregrasp.diagrams.hand_instances import HandInstances, check_inertias
from drake_pregrasp.diagrams.hand_parsing import add_read_model, failures_as_errors, read_model
from drake_pregrasp.diagrams.home_fingers import HomeFingers
from drake_pregrasp.diagrams.model_files import CheckedModel
from drake_pregrasp.diagrams.palm_base import WRIST, PalmCarrier, check_home, make_base
from drake_pregrasp.errors import InvalidArgumentError, ProblemCollector, first_line
from drake_pregrasp.fast import default_kernels
from drake_pregrasp.fast.kernels import REFERENCE, HandKernels, Kernels
from drake_pregrasp.geometry.mesh_surface import AxisArea
from drake_pregrasp.geometry.solids import SignedDistance, Solid
from drake_pregrasp.systems.hand_kinematics import HandKinematics, HandLink, hand_links
from drake_pregrasp.systems.hand_scene import HandScene, separate_fingers
from drake_pregrasp.systems.palm_frames import FROM_ABOVE

_TWO_TURNS = 4 * np.pi


class HandModel:
    """Kinematic model of a hand without a scene.

    Args:
        description: Description of the hand.
        yaw_range: Range of the wrist, as for `add_read_model`.
        X_LA: Approach of the palm: pose of the frame A, in the frame L with its origin in the
            object's centre of mass and the axes of W. The palm comes along z of A, about which its
            yaw turns, and which points to the palm. From above by default, with A as L.
        X_WB: Pose in W of the frame B that the model calls its world. None: that of W, turned with
            A for a carrier.
        model: Model of the description from `read_model`. None: it is read, and warnings about it
            are logged.
        warns: Whether warnings about a given model are logged.
        extent: Largest distance of contacts from the object's centre of mass, in metres, for
            `HomeFingers.measures`. The smaller it is, the finer they are.
        pans: Whether a joint turns a carrier with B about z of W, so that a palm from the side
            turns with the object; not for arms.

    Attributes:
        description: Description of the hand.
        model: Its model, as Drake's parser gets it.
        X_LA: Approach of the palm.
        X_WB: Pose of the model's world B in W.
        pans: Whether the palm turns with the object about the vertical.
        diagram: Plant with only the hand, and its SceneGraph.
        instances: The hand in this plant.
        kinematics: Kinematics of the fingertips in this plant.
        base: Carrier or arm of the palm.
        fingers_home: Home positions of the fingers, and zeros for the base, shape (nq,).
        tip_radii: Radii of the fingertips, shape (n,), in metres.
        fingers: The fingers with the palm at home.
        withdrawn_radii: Radii for `HandGoalShaper`, shape (n,), in metres.
        p_HT: Fingertips at home, in A at yaw 0, shape (n, 3), in metres.
        azimuths: Azimuths of the fingertips at home, in A at yaw 0, shape (n,), in radians.

    Raises:
        InvalidArgumentError: If the model is invalid, with Drake's reason, or if the model and its
            description do not match.
    """

    def __init__(
        self,
        description: HandDescription,
        yaw_range: tuple[float, float] = FREE_TURN,
        X_LA: RigidTransform = FROM_ABOVE,
        X_WB: RigidTransform | None = None,
        model: CheckedModel | None = None,
        *,
        warns: bool = False,
        extent: float = np.inf,
        pans: bool = False,
    ) -> None:
        self.description, self._yaw_range, self.X_LA = description, yaw_range, X_LA
        self.pans = pans
        self.model = model or read_model(description.model)
        if X_WB is None:
            is_turned = isinstance(description.base, Carrier)
            X_WB = RigidTransform(X_LA.rotation(), np.zeros(3)) if is_turned else RigidTransform()
        self.X_WB = X_WB
        try:
            with failures_as_errors():
                self.diagram, self.instances = self._parse(warns=warns or model is None)
        except RuntimeError as error:
            problem = f"model: {description.model} cannot be used: {first_line(error)}"
            raise InvalidArgumentError(problem) from error
        self.base = make_base(description.base, self.instances, X_LA, X_WB.translation(), pans)
        self.kinematics = self._kinematics(self.instances, REFERENCE.hand())
        self.tip_radii: FloatArray = np.array([tip.radius for tip in description.fingertips])
        self.fingers_home = self._place_fingers()
        offset = float(np.linalg.norm(X_LA.translation()))
        self.fingers = HomeFingers(
            self.kinematics,
            self.diagram.scene_graph().model_inspector(),
            self.base,
            self.base.at_home(self.fingers_home),
            self.tip_radii,
            radius=extent + float(np.max(self.tip_radii)) + offset,
        )
        self.p_HT = self.fingers.p_HT
        self.azimuths: FloatArray = np.arctan2(self.p_HT[:, 1], self.p_HT[:, 0])
        given = np.array([tip.withdrawn_radius for tip in description.fingertips])
        mean = np.mean(np.linalg.norm(self.p_HT[:, :2], axis=1))
        self.withdrawn_radii: FloatArray = np.where(given, given, mean)
        self._check_reach(self.p_HT)

    def add_to(self, plant: MultibodyPlant, *, warns: bool = False) -> list[ModelInstanceIndex]:
        """Adds the hand to another plant that is not finalized, as `add_hand_model` does.

        Args:
            plant: Plant to which the hand is added.
            warns: Whether warnings about the model are logged.
        """
        return add_read_model(
            plant,
            self.model,
            self.description,
            self._yaw_range,
            self.X_WB,
            pans=self.pans,
            warns=warns,
        )

    def _parse(self, *, warns: bool = False) -> tuple[RobotDiagram, HandInstances]:
        builder = RobotDiagramBuilder(time_step=0.0)
        plant = builder.plant()
        models = self.add_to(plant, warns=warns)
        plant.Finalize()
        check_inertias(plant)
        diagram = builder.Build()
        return diagram, HandInstances(diagram.plant(), models, are_named=True)

    def _kinematics(self, hand: HandInstances, kernels: HandKernels) -> HandKinematics:
        frames = []
        with ProblemCollector() as collector:
            for i, tip in enumerate(self.description.fingertips):
                with collector.part():
                    frames.append(hand.frame(tip.frame, f"fingertips[{i}].frame"))
        names = [frame.scoped_name().get_full() for frame in frames]
        return HandKinematics(hand.plant, names, kernels.forward_kinematics)

    def make_scene(
        self, object_solid: SignedDistance, fixed: Sequence[Solid], kernels: Kernels | None = None
    ) -> HandScene:
        """Returns a scene of the hand with an object.

        Args:
            object_solid: The object in O.
            fixed: Solids in W that do not move, such as the table.
            kernels: Implementation of its kinematics; that of `default_kernels` by default.
        """
        (diagram, hand), hand_kernels = self._parse(), (kernels or default_kernels()).hand()
        return HandScene(
            diagram,
            self._kinematics(hand, hand_kernels),
            hand_kernels,
            tip_radii=self.tip_radii,
            object_solid=object_solid,
            fixed=fixed,
        )

    def home(self, p_WCoM: FloatArray, yaw: float) -> FloatArray:
        """Returns the home positions of all joints over an object, shape (nq,).

        Args:
            p_WCoM: Centre of mass of the object in W, shape (3,), in metres.
            yaw: Yaw of the palm, in radians.

        Raises:
            InvalidArgumentError: If an arm cannot hold the palm there.
        """
        return self.base.with_palm_over(self.fingers_home, p_WCoM, yaw)

    def yaw_range(self, asked: tuple[float, float] = FREE_TURN) -> tuple[float, float]:
        """Returns the palm's smallest and largest angle, in radians.

        A finite requested range is used as it is. Otherwise a wrist that cannot make a full turn
        either way, with a range of less than two turns, keeps the range of its model, and any other
        wrist is unlimited. The palm of an arm has no wrist joint, so the request is its range.

        Args:
            asked: Requested range; infinite for no request.

        Raises:
            InvalidArgumentError: If the request exceeds the range of the model.
        """
        if not isinstance(self.base, PalmCarrier):
            return asked
        wrist = self.base.joints[WRIST]
        low, high = float(self.kinematics.lower[wrist]), float(self.kinematics.upper[wrist])
        if asked != FREE_TURN:
            if not low <= asked[0] <= asked[1] <= high:
                raise InvalidArgumentError(
                    f"wrist_range {list(asked)} must be within the model's own, from {low:g} to"
                    f" {high:g}"
                )
            return asked
        return (low, high) if high - low < _TWO_TURNS else FREE_TURN

    @property
    def home_yaw(self) -> float:
        """Yaw of the palm at home about z of A, in radians, which is 0 for a carrier.

        If the palm at home does not face along z of A, it is the yaw of the nearest palm that does.
        """
        R_AU = (self.base.X_AW @ self.X_LA).inverse().rotation().matrix()
        return float(np.arctan2(R_AU[1, 0] - R_AU[0, 1], R_AU[0, 0] + R_AU[1, 1]))

    def check_contacts(self, p_OC: FloatArray, normals: FloatArray) -> None:
        """Checks that no contact is on a face that is forbidden to its finger.

        Args:
            p_OC: Contacts in O, in the order of the fingers, shape (n, 3), in metres.
            normals: Outward unit normals of the surface at the contacts, in O, shape (n, 3).

        Raises:
            InvalidArgumentError: If a contact is on such a face.
        """
        for tip, point, normal in zip(self.description.fingertips, p_OC, normals, strict=True):
            for face in (forbidden := tip.forbidden_faces):
                if AxisArea(face).holds(normal[None])[0]:
                    x, y, z = point
                    raise InvalidArgumentError(
                        f"the contact at ({x:.3g}, {y:.3g}, {z:.3g}) m is nearest to {tip.frame},"
                        f" to which {face} is forbidden (all of these: {', '.join(forbidden)})"
                    )

    def around_axis(self, p_OC: FloatArray, R_WO: FloatArray, p_OCoM: FloatArray) -> FloatArray:
        """Returns contacts relative to the palm's axis, along the axes of A, shape (n, 3).

        Args:
            p_OC: Contacts in O, shape (n, 3), in metres.
            R_WO: Orientation of the object.
            p_OCoM: Centre of mass of the object in O.
        """
        p_LC = (p_OC - p_OCoM) @ R_WO.T
        p_AC: FloatArray = (p_LC - self.X_LA.translation()) @ self.X_LA.rotation().matrix()
        return p_AC

    def separate_links(
        self, instances: HandInstances, scene_graph: SceneGraph
    ) -> dict[GeometryId, HandLink]:
        """Lets fingers of a hand in a finalized plant collide as `separate_fingers` says.

        Args:
            instances: The hand in the plant.
            scene_graph: SceneGraph of the plant.

        Returns:
            Collision geometries of the hand's links.
        """
        tips = [instances.frame(tip.frame, "fingertips") for tip in self.description.fingertips]
        inspector = scene_graph.model_inspector()
        links = hand_links(instances.plant, tips, self.tip_radii, inspector)
        separate_fingers(scene_graph.collision_filter_manager(), links)
        return links

    def tips_at(self, q: FloatArray) -> FloatArray:
        """Returns the fingertips' centres in W at positions q, shape (n, 3), in metres."""
        return self.kinematics.pose(q).p_WT

    @property
    def largest_offsets(self) -> FloatArray:
        """Largest angles between fingertips and their fingers' azimuths, shape (n,), in radians."""
        tips = self.description.fingertips
        return np.array([tip.reach.make_reach().half_angle for tip in tips])

    def _place_fingers(self) -> FloatArray:
        kinematics = self.kinematics
        names = np.array([joint.name() for joint in self.instances.moving_joints()])
        home = np.zeros(kinematics.num_positions)
        left = np.ones(len(home), dtype=bool)
        left[self.base.joints] = False
        if still := names[kinematics.rate_limit <= 0].tolist():
            raise InvalidArgumentError(f"model: the speed limit of {', '.join(still)} is 0")
        with ProblemCollector() as collector:
            for index, tip in enumerate(self.description.fingertips):
                own = kinematics.own_joints(index)
                key, left[own] = f"fingertips[{index}]", False
                with collector.part():
                    if shared := names[np.intersect1d(own, self.base.joints)].tolist():
                        raise InvalidArgumentError(
                            f"base.joints: {', '.join(shared)} moves only {tip.frame}; leave it out"
                        )
                    lower, upper = kinematics.lower[own], kinematics.upper[own]
                    check_home(f"{key}.home", names[own].tolist(), tip.home, lower, upper)
                    home[own] = tip.home
            with collector.part():
                if np.any(left):
                    raise InvalidArgumentError(
                        f"{', '.join(names[left])}: neither of base.joints, nor of one finger alone"
                    )
        return home

    def _check_reach(self, p_HT: FloatArray) -> None:
        """Checks that each finger reaches its home, where it is at the best angle."""
        with ProblemCollector() as collector:
            for index, (tip, p_HC) in enumerate(
                zip(self.description.fingertips, p_HT, strict=True)
            ):
                with collector.part():
                    _check_home_in_reach(f"fingertips[{index}].reach", tip, p_HC[None])


def _check_home_in_reach(key: str, tip: Fingertip, p_HC: FloatArray) -> None:
    try:
        reach = tip.reach.make_reach()
    except InvalidArgumentError as error:
        raise InvalidArgumentError(f"{key}: {error}") from error
    normals = np.zeros((1, 3)) if reach.direction is None else reach.direction[None]
    if not reach.permits(p_HC, normals, p_HC)[0]:
        place = ", ".join(f"{x:.3g}" for x in p_HC[0])
        raise InvalidArgumentError(
            f"{key}: it must hold the finger's own home, where {tip.frame} is at ({place}) m in H"
        )
