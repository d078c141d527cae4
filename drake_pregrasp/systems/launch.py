"""The push that throws a body."""

from pydrake.common.value import AbstractValue
from pydrake.multibody.math import SpatialForce, SpatialVelocity
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Context, LeafSystem


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
