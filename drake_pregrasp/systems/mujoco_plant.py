"""MuJoCo as the engine of a MultibodyPlant (extra `mujoco`)."""

from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import SceneGraphInspector
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, QuaternionFloatingJoint
from pydrake.systems.framework import (
    Context,
    DiscreteValues,
    InputPort,
    LeafSystem,
    OutputPort,
    ValueProducer,
)

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.systems.mujoco_model import Pieces, import_mujoco, mujoco_model
from drake_pregrasp.systems.ports import APPLIED_FORCES, BODY_POSES, declare_output

PairForce = tuple[int, int, FloatArray]
"""Contact: values of the `GeometryId` of A and B, and the force of A on B in W, shape (3,), in N.

Contexts are copied with the values of ports, and a `GeometryId` cannot be copied in Python."""

PAIR_FORCES = AbstractValue.Make([])
"""Model value of a port with a list of `PairForce`."""


class MujocoPlant(LeafSystem):
    """Simulates the bodies of a MultibodyPlant with MuJoCo.

    .. pydrake_system::

        name: MujocoPlant
        input_ports:
        - applied_spatial_force
        - hand_desired_state
        output_ports:
        - state
        - net_actuation
        - body_poses
        - contact_results

    The ports are those of the plant, with the same names and orders. Each model instance with
    actuators, such as `hand`, has an input port, which must be connected.

    Port `applied_spatial_force` (optional) accepts a list of `ExternallyAppliedSpatialForce`.

    Port `hand_desired_state` accepts a vector of 2k: desired positions and velocities of the
    actuators' joints, which hold for the end of the plant's time step, as in Drake.

    Port `state` emits a vector of nq + nv: positions and velocities of the plant.

    Port `net_actuation` emits a vector of nu: torques or forces of the actuators, in N m or N, on
    average over the last time step; zero at first.

    Port `body_poses` emits a list of `RigidTransform`: the poses of all bodies in W.

    Port `contact_results` emits a list of `PairForce`, one for each point of contact.

    The discrete state is MuJoCo's own, with what its solver starts from. Each time step of the
    plant has several of MuJoCo.

    Args:
        plant: Plant that is finalized and discrete. Its default positions are the initial ones.
        inspector: Inspector of its SceneGraph, after all filters have been declared.
        pieces: Convex pieces of geometries; other meshes collide as their convex hulls.
        velocities: Initial velocities of the plant, shape (nv,); at rest by default.

    Raises:
        InvalidArgumentError: If mujoco is not installed, or cannot simulate the plant.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        inspector: SceneGraphInspector,
        pieces: Pieces | None = None,
        *,
        velocities: FloatArray | None = None,
    ) -> None:
        super().__init__()
        self._mujoco, self._plant = import_mujoco(), plant
        self._own = own = mujoco_model(plant, inspector, pieces)
        data = self._mujoco.MjData(own.model)
        data.qpos[own.q] = plant.GetPositions(plant.CreateDefaultContext())
        if velocities is not None:
            self._set_velocities(data, velocities)
        data.ctrl[:] = own.gains[:, 0] * data.qpos[own.driven]
        self._signature = self._mujoco.mjtState.mjSTATE_INTEGRATION
        self._state = self.DeclareDiscreteState(self._state_of(data))
        self._actuation = self.DeclareDiscreteState(len(own.gains))
        joints = own.model.actuator_trnid[:, 0]
        self._rates = own.model.jnt_dofadr[joints]  # Index in `qvel` of each actuator's joint.
        tickets, model_value = {self.discrete_state_ticket(self._state)}, AbstractValue.Make(data)
        producer = ValueProducer(
            model_value.Clone,
            lambda context, value: self._forward(context, value.get_mutable_value()),
        )
        self._data = self.DeclareCacheEntry("MjData of the state", producer, tickets)
        # Each Context keeps one for updates, because its allocation is slow.
        unused = ValueProducer(model_value.Clone, ValueProducer.NoopCalc)
        self._scratch = self.DeclareCacheEntry("MjData", unused, {self.nothing_ticket()})
        self._forces = self.DeclareAbstractInputPort("applied_spatial_force", APPLIED_FORCES)
        self._desired: dict[ModelInstanceIndex, tuple[InputPort, list[int]]] = {}
        self._declare("state", plant.num_multibody_states(), self._plant_state)
        self.DeclareStateOutputPort("net_actuation", self._actuation)
        self._declare("body_poses", BODY_POSES, self._body_poses)
        self._declare("contact_results", PAIR_FORCES, self._contacts)
        order = plant.GetJointActuatorIndices()
        for instance in map(ModelInstanceIndex, range(plant.num_model_instances())):
            if found := plant.GetJointActuatorIndices(instance):
                name = f"{plant.GetModelInstanceName(instance)}_desired_state"
                port = self.DeclareVectorInputPort(name, 2 * len(found))
                self._desired[instance] = port, [order.index(index) for index in found]
        self.DeclarePeriodicDiscreteUpdateEvent(plant.time_step(), 0.0, self._update)

    def _declare(
        self, name: str, model: int | AbstractValue, calc: Callable[[Any], Any]
    ) -> OutputPort:
        def evaluated(context: Context) -> Any:
            return calc(self._data.Eval(context))

        return declare_output(self, name, model, evaluated, self._data)

    def get_desired_state_input_port(self, instance: ModelInstanceIndex) -> InputPort:
        """Returns the port with the desired state of a model instance."""
        return self._desired[instance][0]

    def get_applied_spatial_force_input_port(self) -> InputPort:
        """Returns the port with forces on bodies."""
        return self._forces

    def get_state_output_port(self) -> OutputPort:
        """Returns the port with positions and velocities."""
        return self.GetOutputPort("state")

    def get_net_actuation_output_port(self) -> OutputPort:
        """Returns the port with the torques or forces of the actuators."""
        return self.GetOutputPort("net_actuation")

    def get_body_poses_output_port(self) -> OutputPort:
        """Returns the port with the poses of all bodies."""
        return self.GetOutputPort("body_poses")

    def GetVelocities(self, context: Context, instance: ModelInstanceIndex) -> FloatArray:
        """Returns the velocities of a model instance in a Context of this system."""
        velocities = self._velocities(self._data.Eval(context))
        return np.asarray(self._plant.GetVelocitiesFromArray(instance, velocities))

    def SetVelocities(
        self, context: Context, instance: ModelInstanceIndex, velocities: FloatArray
    ) -> None:
        """Sets the velocities of a model instance in a Context of this system."""
        data, all_velocities = self._read(context), self._velocities(self._data.Eval(context))
        self._plant.SetVelocitiesInArray(instance, velocities, all_velocities)
        self._set_velocities(data, all_velocities)
        context.SetDiscreteState(self._state, self._state_of(data))

    def _state_of(self, data: Any) -> FloatArray:
        model = self._own.model
        state = np.empty(self._mujoco.mj_stateSize(model, self._signature))
        self._mujoco.mj_getState(model, data, state, self._signature)
        return state

    def _read(self, context: Context) -> Any:
        """Returns the Context's data for changes, with nothing but its state."""
        data = self._scratch.get_mutable_cache_entry_value(context).GetMutableValueOrThrow()
        state = context.get_discrete_state(self._state).value()
        self._mujoco.mj_setState(self._own.model, data, state, self._signature)
        return data

    def _forward(self, context: Context, data: Any) -> None:
        """Computes poses, contacts and forces of the state."""
        state = context.get_discrete_state(self._state).value()
        self._mujoco.mj_setState(self._own.model, data, state, self._signature)
        self._mujoco.mj_forward(self._own.model, data)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        own, data = self._own, self._read(context)
        q, v = np.zeros((2, len(own.gains)))
        for port, actuators in self._desired.values():
            q[actuators], v[actuators] = port.Eval(context).reshape(2, -1)
        self._apply_forces(context, data)
        stiffness, damping = own.gains.T
        step, impulse = own.model.opt.timestep, np.zeros(len(q))
        for left in range(own.substeps, -1, -1):
            data.ctrl[:] = stiffness * (q - left * step * v) + damping * v
            if left:  # The forces of the new state are those of the targets at its time.
                before = data.qvel[self._rates]
                self._mujoco.mj_step(own.model, data)
                # Damping is integrated implicitly, so it acts on the velocities after the step,
                # unless an effort is at its limit.
                force, (low, high) = data.actuator_force, own.model.actuator_forcerange.T
                is_free = (low < force) & (force < high)
                change = data.qvel[self._rates] - before
                impulse += step * (force - is_free * damping * change)
        discrete_state.set_value(self._state, self._state_of(data))
        discrete_state.set_value(self._actuation, impulse / (own.substeps * step))

    def _apply_forces(self, context: Context, data: Any) -> None:
        """Applies the forces on bodies, which stay the same during the time step."""
        own, mujoco = self._own, self._mujoco
        data.qfrc_applied[:] = 0.0
        forces = self._forces.Eval(context) if self._forces.HasValue(context) else []
        if forces:
            mujoco.mj_fwdPosition(own.model, data)
        for each in forces:
            body, F = own.bodies[each.body_index], each.F_Bq_W
            p_WBq = data.xpos[body] + data.xmat[body].reshape(3, 3) @ each.p_BoBq_B
            force, torque, applied = F.translational(), F.rotational(), data.qfrc_applied
            mujoco.mj_applyFT(own.model, data, force, torque, p_WBq, body, applied)

    def _velocities(self, data: Any) -> FloatArray:
        """Returns the plant's velocities; MuJoCo has angular ones of floating bodies in B."""
        velocities: FloatArray = data.qvel[self._own.v]
        for start, R_WB in self._floating(data):
            velocities[start : start + 3] = R_WB @ velocities[start : start + 3]
        return velocities

    def _set_velocities(self, data: Any, velocities: FloatArray) -> None:
        velocities = np.array(velocities)
        for start, R_WB in self._floating(data):
            velocities[start : start + 3] = R_WB.T @ velocities[start : start + 3]
        data.qvel[self._own.v] = velocities

    def _floating(self, data: Any) -> list[tuple[int, FloatArray]]:
        """Returns the first velocity and the orientation of each floating body."""
        found = []
        for joint in map(self._plant.get_joint, self._plant.GetJointIndices()):
            if isinstance(joint, QuaternionFloatingJoint):
                R_WB, start = np.empty(9), joint.position_start()
                wxyz = data.qpos[self._own.q[start : start + 4]]
                self._mujoco.mju_quat2Mat(R_WB, wxyz)
                found.append((joint.velocity_start(), R_WB.reshape(3, 3)))
        return found

    def _plant_state(self, data: Any) -> FloatArray:
        return np.append(data.qpos[self._own.q], self._velocities(data))

    def _body_poses(self, data: Any) -> list[RigidTransform]:
        own = self._own.bodies
        pairs = zip(data.xmat[own].reshape(-1, 3, 3), data.xpos[own], strict=True)
        return [RigidTransform(RotationMatrix(R_WB), p_WB) for R_WB, p_WB in pairs]

    def _contacts(self, data: Any) -> list[PairForce]:
        own, found, wrench = self._own, [], np.empty(6)
        for index, contact in enumerate(data.contact):
            self._mujoco.mj_contactForce(own.model, data, index, wrench)
            force = contact.frame.reshape(3, 3).T @ wrench[:3]
            a, b = (int(own.geometries[geometry].get_value()) for geometry in contact.geom)
            found.append((a, b, force))
        return found
