"""Obstacles, hands and words about contacts, through the ports of their systems."""

import dataclasses
import struct

import numpy as np
import pytest
import trimesh
from made_systems import X_WO, make_selector, partition
from pydrake.common.value import AbstractValue
from pydrake.geometry import Meshcat, MeshcatParams, Rgba
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.systems.analysis import Simulator

from drake_pregrasp import BallReach, ContactStatus, ForbiddenPoints, InvalidArgumentError
from drake_pregrasp.contacts.selection_input import describe_status
from drake_pregrasp.errors import ContactError
from drake_pregrasp.geometry.solids import BallSolid, BoxSolid, HalfSpace
from drake_pregrasp.regions.constraints import NO_CAUSE, Limit, Obstacles
from drake_pregrasp.regions.safe_regions import NO_REGION
from drake_pregrasp.regions.walls import WALL_TESTS
from drake_pregrasp.systems import centroid_selector, obstacle_visualizer, status_labels
from drake_pregrasp.systems.drawing import text_board
from drake_pregrasp.systems.obstacle_visualizer import ObstacleVisualizer
from drake_pregrasp.systems.sources import HandPose, MovingObstacles, MovingSolid
from drake_pregrasp.systems.status_labels import StatusLabels

TILT = RollPitchYaw(0.1, 0.2, 0.3).ToRotationMatrix().matrix()
SOLIDS = (
    BallSolid(np.array([0.1, 0.2, 0.3]), 0.02),
    BoxSolid(np.array([0.0, 0.1, 0.0]), TILT, np.array([0.1, 0.2, 0.3])),
    HalfSpace(np.array([0.0, 0.0, -0.2]), np.array([0.0, 0.0, 1.0])),
)
VELOCITIES = ([0.1, 0.0, 0.0], [0.0, -0.2, 0.05], [0.0, 0.0, 0.03])
MOVING = [MovingSolid(s, np.array(v)) for s, v in zip(SOLIDS, VELOCITIES, strict=True)]


@pytest.fixture(scope="module")
def meshcat():
    return Meshcat(MeshcatParams(host="localhost"))


# Sources.


@pytest.mark.parametrize("time", [0.0, 0.5, 7.0])
def test_obstacles_move_steadily_without_turning(time):
    system = MovingObstacles(MOVING)
    context = system.CreateDefaultContext()
    system.get_output_port().Eval(context)
    context.SetTime(time)
    obstacles = system.get_output_port().Eval(context)
    probes = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 3))
    for solid, start, velocity in zip(obstacles.solids, SOLIDS, VELOCITIES, strict=True):
        expected = start.distance(probes - time * np.array(velocity))
        np.testing.assert_allclose(solid.distance(probes), expected, atol=1e-12)
    assert len(obstacles.points) == 0


@pytest.mark.parametrize("V_WO", [None, SpatialVelocity(w=[0, 0, 0.5], v=[0.02, -0.01, 0.0])])
def test_over_a_horizon_regions_keep_clear_of_where_obstacles_will_be(surface, p_OC, V_WO):
    velocity, horizon, radius = np.array([-0.06, 0.01, 0.0]), 0.9, 0.009
    wall = HalfSpace(np.array([0.12, 0.0, 0.0]), np.array([-1.0, 0.1, 0.0]))
    obstacles = Obstacles((wall,), velocities=velocity[None])
    # Tilted, so that the order of the rotations matters.
    X = RigidTransform(RollPitchYaw(0.5, -0.4, 0.3), [0.01, 0.0, 0.0])
    tips = {"tip_radii": [radius] * 5}
    inputs = {"obstacles": obstacles}
    later = inputs if V_WO is None else inputs | {"V_WO_estimated": V_WO}
    labels = partition(surface, p_OC, later, X=X, horizon=horizon, **tips).labels
    without = partition(surface, p_OC, inputs, X=X, **tips).labels
    touched = np.zeros(len(labels), dtype=bool)
    for moment in np.linspace(0.0, horizon, 4):
        X_then = X
        if V_WO is not None:
            turned = RotationMatrix.MakeZRotation(0.5 * moment) @ X.rotation()
            X_then = RigidTransform(turned, X.translation() + moment * V_WO.translational())
        tips = X_then @ (surface.p_OQ + radius * surface.nhat_OQ).T
        there = wall.moved(np.eye(3), moment * velocity)
        touched |= there.distance(tips.T) < radius
    kept = without != NO_REGION
    assert 0 < np.sum(touched & kept) < np.sum(kept)
    np.testing.assert_array_equal(labels[kept], np.where(touched, NO_REGION, without)[kept])


