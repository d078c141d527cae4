"""Objects that are tossed, pushed or tipped hardly sink, do not bounce, and come to rest."""

from itertools import product

import numpy as np
import pytest
from conftest import slow
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial.transform import Rotation

from drake_pregrasp import (
    BoxSolid,
    ObjectPlant,
    load_resolved,
    load_scenario,
    resolve,
    shipped_scenarios,
)
from drake_pregrasp.config.object_config import Box, Conveyor, Cylinder, Mesh, Push, Toss
from drake_pregrasp.diagrams.object_body import FRICTION
from drake_pregrasp.diagrams.object_plant import TIP_RADIUS, add_moving_object
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.systems.sources import MovingSolid

SPEED = 2.0  # At the landing, in m/s.
DEPTH = 3e-4  # That landing objects reach, in metres.
GRAVITY = 9.81
OBJECTS = {
    "box": Box(size=[0.1, 0.06, 0.14]),
    "mug": Mesh(file="package://drake_pregrasp/mug.obj"),
    "cylinder": Cylinder(),
    "bracket": Mesh(file="package://drake_pregrasp/bracket.obj"),
}
STARTS = {"flat": (0, 0, 0.2), "edge": (0.785, 0, 0.2), "corner": (0.785, 0.6155, 0.2)}
STARTS["over"] = (2.4, 0.3, 0.2)


FALLS = [f if f == ("box", "corner") else slow(*f) for f in product(OBJECTS, STARTS)]


def motion_over_time(config, motion, duration, *, friction=FRICTION, obstacles=()):
    """Times, positions (t, 3) and rotations (t, 3, 3) of O in W at each default time step."""
    scenario, builder = Scenario(object=config, motion=motion), DiagramBuilder()
    settings = resolve(scenario).plant_config
    _, _, X_WO, _ = add_moving_object(
        builder,
        config.make_shape(),
        config.mass,
        motion,
        settings,
        friction=friction,
        obstacles=obstacles,
    )
    port = builder.ExportOutput(X_WO, "X_WO")
    diagram = builder.Build()
    simulator, poses = Simulator(diagram), []
    times = np.arange(1, int(duration / settings.time_step)) * settings.time_step
    for time in times:
        simulator.AdvanceTo(time)
        pose = diagram.get_output_port(port).Eval(simulator.get_context())
        poses.append(pose.GetAsMatrix34())
    poses = np.array(poses)
    return times, poses[:, :, 3], poses[:, :, :3]


def corners_over_time(config, motion, duration, **options):
    """Times and the corners of the object in W, shape (t, k, 3), at each default time step."""
    times, p_WO, R_WO = motion_over_time(config, motion, duration, **options)
    vertices = config.make_shape().mesh.vertices
    return times, p_WO[:, None] + vertices @ R_WO.swapaxes(1, 2)


@pytest.mark.parametrize(("name", "start"), FALLS)
def test_a_tossed_object_stops_within_a_third_of_a_millimetre(name, start):
    config, rpy = OBJECTS[name], STARTS[start]
    shape, R_WO = config.make_shape(), RollPitchYaw(*rpy).ToRotationMatrix()
    lowest = float(np.min((R_WO @ (shape.mesh.vertices - shape.p_OCoM).T)[2]))
    height = SPEED**2 / (2 * 9.81) - lowest
    motion = Toss([0.0, 0.0, height], rpy=list(rpy), velocity=[0.3, 0.0, 0.0], table=True)
    times, places = corners_over_time(config, motion, 0.7)
    bottom = np.min(places[..., 2], axis=1)
    landed = int(np.argmax(bottom < 0))
    assert times[landed] == pytest.approx(SPEED / 9.81, abs=0.005)
    assert np.min(bottom) > -DEPTH
    assert np.max(bottom[landed:]) < 1e-3
    settled = times > times[landed] + 0.3
    assert np.min(bottom[settled]) > -2.5e-4


def random_drop(seed):
    """A random object and a toss of it onto the table, tumbling."""
    rng = np.random.default_rng(seed)
    size = [float(length) for length in rng.uniform(0.03, 0.14, 3)]
    if seed % 3 == 0:
        config = Box(size=size)
    elif seed % 3 == 1:
        config = Cylinder(radius=size[0] / 2, length=size[1])
    else:
        name = rng.choice(["bracket", "mug", "wedge", "hammer", "bowl", "torus", "screwdriver"])
        config = Mesh(file=f"package://drake_pregrasp/{name}.obj")
    shape, speed = config.make_shape(), rng.uniform(0.3, 2.5)
    R_WO = RotationMatrix(Rotation.random(random_state=seed).as_matrix())
    lowest = float(np.min((R_WO @ (shape.mesh.vertices - shape.p_OCoM).T)[2]))
    motion = Toss(
        [0.0, 0.0, speed**2 / (2 * GRAVITY) - lowest],
        rpy=list(RollPitchYaw(R_WO).vector()),
        velocity=[*rng.uniform(-0.5, 0.5, 2), 0.0],
        spin=list(rng.uniform(-4, 4, 3)),
        table=True,
    )
    return config, motion


