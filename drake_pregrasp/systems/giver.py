"""Force of a person who moves an object along recorded poses, and hands it over."""

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialForce, SpatialVelocity
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem
from scipy.spatial.transform import Rotation

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.object_config import GRAVITY
from drake_pregrasp.estimation.recorded_poses import RecordedPoses
from drake_pregrasp.systems import ports

LETS_GO = 0.5
"""Pull at the object, as a share of its weight, from which on the giver lets it go."""

_FREQUENCY = 40.0  # Natural frequency with which the object follows the recording, in rad/s.
_SPAN = 0.01  # Time between the poses whose difference is the recorded velocity, in seconds.


class Giver(LeafSystem):
    """Moves a body along recorded poses, until somebody takes it.

    .. pydrake_system::

        name: Giver
        input_ports:
        - body_poses
        - body_spatial_velocities
        output_ports:
        - spatial_forces

    Ports `body_poses` and `body_spatial_velocities` accept lists of `RigidTransform` and
    `SpatialVelocity`: the plant's ports of these names.

    Port `spatial_forces` emits a list of `ExternallyAppliedSpatialForce`, for the plant's port
    `applied_spatial_force`: the body's weight, and the force of a critically damped spring to the
    recorded pose. Once this spring pulls with `LETS_GO` of the weight, somebody else moves the
    body: the giver lets go for good, and the list is empty.

    Args:
        plant: The body's plant, finalized and discrete.
        body: The body B.
        poses: Recorded poses of B.
    """

    def __init__(self, plant: MultibodyPlant, body: RigidBody, poses: RecordedPoses) -> None:
        super().__init__()
        inertia = body.CalcSpatialInertiaInBodyFrame(plant.CreateDefaultContext())
        self._mass, self._p_BoBcm = inertia.get_mass(), inertia.get_com()
        self._I_BBcm_B = inertia.Shift(self._p_BoBcm).CalcRotationalInertia().CopyToFullMatrix3()
        self._poses, self._index = poses, body.index()
        self._has_let_go = self.DeclareDiscreteState([0.0])
        self._X_WB, self._V_WB = ports.declare_inputs(self, **ports.BODY_MOTIONS).values()
        sources = (self._X_WB, self._V_WB, self.time_ticket(), self.xd_ticket())
        forces = ports.APPLIED_FORCES
        ports.declare_output(self, "spatial_forces", forces, self._calc_forces, *sources)
        self._step = plant.time_step()
        self.DeclarePeriodicDiscreteUpdateEvent(self._step, 0.0, self._update)

    def _recorded(self, time: float) -> tuple[FloatArray, Rotation]:
        """Returns the recorded position of the centre of mass, and the orientation."""
        p_WB, R_WB = self._poses.at(time)
        return p_WB + R_WB.apply(self._p_BoBcm), R_WB

    def _away(self, context: Context, ahead: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Returns how far a recorded pose is away, as a position and a rotation vector in W."""
        X_WB: RigidTransform = self._X_WB.Eval(context)[self._index]
        p_WBcm, R_WB = self._recorded(context.get_time() + ahead)
        turn = R_WB * Rotation.from_matrix(X_WB.rotation().matrix()).inv()
        return p_WBcm - X_WB @ self._p_BoBcm, turn.as_rotvec()

    def _calc_forces(self, context: Context) -> list[ExternallyAppliedSpatialForce]:
        if context.get_discrete_state(self._has_let_go)[0]:
            return []
        R_WB: RotationMatrix = self._X_WB.Eval(context)[self._index].rotation()
        V_WBcm: SpatialVelocity = self._V_WB.Eval(context)[self._index].Shift(R_WB @ self._p_BoBcm)
        ends = [self._recorded(context.get_time() + side * _SPAN / 2) for side in (-1, 1)]
        v = (ends[1][0] - ends[0][0]) / _SPAN
        w = (ends[1][1] * ends[0][1].inv()).as_rotvec() / _SPAN
        away, turn = self._away(context)
        a = _FREQUENCY**2 * away + 2 * _FREQUENCY * (v - V_WBcm.translational())
        alpha = _FREQUENCY**2 * turn + 2 * _FREQUENCY * (w - V_WBcm.rotational())
        a += [0.0, 0.0, GRAVITY]
        I_BBcm_W = R_WB.matrix() @ self._I_BBcm_B @ R_WB.matrix().T
        F_Bcm_W = SpatialForce(I_BBcm_W @ alpha, self._mass * a)
        return ports.applied_force(self._index, self._p_BoBcm, F_Bcm_W)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        # The plant may have the state of its next step already, as times are rounded.
        away = min(np.linalg.norm(self._away(context, ahead)[0]) for ahead in (0.0, self._step))
        if _FREQUENCY**2 * away > LETS_GO * GRAVITY:
            discrete_state.set_value(self._has_let_go, [1.0])
