"""Inverse kinematics of a whole hand: goals are reached, limits are kept, links stay clear."""

import numpy as np
import pytest
from conftest import slow
from driven import Driven
from made_systems import (
    CONTROL_PERIOD,
    CUBE,
    FORCES,
    HAND,
    NQ,
    N,
    Q,
    grasp_command,
    hand_goals,
    joint_torques,
    make_kinematics,
)
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

from drake_pregrasp import BoxSolid, HalfSpace, InvalidArgumentError, Obstacles, mesh_surface
from drake_pregrasp.geometry.shapes import revolved_shape
from drake_pregrasp.grasping.clearances import LINK_CLEARANCE
from drake_pregrasp.grasping.grasp_state import BASE, NOT_BLOCKED, GiveUp, describe_give_up
from drake_pregrasp.grasping.joint_velocities import constrained_velocities
from drake_pregrasp.systems.differential_kinematics import GAIN
from drake_pregrasp.systems.hand_scene import link_balls

TABLE = HalfSpace(np.zeros(3), np.array([0.0, 0.0, 1.0]))
P_WO = np.array([0.0, 0.0, 0.05])
HOME = HAND.home(P_WO, 0.0)
TIPS = HAND.tips_at(HOME)
ACCELERATION = 5.0
AFAR = RigidTransform([0.0, 3.0, 0.05])
SINGLE = CONTROL_PERIOD * HAND.kinematics.acceleration_limit
ROUNDING = 1e-6


class Follower:
    """A hand that follows goals, with its reference, tick by tick."""

    def __init__(self, *, q=HOME, X_WO=AFAR, solid=CUBE, home=HAND.fingers_home, **goals):
        self.scene = HAND.make_scene(solid, [TABLE])
        system = make_kinematics(self.scene, initial=q, home=home)
        self.X_WO, self.velocity, self.holding = X_WO, SpatialVelocity.Zero(), np.zeros(N, bool)
        self.driven, self.q, self.v = Driven(system), np.array(q), np.zeros(NQ)
        self.goals = {"p_WT": TIPS, "p_WL": P_WO} | goals

    def tick(self, obstacles=None, **goals):
        """Makes a step, and returns the velocity and the finger that is blocked."""
        self.goals |= goals
        command = grasp_command(
            self.X_WO, V_WO=self.velocity, V_WG=self.velocity, fingers_hold=self.holding
        )
        self.driven.fix(goals=hand_goals(**self.goals), command=command)
        if obstacles is not None:
            self.driven.fix(obstacles=obstacles)
        self.driven.tick()  # Of the state one period later, with what was decided before.
        before = self.v
        self.q, self.v = self.driven.array("desired_state").reshape(2, NQ)
        assert np.all(np.abs(self.v) <= HAND.kinematics.rate_limit + ROUNDING)
        assert np.all(np.abs(self.v - before) <= SINGLE + ROUNDING)
        return self.v, self.driven.array("blocked_finger")[0]

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
    follower = Follower(p_WT=goals)
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
    follower = Follower(v_WT=np.tile(v_WG, (N, 1)), v_WL=v_WG)
    for k in range(1, 100):
        ahead = k * CONTROL_PERIOD * v_WG
        follower.tick(p_WT=TIPS + ahead, p_WL=P_WO + ahead - CONTROL_PERIOD * v_WG)
    np.testing.assert_allclose(HAND.tips_at(follower.q), TIPS + ahead, atol=1e-5)
    np.testing.assert_allclose(follower.q[:3] - HOME[:3], ahead, atol=1e-4)  # So does the palm.


def test_the_palm_goes_to_its_goal_as_far_as_the_fingertips_leave_it_free():
    follower = Follower(yaw=1.5)  # Fingers can make up for a part of it.
    for _ in range(50):
        follower.tick()
    np.testing.assert_allclose(HAND.tips_at(follower.q), TIPS, atol=1e-4)
    assert follower.q[3] > HOME[3] + 0.1
    for _ in range(200):
        follower.tick(yaw=0.0)
    np.testing.assert_allclose(follower.q, HOME, atol=1e-3)


def test_fingers_without_a_contact_reach_their_goals_without_moving_the_palm():
    away = np.where(np.arange(N) == 1, 1.0, 0.0)[:, None] * [0.0, 0.02, 0.03]
    v_WG = np.array([0.1, -0.05, 0.0])
    moving = {"v_WT": np.tile(v_WG, (N, 1)), "v_WL": v_WG}
    pulled = Follower(**moving)
    left = Follower(**moving, active=np.arange(N) != 1)
    for k in range(1, 150):
        ahead = k * CONTROL_PERIOD * v_WG
        goals = {"p_WT": TIPS + away + ahead, "p_WL": P_WO + ahead - CONTROL_PERIOD * v_WG}
        for follower in (pulled, left):
            follower.tick(**goals)
    palms = [follower.q[:3] - HOME[:3] - ahead for follower in (pulled, left)]
    assert np.linalg.norm(palms[0]) > 1e-3
    np.testing.assert_allclose(palms[1], 0, atol=1e-4)
    np.testing.assert_allclose(HAND.tips_at(left.q), TIPS + away + ahead, atol=1e-4)


