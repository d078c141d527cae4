"""Goals of fingertips around a cube, and of the palm over it."""

import numpy as np
import pytest
from driven import Driven
from made_systems import AROUND, RADIUS, N, bus, grasp_command, make_shaper
from made_systems import CONTROL_PERIOD as PERIOD
from made_systems import RING as UNIT_RING
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity

from drake_pregrasp import BallSolid, HalfSpace, Obstacles, Pair
from drake_pregrasp.contacts.assignment import palm_turn, wrapped
from drake_pregrasp.contacts.selection_input import ContactStatus

RING = 0.079 * UNIT_RING
TABLE = HalfSpace(np.array([0, 0, -0.05]), np.array([0, 0, 1.0]))
X, Y = np.eye(3)[:2]
POINTS = np.array(
    [[0.05, -0.01, 0], [0.02, 0.05, 0], [-0.03, 0.05, 0.02], [-0.05, -0.02, 0], [0, -0.05, 0.01]]
)
NORMALS = np.array([X, Y, Y, -X, -Y])
HELD = {"holds_contacts": True, "fingers_hold": np.ones(N, dtype=bool)}
OUT = 0.029 * NORMALS  # From a contact to the centre of a tip that stands off.


class Shaper(Driven):
    """A shaper around a cube on a table, whose goals stand off contacts on the cube."""

    def __init__(self, p_OC=POINTS, normals=NORMALS, **more):
        super().__init__(
            make_shaper(fixed=[TABLE], **more),
            fingertip_targets=bus(p_OC, normals),
            contact_status=np.full(N, float(ContactStatus.ACTIVE)),
        )
        self.commanded = {}
        self.command()

    def command(self, **changes):
        """Changes what the phase commands."""
        self.commanded |= changes
        self.fix(command=grasp_command(**self.commanded))

    def goals(self, seconds):
        self.advance(seconds)
        return self.eval("goals").p_WT

    @property
    def contacts(self):
        """Points and normals of the contacts that tips are for."""
        return self.array("contacts")[: 6 * N].reshape(2, N, 3)

    def set_status(self, status, *fingers):
        self.fix(contact_status=np.where(np.isin(np.arange(N), fingers), float(status), 1.0))


def with_first(value, values):
    return np.vstack([[value], values[1:]])


def test_goals_come_to_stand_off_their_contacts():
    np.testing.assert_allclose(Shaper(standoff=0.02).goals(1.0), POINTS + OUT, atol=1e-9)


JAWS = Pair(1, 4)


@pytest.mark.parametrize("turn", [0.0, np.pi / 2])
def test_jaws_go_to_their_contacts_along_the_line_between_them(turn):
    X_LA = RigidTransform(RotationMatrix.MakeYRotation(turn))
    normals = NORMALS + 0.3 * np.array([-X, X, X, X, -X]) + [0.0, 0.0, 0.2]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    shaper = Shaper(normals=normals, palm={"jaws": [JAWS], "X_LA": X_LA}, standoff=0.02)
    goals, (_, directions) = shaper.goals(1.0), shaper.contacts
    others = [0, 2, 3]
    np.testing.assert_allclose(directions[others], normals[others], atol=1e-12)
    line = JAWS.line(normals[1], normals[4], X_LA.rotation().matrix()[:, 2])
    np.testing.assert_allclose(directions[[1, 4]], [-line, line], atol=1e-12)
    if turn == 0:
        np.testing.assert_allclose(goals, POINTS + 0.029 * directions, atol=1e-9)


def test_goals_are_carried_ahead_with_the_frame():
    shaper = Shaper(lead=0.03)
    still = shaper.goals(1.0)
    R_WG = RotationMatrix.MakeZRotation(0.3)
    X_WG = RigidTransform(R_WG, [0.1, 0.2, 0.3])
    shaper.command(X_WG=X_WG, V_WG=SpatialVelocity(w=[0, 0, 0.5], v=[0.05, 0, 0]))
    ahead = RotationMatrix.MakeZRotation(0.3 + 0.015).matrix()
    expected = still @ ahead.T + [0.1 + 0.0015, 0.2, 0.3]
    np.testing.assert_allclose(shaper.goals(0.0), expected, atol=1e-12)


