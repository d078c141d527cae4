"""Model of MuJoCo with the bodies of a MultibodyPlant (extra `mujoco`).

Bodies, joints and their couplers, inertias, drives and collision geometries are the same. Only
pairs of geometries collide that the filters of SceneGraph let through, with the friction that Drake
gives to the pair. The model of contact is MuJoCo's own.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from pydrake.geometry import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    GeometryId,
    HalfSpace,
    SceneGraphInspector,
    Sphere,
)
from pydrake.geometry import Shape as DrakeShape
from pydrake.math import RigidTransform
from pydrake.multibody.inverse_kinematics import AddMultibodyPlantConstraints
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    Joint,
    JointActuator,
    PrismaticJoint,
    QuaternionFloatingJoint,
    RevoluteJoint,
    RigidBody,
    WeldJoint,
)
from pydrake.solvers import MathematicalProgram

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.errors import InvalidArgumentError, first_line
from drake_pregrasp.resources import require_packages

Pieces = Mapping[GeometryId, Sequence[FloatArray]]
"""Vertices of the convex pieces of geometries that are not convex, each of shape (k, 3), in m."""

LONGEST_STEP = 5e-4
"""Longest time step of MuJoCo, in seconds."""

# Contact settles critically damped within 5 ms, and is as hard as DexGraspBench's.
_SOLREF = (0.005, 1.0)
_SOLIMP = (0.5, 0.99, 1e-4, 0.5, 2.0)
_COUPLER_SOLIMP = (0.99, 0.999, 1e-3, 0.5, 2.0)  # Harder than contact.
_IMPRATIO = 10.0  # Of the impedances along and across the contact surface, as DexGraspBench's.
_NOSLIP_ITERATIONS = 3  # Against the creep of soft friction.
_CONDIM = 3  # Contacts resist sliding, but neither twisting nor rolling, as points do in Drake.
_STIFF_RATIO = 4.0  # Of d h / I, above which the inertia I of a drive is raised.
_INERT_RATIO = 0.1  # Of d h / I, to which it is then raised.
_UNLIMITED = 1e9  # Of a joint that is limited on its other side only, in metres or radians.


class MujocoModel(NamedTuple):
    """Model of MuJoCo, with the order of a plant.

    Attributes:
        model: The model, an `MjModel`.
        substeps: Number of time steps of MuJoCo in a time step of the plant.
        q: Index in `qpos` of each position of the plant, shape (nq,).
        v: Index in `qvel` of each velocity of the plant, shape (nv,).
        driven: Index in `qpos` of the joint of each actuator, shape (nu,).
        gains: Stiffness and damping of each actuator, shape (nu, 2).
        bodies: Index of each body of the plant, shape (number of bodies,).
        geometries: Geometry of the plant that each geometry of the model is, or is a piece of.
    """

    model: Any
    substeps: int
    q: IntArray
    v: IntArray
    driven: IntArray
    gains: FloatArray
    bodies: IntArray
    geometries: list[GeometryId]


def mujoco_model(
    plant: MultibodyPlant, inspector: SceneGraphInspector, pieces: Pieces | None = None
) -> MujocoModel:
    """Returns a model of MuJoCo with the bodies of a plant.

    Args:
        plant: Plant that is finalized and discrete.
        inspector: Inspector of its SceneGraph, after all filters have been declared.
        pieces: Convex pieces of geometries; other meshes collide as their convex hulls.

    Raises:
        InvalidArgumentError: If mujoco is not installed, a joint or a constraint has no counterpart
            in MuJoCo, or MuJoCo refuses the model.
    """
    mujoco = import_mujoco()
    spec = mujoco.MjSpec()
    substeps = mujoco_substeps(plant)
    spec.compiler.degree = False
    option = spec.option
    option.timestep = plant.time_step() / substeps
    option.gravity = plant.gravity_field().gravity_vector()
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio, option.noslip_iterations = _IMPRATIO, _NOSLIP_ITERATIONS
    bodies = {plant.world_body().index(): spec.worldbody}
    for joint in _outward_joints(plant, plant.world_body()):
        parent = bodies[joint.parent_body().index()]
        bodies[joint.child_body().index()] = _add_body(mujoco, plant, parent, joint)
    _add_couplers(mujoco, spec, plant)
    names = _add_geometries(mujoco, spec, plant, inspector, bodies, pieces or {})
    actuators = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]
    inertias = np.diag(plant.CalcMassMatrix(plant.CreateDefaultContext()))
    for actuator in actuators:
        _add_drive(mujoco, spec, actuator, inertias[actuator.joint().velocity_start()])
    try:
        model = spec.compile()
    except ValueError as error:
        raise InvalidArgumentError(f"MuJoCo refuses the model: {first_line(error)}") from error
    gains = [actuator.get_controller_gains() for actuator in actuators]
    return MujocoModel(
        model,
        substeps,
        *_state_indices(model, plant),
        np.array([model.joint(_name(a.joint())).qposadr[0] for a in actuators], dtype=np.intp),
        np.array([[each.p, each.d] for each in gains]).reshape(-1, 2),
        np.array([model.body(bodies[index].name).id for index in sorted(bodies)]),
        [names[model.geom(k).name] for k in range(model.ngeom)],
    )


def mujoco_substeps(plant: MultibodyPlant) -> int:
    """Returns the number of MuJoCo's time steps in one of a plant."""
    return int(np.ceil(plant.time_step() / LONGEST_STEP - 1e-9))