def test_the_palm_keeps_its_range():
    base = ArmOfAxes()
    hand = Driven(make_kinematics(base=base, initial=HOME, yaw_range=(-0.2, 0.1)))
    for yaw, aim in ((0.05, 0.07), (0.09, 0.1), (-0.4, -0.2)):
        goals = hand_goals(TIPS, p_WL=P_WO, yaw=yaw, yaw_rate=0.02 * GAIN)
        hand.fix(goals=goals, command=grasp_command(AFAR))
        hand.tick()
        assert base.yaw == pytest.approx(aim)


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
        p_WT=TIPS if velocity else goals,
    )
    follower.velocity = V_WO
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
        p_WT=goals,
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
    others = HAND.tips_at(leaning)
    others[0] = [0.058 - depth, 0.0, 0.05]
    follower = Follower(
        X_WO=RigidTransform(P_WO),
        p_WT=others,
        p_WL=P_WO + np.array([-0.08, 0.0, 0.03]),
        home=leaning,
    )
    follower.holding = np.eye(N)[0] > 0
    for _ in range(150):
        follower.tick()
        gaps = follower.distances("object")
        assert gaps["finger_0_distal link"] - gaps["finger_0_distal tip"] > 0.0018
        assert gaps["finger_0_proximal link"] > LINK_CLEARANCE - 1e-3
    # The tip arrives, which is 1 mm in the object where it is estimated, or deeper.
    assert gaps["finger_0_distal tip"] == pytest.approx(-0.001 - depth, abs=2e-4)


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
    follower = Follower(p_WT=goals, p_WL=P_WO + np.array([0.3, 0.0, 0.0]))
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


def least_gaps(solid):
    """The constraints on a hand at home beside a solid, far from an object."""
    scene = HAND.make_scene(CUBE, [])
    context = scene.diagram.CreateDefaultContext()
    scene.place(context, HOME, AFAR, [solid])
    pose = HAND.kinematics.pose(HOME)
    return np.sort(scene.clearances(context, pose, grasp_command(AFAR), 5.0).least)