def test_the_velocities_of_goals_are_those_with_which_they_move():
    shaper, v_WG = Shaper(), np.array([0.05, -0.02, 0.01])
    shaper.goals(1.0 + PERIOD / 2)  # Between ticks.
    shaper.fix(fingertip_targets=bus(POINTS + 0.02 * X[::-1], NORMALS))
    shaper.command(V_WG=SpatialVelocity(w=np.zeros(3), v=v_WG))
    before, moved = None, []
    for k in range(12):
        shaper.command(X_WG=RigidTransform(k * PERIOD * v_WG))
        after = shaper.goals(PERIOD if k else 0.0)
        if k > 1:
            rates = (after - before) / PERIOD
            np.testing.assert_allclose(shaper.eval("goals").v_WT, rates, atol=1e-9)
            moved.append(np.max(np.abs(rates - v_WG)))
        before = after
    assert max(moved) > 0.05


def test_held_contacts_stay_when_goals_move_on():
    shaper = Shaper()
    before = shaper.goals(1.0)
    moved = with_first([0.05, 0.04, 0.03], POINTS)
    shaper.fix(fingertip_targets=bus(moved, NORMALS))
    shaper.command(**HELD)
    shaper.set_status(ContactStatus.OBSTRUCTED, 4)
    np.testing.assert_allclose(shaper.goals(0.5), before, atol=1e-9)
    shaper.command(standoffs=np.array([-0.001, 0.02, 0.02, 0.02, 0.02]))
    pressed = shaper.goals(0.5)
    np.testing.assert_allclose(pressed[0] - before[0], [-0.021, 0, 0], atol=1e-9)


def test_fingers_without_a_contact_wait_above():
    shaper = Shaper(POINTS[:4], NORMALS[:4])
    shaper.set_status(ContactStatus.LOST, 4)
    goals = shaper.goals(2.0)
    assert goals[4, 2] >= 0.05 + RADIUS + 0.02 - 1e-9
    np.testing.assert_allclose(goals[:4], (POINTS + OUT)[:4], atol=1e-9)


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0])
def test_fingers_without_a_contact_wait_at_their_own_azimuths_in_the_hand(yaw):
    shaper = Shaper(p_GT=RING + np.array([0.0, 0.0, 0.1]))
    shaper.set_status(ContactStatus.OUT_OF_REACH, *range(N))
    R_WG = RotationMatrix.MakeZRotation(yaw)
    shaper.command(X_WG=RigidTransform(R_WG, [0.2, 0.1, 0.3]))
    away = shaper.goals(3.0) - [0.2, 0.1, 0.3]
    turned = shaper.eval("goals").yaw  # Goals above the object do not change it.
    azimuths = np.arctan2(away[:, 1], away[:, 0])
    np.testing.assert_allclose(wrapped(azimuths - AROUND - turned), 0, atol=1e-6)
    radii = np.linalg.norm(RING[:, :2], axis=1)
    np.testing.assert_allclose(np.linalg.norm(away[:, :2], axis=1), radii.mean(), atol=1e-6)
    np.testing.assert_allclose(away[:, 2], 0.05 + RADIUS + 0.02, atol=1e-9)


def test_a_tip_on_the_axis_has_a_way_out():
    shaper = Driven(make_shaper(p_GT=np.array([*RING[:2], [0.0, 0.0, 0.2], *RING[3:]])))
    frames = shaper.array("contacts")[: 6 * N].reshape(2, N, 3)
    np.testing.assert_allclose(frames[1, 2], UNIT_RING[2], atol=1e-12)


def test_a_contact_without_room_is_shifted_along_the_surface_only():
    point, normal = np.array([0.05, -0.01, -0.04]), np.array([0.8, 0.0, -0.6])
    shaper = Shaper(with_first(point, POINTS), with_first(normal, NORMALS))
    shaper.advance(1.0)
    contacts, normals = shaper.contacts
    shift = contacts[0] - point
    assert np.linalg.norm(shift) > 1e-3
    assert shift @ normal == pytest.approx(0, abs=1e-9)
    np.testing.assert_allclose(normals[0], normal, atol=1e-9)


