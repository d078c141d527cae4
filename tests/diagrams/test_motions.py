"""Motions of the object besides the plain conveyor."""

import numpy as np
import pytest
from conftest import slow
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from scipy.spatial.transform import Rotation

from drake_pregrasp import ObjectPlant, load_scenario, shipped_scenarios
from drake_pregrasp.config.object_config import Ball, Box, Conveyor, Mesh, PoseStream, Push, Toss
from drake_pregrasp.diagrams.expected_path import expected_path, expected_poses, read_motion
from drake_pregrasp.estimation.recorded_poses import read_recorded_poses
from drake_pregrasp.geometry.motion_profiles import VelocityProfile
from drake_pregrasp.resources import resource_folder

BOX = Box(size=[0.1, 0.06, 0.14])


def poses(motion, times, time_step=0.0125, box=BOX, engine="drake"):
    config = MultibodyPlantConfig(time_step=time_step, use_sampled_output_ports=False)
    plant = ObjectPlant(box, motion, config, engine=engine)
    simulator = Simulator(plant)
    port, found = plant.GetOutputPort("X_WO"), [None] * len(times)

    def monitor(context):
        """Sees each time before the plant steps on, as the planner does."""
        for k, time in enumerate(times):
            if found[k] is None and context.get_time() > time - 1e-9:
                found[k] = RigidTransform(port.Eval(context))

    simulator.set_monitor(monitor)
    simulator.AdvanceTo(times[-1] + time_step / 2)
    return found


@pytest.mark.parametrize("start", [slow(0.0), 2.5])
def test_a_conveyor_carries_an_object_that_starts_turned_about_its_centre_of_mass(start):
    mug = Mesh(file=str(resource_folder("models") / "mug.obj"))
    motion = Conveyor(linear_velocity=0.02, angular_velocity=0.2, yaw=start)
    *_, X_WO = poses(motion, [0.5], box=mug)
    p_WCoM = X_WO @ mug.make_shape().p_OCoM
    assert yaw(X_WO) == pytest.approx(start + 0.1, abs=0.004)
    np.testing.assert_allclose(p_WCoM[:2], [0.01, 0.0], atol=5e-4)


@pytest.mark.parametrize("y", [0.0, 0.08])
def test_a_conveyor_brings_an_object_from_its_start_place(y):
    motion = Conveyor(position=[-0.7, y], profile=[[0.0, 0.0, 0.0], [0.5, 0.3, 0.5]])
    shape, times = BOX.make_shape(), [0.2, 0.5]
    expected = dict(expected_poses(motion, 0.995, shape))
    for time, X_WO in zip(times, poses(motion, times, 0.0025), strict=True):
        X_expected = expected[min(expected, key=lambda t: abs(t - time))]
        np.testing.assert_allclose(X_WO.translation(), X_expected.translation(), atol=2e-3)
        assert yaw(X_WO) == pytest.approx(yaw(X_expected), abs=4e-3)
    np.testing.assert_allclose(expected_path(motion, 1.0, shape)[0], [-0.7, y, 0.07], atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["drake", "mujoco"])
@pytest.mark.parametrize(("thing", "y"), [(Ball(radius=0.035), 0.0), (BOX, 0.08)])
def test_what_a_conveyor_carries_moves_with_it_from_the_start_on(thing, y, engine):
    """Also a ball, which would roll back if the belt started under it."""
    if engine == "mujoco":
        pytest.importorskip("mujoco")
    motion = Conveyor(position=[-0.5, y], linear_velocity=0.2, angular_velocity=0.5)
    shape, times = thing.make_shape(), [0.005, 0.1]
    for time, X_WO in zip(times, poses(motion, times, 0.0025, thing, engine), strict=True):
        _, X_expected = expected_poses(motion, time, shape)[-1]
        np.testing.assert_allclose(X_WO.translation(), X_expected.translation(), atol=6e-4)
        assert yaw(X_WO) == pytest.approx(yaw(X_expected), abs=2e-3)


def yaw(X_WO):
    return RollPitchYaw(X_WO.rotation()).yaw_angle()


@pytest.mark.parametrize("time_step", [0.05, 0.0125])
@pytest.mark.parametrize("box", [BOX, Box()], ids=["box", "cube"])
def test_a_flight_is_the_exact_parabola_at_any_time_step_and_a_cube_turns_evenly(time_step, box):
    p, v, spin = np.array([0.1, -0.2, 0.5]), np.array([1.0, 0.3, 4.0]), np.array([1.0, -3.0, 2.0])
    motion = Toss(list(p), rpy=[0.4, -0.3, 1.0], velocity=list(v), spin=list(spin))
    start = RollPitchYaw(motion.rpy).ToRotationMatrix().matrix()
    times = [0.05, 0.2, 0.75]
    for t, X_WO in zip(times, poses(motion, times, time_step, box), strict=True):
        expected = p + t * v + [0, 0, -9.81 * t**2 / 2]
        np.testing.assert_allclose(X_WO.translation(), expected, atol=1e-10)
        if box is not BOX:
            R_WO = Rotation.from_rotvec(t * spin).as_matrix() @ start
            np.testing.assert_allclose(X_WO.rotation().matrix(), R_WO, atol=4 * time_step**2)


def test_a_tumbling_bodys_turn_comes_closer_to_its_limit_with_the_time_step():
    motion = Toss(spin=[4.0, 5.0, 3.0])
    fine, *coarse = (poses(motion, [0.5], h)[0].rotation() for h in (1e-4, 1e-3, 4e-3))
    errors = [Rotation.from_matrix((fine.inverse() @ R).matrix()).magnitude() for R in coarse]
    assert errors[0] < 0.01
    assert errors[1] / errors[0] == pytest.approx(4, rel=0.2)


