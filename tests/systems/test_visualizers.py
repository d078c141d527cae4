"""Drawings of the planner in Meshcat: regions, goals, obstacles, and labels of contacts."""

import struct

import numpy as np
import pytest
import trimesh
from driven import Driven
from made_systems import X_WO, regions_of
from pydrake.geometry import Meshcat, MeshcatParams, Rgba
from pydrake.math import RigidTransform, RollPitchYaw

from drake_pregrasp import BallSolid, BoxSolid, ContactStatus, HalfSpace, Obstacles, box_surface
from drake_pregrasp.contacts.selection_input import describe_status
from drake_pregrasp.systems import obstacle_visualizer, pregrasp_visualizer, status_labels
from drake_pregrasp.systems.drawing import text_board
from drake_pregrasp.systems.obstacle_visualizer import ObstacleVisualizer
from drake_pregrasp.systems.pregrasp_visualizer import PregraspVisualizer
from drake_pregrasp.systems.status_labels import StatusLabels

PREGRASP, LABELS = pregrasp_visualizer.ROOT, status_labels.ROOT
TILT = RollPitchYaw(0.1, 0.2, 0.3).ToRotationMatrix().matrix()


@pytest.fixture(scope="module")
def meshcat():
    return Meshcat(MeshcatParams(host="localhost"))


def packed_numbers(message, count):
    """The doubles, big-endian and each with a type byte, that a message of Meshcat ends with."""
    numbers = message[len(message) - 9 * count :]
    return np.array([struct.unpack(">d", numbers[9 * k + 1 : 9 * k + 9])[0] for k in range(count)])


def make_visualizer(meshcat, surface, **options):
    return PregraspVisualizer(meshcat=meshcat, surface=surface, publish_period=0.1, **options)


def drawn(meshcat, surface, p_OC, std=1e-3, **options):
    """A visualizer with inputs, that draws when it is told to."""
    return Driven(
        make_visualizer(meshcat, surface, num_contacts=5, **options),
        X_WO_estimated=X_WO,
        p_WC=(X_WO @ p_OC.T).T.ravel(),
        contact_status=np.ones(5),
        safe_regions=regions_of(surface, p_OC),
        p_WO_covariance=std**2 * np.eye(3).ravel(),
    )


def test_tiles_have_a_spacing_of_their_own(meshcat, surface):
    tiles = box_surface([0.1, 0.1, 0.1], spacing=0.02)
    for tile_surface in (None, tiles):
        make_visualizer(meshcat, surface, tile_surface=tile_surface, num_contacts=1)
        count = len((tile_surface or surface).p_OQ)
        assert meshcat.HasPath(f"{PREGRASP}/object/tiles/{count - 1}")
        assert not meshcat.HasPath(f"{PREGRASP}/object/tiles/{count}")


def test_regions_are_drawn_on_the_object_and_goals_where_they_are(meshcat, surface, p_OC):
    visualizer = drawn(meshcat, surface, p_OC)
    true = X_WO @ RigidTransform([0.0, 0.002, 0.0])
    for pose in (X_WO, true):
        if pose is true:
            visualizer.fix(X_WO=true)
        visualizer.publish()
        message = meshcat._GetPackedTransform(f"{PREGRASP}/object")
        np.testing.assert_allclose(packed_numbers(message, 16).reshape(4, 4).T, pose.GetAsMatrix4())
        goal = packed_numbers(meshcat._GetPackedTransform(f"{PREGRASP}/goals/0"), 16)
        np.testing.assert_allclose(goal.reshape(4, 4).T[:3, 3], X_WO @ p_OC[0], atol=1e-12)


def test_the_planner_is_drawn_once_and_then_only_moves(meshcat, surface, p_OC):
    visualizer = drawn(meshcat, surface, p_OC, trail_length=3)
    assert meshcat.HasPath(f"{PREGRASP}/object/trails/4/2")
    meshcat.StartRecording(frames_per_second=10)
    before = len(meshcat.StaticHtml())
    visualizer.publish()
    assert len(meshcat.StaticHtml()) > before


