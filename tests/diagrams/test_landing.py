"""Objects that are tossed or pushed hardly sink into what they touch, and do not bounce."""

import numpy as np
import pytest
from pydrake.math import RollPitchYaw
from pydrake.systems.analysis import Simulator

from drake_pregrasp import BoxSolid, ObjectPlant, load_scenario
from drake_pregrasp.config.object_config import Box, Cylinder, Mesh, Push, Toss
from drake_pregrasp.diagrams.object_plant import TIP_RADIUS
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.systems.sources import MovingSolid

SPEED = 2.0  # At the landing, in m/s.
OBJECTS = {
    "box": Box(size=[0.1, 0.06, 0.14]),
    "mug": Mesh(file="package://drake_pregrasp/mug.obj"),
    "cylinder": Cylinder(),
    "bracket": Mesh(file="package://drake_pregrasp/bracket.obj"),
}
STARTS = {"flat": (0, 0, 0.2), "edge": (0.785, 0, 0.2), "corner": (0.785, 0.6155, 0.2)}
STARTS["over"] = (2.4, 0.3, 0.2)


NAMES = [pytest.param(n, marks=pytest.mark.slow if n == "mug" else ()) for n in OBJECTS]


def corners_over_time(config, motion, duration, obstacles=()):
    """Returns times and the corners of the object in W, shape (t, k, 3), at each time step."""
    settings = Scenario(motion=motion).plant_settings
    plant = ObjectPlant(config, motion, settings, obstacles=obstacles)
    simulator, vertices = Simulator(plant), config.make_shape().mesh.vertices
    times, places = np.arange(1, int(duration / settings.time_step)) * settings.time_step, []
    for time in times:
        simulator.AdvanceTo(time)
        X_WO = plant.GetOutputPort("X_WO").Eval(simulator.get_context())
        places.append((X_WO @ vertices.T).T)
    return times, np.array(places)


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("name", NAMES)
def test_a_tossed_object_stops_within_half_a_millimetre(name, start):
    config, rpy = OBJECTS[name], STARTS[start]
    shape, R_WO = config.make_shape(), RollPitchYaw(*rpy).ToRotationMatrix()
    lowest = float(np.min((R_WO @ (shape.mesh.vertices - shape.p_OCoM).T)[2]))
    height = SPEED**2 / (2 * 9.81) - lowest
    motion = Toss([0.0, 0.0, height], rpy=list(rpy), velocity=[0.3, 0.0, 0.0], table=True)
    times, places = corners_over_time(config, motion, 1.0)
    bottom = np.min(places[..., 2], axis=1)
    landed = int(np.argmax(bottom < 0))
    assert times[landed] == pytest.approx(SPEED / 9.81, abs=0.005)
    assert np.min(bottom) > -5e-4
    assert np.max(bottom[landed:]) < 1e-3
    settled = times > times[landed] + 0.3
    assert np.min(bottom[settled]) > -2.5e-4


@pytest.mark.slow
@pytest.mark.parametrize("speed", [0.1, 0.5])
@pytest.mark.parametrize("name", ["box", "mug", "cylinder"])
def test_a_pusher_stays_outside_the_object(name, speed):
    motion = Push(speed=speed, start=0.1, offset=0.01)
    plant = ObjectPlant(OBJECTS[name], motion, Scenario(motion=motion).plant_settings)
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
    _, places = corners_over_time(Box(), motion, 0.3, [MovingSolid(wall, np.zeros(3))])
    assert 0.1995 < np.max(places[..., 0]) < 0.2005
    beside = Toss([0.0, 0.5, 0.2], table=True)
    _, places = corners_over_time(Box(), beside, 0.4)
    assert np.max(places[-1, :, 2]) < -0.2


FAST_PUSH = "motion: !Push {speed: 0.5}"
STEPS = {"{}": 0.025, "motion: !Toss {table: true}": 0.0025, "motion: !Toss {}": 0.025}
STEPS |= {FAST_PUSH: 0.001, f"{{{FAST_PUSH}, plant_config: {{time_step: 0.01}}}}": 0.01}


@pytest.mark.parametrize("text", STEPS)
def test_the_default_time_step_suits_the_motion(text):
    step = load_scenario("a_base", text=text).plant_settings.time_step
    assert step == pytest.approx(STEPS[text])