def test_a_contact_too_low_for_a_tip_is_shifted_up():
    shaper = Shaper(with_first([0.05, -0.01, -0.049], POINTS))
    goals = shaper.goals(1.0)
    assert goals[0, 2] == pytest.approx(-0.05 + RADIUS + 0.004)
    np.testing.assert_allclose(shaper.contacts[0, 0], [0.05, -0.01, goals[0, 2]], atol=1e-9)
    shaper.command(**HELD)
    np.testing.assert_allclose(shaper.goals(0.5), goals, atol=1e-9)


def test_obstacles_push_goals_away_but_not_held_contacts():
    shaper = Shaper()
    before = shaper.goals(1.0)
    ball = BallSolid(before[0] + [0.0, 0.03, 0.0], 0.02)
    shaper.fix(obstacles=Obstacles((ball,)))
    pushed = shaper.goals(0.5)
    assert ball.distance(pushed)[0] >= RADIUS + 0.004 - 1e-6
    contacts, normals = shaper.contacts
    nearer = BallSolid(before[0] + [0.0, 0.01, 0.0], 0.02)
    shaper.fix(obstacles=Obstacles((nearer,)))
    shaper.command(**HELD)
    np.testing.assert_allclose(shaper.goals(0.5), contacts + 0.029 * normals, atol=1e-9)
    np.testing.assert_array_equal(shaper.contacts, [contacts, normals])


@pytest.mark.parametrize("let_go", [0, 3])
def test_fingers_that_have_let_go_avoid_obstacles_again(let_go):
    shaper = Shaper()
    before = shaper.goals(1.0)
    balls = tuple(BallSolid(p + np.array([0.0, 0.0, 0.02]), 0.015) for p in before)
    holds = np.arange(N) != let_go
    shaper.fix(obstacles=Obstacles(balls))
    shaper.command(holds_contacts=True, fingers_hold=holds)
    goals = shaper.goals(0.5)
    assert balls[let_go].distance(goals)[let_go] >= RADIUS + 0.004 - 1e-6
    np.testing.assert_allclose(goals[holds], before[holds], atol=1e-12)


LIMITED = (-0.5, 0.3)


def test_a_palm_of_limited_range_goes_to_its_goals_whoever_is_withdrawn():
    turn = RotationMatrix.MakeZRotation(0.25).matrix().T
    shaper = Shaper(0.6 * RING @ turn, UNIT_RING @ turn, palm={"yaw_range": LIMITED})
    shaper.set_status(ContactStatus.LOST, 3, 4)
    goals, yaw = shaper.goals(4.0), shaper.eval("goals").yaw
    assert yaw == pytest.approx(palm_turn(goals[:3], AROUND[:3], 0.0), abs=1e-3)
    aside = np.arctan2(goals[3:, 1], goals[3:, 0]) - AROUND[3:] - yaw
    np.testing.assert_allclose(wrapped(aside), 0, atol=1e-3)


def turning_shaper(yaw_range, rate, seconds, **palm):
    """A shaper whose object has turned at a rate, in rad/s, and the yaws of its palm."""
    shaper, yaws = Shaper(0.6 * RING, UNIT_RING, palm={"yaw_range": yaw_range, **palm}), []
    shaper.goals(1.0)
    for k in range(int(seconds / PERIOD)):
        X_WO = RigidTransform(RotationMatrix.MakeZRotation(rate * k * PERIOD), [0.1, 0.2, 0.3])
        shaper.command(X_WO=X_WO, V_WG=SpatialVelocity(w=[0, 0, rate], v=[0, 0, 0]))
        goals_W = (X_WO @ (0.6 * RING).T).T
        shaper.fix(fingertip_targets=bus(goals_W, UNIT_RING @ X_WO.rotation().matrix().T))
        yaws.append(shaper.eval("goals").yaw)
        shaper.simulator.AdvanceTo((round(1.0 / PERIOD) + k + 1) * PERIOD)
    return shaper, X_WO, np.array(yaws)


@pytest.mark.parametrize(("yaw", "yaw_slack"), [(0.0, 0.0), (0.2, 0.2), (-0.2, 0.3)])
def test_a_palm_turns_with_the_object_on_and_on(yaw, yaw_slack):
    palm = {"yaw": yaw, "yaw_slack": yaw_slack}
    _, _, yaws = turning_shaper((-np.inf, np.inf), rate=4.0, seconds=2.0, **palm)
    assert yaws[0] == pytest.approx(yaw, abs=4.0 * PERIOD)
    np.testing.assert_allclose(np.diff(yaws), 4.0 * PERIOD, atol=1e-6)


