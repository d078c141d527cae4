"""Obstacles that are bodies: they collide with object and hand, and move as given."""

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import Simulator

import drake_pregrasp as dp
from drake_pregrasp.config.object_config import Conveyor, Mesh, Push, Toss
from drake_pregrasp.systems.sources import MovingSolid

CONFIG = MultibodyPlantConfig(time_step=0.005)
STILL = np.zeros(3)


def positions(motion, obstacle, times, box=None, config=CONFIG):
    """Yields the object's position at each time."""
    plant = dp.ObjectPlant(box or dp.Box(), motion, config, obstacles=[obstacle])
    simulator = Simulator(plant)
    for time in times:
        simulator.AdvanceTo(time)
        X_WO = plant.GetOutputPort("X_WO").Eval(simulator.get_context())
        yield X_WO.translation().copy()


WALLS = {
    "box": dp.BoxSolid(np.array([0.13, 0.0, 0.05]), np.eye(3), np.array([0.02, 0.3, 0.08])),
    "plane": dp.HalfSpace(np.array([0.12, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0])),
    "ball": dp.BallSolid(np.array([0.16, 0.0, 0.05]), 0.04),
}
SLIDE = Toss(position=[0.0, 0.0, 0.05], velocity=[2.0, 0.0, 0.0], table=True)


@pytest.mark.slow
@pytest.mark.parametrize("name", WALLS)
def test_an_object_that_slides_stops_at_a_wall(name):
    """Half of its length before it, and a ball is met at its front."""
    config = MultibodyPlantConfig(time_step=0.001)
    (place,) = positions(SLIDE, MovingSolid(WALLS[name], STILL), [1.0], config=config)
    assert place[0] < 0.07 + 6e-4


def test_an_object_that_meets_nothing_slides_on():
    free = MovingSolid(dp.BallSolid(np.array([0.0, 1.0, 0.0]), 0.01), STILL)
    (place,) = positions(SLIDE, free, [1.0])
    assert place[0] > 0.15


def test_a_moving_obstacle_pushes_the_object_at_its_speed():
    ball = MovingSolid(dp.BallSolid(np.array([-0.2, 0.0, 0.03]), 0.02), np.array([0.1, 0.0, 0.0]))
    motion = Push(start=100.0, start_distance=0.5)  # The pusher stays away.
    places = list(positions(motion, ball, (1.0, 3.0, 4.0)))
    assert abs(places[0][0]) < 1e-5
    # Its front is at -0.2 + 0.02 + 0.1 t; the box is 0.05 m before it.
    np.testing.assert_allclose([p[0] for p in places[1:]], [0.17, 0.27], atol=3e-3)


@pytest.mark.slow
def test_a_ball_enters_a_cup():
    """It touches the mesh of an object that is not convex, and not its hull."""
    mug = Mesh(file="package://drake_pregrasp/mug.obj")
    height = mug.make_shape().mesh.bounds[1, 2] - mug.make_shape().mesh.bounds[0, 2]
    down = MovingSolid(
        dp.BallSolid(np.array([0.0, 0.0, height]), 0.01), np.array([0.0, 0.0, -0.02])
    )
    before, after = positions(Conveyor(0.0, 0.0), down, (0.1, 2.0), mug)
    np.testing.assert_allclose(after, before, atol=1e-4)


WALL = "obstacles: [!BoxObstacle {{size: [0.4, 0.02, 0.08], center: [0, {}, 0.045]{}}}]"
TURNING = "motion: {linear_velocity: 0.0, angular_velocity: 0.3}"
AWAY = "motion: {linear_velocity: 0.05, angular_velocity: 0.0}"
BALL = (
    "obstacles: [!BallObstacle {{radius: 0.03, center: [0.2, {}, 0.05], velocity: [-0.1, 0, 0]}}]"
)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (f"{TURNING}, {WALL.format(0.05, '')}", "at 0 s the object is 10 mm inside this body"),
        (f"{TURNING}, {WALL.format(0.075, '')}", "inside this body; move it, or set body: false"),
        (f"{TURNING}, {WALL.format(0.082, '')}", ""),
        (f"{AWAY}, {WALL.format(0.065, '')}", ""),
        (f"{TURNING}, {WALL.format(0.05, ', body: false')}", ""),
        (BALL.format(0.05), "inside this body"),
        (BALL.format(0.11), ""),
    ],
)
def test_bodies_in_the_way_of_the_object_are_refused(text, problem):
    if not problem:
        dp.load_resolved("a_base", text=f"{{{text}}}")
        return
    with pytest.raises(dp.ScenarioError, match=problem) as error:
        dp.load_resolved("a_base", text=f"{{{text}}}")
    assert error.value.key == "a_base.obstacles[0]"