def test_obstacles_tell_where_they_will_be():
    system = MovingObstacles(MOVING, lookahead=0.1)
    now, then = system.CreateDefaultContext(), system.CreateDefaultContext()
    then.SetTime(0.8)
    probes = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 3))
    R, p = X_WO.rotation().matrix(), X_WO.translation()
    expected = system.get_output_port().Eval(then)
    for later, solid in (
        (system.get_output_port().Eval(now).after(0.8), expected),
        (system.get_output_port().Eval(now).moved(R, p).after(0.8), expected.moved(R, p)),
    ):
        for one, other in zip(later.solids, solid.solids, strict=True):
            np.testing.assert_allclose(one.distance(probes), other.distance(probes), atol=1e-12)


def hand_at(X_WH, follow, X_WO_estimated):
    system = HandPose(X_WH, follow=follow)
    context = system.CreateDefaultContext()
    system.get_input_port().FixValue(context, RigidTransform())
    system.get_output_port().Eval(context)
    system.get_input_port().FixValue(context, X_WO_estimated)
    return system.get_output_port().Eval(context)


def test_a_hand_that_follows_keeps_its_place_by_the_object_and_its_orientation():
    X = RigidTransform(RollPitchYaw(0.3, 0.1, -2.0), [0.1, 0.0, 0.2])
    X_WH = hand_at(X, True, X_WO)
    np.testing.assert_allclose(X_WH.translation(), X_WO.translation() + X.translation())
    np.testing.assert_array_equal(X_WH.rotation().matrix(), X.rotation().matrix())


def test_a_hand_that_stays_stays():
    X = RigidTransform(RollPitchYaw(0.3, 0.1, -2.0), [0.1, 0.0, 0.2])
    assert hand_at(X, False, X_WO).IsExactlyEqualTo(X)


# The partitioner.


def ball_reach(center, radius):
    return BallReach(center=list(center), radius=radius)


def differ(a, b):
    """The share of candidates that differ; rounding may decide ties."""
    return np.mean(a.labels != b.labels)


def test_reach_moves_with_the_hand(surface, p_OC):
    reach = [None, None, None, ball_reach([0.02, 0.0, 0.0], 0.05), None]
    X_OH = RigidTransform(RollPitchYaw(0.4, 0.1, 0.5), p_OC[3] - [0.02, 0.01, 0])
    free = partition(surface, p_OC)
    here = partition(surface, p_OC, {"X_WH": X_OH}, X=RigidTransform(), reach=reach)
    there = partition(surface, p_OC, {"X_WH": X_WO @ X_OH}, reach=reach)
    assert differ(here, there) < 0.01
    p_OR = X_OH @ np.array([0.02, 0.0, 0.0])
    inside = np.linalg.norm(surface.p_OQ - p_OR, axis=1) <= 0.05
    expected = np.where((free.labels == 3) & ~inside, NO_REGION, free.labels)
    assert 0 < there.sizes()[3] < free.sizes()[3]
    assert np.mean(there.labels != expected) < 0.01
    away = partition(surface, p_OC, {"X_WH": RigidTransform([9.0, 0, 0])}, reach=reach)
    assert (away.sizes()[3], away.limits[3]) == (0, Limit.REACH)


def test_without_a_hand_reach_is_in_the_world(surface, p_OC):
    reach = [ball_reach(X_WO @ p_OC[0], 0.03)] + [None] * 4
    in_world = partition(surface, p_OC, reach=reach)
    assert in_world.sizes()[0] > 0
    as_hand = partition(surface, p_OC, {"X_WH": RigidTransform()}, reach=reach)
    np.testing.assert_array_equal(in_world.labels, as_hand.labels)


