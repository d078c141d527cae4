"""Points of the object in pictures, and the estimate of its pose from them."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from driven import Driven
from made_systems import cloud
from pydrake.geometry import Sphere
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.tree import SpatialInertia
from pydrake.planning import RobotDiagramBuilder
from pydrake.systems.analysis import Simulator

import drake_pregrasp as dp
from drake_pregrasp.geometry.mesh_solid import MeshSolid
from drake_pregrasp.systems.ports import points_in

CONFIG = dp.DepthSensorConfig(
    [dp.CameraConfig()], period=0.1, latency=0.15, points=40, noise=0, ceiling=9.0
)
BOX = trimesh.creation.box([0.1, 0.08, 0.06])
SOLID = MeshSolid.of(BOX)
CAMERA = dp.CameraConfig(drift_std=0.01, drift_time=0.2)
NOTHING = dp.MeasurementVerdict.NOTHING_NEW


def points_of(system, **inputs):
    driven = Driven(system, **inputs)
    driven.update()
    driven.at(0.2)
    return points_in(driven.eval("point_cloud"))


def test_points_arrive_late_with_the_time_of_their_picture():
    driven = Driven(dp.ObjectPoints(CONFIG), camera_0=cloud([[0, 0, 1.0]]))
    for tick in range(6):
        driven.at(0.1 * tick, camera_0=cloud([[0, 0, 1.0 + tick]]))
        driven.update()
        arrived = tick - 2  # A picture is 0.15 s old when it arrives, between two ticks.
        if arrived < 0:
            assert driven.eval("measurement_time")[0] == -np.inf
            assert driven.eval("point_cloud").size() == 0
            continue
        assert driven.eval("measurement_time")[0] == pytest.approx(0.1 * arrived)
        assert points_in(driven.eval("point_cloud"))[0, 2] == pytest.approx(1.0 + arrived)


def test_points_of_the_table_and_invalid_ones_are_left_out():
    seen = [[0, 0, 0.1], [0, 0, 0.4], [0.1, 0, 0.003], [0.1, 0, -1], [np.nan, 0, 1], [0, np.inf, 1]]
    np.testing.assert_allclose(
        points_of(dp.ObjectPoints(replace(CONFIG, ceiling=0.3)), camera_0=cloud(seen)),
        [[0, 0, 0.1]],
        atol=1e-6,
    )


def test_a_camera_drifts_as_a_gauss_markov_process_of_its_own():
    """All points of a picture move together, and those of another camera otherwise."""
    shifts = []
    for seed in range(200):
        cameras = [CAMERA, dp.CameraConfig(), CAMERA]
        system = dp.ObjectPoints(replace(CONFIG, cameras=cameras, latency=0.001), seed=seed)
        one = [[0, 0, 1.0], [0.1, 0, 1.0]]
        driven = Driven(system, camera_0=cloud(one), camera_1=cloud(one), camera_2=cloud(one))
        pictures = []
        for tick in range(3):
            driven.at(0.1 * tick)
            driven.update()
            driven.at(0.1 * tick + 0.05)
            pictures.append(points_in(driven.eval("point_cloud")).reshape(3, 2, 3) - one)
        np.testing.assert_allclose(np.ptp(pictures, axis=2), 0, atol=1e-6)
        shifts.append(np.array(pictures)[:, :, 0])
    first, none, last = np.moveaxis(shifts, 2, 0) / 0.01  # Each of seeds, ticks and axes.
    np.testing.assert_allclose(none, 0, atol=1e-4)
    for drift in (first, last):
        assert np.var(drift) == pytest.approx(1.0, abs=0.15)
        assert np.mean(drift[:, 0] * drift[:, 2]) == pytest.approx(np.exp(-1), abs=0.12)
    assert abs(np.mean(first * last)) < 0.12
    assert abs(np.mean(first[2:] * last[:-2])) < 0.12  # Not those of another seed either.


def test_of_many_points_some_from_everywhere_are_kept():
    x = np.linspace(0, 1, 1000)
    kept = points_of(
        dp.ObjectPoints(CONFIG), camera_0=cloud(np.column_stack([x, 0 * x, 1 + 0 * x]))
    )
    assert len(kept) == CONFIG.points
    assert np.diff(kept[:, 0]).max() < 2.5 / CONFIG.points


def test_noise_is_along_the_ray_and_a_bias_moves_all_points():
    bias = [0.01, -0.02, 0.005]
    cameras = [dp.CameraConfig(position=[0.1, 0.0, 1.0], bias=bias)]
    place, many = np.array([0.3, 0.0, 0.6]), replace(CONFIG, cameras=cameras, points=1000)
    kept = points_of(
        dp.ObjectPoints(replace(many, noise=0.01), seed=3), camera_0=cloud([place] * 1000)
    )
    ray = place + bias - [0.1, 0.0, 1.0]
    ray /= np.linalg.norm(ray)
    errors = kept - place - bias
    assert np.std(errors @ ray) == pytest.approx(0.01, rel=0.1)
    np.testing.assert_allclose(errors - np.outer(errors @ ray, ray), 0, atol=1e-6)


def test_a_camera_looks_aside():
    above = dp.CameraConfig(position=[0.1, 0.0, 0.5], target=[0.1, 0.0, 0.0])
    with pytest.raises(dp.InvalidArgumentError, match=r"cameras\[1\].target.*straight"):
        dp.ObjectPoints(dp.DepthSensorConfig([dp.CameraConfig(), above]))
    with pytest.raises(dp.InvalidArgumentError, match="cameras"):
        dp.ObjectPoints(dp.DepthSensorConfig())


def test_points_near_links_at_the_measured_positions_are_left_out():
    hand = dp.HandModel(dp.load_hand("package://drake_pregrasp/five_finger_hand.yaml"))
    q = hand.home(np.array([0.0, 0.0, 0.05]), 0.0)
    tips = hand.tips_at(q)
    seen = np.vstack([tips, [0.0, 0.0, 0.05]])
    for shift, kept in ((0.0, [5]), (1.0, range(6)), (np.nan, [])):
        state = np.append(q, np.full(len(q), np.nan))  # Velocities do not matter.
        state[0] += shift  # The carrier's way along x.
        system = dp.ObjectPoints(CONFIG, hand=hand.diagram)
        found = points_of(system, camera_0=cloud(seen), hand_state=state)
        np.testing.assert_allclose(found, seen[list(kept)], atol=1e-6)


def test_exactly_the_points_within_the_margin_of_links_are_left_out():
    hand = dp.HandModel(dp.load_hand("package://drake_pregrasp/five_finger_hand.yaml"))
    q = hand.home(np.array([0.0, 0.0, 0.05]), 0.3)
    diagram, margin = hand.diagram, CONFIG.link_margin
    context = diagram.CreateDefaultContext()
    diagram.plant().SetPositions(diagram.mutable_plant_context(context), q)
    graph = diagram.scene_graph()
    query = graph.get_query_output_port().Eval(diagram.scene_graph_context(context))
    around = hand.tips_at(q).repeat(60, axis=0)
    seen = around + np.random.default_rng(1).uniform(-0.02, 0.02, around.shape)
    seen = seen.astype(np.float32).astype(float)
    apart = [not query.ComputeSignedDistanceToPoint(point, margin) for point in seen]
    assert 30 < sum(apart) < len(seen) - 30
    many = replace(CONFIG, points=len(seen), table_margin=-1.0)
    system = dp.ObjectPoints(many, hand=diagram)
    found = points_of(system, camera_0=cloud(seen), hand_state=np.append(q, np.zeros(len(q))))
    np.testing.assert_allclose(found, seen[apart], atol=1e-6)


def test_cameras_see_a_moving_ball_where_it_is():
    """The copy of the scene follows it, and its facets are within a millimetre."""
    radius, p_WB = 0.04, np.array([0.02, -0.03, 0.05])
    builder = RobotDiagramBuilder(time_step=0.01)
    plant, red = builder.plant(), np.array([1.0, 0.0, 0.0, 1.0])
    body = plant.AddRigidBody("ball", SpatialInertia.SolidSphereWithMass(1.0, radius))
    plant.RegisterVisualGeometry(body, RigidTransform(), Sphere(radius), "ball", red)
    plant.Finalize()
    graph, config = builder.scene_graph(), replace(CONFIG, points=1000, period=0.05)
    sensor = builder.builder().AddNamedSystem("sensor", dp.DepthSensor(config, graph))
    builder.builder().Connect(graph.get_query_output_port(), sensor.GetInputPort("query_object"))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = diagram.mutable_plant_context(simulator.get_mutable_context())
    plant.SetFreeBodyPose(context, body, RigidTransform(p_WB))
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    simulator.AdvanceTo(0.3)
    points = points_in(
        sensor.GetOutputPort("point_cloud").Eval(
            sensor.GetMyContextFromRoot(simulator.get_context())
        )
    )
    distances = np.linalg.norm(points - p_WB, axis=1) - radius
    assert len(points) > 300
    assert np.abs(distances).max() < 1e-3


def seen_at(X_WO, seed=0, count=200):
    """Points of the upper sides of the box at a pose."""
    p_OQ, faces = trimesh.sample.sample_surface(BOX, 3 * count, seed=seed)
    up = (X_WO.rotation().matrix() @ BOX.face_normals[faces].T)[2] > -0.3
    return (X_WO @ p_OQ[up].T).T[:count]


def test_an_estimator_registers_points_and_follows_them():
    """No pose is given to it at any time."""
    estimator = Driven(dp.PoseEstimator(period=0.05, object_solid=SOLID))
    for tick in range(12):
        p_WO = np.array([0.2 + 0.01 * tick, -0.1, 0.03])
        X_WO = RigidTransform(RollPitchYaw(0, 0, 0.3 + 0.02 * tick), p_WO)
        points = cloud(seen_at(X_WO, tick))
        estimator.at(0.05 * tick, point_cloud=points, measurement_time=[0.05 * tick])
        estimator.update()
        X = estimator.eval("X_WO_estimated").inverse() @ X_WO
        assert np.linalg.norm(X.translation()) < 1e-3
        assert X.rotation().ToAngleAxis().angle() < 0.02
    assert estimator.eval("tracking_status")[0] == dp.TrackingStatus.TRACKING
    assert np.linalg.norm(estimator.eval("V_WO_estimated").translational() - [0.2, 0, 0]) < 0.02
    estimator.at(0.6, point_cloud=cloud(seen_at(X_WO)[:5]), measurement_time=[0.6])
    assert estimator.eval("measurement_verdict")[0] == dp.MeasurementVerdict.UNUSABLE  # Too few.
    estimator.update()
    estimator.at(0.65)
    assert estimator.eval("measurement_verdict")[0] == NOTHING  # The picture is known.


def test_touches_correct_what_a_camera_with_a_wrong_place_shows():
    """Two fingertips and the table tell the whole offset, and without touch only the height."""
    X_WO, bias = RigidTransform([0.1, 0.05, 0.03]), np.array([0.004, -0.003, 0.005])
    points = cloud(seen_at(X_WO) + bias)
    p_WT = X_WO @ np.array([[0.059, 0, 0], [0, 0.049, 0], [0.3, 0, 0]]).T
    for touch, left in ((True, [0, 0, 0]), (False, [*bias[:2], 0])):
        config = dp.EstimatorConfig(bias_std=0.005, rests_on_table=True, touch=touch)
        radii = np.full(3, 0.009)
        estimator = Driven(
            dp.PoseEstimator(config, period=0.05, object_solid=SOLID, tip_radii=radii),
            point_cloud=points,
            p_WT=p_WT.T.ravel(),
            touching=[1.0, 1.0, 0.0],
        )
        estimator.tick(20)
        error = estimator.eval("X_WO_estimated").translation() - X_WO.translation()
        np.testing.assert_allclose(error, left, atol=7e-4)
        offset = estimator.eval("camera_offset")
        np.testing.assert_allclose(offset[:3], bias - left, atol=7e-4)
        stds = np.sqrt(offset[3:].reshape(3, 3).diagonal())
        np.testing.assert_allclose(stds > 0.003, np.abs(left) > 0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gap", "touching", "status"),
    [(0.0, 1.0, "COASTING"), (0.0, 0.0, "LOST"), (0.05, 1.0, "LOST")],
)
def test_an_object_that_the_hand_hides_is_not_lost_while_it_is_touched(gap, touching, status):
    X_WO = RigidTransform([0.1, 0.05, 0.03])
    config = dp.EstimatorConfig(lost_after=0.4)
    estimator = Driven(
        dp.PoseEstimator(config, period=0.05, object_solid=SOLID, tip_radii=np.full(1, 0.009)),
        point_cloud=cloud(seen_at(X_WO)),
        p_WT=X_WO @ np.array([0.059 + gap, 0, 0]),
        touching=[touching],
    )
    for tick in range(10):
        estimator.at(0.05 * tick, measurement_time=[0.05 * tick])
        estimator.update()
    assert estimator.eval("tracking_status")[0] == dp.TrackingStatus.TRACKING
    for tick in range(10, 40):
        none = cloud(np.zeros((0, 3)))
        estimator.at(0.05 * tick, point_cloud=none, measurement_time=[0.05 * tick])
        estimator.update()
    assert estimator.eval("tracking_status")[0] == dp.TrackingStatus[status]
    error = estimator.eval("X_WO_estimated").translation() - X_WO.translation()
    assert np.linalg.norm(error) < 1e-3
    # A picture that is late does not say that the touch was not felt.
    estimator.at(2.0, point_cloud=cloud(seen_at(X_WO)), measurement_time=[0.475])
    estimator.update()
    assert estimator.eval("tracking_status")[0] == dp.TrackingStatus[status]
    estimator.at(2.05, touching=[0.0], point_cloud=cloud(np.zeros((0, 3))), measurement_time=[2.05])
    for tick in range(41, 60):  # Released, it is lost, too, and a touch does not find it again.
        estimator.at(0.05 * tick, measurement_time=[0.05 * tick], touching=[float(tick > 55)])
        estimator.update()
    assert estimator.eval("tracking_status")[0] == dp.TrackingStatus.LOST


def test_what_is_touched_is_known_along_the_normal_although_it_is_hidden():
    X_WO = RigidTransform(RollPitchYaw(0, 0, 0.4), [0.1, 0.05, 0.03])
    n = X_WO.rotation().matrix()[:, 0]
    config = dp.EstimatorConfig(rests_on_table=True, lost_after=9.0)
    estimator = Driven(
        dp.PoseEstimator(config, period=0.05, object_solid=SOLID, tip_radii=np.full(2, 0.009)),
        p_WT=(X_WO @ np.array([[0.059, 0.02, 0], [0.059, -0.02, 0]]).T).T.ravel(),
        touching=[1.0, 1.0],
    )
    stds = []
    for tick in range(60):
        seen = seen_at(X_WO, tick) if tick < 10 else np.zeros((0, 3))
        estimator.at(0.05 * tick, point_cloud=cloud(seen), measurement_time=[0.05 * tick])
        estimator.update()
        P = estimator.eval("p_WO_covariance").reshape(3, 3)
        assert np.linalg.eigvalsh(P).min() > 0
        np.testing.assert_allclose(P, P.T, atol=1e-12)
        stds.append([np.sqrt(x @ P @ x) for x in (n, np.cross(n, [0, 0, 1]), [0, 0, 1])])
    along, across, height = np.array(stds[-1])
    assert max(along, height) < 2 * config.touch_std
    assert across > 0.5
    estimator.at(3.0, touching=[0.0, 0.0])
    P = estimator.eval("p_WO_covariance").reshape(3, 3)
    assert np.sqrt(n @ P @ n) > 0.1  # What was felt before stays, but the object may have moved.


def test_contacts_of_a_tick_count_once():
    """The estimate after the discrete update is that before it, with its contacts."""
    X_WO, bias = RigidTransform([0.1, 0.05, 0.03]), np.array([0.004, -0.003, 0.005])
    config = dp.EstimatorConfig(bias_std=0.005, rests_on_table=True)
    estimator = Driven(
        dp.PoseEstimator(config, period=0.05, object_solid=SOLID, tip_radii=np.full(1, 0.009)),
        point_cloud=cloud(seen_at(X_WO) + bias),
        p_WT=X_WO @ np.array([0.059, 0, 0]),
        touching=[1.0],
    )
    for tick in range(4):
        estimator.at(0.05 * tick)
        before = [estimator.array(port) for port in ("camera_offset", "X_WO_estimated")]
        estimator.update()
        for old, port in zip(before, ("camera_offset", "X_WO_estimated"), strict=True):
            np.testing.assert_allclose(estimator.array(port), old, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("is_held", [False, True])
def test_what_a_hand_holds_does_not_rest_on_the_table(is_held):
    high = RigidTransform([0.1, 0.05, 0.03 + 0.006])  # As an offset of the camera would show it.
    config = dp.EstimatorConfig(bias_std=0.01, rests_on_table=True)
    twist = np.zeros(6) if is_held else np.full(6, np.nan)
    estimator = Driven(
        dp.PoseEstimator(config, period=0.05, object_solid=SOLID),
        point_cloud=cloud(seen_at(high)),
        V_WO_held=SpatialVelocity(twist),
    )
    estimator.tick(20)
    height = estimator.eval("X_WO_estimated").translation()[2]
    assert height == pytest.approx(0.036 if is_held else 0.03, abs=7e-4)


def test_a_box_stands_while_only_one_of_its_sides_is_seen():
    """Few points of one side do not tell its tilt, which the table tells."""
    X_WO, rng = RigidTransform([0.1, 0.05, 0.03]), np.random.default_rng(3)
    config = dp.EstimatorConfig(rests_on_table=True)
    estimator = Driven(dp.PoseEstimator(config, period=0.05, object_solid=SOLID))
    for tick in range(80):
        p_WQ = seen_at(X_WO, tick) + rng.normal(scale=1e-3, size=(200, 3))
        if tick > 10:
            p_WQ = p_WQ[p_WQ[:, 0] > 0.148][:22]
        estimator.at(0.05 * tick, point_cloud=cloud(p_WQ), measurement_time=[0.05 * tick])
        estimator.update()
        R = estimator.eval("X_WO_estimated").rotation().matrix()
        assert np.degrees(np.arccos(R[2, 2])) < 0.5


@pytest.mark.slow
def test_a_faster_filter_learns_no_more_from_the_same_touches():
    X_WO, stds = RigidTransform([0.1, 0.05, 0.03]), []
    p_WT = X_WO @ np.array([[0.059, 0, 0], [0, 0.049, 0]]).T
    for period in (0.05, 0.01, 0.005):
        config = dp.EstimatorConfig(bias_std=0.005, bias_time=1e6)
        estimator = Driven(
            dp.PoseEstimator(
                config, period=period, object_solid=SOLID, tip_radii=np.full(2, 0.009)
            ),
            point_cloud=cloud(seen_at(X_WO)),
            p_WT=p_WT.T.ravel(),
            touching=[1.0, 1.0],
        )
        for tick in range(round(0.5 / period) + 1):
            picture = 0.05 * ((tick * period + 1e-9) // 0.05)
            estimator.at(tick * period, measurement_time=[picture])
            estimator.update()
        stds.append(np.sqrt(estimator.eval("camera_offset")[3:].reshape(3, 3).diagonal()[:2]))
    np.testing.assert_allclose(stds[1:], [stds[0]] * 2, rtol=0.2)


def test_what_a_hand_holds_and_touches_does_not_fall():
    X_WO = RigidTransform([0.1, 0.05, 0.5])
    p_WT = X_WO @ np.array([[0.059, 0, 0], [0, 0.049, 0], [0, 0, 0.039]]).T
    config = dp.EstimatorConfig(bias_std=0.003, gravity=9.81)
    estimator = Driven(
        dp.PoseEstimator(config, period=0.01, object_solid=SOLID, tip_radii=np.full(3, 0.009)),
        point_cloud=cloud(seen_at(X_WO)),
        p_WT=p_WT.T.ravel(),
        touching=np.ones(3),
        V_WO_held=SpatialVelocity.Zero(),
    )
    for tick in range(40):  # A picture at every fifth tick.
        estimator.at(0.01 * tick, measurement_time=[0.05 * (tick // 5)])
        estimator.update()
        error = estimator.eval("X_WO_estimated").translation() - X_WO.translation()
        assert np.linalg.norm(error) < 1e-3


def test_fingertips_feed_through_only_where_they_count():
    """Those that the filter ignores would otherwise close loops with a user's hand."""
    fed = {}
    for touch, bias_std in ((False, 0.005), (True, 0.005), (True, 0.0)):
        config = dp.EstimatorConfig(touch=touch, bias_std=bias_std)
        radii = np.full(3, 0.009)
        system = dp.PoseEstimator(config, period=0.05, object_solid=SOLID, tip_radii=radii)
        touching = system.GetInputPort("touching").get_index()
        fed[touch, bias_std] = {
            port.get_name()
            for port in map(system.get_output_port, range(system.num_output_ports()))
            if system.HasDirectFeedthrough(touching, port.get_index())
        }
    assert not fed[False, 0.005]
    assert fed[True, 0.0] == {
        "X_WO_estimated", "V_WO_estimated", "p_WO_covariance", "tracking_status"
    }  # fmt: skip
    assert fed[True, 0.005] == fed[True, 0.0] | {"camera_offset"}


def test_an_object_that_is_no_solid_is_refused_at_once():
    with pytest.raises(dp.InvalidArgumentError, match="must be a MeshSolid, not a Trimesh"):
        dp.PoseEstimator(period=0.05, object_solid=BOX)


def test_points_need_the_object():
    estimator = Driven(dp.PoseEstimator(period=0.05), point_cloud=cloud(seen_at(RigidTransform())))
    with pytest.raises(dp.InvalidArgumentError, match="object_solid"):
        estimator.eval("X_WO_estimated")