def import_mujoco() -> Any:
    """Returns the module `mujoco`.

    Raises:
        InvalidArgumentError: If it is not installed; the message says how to install it.
    """
    require_packages("mujoco", extra="mujoco", purpose="a simulation in MuJoCo")
    import mujoco

    return mujoco


def _outward_joints(plant: MultibodyPlant, parent: RigidBody) -> Iterator[Joint]:
    """Yields the joints of the bodies that hang on a body, each after that of its parent."""
    for joint in map(plant.get_joint, plant.GetJointIndices()):
        if joint.parent_body().index() == parent.index():
            yield joint
            yield from _outward_joints(plant, joint.child_body())


def _name(element: Joint | RigidBody) -> str:
    return f"{int(element.model_instance())}::{element.name()}"


def _add_body(mujoco: Any, plant: MultibodyPlant, parent: Any, joint: Joint) -> Any:
    """Adds the child of a joint, with its inertia and the joint, to its parent; returns it."""
    X_FM, body = RigidTransform(), joint.child_body()
    if isinstance(joint, WeldJoint):
        X_FM = joint.X_FM()
    elif isinstance(joint, QuaternionFloatingJoint):
        X_FM = joint.GetPose(plant.CreateDefaultContext())
    X_BM = joint.frame_on_child().GetFixedPoseInBodyFrame()
    X_PB = joint.frame_on_parent().GetFixedPoseInBodyFrame() @ X_FM @ X_BM.inverse()
    has_gravity = plant.is_gravity_enabled(body.model_instance())
    added = parent.add_body(name=_name(body), gravcomp=float(not has_gravity), **_place(X_PB))
    M_BBo_B = body.default_spatial_inertia()
    if M_BBo_B.get_mass() > 0:
        p_BoBcm_B = M_BBo_B.get_com()
        I_BBcm_B = M_BBo_B.Shift(p_BoBcm_B).CalcRotationalInertia().CopyToFullMatrix3()
        added.mass, added.ipos, added.explicitinertial = M_BBo_B.get_mass(), p_BoBcm_B, True
        added.fullinertia = I_BBcm_B[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    if isinstance(joint, QuaternionFloatingJoint):
        added.add_freejoint(name=_name(joint))
    elif isinstance(joint, PrismaticJoint | RevoluteJoint):
        slides, kinds = isinstance(joint, PrismaticJoint), mujoco.mjtJoint
        limits = [joint.position_lower_limits()[0], joint.position_upper_limits()[0]]
        added.add_joint(
            name=_name(joint),
            type=kinds.mjJNT_SLIDE if slides else kinds.mjJNT_HINGE,
            pos=X_BM.translation(),
            axis=X_BM.rotation() @ (joint.translation_axis() if slides else joint.revolute_axis()),
            limited=bool(np.any(np.isfinite(limits))),
            range=np.clip(limits, -_UNLIMITED, _UNLIMITED),
            damping=[joint.default_damping_vector()[0], 0.0, 0.0],
        )
    elif not isinstance(joint, WeldJoint):
        raise InvalidArgumentError(
            f"joint {joint.name()} is a {joint.type_name()} joint; MuJoCo can simulate welded,"
            " prismatic, revolute and floating ones only"
        )
    return added


def _add_couplers(mujoco: Any, spec: Any, plant: MultibodyPlant) -> None:
    """Adds couplers q_0 = rho q_1 + delta of two joints, such as those of `<mimic>` in a URDF."""
    # Drake's Python interface has constraints on positions, but not their parameters.
    program, context = MathematicalProgram(), plant.CreateDefaultContext()
    positions = program.NewContinuousVariables(plant.num_positions())
    try:
        AddMultibodyPlantConstraints(plant, positions, program, context)
    except RuntimeError as error:
        raise InvalidArgumentError(
            f"MuJoCo cannot simulate the model: {first_line(error)}"
        ) from error
    couplers = program.linear_equality_constraints()
    if others := plant.num_constraints() - len(couplers):
        raise InvalidArgumentError(
            f"{others} of the model's constraints do not couple two joints; MuJoCo can simulate"
            " couplers only"
        )
    joints = map(plant.get_joint, plant.GetJointIndices())
    names = {joint.position_start(): _name(joint) for joint in joints if joint.num_positions()}
    for coupler in couplers:
        (row,), (offset,) = coupler.evaluator().GetDenseA(), coupler.evaluator().lower_bound()
        own, other = np.argsort(-np.abs(row))  # a_0 q_0 + a_1 q_1 = b, with |a_0| >= |a_1|
        name_0, name_1 = (
            names[program.FindDecisionVariableIndex(coupler.variables()[k])] for k in (own, other)
        )
        added = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT)
        added.name1, added.name2 = name_0, name_1
        added.data[:2] = offset / row[own], -row[other] / row[own]
        added.solref, added.solimp = _SOLREF, _COUPLER_SOLIMP


