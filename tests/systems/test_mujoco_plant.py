"""MuJoCo's model of a plant equals the plant, and obeys the laws of mechanics."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from conftest import usable_hands
from driven import Driven
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    ExternallyAppliedSpatialForce,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import (
    BodyIndex,
    ModelInstanceIndex,
    MultibodyForces,
    PdControllerGains,
    ScrewJoint,
)
from pydrake.planning import RobotDiagramBuilder
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial.transform import Rotation

from drake_pregrasp.config.object_config import Box, Conveyor, Cylinder, Mesh, Push, Toss
from drake_pregrasp.diagrams.hand_parsing import add_hand_model
from drake_pregrasp.diagrams.object_body import FRICTION, add_object
from drake_pregrasp.diagrams.object_contact import separate_contacts
from drake_pregrasp.diagrams.object_plant import ENGINES, MUJOCO, ObjectPlant, add_model
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.simulation.hand_file import load_hand
from drake_pregrasp.systems.mujoco_model import mujoco_model
from drake_pregrasp.systems.mujoco_plant import MujocoPlant

mujoco = pytest.importorskip("mujoco", reason="needs the extra mujoco")

TIME_STEP, GRAVITY = 0.005, 9.81
EXACT = {"rtol": 0, "atol": 1e-9}


@pytest.fixture(scope="module", params=usable_hands())
def hand(request):
    """A hand with its carrier or arm: description, plant, data of MuJoCo, and its model."""
    description = load_hand(f"package://drake_pregrasp/{request.param}.yaml")
    builder = RobotDiagramBuilder(time_step=TIME_STEP)
    add_hand_model(builder.plant(), description)
    builder.plant().Finalize()
    diagram = builder.Build()
    plant = diagram.plant()
    converted = mujoco_model(plant, diagram.scene_graph().model_inspector())
    return description, plant, converted, diagram


def random_state(plant, seed):
    generator = np.random.default_rng(seed)
    limits = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
    low, high = np.clip(limits, -2, 2)
    return generator.uniform(low, high), generator.normal(size=plant.num_velocities())


def mujoco_data(converted, q, v):
    data = mujoco.MjData(converted.model)
    data.qpos[converted.q], data.qvel[converted.v] = q, v
    mujoco.mj_forward(converted.model, data)
    return data


def test_masses_and_inertias_are_those_of_the_plant(hand):
    _, plant, converted, _ = hand
    model = converted.model
    for index in map(BodyIndex, range(1, plant.num_bodies())):
        own, M = converted.bodies[index], plant.get_body(index).default_spatial_inertia()
        if M.get_mass() == 0:
            continue
        R = RotationMatrix(Rotation.from_quat(np.roll(model.body_iquat[own], -1)).as_matrix())
        I = R.matrix() @ np.diag(model.body_inertia[own]) @ R.matrix().T  # noqa: E741
        assert model.body_mass[own] == pytest.approx(M.get_mass(), abs=1e-9)
        np.testing.assert_allclose(model.body_ipos[own], M.get_com(), **EXACT)
        expected = M.Shift(M.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
        np.testing.assert_allclose(I, expected, **EXACT)


def test_limits_and_drives_are_those_of_the_plant(hand):
    _, plant, converted, _ = hand
    model = converted.model
    limits = np.array([model.jnt_range[model.dof_jntid[v]] for v in converted.v]).T
    low, high = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
    np.testing.assert_allclose(limits[0], np.maximum(low, -1e9), **EXACT)
    np.testing.assert_allclose(limits[1], np.minimum(high, 1e9), **EXACT)
    q, v = random_state(plant, 1)
    data = mujoco_data(converted, q, v)
    for k, index in enumerate(plant.GetJointActuatorIndices()):
        actuator = plant.get_joint_actuator(index)
        gains, joint = actuator.get_controller_gains(), actuator.joint()
        asked = -gains.p * q[joint.position_start()] - gains.d * v[joint.velocity_start()]
        most = actuator.effort_limit()
        assert data.actuator_force[k] == pytest.approx(np.clip(asked, -most, most))


@pytest.mark.parametrize("speed", [0.001, 0.1])  # Drives of arms are at their limits at first.
def test_actuation_accelerates_the_joints_as_they_moved_in_the_last_time_step(hand, speed):
    _, plant, _, diagram = hand
    q = plant.GetPositions(plant.CreateDefaultContext())
    if np.any((q < plant.GetPositionLowerLimits()) | (q > plant.GetPositionUpperLimits())):
        pytest.skip("joints beyond their limits are pushed back")
    system = MujocoPlant(plant, diagram.scene_graph().model_inspector())
    driven, instances = Driven(system), range(plant.num_model_instances())
    for instance in map(ModelInstanceIndex, instances):
        if own := plant.GetJointActuatorIndices(instance):
            name = f"{plant.GetModelInstanceName(instance)}_desired_state"
            start = [plant.get_joint_actuator(k).joint().default_positions()[0] for k in own]
            driven.fix(**{name: np.append(start, np.full(len(own), speed))})
    np.testing.assert_array_equal(driven.array("net_actuation"), 0)
    driven.update()
    q, v = np.split(driven.array("state"), [plant.num_positions()])
    context = plant.CreateDefaultContext()
    plant.SetPositionsAndVelocities(context, np.append(q, v))
    change = v / plant.time_step()
    expected = plant.CalcInverseDynamics(context, change, MultibodyForces(plant))
    joints = [plant.get_joint_actuator(k).joint() for k in plant.GetJointActuatorIndices()]
    expected = expected[[joint.velocity_start() for joint in joints]]
    assert np.max(np.abs(expected)) > 1e-4
    actuation = driven.array("net_actuation")
    np.testing.assert_allclose(actuation, expected, atol=0.02 * np.max(np.abs(expected)))


def test_fingertips_and_mass_matrix_are_those_of_the_plant(hand):
    description, plant, converted, _ = hand
    context = plant.CreateDefaultContext()
    for seed in range(5):
        q, v = random_state(plant, seed)
        plant.SetPositionsAndVelocities(context, np.append(q, v))
        data = mujoco_data(converted, q, v)
        for tip in description.fingertips:
            frame = plant.GetFrameByName(tip.frame)
            own = converted.bodies[frame.body().index()]
            p_BT = frame.GetFixedPoseInBodyFrame().translation()
            p_WT = data.xpos[own] + data.xmat[own].reshape(3, 3) @ p_BT
            np.testing.assert_allclose(p_WT, frame.CalcPoseInWorld(context).translation(), **EXACT)
        M = mass_matrix(converted.model, data)
        M = M[np.ix_(converted.v, converted.v)]
        np.testing.assert_allclose(M, plant.CalcMassMatrix(context), **EXACT)


def mass_matrix(model, data):
    """The mass matrix, a column at a time."""
    columns = np.zeros((model.nv, model.nv))
    for k, unit in enumerate(np.eye(model.nv)):
        mujoco.mj_mulM(model, data, columns[k], unit)
    return columns


def test_pairs_that_collide_are_those_of_the_scene(hand):
    _, _, converted, diagram = hand
    inspector = diagram.scene_graph().model_inspector()
    pairs = zip(converted.model.pair_geom1, converted.model.pair_geom2, strict=True)
    found = {frozenset(converted.geometries[g] for g in pair) for pair in pairs}
    assert found == {frozenset(pair) for pair in inspector.GetCollisionCandidates()}


def station(config, motion, **changes):
    settings = MultibodyPlantConfig(time_step=TIME_STEP, use_sampled_output_ports=False)
    return ObjectPlant(config, motion, settings, engine=MUJOCO, **changes)


def pose_after(config, motion, seconds):
    """The object's pose in the last time step before a time."""
    driven = Driven(station(config, motion))
    driven.advance(seconds - TIME_STEP / 2)
    return driven.eval("X_WO")


