"""Inverse kinematics of a whole hand: goals are reached, limits are kept, links stay clear."""

import numpy as np
import pytest
from conftest import slow
from driven import Driven
from made_systems import CONTROL_PERIOD, FRAMES, HAND, NQ, N, bus
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    GeometryInstance,
    ProximityProperties,
    Role,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.solvers import MathematicalProgram, Solve

from drake_pregrasp import BoxSolid, HalfSpace, Obstacles, mesh_surface
from drake_pregrasp.geometry.shapes import revolved_shape
from drake_pregrasp.grasping.grasp_state import BASE, NOT_BLOCKED, GiveUp, describe_give_up
from drake_pregrasp.systems.differential_kinematics import (
    DifferentialKinematics,
    constrained_velocity,
)
from drake_pregrasp.systems.hand_scene import LINK_CLEARANCE, link_balls

TABLE = HalfSpace(np.zeros(3), np.array([0.0, 0.0, 1.0]))
CUBE = BoxSolid(np.zeros(3), np.eye(3), np.full(3, 0.1))
P_WO = np.array([0.0, 0.0, 0.05])
HOME = HAND.home(P_WO, 0.0)
TIPS = HAND.tips_at(HOME)
ACCELERATION, GAIN = 5.0, 5.0
AFAR = RigidTransform([0.0, 3.0, 0.05])
SINGLE = CONTROL_PERIOD * HAND.kinematics.acceleration_limit
ROUNDING = 1e-6


class Follower:
    """The system with the reference that it drives, tick by tick."""

    def __init__(self, *, q=HOME, X_WO=AFAR, solid=CUBE, **inputs):
        masks = dict.fromkeys(FRAMES, np.array([0, 0, 0, 1, 1, 1]))
        self.scene = HAND.make_scene(solid, [TABLE])
        system = DifferentialKinematics(
            self.scene,
            masks=masks,
            posture_gain=GAIN,
            acceleration=ACCELERATION,
            period=CONTROL_PERIOD,
        )
        self.q, self.v, self.X_WO = np.array(q), np.zeros(NQ), X_WO
        fixed = {
            "nominal_posture": HOME,
            "desired_cartesian_poses": bus(TIPS),
            "v_WT": np.zeros(3 * N),
            "V_WG": SpatialVelocity.Zero(),
            "V_WO_estimated": SpatialVelocity.Zero(),
            "fingers_hold": np.zeros(N),
        }
        self.driven = Driven(system, **(fixed | inputs))

    def tick(self, **inputs):
        """Makes a step, and returns the velocity and the finger that blocking."""
        pose = {"X_WG": self.X_WO, "X_WO_estimated": self.X_WO}
        self.driven.fix(position=self.q, velocity=self.v, **(pose | inputs))
        v, (blocking,) = (
            self.driven.array("commanded_velocity"),
            self.driven.array("blocked_finger"),
        )
        assert np.all(np.abs(v) <= HAND.kinematics.rate_limit + ROUNDING)
        assert np.all(np.abs(v - self.v) <= SINGLE + ROUNDING)
        self.q, self.v = self.q + CONTROL_PERIOD * v, v
        return v, blocking

    def distances(self, other):
        """Signed distances between the hand's geometries and one other, by their names."""
        context = self.scene.diagram.CreateDefaultContext()
        self.scene.place(context, self.q, self.X_WO, ())
        graph = self.scene.diagram.scene_graph()
        query = graph.get_query_output_port().Eval(graph.GetMyContextFromRoot(context))
        inspector = query.inspector()
        (target,) = [
            g for g in inspector.GetAllGeometryIds(Role.kProximity) if inspector.GetName(g) == other
        ]
        plant = self.scene.hand.plant
        return {
            f"{plant.get_body(body).name()} {inspector.GetName(g).split('::')[-1]}": (
                query.ComputeSignedDistancePairClosestPoints(g, target).distance
            )
            for body in plant.GetBodyIndices(plant.GetModelInstanceByName("hand"))
            for g in plant.GetCollisionGeometriesForBody(plant.get_body(body))
        }