@pytest.mark.parametrize("far", [0.0, 40.0, -1e4])
def test_it_makes_no_difference_how_a_large_solid_is_described(far):
    """Which point of a plane is given, or how long a box is, and where its centre."""
    low = np.min(TIPS[:, 2]) - 0.012
    expected = least_gaps(HalfSpace(np.array([0.0, 0.0, low]), np.array([0.0, 0.0, 1.0])))
    assert len(expected)
    plane = HalfSpace(np.array([far, far, low]), np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(least_gaps(plane), expected, atol=1e-9)
    length = 2 * abs(far) + 4
    box = BoxSolid(np.array([far, 0.0, low - 0.5]), np.eye(3), np.array([length, 4.0, 1.0]))
    np.testing.assert_allclose(least_gaps(box), expected, atol=1e-5)
    sheet = BoxSolid(np.array([far, 0.0, low]), np.eye(3), np.array([length, 4.0, 0.0]))
    np.testing.assert_allclose(least_gaps(sheet), expected, atol=1e-5)


def test_a_clock_that_is_set_back_does_not_move_the_reference():
    follower = Follower(p_WT=TIPS + np.array([0.06, -0.03, 0.04]))
    for _ in range(10):
        follower.tick()
    follower.driven.at(follower.driven.context.get_time() - 0.1)
    q, v = follower.driven.array("desired_state").reshape(2, NQ)
    # As at the last tick, one period before.
    np.testing.assert_allclose(q, follower.q - CONTROL_PERIOD * follower.v, atol=1e-9)
    assert np.max(np.abs(v)) > 0.01


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
        v = constrained_velocities(H, v_free, A, b)
        program = MathematicalProgram()
        dv = program.NewContinuousVariables(NQ)
        program.AddQuadraticCost(2 * H, np.zeros(NQ), dv, is_convex=True)
        program.AddLinearConstraint(A, b - A @ v_free, np.full(len(b), np.inf), dv)
        result = Solve(program)
        assert result.is_success()
        np.testing.assert_allclose(v, v_free + result.GetSolution(dv), atol=2e-4)
        assert np.min(A @ v - b) > -1e-8
        if distance == 0:
            np.testing.assert_array_equal(v, v_free)


def test_constraints_that_contradict_each_other_have_no_velocity():
    along = np.eye(3)[0]
    A, free = np.array([along, -along]), np.zeros(3)
    np.testing.assert_allclose(
        constrained_velocities(np.eye(3), free, A, np.array([1.0, -1.001])), along, atol=1e-9
    )
    assert constrained_velocities(np.eye(3), free, A, np.array([1.0, -0.999])) is None
    assert constrained_velocities(np.eye(3), free, A, np.array([np.nan, -2.0])) is None


def test_an_arms_palm_follows_its_goal_without_lag_beside_the_fingertips():
    """The carrier of the hand is used as an arm of four joints: the palm's frame has a goal."""
    base, v = ArmOfAxes(), np.array([0.05, -0.02, 0.0])
    follower = Driven(make_kinematics(HAND.make_scene(CUBE, []), base=base, initial=HOME))
    for k in range(200):
        moved = P_WO + k * CONTROL_PERIOD * v
        goals = hand_goals(TIPS - P_WO + moved + CONTROL_PERIOD * v, np.tile(v, (N, 1)), moved, v)
        follower.fix(goals=goals, command=grasp_command(AFAR))
        follower.tick()
    q = follower.array("desired_state")[:NQ]
    np.testing.assert_allclose(q[:3] - HOME[:3], moved - P_WO + CONTROL_PERIOD * v, atol=1e-4)
    np.testing.assert_allclose(HAND.tips_at(q), TIPS - P_WO + moved + CONTROL_PERIOD * v, atol=1e-4)


class ArmOfAxes:
    """The carrier's axes, whose palm has a goal pose."""

    palm_frame = "hand::palm"

    def __init__(self):
        plant = HAND.kinematics.plant
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, HOME)
        self.X_LP = RigidTransform(-P_WO) @ plant.GetFrameByName("palm").CalcPoseInWorld(context)

    def rest_posture(self, home, p_WL, yaw, pan):
        return HOME

    def palm_goal(self, p_WL, yaw, pan):
        self.yaw = yaw
        turn = RigidTransform(RotationMatrix.MakeZRotation(yaw), np.zeros(3))
        return RigidTransform(p_WL) @ turn @ self.X_LP


def resting_hand(**commanded):
    """A hand at Q, with goals there, after a tick."""
    p_WL = HAND.base.with_palm_over(Q, np.zeros(3), 0.0)[:3]  # With the carrier's height.
    goals = hand_goals(HAND.tips_at(Q), p_WL=Q[:3] - p_WL, yaw=Q[3])
    command = grasp_command(AFAR, **commanded)
    system = make_kinematics(initial=Q, home=np.append(np.zeros(4), Q[4:]))
    hand = Driven(system, goals=goals, command=command)
    hand.advance(CONTROL_PERIOD / 2)  # The first tick is over.
    return hand


@pytest.mark.parametrize("changes", [{"period": 0.0}, {"initial": Q[:3]}])
def test_a_period_and_positions_of_all_joints_are_needed(changes):
    with pytest.raises(InvalidArgumentError, match=r"period must be|the hand has 19 joints"):
        make_kinematics(**changes)


def test_the_reference_moves_steadily_between_ticks():
    follower = Follower(p_WT=TIPS + np.array([0.0, 0.02, 0.0]))
    follower.tick()
    hand, start = follower.driven, follower.driven.context.get_time()
    hand.advance(1e-9)  # The tick at this time is over.
    q, v = hand.array("desired_state").reshape(2, NQ)
    assert np.max(np.abs(v)) > 0.01
    for share in (0.2, 0.5, 0.99):
        hand.simulator.AdvanceTo(start + share * CONTROL_PERIOD)
        now = hand.array("desired_state")
        np.testing.assert_allclose(now[:NQ], q + share * CONTROL_PERIOD * v, atol=1e-8)
        np.testing.assert_array_equal(now[NQ:], v)


def test_fingers_press_by_the_stiffness_of_their_joints():
    hand = resting_hand(f_T_W=FORCES)
    torques = HAND.kinematics.stiffness * (hand.array("desired_state")[:NQ] - Q)
    np.testing.assert_allclose(torques, joint_torques(FORCES), atol=1e-6)