def test_a_thrown_body_follows_the_parabola_of_its_centre_of_mass():
    bracket = Mesh(file="package://drake_pregrasp/bracket.obj")
    p_OCoM = bracket.make_shape().p_OCoM
    p, v, spin = np.array([0, 0, 1.0]), np.array([1.0, 0.2, 2.0]), np.array([2.0, 5, -3])
    toss = Toss(list(p), rpy=[0.4, -0.3, 1.0], velocity=list(v), spin=list(spin), table=False)
    t = 0.2
    found = pose_after(bracket, toss, t) @ p_OCoM
    np.testing.assert_allclose(found, p + t * v + [0, 0, -GRAVITY * t**2 / 2], atol=5e-5)


def test_a_body_without_spin_falls_exactly():
    toss, t = Toss([0.0, 0.0, 1.0], velocity=[0.0, 0.0, 0.0], table=False), 0.3
    z = pose_after(Box(), toss, t).translation()[2]
    assert z == pytest.approx(1.0 - GRAVITY * t**2 / 2, abs=1e-9)


def test_a_sliding_block_stops_after_the_distance_of_its_friction():
    """v²/(2 mu g), to within the distance in which the friction builds up."""
    speed, box = 0.5, Box(size=[0.2, 0.2, 0.04])
    driven = sliding(box, speed)
    driven.advance(0.3)
    x, _, z = driven.eval("body_poses")[driven.body].translation()
    assert x == pytest.approx(speed**2 / (2 * FRICTION * GRAVITY), rel=0.01)
    assert z == pytest.approx(0.02, abs=1e-4)