def test_fingertips_settle_at_goals_without_overshoot_and_within_their_acceleration():
    goals = TIPS + np.array([0.06, -0.03, 0.04])
    follower = Follower(desired_cartesian_poses=bus(goals))
    tips = [TIPS]
    for _ in range(60):
        follower.tick()
        tips.append(HAND.tips_at(follower.q))
    way = goals - TIPS
    along = np.einsum("tij,ij->ti", np.array(tips) - TIPS, way) / np.sum(way**2, axis=1)
    accelerations = np.diff(tips, n=2, axis=0) / CONTROL_PERIOD**2
    assert np.all(np.diff(along, axis=0) >= -5e-3)
    assert np.max(along) <= 1.005
    np.testing.assert_allclose(tips[-1], goals, atol=1e-5)
    assert np.max(np.linalg.norm(accelerations, axis=2)) <= ACCELERATION


def test_goals_that_move_are_followed_without_lag():
    v_WG = np.array([0.25, 0.1, 0.0])
    follower = Follower(v_WT=np.tile(v_WG, N))
    for k in range(1, 40):
        goals = TIPS + k * CONTROL_PERIOD * v_WG
        follower.tick(desired_cartesian_poses=bus(goals))
    np.testing.assert_allclose(HAND.tips_at(follower.q), goals, atol=1e-5)


def test_what_goals_leave_free_returns_to_the_posture():
    turned = HOME.copy()
    turned[3] += 1.5  # The wrist, which the fingers can make up for.
    follower = Follower(nominal_posture=turned)
    for _ in range(50):
        follower.tick()
    np.testing.assert_allclose(HAND.tips_at(follower.q), TIPS, atol=1e-4)
    assert follower.q[3] > HOME[3] + 0.1
    for _ in range(200):
        follower.tick(nominal_posture=HOME)
    np.testing.assert_allclose(follower.q, HOME, atol=1e-3)


@pytest.mark.parametrize("velocity", [slow(0.0), 0.06])
def test_links_and_fingertips_stay_clear_of_an_object_wherever_the_goals_are(velocity):
    """The goals are inside the object, which comes from the side."""
    start = np.array([-0.24 * (velocity > 0), 0.0, 0.05])
    step = CONTROL_PERIOD * np.array([velocity, 0.0, 0.0])
    V_WO = SpatialVelocity(np.zeros(3), [velocity, 0.0, 0.0])
    raised = HAND.home(P_WO + np.array([0.0, 0.0, 0.15]), 0.0)
    goals = P_WO + 0.3 * (TIPS - P_WO)
    follower = Follower(
        q=HOME if velocity else raised,
        X_WO=RigidTransform(start),
        desired_cartesian_poses=bus(goals if not velocity else TIPS),
        V_WO_estimated=V_WO,
    )
    least = np.inf
    for k in range(150):
        follower.X_WO = RigidTransform(start + k * step)
        follower.tick()
        gaps = follower.distances("object")
        least = min(least, *gaps.values())
        assert min(gap for name, gap in gaps.items() if "tip" not in name) > LINK_CLEARANCE - 2e-3
    assert 0.001 < least < 0.01