def test_obstacles_in_the_world_are_those_in_the_object(surface, p_OC):
    solids = (
        BallSolid(np.array([0.07, 0.0, 0.0]), 0.012),
        BoxSolid(np.array([0.0, 0.08, 0.02]), SOLIDS[1].R_FB, np.array([0.05, 0.03, 0.02])),
    )
    in_O = Obstacles(solids, ForbiddenPoints(np.array([[-0.06, 0, 0]]), np.array([0.005])))
    in_W = in_O.moved(X_WO.rotation().matrix(), X_WO.translation())
    tips = {"tip_radii": [0.004] * 5, "clearance": 0.003}
    here = partition(surface, p_OC, {"obstacles": in_O}, X=RigidTransform(), **tips)
    there = partition(surface, p_OC, {"obstacles": in_W}, **tips)
    assert differ(here, there) < 0.01
    np.testing.assert_array_equal(here.limits, there.limits)
    assert differ(here, partition(surface, p_OC, **tips)) > 0.03


@pytest.mark.parametrize("arguments", [{"clearance": 0.02}, {"tip_radii": [0.02] * 5}])
def test_clearance_and_fingertips_set_regions_back_from_obstacles(surface, p_OC, arguments):
    up = X_WO.rotation().matrix()[:, 2]
    obstacles = Obstacles((HalfSpace(X_WO @ np.array([0.0, 0.0, -0.03]), up),))
    before = partition(surface, p_OC, {"obstacles": obstacles})
    after = partition(surface, p_OC, {"obstacles": obstacles}, **arguments)
    lowest = [np.min(surface.p_OQ[r.labels != NO_REGION, 2]) for r in (before, after)]
    assert lowest[1] >= -0.03 + 0.02 - 1e-9 > lowest[0]


@pytest.mark.parametrize("wall_test", WALL_TESTS)
def test_regions_with_a_wall_test_turn_with_the_world(surface, p_OC, wall_test):
    here = partition(surface, p_OC, X=RigidTransform(), wall_test=wall_test)
    there = partition(surface, p_OC, wall_test=wall_test)
    assert differ(here, there) < 0.01
    assert (here.constraints.same_side is None) == (wall_test == "none")


def test_normals_as_coordinates_keep_regions_to_one_face(surface):
    p_OC = np.array([[0.05, 0.0, 0.0], [0.03, 0.05, 0.0]])
    on_x = surface.nhat_OQ[:, 0] > 0.9
    assert np.any(partition(surface, p_OC).labels[on_x] == 1)
    assert not np.any(partition(surface, p_OC, normal_length=0.2).labels[on_x] == 1)


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ({"tip_radii": [0.0] * 3}, "tip_radii must be 5 or none, not 3"),
        ({"tip_radii": [-1.0] * 5}, r"limits.tip_radii\[0\] must be a number at least 0"),
        ({"reach": [None]}, "reach must be 5 or none, not 1"),
        ({"clearance": -1.0}, "limits.clearance must be a number at least 0 .*, not -1"),
        ({"tip_gap": 0.1}, "a tip gap or a standoff needs tip_radii"),
        ({"wall_test": "glance"}, "wall_test must be one of: none, normals, surface"),
        ({"normal_length": np.nan}, "normal_length must be a number at least 0"),
    ],
)
def test_the_partitioner_refuses_what_makes_no_sense(surface, p_OC, arguments, problem):
    with pytest.raises(InvalidArgumentError, match=problem):
        partition(surface, p_OC, **arguments)


# The selector.


def select(surface, p_OC, regions, **settings):
    system = make_selector(surface, p_OC, **settings)
    context = system.CreateDefaultContext()
    system.GetInputPort("X_WO_estimated").FixValue(context, X_WO)
    system.GetInputPort("p_WO_covariance").FixValue(context, 1e-6 * np.eye(3).ravel())
    system.GetInputPort("safe_regions").FixValue(context, AbstractValue.Make(regions))

    def emitted():
        ports = ("contact_status", "contact_causes", "p_WC")
        return [system.GetOutputPort(port).Eval(context).copy() for port in ports]

    return system, context, emitted