def sliding(config, speed):
    """A box on a table with an initial velocity along x."""
    builder, shape = DiagramBuilder(), config.make_shape()
    settings = MultibodyPlantConfig(time_step=TIME_STEP)
    plant, scene_graph = AddMultibodyPlant(settings, builder)
    body = add_object(plant, shape, config.mass)
    add_model(plant, "table.sdf")
    plant.Finalize()
    separate_contacts(plant, scene_graph, body, is_convex=True)
    X_WB = RigidTransform([0.0, 0.0, config.size[2] / 2 - 1e-6])
    plant.SetDefaultFloatingBaseBodyPose(body, X_WB)
    v = np.array([0.0, 0.0, 0.0, speed, 0.0, 0.0])
    system = MujocoPlant(plant, scene_graph.model_inspector(), velocities=v)
    driven = Driven(system)
    geometries = plant.GetCollisionGeometriesForBody(body)
    driven.instance = body.model_instance()
    driven.body, driven.geometries = int(body.index()), [g.get_value() for g in geometries]
    driven.owner = builder.Build()  # Keeps the plant alive.
    return driven


def test_contact_forces_carry_the_weight_of_an_object_at_rest():
    config = Box()
    driven = sliding(config, 0.0)
    driven.advance(0.5)
    contacts = driven.eval("contact_results")
    on_object = [force if b in driven.geometries else -force for _, b, force in contacts]
    np.testing.assert_allclose(sum(on_object), [0, 0, config.mass * GRAVITY], atol=1e-3)


@pytest.mark.parametrize("config", [Box(), Cylinder(), Box(size=[0.03, 0.1, 0.15], mass=0.35)])
def test_a_belt_that_starts_at_its_speed_carries_an_object_and_does_not_throw_it(config):
    plant = station(config, Conveyor(linear_velocity=0.05, angular_velocity=0.5))
    driven = Driven(plant)
    height = config.make_shape().mesh.extents[2] / 2
    for _ in range(100):
        driven.advance(0.01)
        assert abs(driven.eval("X_WO").translation()[2] - height) < 1e-4
    X_WO = driven.eval("X_WO")
    np.testing.assert_allclose(X_WO.translation()[:2], [0.05, 0], atol=5e-4)
    assert RollPitchYaw(X_WO.rotation()).yaw_angle() == pytest.approx(0.5, abs=0.005)


def test_a_pusher_pushes_an_object_as_far_as_in_drake():
    push, ends = Push(speed=0.05, distance=0.12), []
    for engine in ENGINES:
        plant = ObjectPlant(Box(), push, MultibodyPlantConfig(time_step=0.01), engine=engine)
        driven = Driven(plant)
        driven.advance(3.5)
        ends.append(driven.array("X_WO"))
    np.testing.assert_allclose(*ends, atol=1e-3)
    assert ends[0][0, 3] > 0.01


def test_velocities_of_a_turned_body_are_those_of_drake():
    toss = Toss(
        [0.0, 0.0, 1.0], rpy=[0.4, -0.3, 1.0], velocity=[1.0, 2.0, 3.0], spin=[3.0, 2.0, 1.0]
    )
    plant = station(Box(), toss)
    driven = Driven(plant)
    dynamics, instance = plant.dynamics, plant.plant.GetModelInstanceByName("object")
    context = dynamics.GetMyMutableContextFromRoot(driven.context)
    np.testing.assert_allclose(dynamics.GetVelocities(context, instance)[:3], [3, 2, 1], **EXACT)
    asked = np.array([0.0, 0.0, 4.0, 0.0, 0.0, 0.0])
    dynamics.SetVelocities(context, instance, asked)
    np.testing.assert_allclose(dynamics.GetVelocities(context, instance), asked, **EXACT)
    before = driven.eval("X_WO").rotation().matrix().copy()
    driven.advance(0.1 - TIME_STEP / 2)
    turned = driven.eval("X_WO").rotation().matrix() @ before.T
    np.testing.assert_allclose(Rotation.from_matrix(turned).as_rotvec(), [0, 0, 0.4], atol=1e-3)


def test_a_context_holds_all_that_a_trajectory_depends_on():
    driven = sliding(Box(), 0.5)
    driven.advance(0.1)
    assert len(driven.eval("contact_results")) > 2
    saved = driven.context.Clone()
    driven.advance(0.1)
    first = driven.array("state")
    driven.context.SetTimeStateAndParametersFrom(saved)
    driven.simulator.Initialize()
    driven.advance(0.1)
    np.testing.assert_array_equal(driven.array("state"), first)