def test_a_palm_of_limited_range_stays_in_it_and_comes_back_the_other_way_round():
    _, _, yaws = turning_shaper(LIMITED, rate=2.0, seconds=np.pi - PERIOD / 2)
    assert (yaws.min(), yaws.max()) == LIMITED
    assert yaws[-1] == pytest.approx(2.0 * PERIOD * (len(yaws) - 1) - 2 * np.pi, abs=1e-6)


@pytest.mark.parametrize(("yaw_range", "middle"), [(LIMITED, -0.1), ((-np.inf, np.inf), None)])
def test_the_frames_of_reach_and_palm_are_over_the_centre_of_mass(yaw_range, middle):
    p_OCoM = np.array([0.05, -0.02, 0.01])
    shaper, X_WO, yaws = turning_shaper(yaw_range, rate=0.5, seconds=1.0, p_OCoM=p_OCoM)
    goals = shaper.eval("goals")
    for name, yaw in (("X_WU", yaws[-1]), ("X_WH", yaws[-1] if middle is None else middle)):
        expected = RigidTransform(RotationMatrix.MakeZRotation(yaw), X_WO @ p_OCoM)
        assert shaper.eval(name).IsNearlyEqualTo(expected, 1e-9)
    np.testing.assert_allclose(goals.p_WL, X_WO @ p_OCoM, atol=1e-12)
    lever = X_WO.rotation() @ p_OCoM
    np.testing.assert_allclose(goals.v_WL, np.cross([0.0, 0.0, 0.5], lever), atol=1e-12)
    assert goals.yaw_rate == pytest.approx(0.5)


@pytest.mark.parametrize("R_WO", [np.eye(3), None])
def test_an_approach_from_the_side_turns_with_the_object_about_the_vertical(R_WO):
    X_LA = RigidTransform(RotationMatrix.MakeYRotation(np.pi / 2), [0.0, 0.0, 0.02])
    palm = {"X_LA": X_LA, "R_WO": R_WO, "jaws": [JAWS]}
    shaper, X_WO, _ = turning_shaper((-np.inf, np.inf), 1.2, 4.0, **palm)
    goals, turned = shaper.eval("goals"), 0.0
    if R_WO is not None:
        assert (goals.pan, goals.pan_rate) == pytest.approx((1.2 * (4.0 - PERIOD), 1.2))
        turned = goals.pan  # More than half a turn.
        assert goals.yaw == pytest.approx(0.0, abs=1e-6)
    X_LU = RigidTransform(RotationMatrix.MakeZRotation(turned), np.zeros(3)) @ X_LA
    X_WU = RigidTransform(X_WO.translation()) @ X_LU
    for port in ("X_WU", "X_WH"):
        z = shaper.eval(port).rotation().col(2)
        np.testing.assert_allclose(z, X_WU.rotation().col(2), atol=1e-9)
        assert shaper.eval(port).translation() == pytest.approx(X_WU.translation(), abs=1e-9)
    line_W = X_WO.rotation() @ shaper.contacts[1][JAWS.first]
    # Directions are some ticks old in W, but not in O, with which the approach turns.
    late = 1e-6 if R_WO is not None else 3 * 1.2 * PERIOD
    assert line_W @ X_WU.rotation().col(2) == pytest.approx(0.0, abs=late)


def test_a_palm_from_the_side_turns_about_its_own_axis():
    """From the side, z of the approach is x of the world; the tips lie in the plane y-z."""
    level = RotationMatrix.MakeYRotation(np.pi / 2)
    shaper = Shaper(p_GT=0.1 * UNIT_RING @ level.matrix().T, palm={"X_LA": RigidTransform(level)})
    shaper.command(V_WG=SpatialVelocity(w=[0.3, 0.0, 0.7], v=[0.0, 0.0, 0.0]))
    goals = shaper.eval("goals")
    assert goals.yaw == pytest.approx(0.0, abs=1e-9)
    assert goals.yaw_rate == pytest.approx(0.3)
    assert shaper.eval("X_WU").IsNearlyEqualTo(RigidTransform(level), 1e-9)