@pytest.mark.parametrize("seed", [0, *map(slow, range(1, 12))])
def test_landing_objects_hardly_sink_and_never_gain_energy(seed):
    config, motion = random_drop(seed)
    shape = config.make_shape()
    times, p_WO, R_WO = motion_over_time(config, motion, 0.7)
    places = p_WO[:, None] + shape.mesh.vertices @ R_WO.swapaxes(1, 2)
    over = np.all(np.abs(places[..., :2]) < [0.6, 0.4], axis=-1)
    assert np.min(np.where(over, places[..., 2], 0.0)) > -DEPTH
    # Velocities are constant between two steps, where the mean height counts. Energy is per mass.
    step, p_WCoM = times[0], p_WO + R_WO @ shape.p_OCoM
    v, heights = np.diff(p_WCoM, axis=0) / step, (p_WCoM[:-1, 2] + p_WCoM[1:, 2]) / 2
    w = Rotation.from_matrix(R_WO[:-1].swapaxes(1, 2) @ R_WO[1:]).as_rotvec() / step
    moments = w @ (shape.mesh.moment_inertia / shape.mesh.volume)
    energy = np.sum(v * v, axis=1) / 2 + np.sum(w * moments, axis=1) / 2 + GRAVITY * heights
    gain = np.max(energy[1:] - np.minimum.accumulate(energy)[:-1])
    assert gain < 3e-3 * energy[0]
    assert energy[-1] < 0.99 * energy[0]


def assert_slides(size, friction, speed, pitch):
    """A box that is tossed along the table stops after v²/(2 mu g), and does not pitch."""
    coulomb = 2 * friction * FRICTION / (friction + FRICTION)  # As Drake combines them.
    distance = speed**2 / (2 * coulomb * GRAVITY)
    start = [-0.5, 0.0, size[2] / 2]
    motion = Toss(start, velocity=[speed, 0.0, 0.0], table=True)
    duration = speed / (coulomb * GRAVITY) + 0.2
    _, p_WO, R_WO = motion_over_time(Box(size=size), motion, duration, friction=friction)
    assert p_WO[-1, 0] - start[0] == pytest.approx(distance, rel=0.05)
    assert np.degrees(np.arccos(np.clip(np.min(R_WO[:, 2, 2]), -1, 1))) < pitch


def test_a_cube_slides_as_far_as_coulomb_says():
    assert_slides([0.1, 0.1, 0.1], FRICTION, 1.0, pitch=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_boxes_slide_as_far_as_coulomb_says(seed):
    """Boxes that friction does not tip over."""
    rng = np.random.default_rng(seed)
    friction, speed = rng.uniform(0.1, FRICTION), rng.uniform(0.5, 1.5)
    length, width, height = (float(size) for size in rng.uniform(0.04, 0.14, 3))
    coulomb = 2 * friction * FRICTION / (friction + FRICTION)
    assert_slides([length, width, min(height, 0.75 * length / coulomb)], friction, speed, pitch=2.0)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [0.1, 0.5])
@pytest.mark.parametrize("name", ["box", "mug", "cylinder"])
def test_a_pusher_stays_outside_the_object(name, speed):
    motion = Push(speed=speed, start=0.1, offset=0.01)
    plant = ObjectPlant(OBJECTS[name], motion, resolve(Scenario(motion=motion)).plant_config)
    simulator, solid, deepest = Simulator(plant), OBJECTS[name].make_shape().solid, -np.inf
    root, tip = simulator.get_context(), plant.plant.GetBodyByName("tip")
    for time in np.linspace(0.1, 0.1 + motion.distance / speed, 200):
        simulator.AdvanceTo(time)
        context = plant.plant.GetMyContextFromRoot(root)
        X_OT = plant.GetOutputPort("X_WO").Eval(root).inverse() @ tip.EvalPoseInWorld(context)
        deepest = max(deepest, TIP_RADIUS - solid.distance(X_OT.translation()[None])[0])
    assert 0 < deepest < 1e-3


def test_it_stops_at_a_wall_too_and_falls_beside_the_table():
    wall = BoxSolid(np.array([0.22, 0.0, 0.1]), np.eye(3), np.array([0.04, 0.4, 0.2]))
    motion = Toss([0.0, 0.0, 0.15], velocity=[3.0, 0.0, 0.0], table=True)
    _, places = corners_over_time(Box(), motion, 0.3, obstacles=[MovingSolid(wall, np.zeros(3))])
    assert 0.1995 < np.max(places[..., 0]) < 0.2005
    beside = Toss([0.0, 0.5, 0.2], table=True)
    _, places = corners_over_time(Box(), beside, 0.4)
    assert np.max(places[-1, :, 2]) < -0.2


FAST_PUSH = "motion: !Push {speed: 0.5}"
STEPS = {"{}": 0.025, "motion: !Toss {table: true}": 0.001, "motion: !Toss {}": 0.001}
STEPS |= {FAST_PUSH: 0.001, f"{{{FAST_PUSH}, plant_config: {{time_step: 0.01}}}}": 0.01}


