"""Systems that move the object, and one that tells the pose of a body."""

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.common.value import AbstractValue
from pydrake.geometry import FrameId, FramePoseVector
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialForce, SpatialVelocity
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, RigidBody
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_pregrasp.estimation.recorded_poses import RecordedPoses
from drake_pregrasp.geometry.motion_profiles import VelocityProfile


class BodyPose(LeafSystem):
    """Emits the pose of one body of a MultibodyPlant.

    .. pydrake_system::

        name: BodyPose
        input_ports:
        - body_poses
        output_ports:
        - X_WB

    Port `body_poses` accepts a list of `RigidTransform`: the plant's port of that name.

    Port `X_WB` emits a `RigidTransform`: the pose of body B in the world W.

    Args:
        body_index: The body B.
    """

    def __init__(self, body_index: BodyIndex) -> None:
        super().__init__()
        self._body_index = int(body_index)
        self._body_poses = self.DeclareAbstractInputPort(
            "body_poses", AbstractValue.Make([RigidTransform()])
        )
        self.DeclareAbstractOutputPort(
            "X_WB",
            lambda: AbstractValue.Make(RigidTransform()),
            self._calc_pose,
            {self._body_poses.ticket()},
        )

    def _calc_pose(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._body_poses.Eval(context)[self._body_index])


class ObjectMotion(LeafSystem):
    """Commands the joints under or behind the object: conveyor and turntable, or a pusher.

    .. pydrake_system::

        name: ObjectMotion
        output_ports:
        - desired_state

    Port `desired_state` emits a vector of 2 k: the k positions, from 0 at time 0, then their k
    rates, in metres or radians and seconds.

    Args:
        profile: The rates over time.
    """

    def __init__(self, profile: VelocityProfile) -> None:
        super().__init__()
        self._profile = profile
        self.DeclareVectorOutputPort(
            "desired_state", 2 * profile.size, self._calc_desired_state, {self.time_ticket()}
        )

    def _calc_desired_state(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(np.concatenate(self._profile.at(context.get_time())))


class PoseReplay(LeafSystem):
    """Emits the recorded pose at the Context's time.

    .. pydrake_system::

        name: PoseReplay
        output_ports:
        - X_WO
        - geometry_pose

    Port `X_WO` emits a `RigidTransform`: the pose of the object O in the world W.

    Port `geometry_pose` emits a `FramePoseVector`: the same for SceneGraph.

    Args:
        poses: What is replayed.
        frame_id: The object's frame in SceneGraph; a new one if left out, for a diagram without.
    """

    def __init__(self, poses: RecordedPoses, frame_id: FrameId | None = None) -> None:
        super().__init__()
        self._poses = poses
        self._frame_id = FrameId.get_new_id() if frame_id is None else frame_id
        self._pose = self.DeclareAbstractOutputPort(
            "X_WO",
            lambda: AbstractValue.Make(RigidTransform()),
            self._calc_pose,
            {self.time_ticket()},
        )
        self.DeclareAbstractOutputPort(
            "geometry_pose",
            lambda: AbstractValue.Make(FramePoseVector()),
            self._calc_geometry_pose,
            {self.time_ticket()},
        )

    def _calc_pose(self, context: Context, output: AbstractValue) -> None:
        p_WO, R_WO = self._poses.at(context.get_time())
        x, y, z, w = R_WO.as_quat()
        output.set_value(RigidTransform(RotationMatrix(Quaternion(w, x, y, z)), p_WO))

    def _calc_geometry_pose(self, context: Context, output: AbstractValue) -> None:
        poses = FramePoseVector()
        poses.set_value(self._frame_id, self._pose.Eval(context))
        output.set_value(poses)


class Launch(LeafSystem):
    """Gives a body that is at rest a velocity, by a force in the plant's first time step.

    .. pydrake_system::

        name: Launch
        output_ports:
        - spatial_forces

    Port `spatial_forces` emits a list of `ExternallyAppliedSpatialForce`, for the plant's port
    `applied_spatial_force`: the one force in the first step, and none from the second on. It is
    M V / h, with the body's spatial inertia M about its centre of mass and the step h. A plant has
    default poses, but no default velocities; with this, its default Context is the start.

    Args:
        plant: The body's plant, finalized and discrete.
        body: The body B.
        V_WBcm: Velocity of B's centre of mass that the force brings about, where gravity does not
            count, and its angular velocity, expressed in W.
    """

    def __init__(self, plant: MultibodyPlant, body: RigidBody, V_WBcm: SpatialVelocity) -> None:
        super().__init__()
        self._time_step = plant.time_step()
        context = plant.CreateDefaultContext()
        M_BBo_B = body.CalcSpatialInertiaInBodyFrame(context)
        p_BoBcm_B = M_BBo_B.get_com()
        R_WB = body.EvalPoseInWorld(context).rotation()
        M_BBcm_W = M_BBo_B.Shift(p_BoBcm_B).ReExpress(R_WB)
        force = ExternallyAppliedSpatialForce()
        force.body_index = body.index()
        force.p_BoBq_B = p_BoBcm_B
        force.F_Bq_W = SpatialForce(
            M_BBcm_W.CopyToFullMatrix6() @ V_WBcm.get_coeffs() / self._time_step
        )
        self._force = force
        self.DeclareAbstractOutputPort(
            "spatial_forces",
            lambda: AbstractValue.Make([ExternallyAppliedSpatialForce()]),
            self._calc_forces,
            {self.time_ticket()},
        )

    def _calc_forces(self, context: Context, output: AbstractValue) -> None:
        first = context.get_time() < self._time_step / 2
        output.set_value([self._force] if first else [])
