"""Launch of a body, and its impacts on solids that stand still."""

from collections.abc import Sequence

import numpy as np
from pydrake.multibody.math import SpatialForce, SpatialVelocity
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Context, LeafSystem

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.geometry.impacts import impact
from drake_pregrasp.geometry.solids import Solid, nearest_solids
from drake_pregrasp.systems import ports

_DEPTH = 1e-4  # Depth at which an impact ends, in metres: compliant contact takes over there.
_SLOW = 1e-3  # Velocity below which a body rests, in m/s and rad/s.


class TossedBody(LeafSystem):
    """Launches a body, and stops it where it hits a solid, by forces on the body.

    .. pydrake_system::

        name: TossedBody
        input_ports:
        - body_poses
        - body_spatial_velocities
        output_ports:
        - spatial_forces

    Ports `body_poses` and `body_spatial_velocities` accept lists of `RigidTransform` and
    `SpatialVelocity`: the plant's ports of these names.

    Port `spatial_forces` emits a list of `ExternallyAppliedSpatialForce`, for the plant's port
    `applied_spatial_force`. A change V of velocity in a time step of h needs the force M V / h with
    the spatial inertia M of the body about its centre of mass. A plant has default poses but no
    default velocities, so a force in the first step launches the body from the default Context.

    A plant finds contacts at the start of a time step, so a body that falls at a speed v could sink
    by v h into a table. Forces therefore stop its corners in the time step in which they arrive:
    the impact is inelastic, with friction, and leaves the rest to the plant's compliant contact.

    Args:
        plant: The body's plant, finalized and discrete.
        body: The body B.
        V_WBcm: Velocity of B's centre of mass in W that the first force causes in the absence of
            gravity, and the angular velocity of B.
        points: Corners of B's convex hull, in B, shape (k, 3), in metres.
        solids: Solids in W that B may hit.
        friction: Coulomb's coefficient of B on the solids.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        body: RigidBody,
        V_WBcm: SpatialVelocity,
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
        self._index, self._launch = body.index(), V_WBcm.get_coeffs()
        self._poses, self._velocities = ports.declare_inputs(self, **ports.BODY_MOTIONS).values()
        sources = (self._poses, self._velocities, self.time_ticket())
        forces = ports.APPLIED_FORCES
        ports.declare_output(self, "spatial_forces", forces, self._calc_forces, *sources)

    def _calc_forces(self, context: Context) -> list[ExternallyAppliedSpatialForce]:
        X_WB, V_WB = (port.Eval(context)[self._index] for port in (self._poses, self._velocities))
        R_WB, change = X_WB.rotation(), self._launch
        M_BBcm_W = self._M_BBcm_B.ReExpress(R_WB).CopyToFullMatrix6()
        if context.get_time() > self._step / 2:
            if len(self._solids) == 0 or np.linalg.norm(V_WB.get_coeffs()) < _SLOW:
                return []
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