@pytest.mark.slow
def test_fingers_reach_into_a_hollow_and_links_stay_clear_of_its_true_surface():
    """All fingertips go into a bowl, which its convex hull would close."""
    bowl = revolved_shape([[0, 0], [0.11, 0], [0.11, 0.06], [0.1, 0.06], [0.1, 0.005], [0, 0.005]])
    goals = TIPS * [0.7, 0.7, 0.0] + [0.0, 0.0, 0.025]
    follower = Follower(
        q=HAND.home(P_WO + np.array([0.0, 0.0, 0.1]), 0.0),
        X_WO=RigidTransform(),
        solid=bowl.solid,
        desired_cartesian_poses=bus(goals),
    )
    surface, inspector = mesh_surface(bowl, spacing=0.01), follower.scene.diagram.scene_graph()
    for _ in range(150):
        follower.tick()
    np.testing.assert_allclose(HAND.tips_at(follower.q), goals, atol=1e-4)
    plant, inspector = follower.scene.hand.plant, inspector.model_inspector()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, follower.q)
    for finger in range(N):
        link = plant.GetBodyByName(f"finger_{finger}_distal")
        for geometry in plant.GetCollisionGeometriesForBody(link):
            if "tip" not in inspector.GetName(geometry):
                *p_BS, radius = link_balls(inspector, geometry).T
                p_WS = link.EvalPoseInWorld(context) @ np.array(p_BS)
                assert np.min(surface.distance(p_WS.T) - radius) > LINK_CLEARANCE - 1e-3


@pytest.mark.parametrize(
    "shape",
    [
        Sphere(0.013),
        Capsule(0.006, 0.09),
        Box(0.02, 0.027, 0.05),
        Cylinder(0.03, 0.016),
        Ellipsoid(0.01, 0.02, 0.03),
        Convex(
            points=np.array([[0, 0.02, 0, 0], [0, 0, 0.03, 0], [0, 0, 0, 0.04]]), label="corner"
        ),
    ],
    ids=lambda shape: type(shape).__name__,
)
def test_the_balls_of_a_link_are_in_it_and_as_near_to_points_as_it_is(shape):
    graph, X_WG = SceneGraph(), RigidTransform(RotationMatrix.MakeXRotation(0.4), [0.1, 0, 0.2])
    geometry = GeometryInstance(X_WG, shape, "link")
    geometry.set_proximity_properties(ProximityProperties())
    name = graph.RegisterAnchoredGeometry(graph.RegisterSource("test"), geometry)
    *p_WS, radius = link_balls(graph.model_inspector(), name).T
    query = graph.get_query_output_port().Eval(graph.CreateDefaultContext())
    drake_error = 2e-3 if isinstance(shape, Ellipsoid) else 1e-5
    points = X_WG.translation() + np.random.default_rng(0).uniform(-0.06, 0.06, (500, 3))
    for point in points:
        (exact,) = query.ComputeSignedDistanceToPoint(point)
        if exact.distance > LINK_CLEARANCE:
            away = np.linalg.norm(np.transpose(p_WS) - point, axis=1) - radius
            assert -drake_error < np.min(away) - exact.distance < 1e-3


@pytest.mark.parametrize("depth", [slow(0.0), 0.02])
def test_a_finger_that_holds_touches_with_its_tip_first_wherever_the_object_is(depth):
    """The palm goes over the object to the other side: the finger leans on the object's edge."""
    leaning = HOME.copy()
    leaning[[0, 2]] += [-0.08, 0.03]
    leaning[4:7] = [0.0, 0.44, 0.0]
    leaning[8::3] = 1.4  # The other fingers stretch out.
    follower = Follower(
        X_WO=RigidTransform(P_WO),
        desired_cartesian_poses=bus([[0.058 - depth, 0.0, 0.05]]),
        fingers_hold=np.eye(N)[0],
        nominal_posture=leaning,
    )
    for _ in range(150):
        follower.tick()
        gaps = follower.distances("object")
        assert gaps["finger_0_distal link"] - gaps["finger_0_distal tip"] > 0.0019
        assert gaps["finger_0_proximal link"] > LINK_CLEARANCE - 1e-3
    # The tip arrives, which is 1 mm in the object where it is estimated, or deeper.
    assert gaps["finger_0_distal tip"] == pytest.approx(-0.001 - depth, abs=1e-4)


