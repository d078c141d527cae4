"""Drawings of the planner in Meshcat: regions, goals and obstacles; and words for statuses."""

import struct

import numpy as np
import pytest
from driven import Driven
from made_systems import X_WO, regions_of
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.math import RigidTransform, RollPitchYaw

from drake_pregrasp import BallSolid, BoxSolid, ContactStatus, HalfSpace, Obstacles, box_surface
from drake_pregrasp.contacts.selection_input import describe_status
from drake_pregrasp.grasping.catch_limits import CatchLimit
from drake_pregrasp.visualization import obstacle_visualizer, pregrasp_visualizer
from drake_pregrasp.visualization.obstacle_visualizer import ObstacleVisualizer
from drake_pregrasp.visualization.pregrasp_visualizer import PregraspVisualizer

PREGRASP = pregrasp_visualizer.ROOT
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
    touching = p_OC[0] + 0.006 * surface.project(p_OC)[1][0]  # A ball outside.
    true = X_WO @ RigidTransform([0.0, 0.002, 0.0])
    for pose in (X_WO, true):
        if pose is true:
            visualizer.fix(X_WO=true)
        visualizer.publish()
        message = meshcat._GetPackedTransform(f"{PREGRASP}/object")
        np.testing.assert_allclose(packed_numbers(message, 16).reshape(4, 4).T, pose.GetAsMatrix4())
        goal = packed_numbers(meshcat._GetPackedTransform(f"{PREGRASP}/goals/0"), 16)
        np.testing.assert_allclose(goal.reshape(4, 4).T[:3, 3], X_WO @ touching, atol=1e-12)


def test_the_planner_is_drawn_once_and_then_only_moves(meshcat, surface, p_OC):
    visualizer = drawn(meshcat, surface, p_OC)
    assert meshcat.HasPath(f"{PREGRASP}/object/trails/4/19")
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


def test_a_meeting_is_drawn_where_and_while_it_is_planned(meshcat, surface, p_OC):
    visualizer = drawn(meshcat, surface, p_OC)
    place = [0.4, -0.1, 0.2]
    for certificate, is_seen in (
        ([CatchLimit.NONE, 1.5, *place], True),
        ([CatchLimit.SPEED, *4 * [np.nan]], False),
        ([CatchLimit.NONE, 1.5, *place], True),
        ([CatchLimit.NONE, 0.0, *place], False),
    ):
        visualizer.fix(catch_certificate=certificate)
        visualizer.publish()
        message = meshcat._GetPackedProperty(f"{PREGRASP}/meeting", "visible")
        assert message.endswith(b"\xc3" if is_seen else b"\xc2")  # MessagePack's true and false.
    meeting = packed_numbers(meshcat._GetPackedTransform(f"{PREGRASP}/meeting"), 16)
    np.testing.assert_allclose(meeting.reshape(4, 4).T[:3, 3], place)
    scale = meshcat._GetPackedProperty(f"{PREGRASP}/meeting/axes", "scale")
    np.testing.assert_allclose(packed_numbers(scale, 3), 0.03)


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


@pytest.mark.parametrize(("offset", "turn", "is_seen"), [(0, 0, 0), (3e-3, 0, 1), (0, 0.05, 1)])
def test_an_estimate_beside_the_object_is_drawn_as_a_ghost(
    meshcat, surface, p_OC, offset, turn, is_seen
):
    visualizer = drawn(meshcat, surface, p_OC)
    visualizer.fix(X_WO=X_WO @ RigidTransform(RollPitchYaw(0, 0, turn), [offset, 0, 0]))
    visualizer.publish()
    ghost = f"{PREGRASP}/estimate"
    assert meshcat._GetPackedProperty(ghost, "visible")[-1] == (0xC3 if is_seen else 0xC2)
    message = packed_numbers(meshcat._GetPackedTransform(ghost), 16)
    np.testing.assert_allclose(message.reshape(4, 4).T, X_WO.GetAsMatrix4())
