"""Poses in MCAP files and rosbag2 folders, and files that are broken."""

import numpy as np
import pytest

from drake_pregrasp.wires.pose_files import read_poses

pytest.importorskip("mcap")
pytest.importorskip("rosbags")
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.rosbag2.enums import StoragePlugin
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
START = 1_700_000_000
TIMES = np.array([0.0, 0.1, 0.1, 0.25])
P = np.array([[0.1, 0.2, 0.3], [0.2, 0.2, 0.3], [9.0, 9.0, 9.0], [0.3, 0.1, 0.3]])
HALF = np.sqrt(0.5)
Q = np.array([[1.0, 0, 0, 0], [HALF, 0, 0, HALF], [1, 0, 0, 0], [0, 0, 0, 1]])  # w, x, y, z


def ros_message(kind, stamp, p, q, frame="cup"):
    t = STORE.types
    sec, nanosec = divmod(round(stamp * 1e9), 10**9)
    time = t["builtin_interfaces/msg/Time"](sec=(START if stamp >= 0 else 0) + sec, nanosec=nanosec)
    header = t["std_msgs/msg/Header"](stamp=time, frame_id="base")
    turn = t["geometry_msgs/msg/Quaternion"](w=q[0], x=q[1], y=q[2], z=q[3])
    if kind == "geometry_msgs/msg/PoseStamped":
        point = t["geometry_msgs/msg/Point"](*p)
        return t[kind](header, t["geometry_msgs/msg/Pose"](point, turn))
    move = t["geometry_msgs/msg/Transform"](t["geometry_msgs/msg/Vector3"](*p), turn)
    one = t["geometry_msgs/msg/TransformStamped"](header, frame, move)
    if kind == "tf2_msgs/msg/TFMessage":
        other = t["geometry_msgs/msg/TransformStamped"](header, "camera", move)
        return t[kind]([other, one])
    return one


def write_bag(folder, kind, storage, topics=("/poses",)):
    with BagWriter(folder, version=9, storage_plugin=storage) as bag:
        for topic in topics:
            connection = bag.add_connection(topic, kind, typestore=STORE)
            for k in (0, 3, 1, 2):  # Messages need not be in order.
                message = ros_message(kind, TIMES[k], P[k], Q[k])
                bag.write(connection, k, STORE.serialize_cdr(message, kind))
        note = bag.add_connection("/note", "std_msgs/msg/String", typestore=STORE)
        text = STORE.types["std_msgs/msg/String"]("hello")
        bag.write(note, 5, STORE.serialize_cdr(text, "std_msgs/msg/String"))
    return folder


@pytest.mark.parametrize("storage", StoragePlugin)
@pytest.mark.parametrize(
    "kind",
    [
        "geometry_msgs/msg/PoseStamped",
        "geometry_msgs/msg/TransformStamped",
        "tf2_msgs/msg/TFMessage",
    ],
)
def test_bags_of_ros_2_hold_poses(tmp_path, kind, storage):
    folder = write_bag(tmp_path / "bag", kind, storage)
    track = read_poses(folder, frame="cup" if kind.endswith("TFMessage") else "")
    np.testing.assert_array_equal(track.times, [0.0, 0.1, 0.25])  # From the first stamp.
    np.testing.assert_array_equal(track.p_WO, P[[0, 1, 3]])
    np.testing.assert_allclose(np.roll(track.R_WO.as_quat(), 1, axis=1), Q[[0, 1, 3]], atol=1e-15)
    for file in folder.glob("*.mcap"):
        np.testing.assert_array_equal(
            read_poses(file, frame="cup" if "TF" in kind else "").p_WO, track.p_WO
        )


def foxglove_pose(sec=0, x=0.0, w=1.0):
    pose = {"position": {"x": x, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": w}}
    return {"timestamp": {"sec": sec, "nsec": 0}, "frame_id": "world", "pose": pose}