def test_the_palm_gives_way_where_a_link_has_no_room():
    """A wall stands where the first finger leans out to; only the palm's posture is in the way."""
    follower = Follower()
    link = follower.scene.hand.plant.GetFrameByName("finger_0_distal")
    context = follower.scene.hand.plant.CreateDefaultContext()
    follower.scene.hand.plant.SetPositions(context, HOME)
    knee = link.CalcPoseInWorld(context).translation()
    x, y, height = (knee + TIPS[0]) / 2
    wall = BoxSolid(np.array([x + 0.05, y, height / 2]), np.eye(3), np.array([0.1, 0.4, height]))
    for _ in range(150):
        _, blocking = follower.tick(obstacles=Obstacles((wall,)))
        assert blocking == NOT_BLOCKED
    assert np.linalg.norm(follower.q[:4] - HOME[:4]) > 0.005
    np.testing.assert_allclose(HAND.tips_at(follower.q), TIPS, atol=1e-3)


def test_a_hand_without_a_way_stops_says_why_and_goes_on_without_a_jump():
    goals = TIPS + np.array([0.3, 0.0, 0.0])
    follower = Follower(desired_cartesian_poses=bus(goals))
    for _ in range(10):
        _, blocking = follower.tick()
        assert blocking == NOT_BLOCKED
    moving = np.max(np.abs(follower.v))
    x = follower.q[0]
    # Two walls, which leave less room than the palm is wide.
    narrow = Obstacles(
        tuple(
            HalfSpace(np.array([x + side * 0.02, 0.0, 0.0]), np.array([-side, 0.0, 0.0]))
            for side in (-1.0, 1.0)
        )
    )
    for _ in range(30):
        v, blocking = follower.tick(obstacles=narrow)
        assert blocking != NOT_BLOCKED
        assert describe_give_up(GiveUp.BLOCKED, blocking).startswith("no way is clear for the")
    assert moving > 0.05
    np.testing.assert_array_equal(v, 0.0)
    for _ in range(100):
        v, blocking = follower.tick(obstacles=Obstacles())
        assert blocking == NOT_BLOCKED
    np.testing.assert_allclose(HAND.tips_at(follower.q), goals, atol=1e-3)
    assert "base" in describe_give_up(GiveUp.BLOCKED, BASE)


@pytest.mark.parametrize("number", [1e20, np.nan])
def test_a_step_without_a_solution_stops_the_hand_and_says_so(number):
    follower = Follower()
    for _ in range(3):
        v, blocking = follower.tick(nominal_posture=np.where(np.arange(NQ) == 3, number, HOME))
        assert blocking == BASE
        np.testing.assert_array_equal(v, 0.0)
    _, blocking = follower.tick(nominal_posture=HOME)
    assert blocking == NOT_BLOCKED


@pytest.mark.parametrize("distance", [0.0, 0.05, 0.3, 1.0])
def test_the_constrained_velocity_is_the_optimum_and_the_free_one_where_it_is_allowed(distance):
    """The system takes the velocity without constraints where it keeps all of them."""
    rng = np.random.default_rng(5)
    for case in range(40):
        J, rows = rng.normal(size=(15, NQ)), rng.normal(size=(1 + case % 12, NQ))
        H, v_free = 100 * J.T @ J + 0.5 * np.eye(NQ), rng.normal(size=NQ)
        if case % 4 == 0:
            rows[-1] = rows[0]  # Constraints that depend on each other.
        A = np.concatenate([np.eye(NQ), -np.eye(NQ), rows])
        kept = v_free + distance * rng.normal(size=NQ)  # Keeps all constraints.
        b = A @ kept - rng.uniform(0.0, 0.3, size=len(A))
        b[-1] = b[-len(rows)] if case % 4 == 0 else b[-1]
        v = constrained_velocity(H, v_free, A, b)
        program = MathematicalProgram()
        dv = program.NewContinuousVariables(NQ)
        program.AddQuadraticCost(2 * H, np.zeros(NQ), dv, is_convex=True)
        program.AddLinearConstraint(A, b - A @ v_free, np.full(len(b), np.inf), dv)
        result = Solve(program)
        assert result.is_success()
        np.testing.assert_allclose(v, v_free + result.GetSolution(dv), atol=2e-4)
        if distance == 0:
            np.testing.assert_array_equal(v, v_free)