@pytest.mark.parametrize("text", STEPS)
def test_the_default_time_step_suits_the_motion(text):
    step = load_resolved("a_base", text=text).plant_config.time_step
    assert step == pytest.approx(STEPS[text])


DEEPEST = 5e-4  # Metres.
SLOW = 0.02  # Speed below which an object rests, or rolls slowly, in m/s.
LONGEST = 10  # Seconds within which it does.
RADIUS = 0.16  # Of the turntable; an object whose centre of mass is beyond it falls off.

BOXES = {f"box of {size}": Box(size=size) for size in ([0.1, 0.1, 0.1], [0.05, 0.06, 0.14])}
SHIPPED = [name for name, (file, _) in shipped_scenarios().items() if file.stem == "objects"]
# Faces down, and starts on edges and corners that are not stable. A pin on its head is tilted.
FACES = {"z": (0, 0), "-z": (3.04, 0), "x": (0, 1.571), "-x": (0, -1.571), "y": (1.571, 0)}
EDGES = {"edge": (np.pi / 4, 0), "corner": (np.pi / 4, 0.6155), "tipped": (0.6, 0.6)}
TILTS = FACES | {"-y": (-1.571, 0)} | EDGES | {"over": (2.4, 0.3), "forward": (-0.7, 1.0)}
TABLES = {"table": Toss(table=True), "turntable": Conveyor(0.0, 0.0)}
COARSE = MultibodyPlantConfig(time_step=0.01)


def rested(plant, shape, tilt):
    """Returns whether the object comes to rest, or falls off; its depth, place and speed then."""
    body, simulator = plant.plant.GetBodyByName("object"), Simulator(plant)
    context = plant.plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    R_WO = RollPitchYaw(*tilt, 0.2).ToRotationMatrix()
    p_WO = -(R_WO @ shape.p_OCoM)
    p_WO[2] = -np.min((R_WO @ shape.mesh.vertices.T)[2])
    plant.plant.SetFreeBodyPose(context, body, RigidTransform(R_WO, p_WO))
    for second in range(2, LONGEST + 1):
        simulator.AdvanceTo(second)
        X_WO = body.EvalPoseInWorld(context)
        points = (X_WO @ shape.mesh.vertices.T).T
        over = points[np.linalg.norm(points[:, :2], axis=1) < RADIUS]
        depth = -float(np.min(over[:, 2], initial=0.0))
        speed = np.linalg.norm(body.EvalSpatialVelocityInWorld(context).translational())
        place = X_WO @ shape.p_OCoM
        if (depth < DEEPEST and speed < SLOW) or np.linalg.norm(place[:2]) > RADIUS:
            return True, depth, place, speed
    return False, depth, place, speed


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "table"),
    [pair for pair in product([*BOXES, *SHIPPED], TABLES) if pair != ("ball", "turntable")],
)
def test_a_tipped_object_comes_to_rest_on_the_table(name, table):
    config = BOXES.get(name) or load_scenario(name).object
    starts = TILTS if table == "table" else EDGES
    if name == "ball":  # It has no sides.
        starts = {"tipped": EDGES["tipped"]}
    plant = ObjectPlant(config, TABLES[table], COARSE)
    for start, tilt in starts.items():
        rests, *found = rested(plant, config.make_shape(), tilt)
        assert rests, (start, found)


def test_a_tipped_cube_rests_on_a_face():
    plant = ObjectPlant(Box(), TABLES["turntable"], COARSE)
    rests, depth, place, speed = rested(plant, Box().make_shape(), TILTS["tipped"])
    assert rests
    assert depth < 1e-5
    assert place[2] == pytest.approx(0.05, abs=1e-5)
    assert speed < 1e-6


@pytest.mark.parametrize("size", [[0.1, 0.1, 0.1], slow([0.2, 0.2, 0.02])])
@pytest.mark.parametrize("time_step", [0.025, slow(0.01)])
def test_a_dropped_box_does_not_rock_wherever_it_lies(size, time_step):
    for x, y, yaw in [(0.2, 0.05, 0.0), (0.2, 0.1, 0.78), (-0.3, -0.2, 0.3)]:
        plant = ObjectPlant(
            Box(size=size), TABLES["table"], MultibodyPlantConfig(time_step=time_step)
        )
        body, simulator = plant.plant.GetBodyByName("object"), Simulator(plant)
        context = plant.plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        dropped = RigidTransform(RollPitchYaw(-0.02, 0.02, yaw), [x, y, size[2] / 2 + 0.0025])
        plant.plant.SetFreeBodyPose(context, body, dropped)
        simulator.AdvanceTo(1.0)
        for step in range(5):
            simulator.AdvanceTo(1.0 + step * time_step)
            up = body.EvalPoseInWorld(context).rotation().matrix()[2, 2]
            assert np.arccos(min(up, 1.0)) < 1e-5
            assert np.linalg.norm(body.EvalSpatialVelocityInWorld(context).get_coeffs()) < 1e-4