def test_a_thrown_body_follows_its_centre_of_mass():
    """Also where that is not at O, and the body is thrown in any orientation."""
    bracket = Mesh(file="package://drake_pregrasp/bracket.obj")
    p_OCoM = bracket.make_shape().p_OCoM
    assert np.linalg.norm(p_OCoM) > 0.005
    p, v, spin = np.array([0, 0, 1.0]), np.array([1.0, 0, 2]), np.array([2.0, 5, -3])
    motion = Toss(position=list(p), rpy=[1, 0.5, -2], velocity=list(v), spin=list(spin))
    h = 0.001
    start, step, later = poses(motion, [0.0, h, 0.5], h, bracket)
    np.testing.assert_allclose(start @ p_OCoM, p, atol=1e-12)
    turn = Rotation.from_matrix((step.rotation() @ start.rotation().inverse()).matrix())
    np.testing.assert_allclose(turn.as_rotvec() / h, spin, rtol=1e-4)
    expected = p + 0.5 * v + [0, 0, -9.81 * 0.5**2 / 2]
    np.testing.assert_allclose(later @ p_OCoM, expected, atol=1e-3)


def test_a_conveyor_follows_its_profile():
    rows = [[0.0, 0, 0], [1.0, 0.1, 0.5], [2.0, 0.1, -0.5], [2.5, 0.0, 0.0]]
    profile, times = VelocityProfile(rows), [0.5, 1.0, 1.5, 2.5, 3.5]
    for time, X_WO in zip(times, poses(Conveyor(profile=rows), times), strict=True):
        expected = profile.at(time)[0]
        assert X_WO.translation()[0] == pytest.approx(expected[0], abs=0.003)
        assert yaw(X_WO) == pytest.approx(expected[1], abs=0.02)
        np.testing.assert_allclose(X_WO.translation()[1:], [0, 0.07], atol=0.003)


def test_a_profile_of_one_row_is_the_constant_conveyor():
    one = poses(Conveyor(profile=[[0.0, 0.02, 0.3]]), [1.0])[0]
    assert one.IsExactlyEqualTo(poses(Conveyor(0.02, 0.3), [1.0])[0])


def test_a_push_through_the_centre_moves_the_object_its_way():
    """From where the tip meets it to where the tip stops, by friction and no further."""
    motion = Push(direction=2.0, speed=0.1, distance=0.15, start=0.2, start_distance=0.09)
    before, during, after, later = poses(
        motion, [0.2, 1.2, 2.5, 3.5], time_step=0.005, box=Box(size=[0.1, 0.1, 0.1])
    )
    u = np.array([np.cos(2.0), np.sin(2.0), 0])
    assert np.linalg.norm(before.translation()[:2]) < 1e-5
    assert 0.02 < during.translation() @ u < after.translation() @ u
    # The face that the tip meets is 0.05 m behind the centre, or further if met at a slant.
    assert 0.1 < after.translation() @ u < 0.14
    np.testing.assert_allclose(later.translation(), after.translation(), atol=1e-3)
    assert after.translation()[2] == pytest.approx(0.05, abs=1e-3)


@pytest.mark.slow
def test_a_push_off_the_centre_turns_the_object():
    turns = {}
    for offset in (-0.02, 0.0, 0.02):
        motion = Push(offset=offset, speed=0.1, distance=0.15, start=0.1)
        (X_WO,) = poses(motion, [2.0], time_step=0.005, box=Box())
        turns[offset] = yaw(X_WO)
    assert turns[0.02] < -0.2
    assert turns[-0.02] == pytest.approx(-turns[0.02], abs=0.02)
    assert abs(turns[0.0]) < 0.01


def test_a_pose_stream_is_followed_as_recorded_and_shown():
    file = "package://drake_pregrasp/carried_by_hand.csv"
    plant = ObjectPlant(Box(), PoseStream(file=file), MultibodyPlantConfig(time_step=0.01))
    track = read_recorded_poses(resource_folder("models") / "carried_by_hand.csv")
    context = plant.CreateDefaultContext()
    frame = plant.plant.GetBodyFrameIdOrThrow(plant.plant.GetBodyByName("object").index())
    for time in (0.0, 1.234, 9.0):
        context.SetTime(time)
        X_WO = plant.GetOutputPort("X_WO").Eval(context)
        np.testing.assert_allclose(X_WO.translation(), track.at(time)[0], atol=1e-12)
        shown = plant.GetOutputPort("query_object").Eval(context).GetPoseInWorld(frame)
        assert shown.IsNearlyEqualTo(X_WO, 1e-12)


MOTIONS = [name for name, (file, _) in shipped_scenarios().items() if file.stem == "motions"]


@pytest.mark.parametrize("name", MOTIONS)
def test_the_expected_path_is_near_the_one_that_is_taken(name):
    scenario = load_scenario(name)
    duration = min(3.0, scenario.simulation_duration)
    path = expected_path(read_motion(scenario.motion), duration, scenario.object.make_shape())
    times = list(np.linspace(0.1, duration - 0.1, 5))
    step = scenario.plant_config.time_step
    for X_WO in poses(scenario.motion, times, step, scenario.object):
        assert np.min(np.linalg.norm(path - X_WO.translation(), axis=1)) < 0.06


def test_the_path_of_a_fall_ends_on_the_table():
    path = expected_path(Toss(position=[0, 0, 1.0], table=True), 10.0, Box().make_shape())
    assert path[:, 2].min() == pytest.approx(0.05, abs=1e-5)
    assert expected_path(Toss(position=[0, 0, 1.0]), 10.0, Box().make_shape())[:, 2].min() < -100