def _place(X: RigidTransform) -> dict[str, FloatArray]:
    return {"pos": X.translation(), "quat": X.rotation().ToQuaternion().wxyz()}


def _add_drive(mujoco: Any, spec: Any, actuator: JointActuator, inertia: float) -> None:
    """Adds a drive with the force u - p q - d v, for the control u = p q_d + d v_d.

    MuJoCo integrates the damping d of a drive implicitly, but its contacts do not see that: in a
    time step h they carry an object along with a velocity that is too large by the factor
    1 + d h / I for the inertia I at the joint. Fingers have a factor of 1.2, and wrists of arms up
    to 3. The turntable of a conveyor, with a factor of 6, would throw what it carries. Such a drive
    is made inert, because it prescribes the motion.

    Args:
        mujoco: The module.
        spec: Specification of the model, with the joint.
        actuator: Actuator of the plant.
        inertia: Inertia I at the joint, with that of the rotor, in kg or kg m².
    """
    gains, name = actuator.get_controller_gains(), _name(actuator.joint())
    impulse = gains.d * spec.option.timestep
    added_inertia = impulse / _INERT_RATIO if impulse > _STIFF_RATIO * inertia else 0.0
    spec.joint(name).armature = actuator.default_reflected_inertia() + added_inertia
    added = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    added.gaintype, added.gainprm[0] = mujoco.mjtGain.mjGAIN_FIXED, 1.0
    added.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    added.biasprm[:3] = [0.0, -gains.p, -gains.d]
    if np.isfinite(effort := actuator.effort_limit()):
        added.forcelimited, added.forcerange = True, [-effort, effort]


