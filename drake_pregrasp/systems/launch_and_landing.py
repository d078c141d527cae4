"""Launch of bodies, and impacts of a body on solids that stand still."""

from collections.abc import Sequence

import numpy as np
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, RigidBody
from pydrake.systems.framework import Context, LeafSystem

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.geometry.impacts import impact
from drake_pregrasp.geometry.solids import Solid, nearest_solids
from drake_pregrasp.systems import ports

_DEPTH = 1e-4  # Depth at which an impact ends, in metres: compliant contact takes over there.
_SLOW = 1e-3  # Velocity below which a body rests, in m/s and rad/s.


class Launch(LeafSystem):
    """Launches the bodies of a plant by forces in its first time step.

    .. pydrake_system::

        name: Launch
        input_ports:
        - body_poses
        output_ports:
        - spatial_forces

    Port `body_poses` accepts a list of `RigidTransform`: the plant's port of this name.

    Port `spatial_forces` emits a list of `ExternallyAppliedSpatialForce`, for the plant's port
    `applied_spatial_force`. A velocity V after a time step of h needs the force M V / h with the
    spatial inertia M of the body about its centre of mass. A plant has default poses but no
    default velocities, so this launches bodies from the default Context.

    Args:
        plant: The plant, finalized and discrete.
        velocities: Generalized velocities after the first step in the absence of other forces, at
            the default positions, shape (nv,).
    """

    def __init__(self, plant: MultibodyPlant, velocities: FloatArray) -> None:
        super().__init__()
        context = plant.CreateDefaultContext()
        plant.SetVelocities(context, velocities)
        self._step = plant.time_step()
        self._launched = []
        for index in range(1, plant.num_bodies()):
            body = plant.get_body(BodyIndex(index))
            V_WB, R_WB = body.EvalSpatialVelocityInWorld(context), body.EvalPoseInWorld(context)
            if V_WB.get_coeffs().any():
                M_BBo_B = body.CalcSpatialInertiaInBodyFrame(context)
                p_BoBcm = M_BBo_B.get_com()
                V_WBcm = V_WB.Shift(R_WB.rotation() @ p_BoBcm).get_coeffs()
                self._launched.append((body.index(), p_BoBcm, M_BBo_B.Shift(p_BoBcm), V_WBcm))
        self._poses = self.DeclareAbstractInputPort("body_poses", ports.BODY_POSES)
        sources = (self._poses, self.time_ticket())
        ports.declare_output(self, "spatial_forces", ports.APPLIED_FORCES, self._calc, *sources)

    def _calc(self, context: Context) -> list[ExternallyAppliedSpatialForce]:
        if context.get_time() > self._step / 2:
            return []
        poses, forces = self._poses.Eval(context), []
        for index, p_BoBcm, M_BBcm_B, V_WBcm in self._launched:
            M_BBcm_W = M_BBcm_B.ReExpress(poses[index].rotation()).CopyToFullMatrix6()
            F_Bcm_W = SpatialForce(M_BBcm_W @ V_WBcm / self._step)
            forces += ports.applied_force(index, p_BoBcm, F_Bcm_W)
        return forces


class Landing(LeafSystem):
    """Stops a body where it hits a solid, by a force on the body.

    .. pydrake_system::

        name: Landing
        input_ports:
        - body_poses
        - body_spatial_velocities
        output_ports:
        - spatial_forces

    Ports `body_poses` and `body_spatial_velocities` accept lists of `RigidTransform` and
    `SpatialVelocity`: the plant's ports of these names.

    Port `spatial_forces` emits a list of `ExternallyAppliedSpatialForce`, for the plant's port
    `applied_spatial_force`.

    A plant finds contacts at the start of a time step, so a body that falls at a speed v could sink
    by v h into a table. The force therefore stops its corners in the time step in which they
    arrive: the impact is inelastic, with friction, and leaves the rest to the plant's compliant
    contact.

    Args:
        plant: The body's plant, finalized and discrete.
        body: The body B.
        points: Corners of B's convex hull, in B, shape (k, 3), in metres.
        solids: Solids in W that B may hit, at least one.
        friction: Coulomb's coefficient of B on the solids.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        body: RigidBody,
        *,
        points: FloatArray,
        solids: Sequence[Solid],
        friction: float,
    ) -> None:
        super().__init__()
        M_BBo_B = body.CalcSpatialInertiaInBodyFrame(plant.CreateDefaultContext())
        self._p_BoBcm = M_BBo_B.get_com()
        self._M_BBcm_B = M_BBo_B.Shift(self._p_BoBcm)
        self._points = points - self._p_BoBcm
        self._solids = np.array([solid.rounded_box() for solid in solids])
        self._friction, self._step = friction, plant.time_step()
        self._fall = np.append(np.zeros(3), self._step * plant.gravity_field().gravity_vector())
        # Compliant contact holds a body at rest, so it does not sink by as much as it would fall.
        self._depth = max(_DEPTH, 2 * self._step * float(np.linalg.norm(self._fall)))
        self._index = body.index()
        self._poses, self._velocities = ports.declare_inputs(self, **ports.BODY_MOTIONS).values()
        sources = (self._poses, self._velocities)
        forces = ports.APPLIED_FORCES
        ports.declare_output(self, "spatial_forces", forces, self._calc_forces, *sources)

    def _calc_forces(self, context: Context) -> list[ExternallyAppliedSpatialForce]:
        X_WB, V_WB = (port.Eval(context)[self._index] for port in (self._poses, self._velocities))
        if np.linalg.norm(V_WB.get_coeffs()) < _SLOW:
            return []
        R_WB = X_WB.rotation()
        M_BBcm_W = self._M_BBcm_B.ReExpress(R_WB).CopyToFullMatrix6()
        p_BcmP_W = self._points @ R_WB.matrix().T
        distances, normals = nearest_solids(self._solids, X_WB @ self._p_BoBcm + p_BcmP_W)
        change = impact(
            np.tile(p_BcmP_W, (len(distances), 1)),
            distances.ravel(),
            normals.reshape(-1, 3),
            V_WB.Shift(R_WB @ self._p_BoBcm).get_coeffs() + self._fall,
            M_BBcm_W,
            friction=self._friction,
            time_step=self._step,
            depth=self._depth,
        )
        F_Bcm_W = SpatialForce(M_BBcm_W @ change / self._step)
        return ports.applied_force(self._index, self._p_BoBcm, F_Bcm_W)