@pytest.mark.parametrize(("std", "half_axis"), [(1e-3, 0.03), (1e-2, 0.1 / 3), (1e5, 0.1 / 3)])
def test_the_covariance_is_drawn_no_larger_than_there_is_room(
    meshcat, surface, p_OC, std, half_axis
):
    drawn(meshcat, surface, p_OC, std).publish()
    message = meshcat._GetPackedProperty(f"{PREGRASP}/covariance/axes", "scale")
    np.testing.assert_allclose(packed_numbers(message, 3), half_axis)


def test_no_touch_volumes_are_drawn_where_they_are(meshcat):
    solids = (
        BallSolid(np.array([0.1, 0.2, 0.3]), 0.02),
        BoxSolid(np.array([0.0, 0.1, 0.0]), TILT, np.array([0.1, 0.2, 0.3])),
        HalfSpace(np.array([0.0, 0.0, -0.2]), np.array([0.0, 0.0, 1.0])),
    )
    shift = np.array([0.1, -0.2, 0.05])
    system = ObstacleVisualizer(meshcat=meshcat, solids=solids, publish_period=0.1)
    visualizer = Driven(system, obstacles=Obstacles(solids).moved(np.eye(3), shift))
    visualizer.publish()
    root = obstacle_visualizer.ROOT
    assert [meshcat.HasPath(f"{root}/{k}") for k in range(4)] == [True, True, True, False]
    messages = [meshcat._GetPackedTransform(f"{root}/{k}") for k in range(3)]
    ball, box, plate = (packed_numbers(message, 16).reshape(4, 4).T for message in messages)
    for shown, solid in ((ball, solids[0]), (box, solids[1])):
        np.testing.assert_allclose(shown[:3, 3], solid.center + shift, atol=1e-12)
    np.testing.assert_allclose(box[:3, :3], TILT, atol=1e-9)
    # The plate's upper side is the half-space's plane.
    np.testing.assert_allclose(plate[:3, 2], [0, 0, 1], atol=1e-12)
    assert plate[2, 3] == pytest.approx(-0.2 + 0.05 - 0.004)


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
                seen.add(path.removeprefix(f"{LABELS}/"))
        return seen


ACTIVE, OBSTRUCTED, CROWDED = 1.0, float(ContactStatus.OBSTRUCTED), float(ContactStatus.CROWDED)


class Labels(Driven):
    """Labels of three contacts in a viewer."""

    def __init__(self, viewer, **arguments):
        arguments = {"num_contacts": 3, "publish_period": 0.1, "hover": 0.15, **arguments}
        super().__init__(StatusLabels(meshcat=viewer, **arguments), X_WO_estimated=X_WO)

    def show(self, time, status, causes, **inputs):
        self.at(time, contact_status=status, contact_causes=causes, **inputs)
        self.publish()


def test_boards_appear_when_they_are_needed_and_only_then():
    spy = Spy()
    labels = Labels(spy)
    labels.show(0.0, [ACTIVE, ACTIVE, ACTIVE], [-1, -1, -1])
    assert spy.objects == {}
    labels.show(1.0, [ACTIVE, OBSTRUCTED, ACTIVE], [-1, 2, -1])
    labels.show(2.0, [ACTIVE, OBSTRUCTED, CROWDED], [-1, 2, 0])
    labels.show(3.0, [ACTIVE, ACTIVE, CROWDED], [-1, -1, 1])
    labels.show(4.0, [ACTIVE, OBSTRUCTED, CROWDED], [-1, 2, 0])
    seen = [spy.seen_at(time) for time in (0.9, 1.5, 2.5, 3.5, 4.5)]
    both = {"1/-5_2", "2/3_0"}
    assert seen == [set(), {"1/-5_2"}, both, {"2/3_1"}, both]


def test_a_board_says_when_the_object_is_not_tracked():
    spy = Spy()
    labels = Labels(spy)
    for time, tracking in enumerate([0.0, 1.0, 2.0, 3.0, 1.0]):
        status = [ACTIVE, OBSTRUCTED, ACTIVE]
        labels.show(float(time), status, [-1, 2, -1], tracking_status=[tracking])
    names = [spy.seen_at(time + 0.5) - {"1/-5_2"} for time in range(5)]
    assert names == [{"object/waiting"}, set(), {"object/coasting"}, {"object/lost"}, set()]
    heights = {path: X.translation()[2] for path, X in spy.places.items()}
    assert heights[f"{LABELS}/object/lost"] > heights[f"{LABELS}/1/-5_2"]