def test_a_finger_that_is_in_the_way_presses_with_no_more_than_its_limit():
    limits = np.array([[0.5, 0.1], [0.5, 1e6], [1e6, 1e6], [1e6, 0.2], [2.0, 1e6]])
    now = Q - joint_torques(3 * FORCES) / HAND.kinematics.stiffness
    inward = np.add(FORCES, [0.3, -0.2, 0.4])  # Not along the forces.
    inward[4] *= -1  # This finger pulls.
    nhat_W = -inward / np.linalg.norm(inward, axis=1, keepdims=True)
    hand = resting_hand(force_limits=limits, nhat_W=nhat_W)
    hand.fix(hand_state=np.append(now, np.zeros(NQ)))
    desired, _ = hand.array("desired_state").reshape(2, NQ)
    torques = HAND.kinematics.stiffness * (desired - now)
    forces = HAND.kinematics.tip_forces(HAND.kinematics.pose(Q).J_WT, torques)
    presses = -np.sum(3 * FORCES * nhat_W, axis=1, keepdims=True)
    across = 3 * FORCES + presses * nhat_W
    sizes = np.concatenate([presses, np.linalg.norm(across, axis=1, keepdims=True)], axis=1)
    assert presses[4] < -2.0
    assert np.all(np.any(sizes > limits, axis=0))
    most = np.minimum(limits, sizes)
    expected = across * (most / sizes)[:, 1:] - most[:, :1] * nhat_W
    np.testing.assert_allclose(forces, expected, atol=1e-5)
    hand.fix(hand_state=np.full(2 * NQ, np.nan))  # What is not known is not limited.
    np.testing.assert_allclose(hand.array("desired_state")[:NQ], Q, atol=1e-7)


def test_limits_of_force_leave_a_joint_at_its_stop_alone():
    """The stop bears what is left of its torque, so that no limit holds for it."""
    hand = resting_hand(force_limits=np.full((N, 2), 0.01), nhat_W=-FORCES)
    now, stuck = Q - 0.1, HAND.kinematics.own_joints(1)[1]
    now[stuck] = HAND.kinematics.upper[stuck]
    hand.fix(hand_state=np.append(now, np.zeros(NQ)))
    changed = np.abs(hand.array("desired_state")[:NQ] - Q) > 1e-6
    assert changed[HAND.kinematics.own_joints(2)].all()
    assert changed[HAND.kinematics.own_joints(1)].sum() == 2
    assert not changed[stuck]


def test_a_joint_at_its_limit_stays_there():
    system = make_kinematics(initial=Q)
    hand, upper = Driven(system), HAND.kinematics.upper
    fast = np.concatenate([[0.0], Q, 0.5 * np.eye(NQ)[5], np.zeros(NQ)])
    hand.context.SetDiscreteState(0, fast)
    hand.context.SetTime(10.0)
    q, v = hand.array("desired_state").reshape(2, NQ)
    assert q[5] == upper[5]
    assert v[5] == 0


def test_the_torques_that_accelerate_the_hand_are_commanded():
    aside = hand_goals(p_WT=TIPS + np.array([0.0, 0.02, 0.0]), p_WL=P_WO)
    lagging, fed = (
        Driven(
            make_kinematics(initial=HOME, feeds_inertia=feeds),
            goals=aside,
            command=grasp_command(AFAR),
        )
        for feeds in (False, True)
    )
    for hand in (lagging, fed):
        hand.advance(CONTROL_PERIOD / 2)  # The first tick is over.
    (q, v), (q_fed, v_fed) = (hand.array("desired_state").reshape(2, NQ) for hand in (lagging, fed))
    plant = HAND.kinematics.plant
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, HOME)
    torques = plant.CalcMassMatrix(context) @ v / CONTROL_PERIOD
    assert np.max(np.abs(torques)) > 0.01
    np.testing.assert_array_equal(v_fed, v)
    np.testing.assert_allclose(HAND.kinematics.stiffness * (q_fed - q), torques, atol=1e-6)


def test_what_a_finger_touches_stops_its_joints():
    inward = hand_goals(p_WT=TIPS - 0.1 * (TIPS - P_WO), p_WL=P_WO)
    pressing = FORCES * (np.arange(N) == 1)[:, None]
    desired = []
    for feeds in (False, True):
        hand = Driven(
            make_kinematics(initial=HOME, feeds_inertia=feeds),
            goals=inward,
            command=grasp_command(AFAR, f_T_W=pressing),
        )
        hand.advance(CONTROL_PERIOD / 2)
        desired.append(hand.array("desired_state").reshape(2, NQ))
    (q, change), (q_fed, _) = desired
    own = HAND.kinematics.own_joints(1)
    assert np.max(np.abs(change[own])) > 0.01
    change[own] = 0
    plant = HAND.kinematics.plant
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, HOME)
    torques = plant.CalcMassMatrix(context) @ change / CONTROL_PERIOD
    np.testing.assert_allclose(HAND.kinematics.stiffness * (q_fed - q), torques, atol=1e-6)
