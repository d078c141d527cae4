"""Objects that are tipped onto all sides come to rest on tables, and do not sink."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import Simulator

from drake_pregrasp import ObjectPlant, load_scenario, shipped_scenarios
from drake_pregrasp.config.object_config import Box, Conveyor, Toss

DEEPEST = 5e-4  # Metres.
SLOW = 0.02  # Speed below which an object rests, or rolls slowly, in m/s.
LONGEST = 10  # Seconds within which it does.
RADIUS = 0.16  # Of the turntable; an object whose centre of mass is beyond it falls off.

OBJECTS = {f"box of {size}": Box(size=size) for size in ([0.1, 0.1, 0.1], [0.05, 0.06, 0.14])}
OBJECTS |= {
    name: load_scenario(name).object
    for name, (file, _) in shipped_scenarios().items()
    if file.stem == "objects"
}
# Faces down, and starts on edges and corners that are not stable. A pin on its head is tilted.
FACES = {"z": (0, 0), "-z": (3.04, 0), "x": (0, 1.571), "-x": (0, -1.571), "y": (1.571, 0)}
EDGES = {"edge": (np.pi / 4, 0), "corner": (np.pi / 4, 0.6155), "tipped": (0.6, 0.6)}
STARTS = FACES | {"-y": (-1.571, 0)} | EDGES | {"over": (2.4, 0.3), "forward": (-0.7, 1.0)}
TABLES = {"table": Toss(table=True), "turntable": Conveyor(0.0, 0.0)}


def rested(config, motion, tilt):
    """Returns whether the object comes to rest, or falls off; its depth, place and speed then."""
    plant = ObjectPlant(config, motion, MultibodyPlantConfig(time_step=0.01))
    body, simulator = plant.plant.GetBodyByName("object"), Simulator(plant)
    context = plant.plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    shape, R_WO = config.make_shape(), RollPitchYaw(*tilt, 0.2).ToRotationMatrix()
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
@pytest.mark.parametrize("table", TABLES)
@pytest.mark.parametrize("name", OBJECTS)
def test_a_tipped_object_comes_to_rest_on_the_table(name, table):
    for start, tilt in STARTS.items():
        rests, *found = rested(OBJECTS[name], TABLES[table], tilt)
        assert rests, (start, found)


def test_a_tipped_cube_rests_on_a_face():
    rests, depth, place, speed = rested(Box(), TABLES["turntable"], STARTS["tipped"])
    assert rests
    assert depth < 1e-5
    assert place[2] == pytest.approx(0.05, abs=1e-5)
    assert speed < 1e-6


@pytest.mark.parametrize("size", [[0.1, 0.1, 0.1], [0.2, 0.2, 0.02], [0.05, 0.06, 0.14]])
@pytest.mark.parametrize("time_step", [0.01, 0.025])
def test_a_dropped_box_does_not_rock_wherever_it_lies(size, time_step):
    for x, y, yaw in [(0.2, 0.05, 0.0), (0.2, 0.1, 0.78), (-0.3, -0.2, 0.3)]:
        plant = ObjectPlant(
            Box(size=size), TABLES["table"], MultibodyPlantConfig(time_step=time_step)
        )
        body, simulator = plant.plant.GetBodyByName("object"), Simulator(plant)
        context = plant.plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        dropped = RigidTransform(RollPitchYaw(-0.02, 0.02, yaw), [x, y, size[2] / 2 + 0.0025])
        plant.plant.SetFreeBodyPose(context, body, dropped)
        simulator.AdvanceTo(2.0)
        for step in range(5):
            simulator.AdvanceTo(2.0 + step * time_step)
            up = body.EvalPoseInWorld(context).rotation().matrix()[2, 2]
            assert np.arccos(min(up, 1.0)) < 1e-5
            assert np.linalg.norm(body.EvalSpatialVelocityInWorld(context).get_coeffs()) < 1e-4