def test_the_selector_says_what_has_become_of_each_contact_and_why(surface, p_OC):
    ball = Obstacles((BallSolid(np.array([9.0, 0, 0]), 0.1), BallSolid(X_WO @ p_OC[1], 0.05)))
    reach = [None, None, ball_reach([9.0, 0, 0], 0.1), None, None]
    regions = partition(surface, p_OC, {"obstacles": ball}, reach=reach)
    system, context, emitted = select(surface, p_OC, regions)
    status, causes, p_WC = emitted()
    assert (status[1], causes[1]) == (ContactStatus.OBSTRUCTED, 1)
    assert (status[2], causes[2]) == (ContactStatus.OUT_OF_REACH, NO_CAUSE)
    for contact in (1, 2):
        np.testing.assert_allclose(p_WC.reshape(-1, 3)[contact], X_WO @ p_OC[contact])
    context.SetDiscreteState(system.EvalUniquePeriodicDiscreteUpdate(context))
    for before, after in zip((status, causes, p_WC), emitted(), strict=True):
        np.testing.assert_array_equal(before, after)
    context.SetTime(0.02)  # Between ticks what is stored holds.
    np.testing.assert_array_equal(emitted()[1], causes)


def test_the_selector_keeps_to_its_limits(surface, p_OC):
    regions = partition(surface, p_OC)
    goals = {}
    for name, limits in (("free", {}), ("slow", {"max_step": 0.001})):
        _, _, emitted = select(surface, p_OC, regions, limits=limits)
        goals[name] = (X_WO.inverse() @ emitted()[2].reshape(-1, 3).T).T
    ways = {name: np.linalg.norm(p - p_OC, axis=1) for name, p in goals.items()}
    assert np.max(ways["slow"]) <= 0.001 + 1e-9 < np.max(ways["free"])


def test_the_selector_verifies_if_told_to(surface, p_OC, monkeypatch):
    """With a defect put in: goals that hover over the object."""

    def hovering(selection, strategy, **_):
        goals = centroid_selector.hold_contacts(selection)
        return dataclasses.replace(goals, p_OC=goals.p_OC + 2e-4 * surface.project(p_OC)[1])

    monkeypatch.setattr(centroid_selector, "select_contacts", hovering)
    regions = partition(surface, p_OC)
    select(surface, p_OC, regions)[2]()
    with pytest.raises(ContactError, match=r"contact 0 is 0.2 mm off the object"):
        select(surface, p_OC, regions, verify_contacts=True)[2]()


# What is shown.


def shown_matrix(meshcat, path):
    """The pose that Meshcat has for a path, out of its message: an array of 16 doubles."""
    message = meshcat._GetPackedTransform(path)
    numbers = message[message.index(b"matrix") + len(b"matrix") + 3 :]
    values = [struct.unpack(">d", numbers[9 * k + 1 : 9 * k + 9])[0] for k in range(16)]
    return np.array(values).reshape(4, 4).T


@pytest.mark.parametrize("time", [0.0, 1.5])
def test_obstacles_are_drawn_where_they_are(meshcat, time):
    moving = MovingObstacles(MOVING)
    moving_context = moving.CreateDefaultContext()
    moving_context.SetTime(time)
    obstacles = moving.get_output_port().Eval(moving_context)
    visualizer = ObstacleVisualizer(meshcat=meshcat, solids=SOLIDS, publish_period=0.1)
    context = visualizer.CreateDefaultContext()
    visualizer.get_input_port().FixValue(context, AbstractValue.Make(obstacles))
    visualizer.ForcedPublish(context)
    root = obstacle_visualizer.ROOT
    assert [meshcat.HasPath(f"{root}/{k}") for k in range(4)] == [True, True, True, False]
    ball, box, plate = (shown_matrix(meshcat, f"{root}/{k}") for k in range(3))
    for shown, index in ((ball, 0), (box, 1)):
        place = SOLIDS[index].center + time * np.array(VELOCITIES[index])
        np.testing.assert_allclose(shown[:3, 3], place, atol=1e-12)
    np.testing.assert_allclose(box[:3, :3], SOLIDS[1].R_FB, atol=1e-9)
    # The plate's upper side is the half-space's plane.
    np.testing.assert_allclose(plate[:3, 2], [0, 0, 1], atol=1e-12)
    assert plate[2, 3] == pytest.approx(-0.2 + 0.03 * time - 0.004)


