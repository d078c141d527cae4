"""The object as a body: its inertia, and how it stands on a table and is carried."""

import numpy as np
import pytest
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import UnitInertia
from pydrake.systems.analysis import Simulator

from drake_pregrasp import ObjectPlant
from drake_pregrasp.config.limits_config import BallReach, BoxReach, LimitsConfig, Pair
from drake_pregrasp.config.object_config import Ball, Box, Conveyor, Cylinder, Mesh, Revolved
from drake_pregrasp.diagrams.object_body import add_object_body, standing_position
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.resources import resource_folder

CUP_PROFILE = [[0, 0], [0.035, 0], [0.035, 0.09], [0.032, 0.09], [0.032, 0.003], [0, 0.003]]
OBJECTS = {
    "box": Box(size=[0.05, 0.06, 0.1]),
    "cup": Revolved(profile=CUP_PROFILE, mass=0.2),
    "can": Cylinder(),
    "mug": Mesh(file=str(resource_folder("models") / "mug.obj")),
    "bracket": Mesh(file=str(resource_folder("models") / "bracket.obj"), mass=0.25),
    "ball": Ball(),
}
STANDING = ["cup", "can", "mug", "bracket"]


@pytest.mark.parametrize("name", OBJECTS)
def test_the_body_has_the_inertia_of_its_mesh(name):
    config = OBJECTS[name]
    scene_graph, plant = SceneGraph(), MultibodyPlant(0.01)
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    body = add_object_body(plant, config)
    plant.Finalize()
    M_O = body.CalcSpatialInertiaInBodyFrame(plant.CreateDefaultContext())
    mesh = config.make_shape().mesh
    assert M_O.get_mass() == pytest.approx(config.mass)
    np.testing.assert_allclose(M_O.get_com(), mesh.center_mass, atol=1e-9)
    central = M_O.Shift(M_O.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
    expected = mesh.moment_inertia * config.mass / mesh.volume
    np.testing.assert_allclose(central, expected, rtol=1e-6, atol=1e-9 * np.max(expected))


def test_a_ball_has_the_inertia_of_a_ball_up_to_its_facets():
    config = Ball(radius=0.04, mass=2.0)
    plant = MultibodyPlant(0.01)
    body = add_object_body(plant, config)
    plant.Finalize()
    I_O = body.CalcSpatialInertiaInBodyFrame(plant.CreateDefaultContext()).CalcRotationalInertia()
    exact = 2.0 * UnitInertia.SolidSphere(0.04).CopyToFullMatrix3()
    np.testing.assert_allclose(I_O.CopyToFullMatrix3(), exact, atol=0.005 * exact[0, 0])


def carried(config, plant_config, v, w, times):
    plant = ObjectPlant(config, Conveyor(v, w), plant_config)
    simulator = Simulator(plant)
    poses = []
    for time in times:
        simulator.AdvanceTo(time)
        pose = plant.GetOutputPort("X_WO").Eval(simulator.get_context())
        poses.append(RigidTransform(pose))  # What Eval returns changes with the Context.
    return poses


@pytest.mark.parametrize("name", STANDING)
def test_it_stands_still_on_the_table(scenario, name):
    (X_WO,) = carried(OBJECTS[name], scenario.plant_config, 0.0, 0.0, [1.0])
    start = standing_position(OBJECTS[name])
    np.testing.assert_allclose(X_WO.translation(), start, atol=1e-5)
    tilt = X_WO.rotation().matrix()[2, 2]
    assert np.arccos(min(tilt, 1.0)) < 1e-4
    assert abs(RollPitchYaw(X_WO.rotation()).yaw_angle()) < 1e-6


@pytest.mark.parametrize("name", STANDING)
def test_the_conveyor_carries_it_at_its_speed(scenario, name):
    v = 0.02
    early, late = carried(OBJECTS[name], scenario.plant_config, v, 0.0, [0.2, 1.0])
    step = scenario.plant_config.time_step
    way = late.translation() - early.translation()
    np.testing.assert_allclose(way, [0.8 * v, 0, 0], atol=5e-5)
    # It starts from rest, and so lags by one step.
    gone = late.translation()[0] - standing_position(OBJECTS[name])[0]
    assert gone == pytest.approx(v * (1 - step), abs=5e-5)


@pytest.mark.parametrize("name", STANDING)
def test_it_stands_as_high_as_its_lowest_point_is_deep(name):
    lowest = np.min(OBJECTS[name].make_shape().mesh.vertices[:, 2])
    position = standing_position(OBJECTS[name])
    assert position[2] == pytest.approx(-lowest, abs=2e-6)
    p_OCoM = OBJECTS[name].make_shape().p_OCoM
    np.testing.assert_allclose((position + p_OCoM)[:2], 0, atol=1e-12)


# The keys of what limits contacts.


def test_reaches_are_solids_of_the_hand():
    ball = BallReach(center=[0.1, 0, 0], radius=0.05).make_reach().solid
    np.testing.assert_allclose(ball.distance(np.zeros((1, 3))), [0.05])
    box = (
        BoxReach(size=[0.2, 0.02, 0.02], center=[0, 0, 0.1], rpy=[0, 0, np.pi / 4])
        .make_reach()
        .solid
    )
    diagonal = 0.09 * np.sqrt(0.5)  # Along which the box, turned, is long.
    probes = np.array([[diagonal, diagonal, 0.1], [diagonal, -diagonal, 0.1]])
    np.testing.assert_allclose(box.distance(probes), [-0.01, 0.08], atol=1e-12)


def test_the_shorter_of_speed_and_step_limits_steps():
    def step(**keys):
        return LimitsConfig(**keys).make_limits(period=0.1, friction=0.7).max_step

    assert step() == np.inf
    assert step(max_speed=0.02) == pytest.approx(0.002)
    assert step(max_step=0.003) == 0.003
    assert step(max_speed=0.02, max_step=0.003) == pytest.approx(0.002)
    assert step(max_speed=0.02, max_step=0.001) == 0.001


def test_all_keys_reach_the_limits():
    pair = Pair(first=1, second=0, distance=0.03, tolerance=0.002)
    config = LimitsConfig(deadband=0.001, pairs=[pair], guard=["margin", "q_vew"], recover=True)
    limits = config.make_limits(period=0.1, friction=0.7)
    assert (limits.deadband, limits.recover) == (0.001, True)
    (coupled,) = limits.pairs
    assert (coupled.first, coupled.second, coupled.distance, coupled.tolerance) == (
        1,
        0,
        0.03,
        0.002,
    )
    p_CoMC = 0.03 * np.array([[1.0, 0, 0], [-0.5, 0.87, 0], [-0.5, -0.87, 0], [0, 0, 1]])
    nhat = p_CoMC / np.linalg.norm(p_CoMC, axis=1, keepdims=True)
    slippery = config.make_limits(period=0.1, friction=0.0)
    margins = [list(each.guard(p_CoMC, nhat))[-1] for each in (limits, slippery)]
    assert margins[0] > margins[1]
    assert LimitsConfig().make_limits(period=0.1, friction=0.7).guard is None


def test_contradicting_pairs_are_refused():
    pairs = [Pair(first=0, second=1, distance=0.03), Pair(first=1, second=2, distance=0.03)]
    with pytest.raises(InvalidArgumentError, match="in two pairs"):
        LimitsConfig(pairs=pairs).make_limits(period=0.1, friction=0.7)