def test_boards_hover_over_the_object_in_a_row_for_each_contact():
    spy = Spy()
    Labels(spy, yaw=0.7).show(0.0, [OBSTRUCTED] * 3, [0, 0, 0])
    X_WB = spy.places[LABELS]
    np.testing.assert_allclose(X_WB.translation(), [0.5, -0.3, 0.2 + 0.15])
    assert RollPitchYaw(X_WB.rotation()).yaw_angle() == pytest.approx(0.7)
    rows = [spy.places[f"{LABELS}/{k}/-5_0"].translation()[2] for k in range(3)]
    assert rows[0] == 0
    assert np.min(np.diff(rows)) > 0.016


def test_a_new_simulation_starts_with_the_boards_that_it_needs_only():
    spy = Spy()
    labels = Labels(spy)
    labels.show(5.0, [OBSTRUCTED, ACTIVE, ACTIVE], [0, -1, -1])
    for status, seen in ((OBSTRUCTED, {"0/-5_0"}), (ACTIVE, set())):
        spy.visible.clear()
        labels.at(0.0, contact_status=[status, ACTIVE, ACTIVE])
        labels.simulator.Initialize()
        assert spy.seen_at(0.0) == seen


def test_boards_are_objects_of_meshcat(meshcat):
    labels = Labels(meshcat)
    labels.show(0.0, [ACTIVE, OBSTRUCTED, ACTIVE], [-1, 2, -1])
    assert meshcat.HasPath(f"{LABELS}/1/-5_2")
    assert not meshcat.HasPath(f"{LABELS}/0")
    assert meshcat._GetPackedProperty(f"{LABELS}/1/-5_2", "visible")[-1] == 0xC3  # True.
    labels.show(1.0, [ACTIVE, ACTIVE, ACTIVE], [-1, -1, -1])
    assert meshcat._GetPackedProperty(f"{LABELS}/1/-5_2", "visible")[-1] == 0xC2


@pytest.mark.parametrize("status", ContactStatus)
def test_every_status_has_words(status):
    words = describe_status(float(status), 7.0)
    named = status.name.startswith(("CROWDED", "OBSTRUCTED", "NEARLY_OBSTRUCTED", "APART"))
    assert words.endswith("7") == named
    assert len({describe_status(float(s), 7.0) for s in ContactStatus}) == len(ContactStatus)


def test_an_obstacle_with_a_name_is_called_by_it():
    names = {1: "the table"}
    for status in (ContactStatus.OBSTRUCTED, ContactStatus.NEARLY_OBSTRUCTED):
        assert describe_status(float(status), 1.0, names).endswith("obstructed by the table")
        assert describe_status(float(status), 0.0, names).endswith("obstructed by obstacle 0")
    assert describe_status(float(ContactStatus.CROWDED), 1.0, names) == "crowded by contact 1"


def test_longer_words_make_wider_boards_of_the_same_height():
    sizes = []
    for text in ("no", "out of reach of everybody"):
        board = text_board(text, height=0.02, frame_color=Rgba(1, 0, 0))
        file = board.source().in_memory().mesh_file
        scene = trimesh.load_scene(trimesh.util.wrap_as_stream(file.contents()), file_type="gltf")
        sizes.append(scene.extents)
        width, height = scene.extents[:2]  # Its lower edge has its middle at the origin.
        bounds = [[-width / 2, 0, 0], [width / 2, height, 0]]
        np.testing.assert_allclose(scene.bounds, bounds, atol=1e-9)
        np.testing.assert_allclose(scene.area, np.prod(scene.extents[:2]))  # Nothing is cut off.
    np.testing.assert_allclose(np.array(sizes)[:, 1], 0.02)
    assert sizes[1][0] > 3 * sizes[0][0]