class Spy:
    """Stands for Meshcat, and remembers what was asked of it."""

    def __init__(self):
        self.objects, self.places, self.visible = {}, {}, {}

    def Delete(self, path):
        pass

    def SetObject(self, path, board):
        assert path not in self.objects
        self.objects[path] = board

    def SetTransform(self, path, X, time=None):
        self.places[path] = X

    def SetProperty(self, path, name, value, time):
        assert name == "visible"
        self.visible.setdefault(path, []).append((time, value))

    def seen_at(self, time):
        """The paths that a recording shows at a time; what is never hidden is always seen."""
        seen = set()
        for path in self.objects:
            frames = [value for at, value in self.visible.get(path, []) if at <= time]
            if not frames or frames[-1]:
                seen.add(path.removeprefix(f"{status_labels.ROOT}/"))
        return seen


def labels(screen, **arguments):
    system = StatusLabels(
        meshcat=screen, num_contacts=3, publish_period=0.1, hover=0.15, **arguments
    )
    context = system.CreateDefaultContext()

    def show(time, status, causes, tracking=None):
        context.SetTime(time)
        values = {"X_WO_estimated": X_WO, "contact_status": status, "contact_causes": causes}
        if tracking is not None:
            values["tracking_status"] = [tracking]
        for name, value in values.items():
            system.GetInputPort(name).FixValue(context, value)
        system.ForcedPublish(context)

    return system, show


ACTIVE, OBSTRUCTED, CROWDED = 1.0, float(ContactStatus.OBSTRUCTED), float(ContactStatus.CROWDED)


def test_boards_appear_when_they_are_needed_and_only_then():
    spy = Spy()
    _, show = labels(spy)
    show(0.0, [ACTIVE, ACTIVE, ACTIVE], [-1, -1, -1])
    assert spy.objects == {}
    show(1.0, [ACTIVE, OBSTRUCTED, ACTIVE], [-1, 2, -1])
    show(2.0, [ACTIVE, OBSTRUCTED, CROWDED], [-1, 2, 0])
    show(3.0, [ACTIVE, ACTIVE, CROWDED], [-1, -1, 1])
    show(4.0, [ACTIVE, OBSTRUCTED, CROWDED], [-1, 2, 0])
    assert spy.seen_at(0.9) == set()
    assert spy.seen_at(1.5) == {"1/-5_2"}
    assert spy.seen_at(2.5) == {"1/-5_2", "2/3_0"}
    assert spy.seen_at(3.5) == {"2/3_1"}
    assert spy.seen_at(4.5) == {"1/-5_2", "2/3_0"}


def test_a_board_says_when_the_object_is_not_tracked():
    spy = Spy()
    _, show = labels(spy)
    for time, tracking in enumerate([0.0, 1.0, 2.0, 3.0, 1.0]):
        show(float(time), [ACTIVE, OBSTRUCTED, ACTIVE], [-1, 2, -1], tracking)
    names = [spy.seen_at(time + 0.5) - {"1/-5_2"} for time in range(5)]
    assert names == [{"object/waiting"}, set(), {"object/coasting"}, {"object/lost"}, set()]
    heights = {path: X.translation()[2] for path, X in spy.places.items()}
    root = status_labels.ROOT
    assert heights[f"{root}/object/lost"] > heights[f"{root}/1/-5_2"]


def test_boards_hover_over_the_object_in_a_row_for_each_contact():
    spy = Spy()
    _, show = labels(spy, yaw=0.7)
    show(0.0, [OBSTRUCTED] * 3, [0, 0, 0])
    X_WB = spy.places[status_labels.ROOT]
    np.testing.assert_allclose(X_WB.translation(), [0.5, -0.3, 0.2 + 0.15])
    assert RollPitchYaw(X_WB.rotation()).yaw_angle() == pytest.approx(0.7)
    rows = [spy.places[f"{status_labels.ROOT}/{k}/-5_0"].translation()[2] for k in range(3)]
    assert rows[0] == 0
    assert np.min(np.diff(rows)) > 0.016