def _add_geometries(
    mujoco: Any,
    spec: Any,
    plant: MultibodyPlant,
    inspector: SceneGraphInspector,
    bodies: Mapping[Any, Any],
    pieces: Pieces,
) -> dict[str, GeometryId]:
    """Adds the geometries that may collide, and their pairs; returns geometries by their names."""
    pairs = sorted(inspector.GetCollisionCandidates(), key=lambda pair: [*map(_number, pair)])
    names: dict[GeometryId, list[str]] = {}
    for geometry in sorted({one for pair in pairs for one in pair}, key=_number):
        body = bodies[plant.GetBodyFromFrameId(inspector.GetFrameId(geometry)).index()]
        shape = inspector.GetShape(geometry)
        # Without the bits of contype and conaffinity, only the listed pairs collide.
        place: dict[str, Any] = {"contype": 0, "conaffinity": 0, "density": 0.0}
        place |= _place(inspector.GetPoseInFrame(geometry))
        name, primitive = f"geometry {_number(geometry)}", _primitive(mujoco, shape)
        if primitive:
            names[geometry] = [body.add_geom(name=name, **primitive, **place).name]
            continue
        if (convex := pieces.get(geometry)) is None:
            hull = inspector.GetConvexHull(geometry)
            convex = [np.array([hull.vertex(k) for k in range(hull.num_vertices())])]
        names[geometry] = [f"{name} {k}" for k in range(len(convex))]
        for own, vertices in zip(names[geometry], convex, strict=True):
            mesh = spec.add_mesh(name=own, uservert=vertices.ravel())
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
            body.add_geom(name=own, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=own, **place)
    for one, other in pairs:
        a, b = _friction(inspector, one), _friction(inspector, other)
        mu = 2 * a * b / (a + b) if a + b > 0 else 0.0  # As Drake combines them.
        contact = {"condim": _CONDIM, "friction": [mu, mu, 0.0, 0.0, 0.0]}
        contact |= {"solref": _SOLREF, "solimp": _SOLIMP}
        for first in names[one]:
            for second in names[other]:
                spec.add_pair(geomname1=first, geomname2=second, **contact)
    return {name: geometry for geometry, own in names.items() for name in own}


def _number(geometry: GeometryId) -> int:
    return int(geometry.get_value())


def _friction(inspector: SceneGraphInspector, geometry: GeometryId) -> float:
    """Returns Coulomb's coefficient of a geometry: of the two, Drake's time steps use this one."""
    properties = inspector.GetProximityProperties(geometry)
    return float(properties.GetProperty("material", "coulomb_friction").dynamic_friction())


def _primitive(mujoco: Any, shape: DrakeShape) -> dict[str, Any]:
    """Returns type and size of a geometry of MuJoCo; empty for a mesh."""
    kinds = mujoco.mjtGeom
    if isinstance(shape, Sphere):
        return {"type": kinds.mjGEOM_SPHERE, "size": [shape.radius(), 0.0, 0.0]}
    if isinstance(shape, Box):
        return {"type": kinds.mjGEOM_BOX, "size": shape.size() / 2}
    if isinstance(shape, Cylinder | Capsule):
        kind = kinds.mjGEOM_CYLINDER if isinstance(shape, Cylinder) else kinds.mjGEOM_CAPSULE
        return {"type": kind, "size": [shape.radius(), shape.length() / 2, 0.0]}
    if isinstance(shape, Ellipsoid):
        return {"type": kinds.mjGEOM_ELLIPSOID, "size": [shape.a(), shape.b(), shape.c()]}
    if isinstance(shape, HalfSpace):
        return {"type": kinds.mjGEOM_PLANE, "size": [0.0, 0.0, 1.0]}
    return {}


def _state_indices(model: Any, plant: MultibodyPlant) -> tuple[IntArray, IntArray]:
    """Returns the indices in `qpos` and `qvel` of a plant's positions and velocities."""
    q, v = (np.zeros(n, dtype=np.intp) for n in (plant.num_positions(), plant.num_velocities()))
    for joint in map(plant.get_joint, plant.GetJointIndices()):
        if joint.num_velocities() == 0:
            continue
        places, rates = np.arange(joint.num_positions()), np.arange(joint.num_velocities())
        own = model.joint(_name(joint))
        # Of a floating body, Drake has the rotation first, and MuJoCo the translation.
        turned = 3 if isinstance(joint, QuaternionFloatingJoint) else 0
        q[joint.position_start() + places] = own.qposadr[0] + np.roll(places, -turned)
        v[joint.velocity_start() + rates] = own.dofadr[0] + np.roll(rates, -turned)
    return q, v