def test_contexts_advance_in_threads_as_they_do_alone():
    one = sliding(Box(), 0.5)
    other = Simulator(one.system, one.system.CreateDefaultContext())
    velocities = np.array([0.0, 0.0, 3.0, 0.0, 0.3, 0.0])
    one.system.SetVelocities(other.get_mutable_context(), one.instance, velocities)
    simulators, seconds = [one.simulator, other], np.arange(1, 101) * TIME_STEP
    starts = [simulator.get_context().Clone() for simulator in simulators]

    def states(k):
        context, found = simulators[k].get_mutable_context(), []
        context.SetTimeStateAndParametersFrom(starts[k])
        simulators[k].Initialize()
        for time in seconds:
            simulators[k].AdvanceTo(time)
            found.append(one.system.GetOutputPort("state").Eval(context))
        return found

    alone = [states(k) for k in range(2)]
    with ThreadPoolExecutor(2) as pool:
        np.testing.assert_array_equal(list(pool.map(states, range(2))), alone)


MIMIC = """
<robot name="pair">
  <link name="palm"/>
  <link name="leader">{inertial}</link>
  <link name="follower">{inertial}</link>
  <joint name="lead" type="revolute">
    <parent link="palm"/> <child link="leader"/> <axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="10" velocity="10"/>
  </joint>
  <joint name="follow" type="revolute">
    <parent link="palm"/> <child link="follower"/> <axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="10" velocity="10"/>
    <mimic joint="lead" multiplier="-1.5" offset="0.2"/>
  </joint>
</robot>
"""
INERTIAL = """
<inertial>
  <origin xyz="0 0 0.05"/> <mass value="0.1"/>
  <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/>
</inertial>
"""


def coupled_plant():
    """A driven joint and one that is coupled to it, against gravity."""
    builder = RobotDiagramBuilder(time_step=TIME_STEP)
    plant = builder.plant()
    builder.parser().AddModelsFromString(MIMIC.format(inertial=INERTIAL), "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("palm"))
    drive = plant.AddJointActuator("drive", plant.GetJointByName("lead"))
    drive.set_controller_gains(PdControllerGains(p=20.0, d=0.5))
    return plant, builder


def test_a_mimic_joint_follows_its_joint_as_in_drake():
    plant, builder = coupled_plant()
    plant.Finalize()
    diagram = builder.Build()
    in_mujoco = Driven(MujocoPlant(plant, diagram.scene_graph().model_inspector()))
    in_mujoco.fix(pair_desired_state=[0.5, 0.0])
    in_mujoco.advance(1.0)
    simulator = Simulator(diagram)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    instance = plant.GetModelInstanceByName("pair")
    plant.get_desired_state_input_port(instance).FixValue(context, [0.5, 0.0])
    simulator.AdvanceTo(1.0)
    found = in_mujoco.array("state")
    assert found[1] == pytest.approx(-1.5 * found[0] + 0.2, abs=1e-3)
    np.testing.assert_allclose(found, plant.GetPositionsAndVelocities(context), atol=2e-3)


def test_a_constraint_without_counterpart_is_refused():
    plant, builder = coupled_plant()
    one, other = plant.GetBodyByName("leader"), plant.GetBodyByName("follower")
    plant.AddBallConstraint(one, [0.0, 0.0, 0.1], other, [0.0, 0.0, 0.1])
    plant.Finalize()
    diagram = builder.Build()
    with pytest.raises(InvalidArgumentError, match="1 of the model's constraints do not couple"):
        mujoco_model(plant, diagram.scene_graph().model_inspector())


def test_a_joint_without_counterpart_is_named():
    builder = RobotDiagramBuilder(time_step=TIME_STEP)
    plant = builder.plant()
    body = plant.AddRigidBody("nut")
    ends = plant.world_frame(), body.body_frame()
    plant.AddJoint(ScrewJoint("thread", *ends, screw_pitch=0.01, damping=0.0))
    plant.Finalize()
    diagram = builder.Build()
    with pytest.raises(InvalidArgumentError, match=r"joint thread is a screw joint"):
        mujoco_model(plant, diagram.scene_graph().model_inspector())


def test_a_force_beside_the_centre_of_mass_accelerates_and_turns_a_body():
    toss = Toss([0.0, 0.0, 1.0], velocity=[0.0, 0.0, 0.0], table=False)
    plant, config = station(Box(), toss), Box()
    dynamics, body = plant.dynamics, plant.plant.GetBodyByName("object")
    driven = Driven(dynamics)
    force, lever, t = ExternallyAppliedSpatialForce(), 0.01, 0.02
    force.body_index, force.p_BoBq_B = body.index(), [0.0, lever, 0.0]
    force.F_Bq_W = SpatialForce(tau=np.zeros(3), f=[2.0, 0.0, 0.0])
    driven.fix(applied_spatial_force=AbstractValue.Make([force]))
    driven.advance(t - TIME_STEP / 2)
    w_v = driven.array("state")[-6:]
    inertia = config.mass * config.size[0] ** 2 / 6
    assert w_v[3] == pytest.approx(2.0 / config.mass * t, rel=1e-3)
    assert w_v[2] == pytest.approx(-2.0 * lever / inertia * t, rel=1e-3)
