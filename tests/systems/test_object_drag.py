"""The force with which a user drags an object, and what it does to an object in a plant."""

import numpy as np
import pytest
from broken_values import NOT_FINITE
from driven import Driven
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity

from drake_pregrasp import Box, Conveyor, ObjectPlant
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.systems.object_drag import STRONGEST, ObjectDrag

MASS, WEIGHT = 0.4, 0.4 * 9.81
NOWHERE = np.full(3, np.nan)
P_BA, STILL = np.array([0.02, 0.05, -0.03]), np.zeros(6)
X_WB = RigidTransform(RotationMatrix.MakeZRotation(0.7), [0.3, -0.2, 0.05])
P_WA = X_WB @ P_BA


@pytest.fixture(scope="module")
def plant():
    still = Conveyor(linear_velocity=0.0, angular_velocity=0.0)
    config = Scenario().plant_config
    config.time_step = 0.005
    return ObjectPlant(Box(mass=MASS), still, config, forces=[("object_drag", ObjectDrag)])


@pytest.fixture
def drag(plant):
    """Returns a function that tells the force and its point for a target and a velocity of B."""
    body = plant.plant.GetBodyByName("object")
    driven, bodies = Driven(ObjectDrag(body)), plant.plant.num_bodies()

    def pulled(p_WT, V_WB=STILL):
        driven.system.set_pull(driven.context, P_BA, np.asarray(p_WT))
        motions = [SpatialVelocity(np.asarray(V_WB, dtype=float))] * bodies
        driven.fix(body_poses=[X_WB] * bodies, body_spatial_velocities=motions)
        forces = driven.eval("spatial_forces")
        for force in forces:
            assert force.body_index == body.index()
            np.testing.assert_array_equal(force.p_BoBq_B, P_BA)
            np.testing.assert_array_equal(force.F_Bq_W.rotational(), 0)
        return [force.F_Bq_W.translational() for force in forces]

    return pulled


def test_it_pulls_towards_the_target_in_proportion_to_the_distance(drag):
    way = np.array([0.02, -0.01, 0.03])
    (near,), (far,), (there,) = drag(P_WA + way), drag(P_WA + 2 * way), drag(P_WA)
    np.testing.assert_allclose(near, MASS * 100 * way)
    np.testing.assert_allclose(far, 2 * near)
    np.testing.assert_allclose(there, 0, atol=1e-12)


@pytest.mark.parametrize("turning", [False, True])
def test_it_brakes_the_pulled_point(drag, turning):
    V_WB = np.array([0.0, 0, 1, 0, 0, 0] if turning else [0.0, 0, 0, 0.1, 0.2, -0.1])
    v_WA = np.cross(V_WB[:3], P_WA - X_WB.translation()) + V_WB[3:]
    (force,) = drag(P_WA, V_WB)
    np.testing.assert_allclose(force, -10 * MASS * v_WA)


@pytest.mark.parametrize("size", [0.2, 1.0, 1e6])
@pytest.mark.parametrize("speed", [0.0, 1.0, 5.0, -5.0, 1e6])
def test_neither_the_spring_nor_the_sum_exceeds_the_bound(drag, size, speed):
    (force,) = drag(P_WA + np.array([size, 0, 0]), [0.0, 0, 0, speed, 0, 0])
    largest = STRONGEST * WEIGHT
    expected = np.clip(largest - 10 * MASS * speed, -largest, largest)
    np.testing.assert_allclose(force, [expected, 0, 0], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("number", NOT_FINITE)
def test_without_a_target_there_is_no_force(drag, plant, number):
    assert drag([0.0, number, 0.0]) == []
    assert Driven(ObjectDrag(plant.plant.GetBodyByName("object"))).eval("spatial_forces") == []


def puller(plant):
    """Returns a function that sets what pulls the object in a driven plant."""
    system = plant.GetSubsystemByName("object_drag")

    def pull(driven, p_BA, p_WT):
        context = system.GetMyMutableContextFromRoot(driven.context)
        system.set_pull(context, p_BA, np.asarray(p_WT))

    return pull


def test_an_object_on_a_table_is_dragged_and_stays_where_it_is_let_go(plant):
    """It slides until friction holds it, at most mu g / k before the target."""
    driven, pull = Driven(plant), puller(plant)
    low, target = np.array([0.05, 0.0, -0.04]), np.array([0.2, 0.05, 0.01])

    def place():
        return driven.eval("X_WO").translation().copy()

    driven.advance(0.2)
    np.testing.assert_allclose(place(), [0, 0, 0.05], atol=1e-4)
    pull(driven, low, target)
    driven.advance(3.0)
    left = target - driven.eval("X_WO") @ low
    assert np.linalg.norm(left) < 0.8 * 9.81 / 100 + 0.005
    dragged = place()
    assert dragged[2] == pytest.approx(0.05, abs=1e-3)
    pull(driven, low, NOWHERE)
    driven.advance(0.5)
    released = place()
    driven.advance(0.5)
    np.testing.assert_allclose(place(), released, atol=1e-5)
    assert np.linalg.norm(released - dragged) < 0.005


@pytest.mark.slow
@pytest.mark.parametrize("p_BA", [[0, 0, 0.05], [0.05, 0.05, 0.05], [0.05, 0.01, 0.05]])
def test_an_object_that_is_lifted_and_let_go_does_not_sink_into_the_table(plant, p_BA):
    """It comes to rest on a face, and is never deep in the table at steps of 5 ms."""
    driven, pull = Driven(plant), puller(plant)
    corners = 0.1 * (np.indices((2, 2, 2)).reshape(3, 8) - 0.5)

    def lowest():
        return np.min((driven.eval("X_WO") @ corners)[2])

    pull(driven, np.array(p_BA), [0, 0, 0.35])
    driven.advance(2.0)
    assert lowest() > 0.05
    pull(driven, np.array(p_BA), NOWHERE)
    depths = []
    for _ in range(300):
        driven.advance(0.005)
        depths.append(-lowest())
    assert max(depths) < 0.01
    assert depths[-1] == pytest.approx(0, abs=1e-4)