def test_a_new_simulation_starts_without_boards():
    spy = Spy()
    system, show = labels(spy)
    show(5.0, [OBSTRUCTED, ACTIVE, ACTIVE], [0, -1, -1])
    assert spy.seen_at(5.0) == {"0/-5_0"}
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    values = {"X_WO_estimated": X_WO, "contact_status": np.ones(3), "contact_causes": -np.ones(3)}
    for name, value in values.items():
        system.GetInputPort(name).FixValue(context, value)
    spy.visible.clear()
    simulator.Initialize()
    assert spy.seen_at(0.0) == set()
    show(1.0, [OBSTRUCTED, ACTIVE, ACTIVE], [0, -1, -1])
    system.GetInputPort("contact_status").FixValue(context, [OBSTRUCTED, ACTIVE, ACTIVE])
    system.GetInputPort("contact_causes").FixValue(context, [0, -1, -1])
    spy.visible.clear()
    context.SetTime(0.0)
    simulator.Initialize()  # Needed from the start, a board is there from the start.
    assert spy.seen_at(0.0) == {"0/-5_0"}


def test_boards_are_objects_of_meshcat(meshcat):
    _, show = labels(meshcat)
    root = status_labels.ROOT
    show(0.0, [ACTIVE, OBSTRUCTED, ACTIVE], [-1, 2, -1])
    assert meshcat.HasPath(f"{root}/1/-5_2")
    assert not meshcat.HasPath(f"{root}/0")
    assert meshcat._GetPackedProperty(f"{root}/1/-5_2", "visible")[-1] == 0xC3  # True.
    show(1.0, [ACTIVE, ACTIVE, ACTIVE], [-1, -1, -1])
    assert meshcat._GetPackedProperty(f"{root}/1/-5_2", "visible")[-1] == 0xC2


@pytest.mark.parametrize("status", ContactStatus)
def test_every_status_has_words(status):
    words = describe_status(float(status), 7.0)
    named = status.name.startswith(("CROWDED", "OBSTRUCTED", "NEARLY_OBSTRUCTED", "APART"))
    assert words.endswith("7") == named
    assert len({describe_status(float(s), 7.0) for s in ContactStatus}) == len(ContactStatus)


def test_longer_words_make_wider_boards_of_the_same_height():
    meshes = []
    for text in ("no", "out of reach of everybody"):
        board = text_board(text, height=0.02, frame_color=Rgba(1, 0, 0))
        file = board.source().in_memory().mesh_file
        scene = trimesh.load_scene(trimesh.util.wrap_as_stream(file.contents()), file_type="gltf")
        meshes.append(scene.extents)
    (short, low, _), (long, high, _) = meshes
    assert low == pytest.approx(0.02)
    assert high == pytest.approx(0.02)
    assert long > 3 * short


def test_obstacles_have_no_velocities_or_one_a_solid():
    wall = HalfSpace(np.zeros(3), np.array([0.0, 0.0, 1.0]))
    assert Obstacles((wall,)).after(1.0).solids == (wall,)
    Obstacles((wall,), velocities=np.zeros((1, 3)))
    with pytest.raises(InvalidArgumentError, match=r"shape \(1, 3\), one a solid, not \(2, 3\)"):
        Obstacles((wall,), velocities=np.ones((2, 3)))


def test_an_obstacle_with_a_name_is_called_by_it():
    names = {1: "the table"}
    for status in (ContactStatus.OBSTRUCTED, ContactStatus.NEARLY_OBSTRUCTED):
        assert describe_status(float(status), 1.0, names).endswith("obstructed by the table")
        assert describe_status(float(status), 0.0, names).endswith("obstructed by obstacle 0")
    assert describe_status(float(ContactStatus.CROWDED), 1.0, names) == "crowded by contact 1"
