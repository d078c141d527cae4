"""Poses in MCAP files and rosbag2 folders, and files that are broken."""

import json
import os
import sqlite3
import tracemalloc

import numpy as np
import pytest

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.interfaces import pose_files
from drake_pregrasp.interfaces.pose_files import read_poses

pytest.importorskip("mcap")
pytest.importorskip("rosbags")
import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
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


def write_mcap(file, messages, schema="foxglove.PoseInFrame", **options):
    with file.open("wb") as stream:
        writer = Writer(stream, **options)
        writer.start()
        number = writer.register_schema(schema, "jsonschema", b"{}")
        channel = writer.register_channel("/cup", "json", number)
        for k, message in enumerate(messages):
            data = message if isinstance(message, bytes) else json.dumps(message).encode()
            writer.add_message(channel, k * 10**9, data, 0)
        writer.finish()
    return file


@pytest.mark.parametrize("compression", CompressionType)
@pytest.mark.parametrize("use_chunking", [False, True])
def test_poses_of_foxglove_are_read(tmp_path, compression, use_chunking):
    messages = [foxglove_pose(sec, x=0.1 * sec) for sec in (3, 4, 6)]
    options = {"compression": compression, "use_chunking": use_chunking, "chunk_size": 300}
    track = read_poses(write_mcap(tmp_path / "x.mcap", messages, **options), "/cup")
    np.testing.assert_array_equal(track.times, [0.0, 1.0, 3.0])
    np.testing.assert_array_equal(track.p_WO[:, 0], [0.1 * 3, 0.4, 0.1 * 6])


def test_messages_without_stamps_have_the_time_of_their_recording(tmp_path):
    track = read_poses(write_mcap(tmp_path / "x.mcap", [foxglove_pose()] * 3))
    np.testing.assert_array_equal(track.times, [0.0, 1.0, 2.0])


def test_stamps_may_begin_at_zero(tmp_path):
    """As those of a bag of a simulation, which was recorded by the clock on the wall."""
    kind = "geometry_msgs/msg/PoseStamped"
    with BagWriter(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connection = bag.add_connection("/poses", kind, typestore=STORE)
        for k in range(4):
            message = ros_message(kind, 0.1 * k, P[0] + [0.1 * k, 0, 0], Q[0])
            message.header.stamp.sec -= START
            log_time = (START + k) * 10**9
            bag.write(connection, log_time, STORE.serialize_cdr(message, kind))
    track = read_poses(tmp_path / "bag")
    np.testing.assert_allclose(track.times, [0.0, 0.1, 0.2, 0.3])
    np.testing.assert_allclose(track.p_WO[:, 0], [0.1, 0.2, 0.3, 0.4])


@pytest.mark.parametrize("unstamped", [1, 2])
def test_poses_with_and_without_stamps_are_not_mixed(tmp_path, unstamped):
    kind = "geometry_msgs/msg/PoseStamped"
    with BagWriter(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connection = bag.add_connection("/poses", kind, typestore=STORE)
        for k in range(4):
            message = ros_message(kind, 0.1 * k, P[0], Q[0])
            if k < unstamped:
                message.header.stamp.sec = message.header.stamp.nanosec = 0
            bag.write(connection, (START + k) * 10**9, STORE.serialize_cdr(message, kind))
    with pytest.raises(InvalidArgumentError, match="has poses with and without stamps"):
        read_poses(tmp_path / "bag")


def test_one_of_several_poses_is_named(tmp_path):
    folder = write_bag(tmp_path / "bag", "tf2_msgs/msg/TFMessage", StoragePlugin.MCAP, ("/a", "/b"))
    with pytest.raises(InvalidArgumentError, match="topic='/a', frame='camera', parent='base'"):
        read_poses(folder)
    with pytest.raises(InvalidArgumentError, match="name one of them by topic and frame"):
        read_poses(folder, frame="cup")
    with pytest.raises(InvalidArgumentError, match="frame='cup', parent='base'"):
        read_poses(folder, "/c", "cup")
    assert len(read_poses(folder, "/b", "cup").times) == 3


@pytest.mark.parametrize(
    ("messages", "problem"),
    [
        ([], "has no messages of geometry_msgs"),
        (
            [foxglove_pose(), foxglove_pose(1) | {"frame_id": "table"}],
            "parent='table'; topic='/cup', frame='', parent='world': keep one parent only",
        ),
        ([b"\xff{"], "cannot be read"),
        ([b"[" * 100_000], "cannot be read"),
        ([{"timestamp": {"sec": 0, "nsec": 0}}], "cannot be read"),
        ([foxglove_pose(sec="1_0")], "has a time that is no whole number"),
        ([foxglove_pose(x="1_0")], "has a value that is no finite number"),
        ([foxglove_pose(x=float("nan"))], "has a value that is no finite number"),
        ([foxglove_pose(x=350.0)], "350 m is more than 100 m away"),
        ([foxglove_pose(1), foxglove_pose(2, w=0.5)], "pose 1, columns qw to qz: a quaternion of"),
    ],
)
def test_broken_messages_are_refused_in_one_line(tmp_path, messages, problem):
    file = write_mcap(tmp_path / "x.mcap", messages)
    with pytest.raises(InvalidArgumentError) as caught:
        read_poses(file)
    assert str(caught.value).startswith(f"{file}: ")
    assert problem in str(caught.value)
    assert str(caught.value).isprintable()


def test_files_of_other_kinds_are_refused(tmp_path, monkeypatch):
    (tmp_path / "x.csv").write_text("time,x\n")
    with pytest.raises(InvalidArgumentError, match="a CSV file has neither topics nor frames"):
        read_poses(tmp_path / "x.csv", "/cup")
    (tmp_path / "x.mcap").write_bytes(b"\x89MCAP1\r\n")
    with pytest.raises(InvalidArgumentError, match="cannot be read: not a valid MCAP file"):
        read_poses(tmp_path / "x.mcap")
    (tmp_path / "bag").mkdir()
    os.mkfifo(tmp_path / "bag" / "x.db3")  # It would be waited for.
    with pytest.raises(InvalidArgumentError, match="has no messages of geometry_msgs"):
        read_poses(tmp_path / "bag")
    (tmp_path / "bag" / "x.mcap").symlink_to(tmp_path / "x.mcap")
    with pytest.raises(InvalidArgumentError, match=r"is outside of .*bag"):
        read_poses(tmp_path / "bag")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InvalidArgumentError, match=r"pip install 'drake_pregrasp\[interfaces\]'"):
        read_poses(tmp_path / "x.mcap")


def test_large_files_are_refused(tmp_path, monkeypatch):
    messages = [foxglove_pose(sec) for sec in range(200)]
    file = write_mcap(tmp_path / "x.mcap", messages)
    monkeypatch.setattr(pose_files, "MAX_ROWS", 199)
    with pytest.raises(InvalidArgumentError, match="has more than 199 poses"):
        read_poses(file)
    monkeypatch.setattr(pose_files, "MAX_BAG_BYTES", 2 * file.stat().st_size)
    with pytest.raises(InvalidArgumentError, match="unpacks to more than"):
        read_poses(file)
    monkeypatch.setattr(pose_files, "MAX_BAG_BYTES", file.stat().st_size - 1)
    with pytest.raises(InvalidArgumentError, match="keep only poses"):
        read_poses(file)


MAGIC = b"\x89MCAP0\r\n"


def chunk(records, size=None, kind=""):
    """Returns a chunk record, which may say a wrong size."""
    builder = RecordBuilder()
    size = len(records) if size is None else size
    Chunk(kind, records, 0, 0, 0, uncompressed_size=size).write(builder)
    return builder.end()


def records_of(tmp_path, messages):
    plain = write_mcap(tmp_path / "x.mcap", messages, use_chunking=False).read_bytes()
    return plain[8 : plain.index(b"\x0f\x04\0\0\0\0\0\0\0")]  # Until the end of the data.


@pytest.mark.parametrize("kind", ["lz4", "zstd"])
def test_a_chunk_unpacks_to_no_more_than_it_says(tmp_path, kind):
    records = records_of(tmp_path, [foxglove_pose()])
    compress = lz4.frame.compress if kind == "lz4" else zstandard.compress
    packed = chunk(compress(records + bytes(50_000_000)), len(records), kind)
    (tmp_path / "x.mcap").write_bytes(MAGIC + packed)
    read_poses(write_mcap(tmp_path / "y.mcap", [foxglove_pose()]))  # Imports what it needs.
    tracemalloc.start()
    try:
        assert len(read_poses(tmp_path / "x.mcap").times) == 1
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()


def test_chunks_hold_what_they_say_and_no_chunks(tmp_path):
    records = records_of(tmp_path, [foxglove_pose()])
    for content, problem in (
        (chunk(chunk(records)), "has a chunk inside of a chunk"),
        (chunk(chunk(records), 0), "has no messages"),
        (chunk(records, 0), "has no messages"),
    ):
        (tmp_path / "x.mcap").write_bytes(MAGIC + content)
        with pytest.raises(InvalidArgumentError, match=problem):
            read_poses(tmp_path / "x.mcap")
    (tmp_path / "x.mcap").write_bytes(MAGIC + chunk(records))
    assert len(read_poses(tmp_path / "x.mcap").times) == 1


def frames(names):
    """Returns a message with a pose of each frame."""
    pose = foxglove_pose()
    one = {"timestamp": pose["timestamp"], "parent_frame_id": "world"}
    one |= {"translation": pose["pose"]["position"], "rotation": pose["pose"]["orientation"]}
    return {"transforms": [one | {"child_frame_id": name} for name in names]}


@pytest.mark.parametrize(
    ("message", "problem"),
    [
        (b'{"transforms": [%s{}]}' % (b"{}," * 350_000), "has a message of more than 1 MB"),
        (frames(map(str, range(1001))), "has more than 1000 frames"),
        (frames(["x" * 301]), "a name of more than 300 characters"),
    ],
)
def test_large_messages_are_refused(tmp_path, message, problem):
    file = write_mcap(tmp_path / "x.mcap", [message], "foxglove.FrameTransforms")
    with pytest.raises(InvalidArgumentError, match=problem):
        read_poses(file)


def test_records_are_counted(tmp_path, monkeypatch):
    (tmp_path / "x.mcap").write_bytes(MAGIC + chunk(bytes(9) * 9))
    monkeypatch.setattr(pose_files, "MAX_RECORDS", 8)
    with pytest.raises(InvalidArgumentError, match="has more than 8 records"):
        read_poses(tmp_path / "x.mcap")


def test_poses_of_all_frames_are_counted(tmp_path, monkeypatch):
    file = write_mcap(tmp_path / "x.mcap", [frames("abc")] * 5, "foxglove.FrameTransforms")
    monkeypatch.setattr(pose_files, "MAX_POSES", 14)
    with pytest.raises(InvalidArgumentError, match="more than 200000 poses"):
        read_poses(file)


def test_reading_ends_in_time(tmp_path, monkeypatch):
    file = write_mcap(tmp_path / "x.mcap", [foxglove_pose()])
    monkeypatch.setattr(pose_files, "MAX_SECONDS", -1)
    with pytest.raises(InvalidArgumentError, match="takes over -1 s to read"):
        read_poses(file)
    with pytest.raises(InvalidArgumentError, match="cannot be read: interrupted"):
        read_poses(
            database(tmp_path, [TOPICS, MESSAGES, *["INSERT INTO topics VALUES(1,1,1)"] * 99])
        )


TOPICS = "CREATE TABLE topics(id, name, type)"
TOPIC = "INSERT INTO topics VALUES(1, '/a', 'geometry_msgs/msg/PoseStamped')"
MESSAGES = "CREATE TABLE messages(topic_id, timestamp, data)"
NO_TABLE = "messages is no table of plain columns"
ZERO = "0 AS timestamp, '' AS data"
LONG = "instr(zeroblob(50000000), zeroblob(25000000) || x'01')"  # One step of many seconds.
ENDLESS = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT x FROM c"


def database(folder, statements):
    """Returns a rosbag2 whose database is made by some statements."""
    bag = folder / "bag"
    bag.mkdir()
    made = sqlite3.connect(bag / "x.db3")
    for statement in statements:
        made.execute(statement)
    made.commit()
    made.close()
    return bag


@pytest.mark.parametrize(
    ("messages", "problem"),
    [
        (f"CREATE VIEW messages AS SELECT x AS topic_id, {ZERO} FROM ({ENDLESS})", NO_TABLE),
        (f"CREATE VIEW messages AS SELECT 1 AS topic_id, {LONG} AS data", NO_TABLE),
        (f"CREATE TABLE messages(topic_id, timestamp, data AS ({LONG}))", NO_TABLE),
        ("CREATE VIRTUAL TABLE messages USING rtree(topic_id, timestamp, data)", NO_TABLE),
        (f"{MESSAGES}; INSERT INTO messages VALUES(1, 0, 1000000)", "message that is not of bytes"),
        (f"{MESSAGES}; INSERT INTO messages VALUES(1, 0, 'text')", "message that is not of bytes"),
        (f"{MESSAGES}; INSERT INTO messages VALUES(1, 'a', x'00')", "message that is not of bytes"),
        (f"{MESSAGES}; INSERT INTO messages VALUES(1, 0, zeroblob(1000001))", "blob too big"),
        (
            f"{MESSAGES}; INSERT INTO topics SELECT id + 1, name, type FROM topics",
            "more than 1 topic",
        ),
        (
            f"{MESSAGES}; DROP TABLE topics; CREATE VIEW topics AS SELECT 1 AS id",
            "topics is no table",
        ),
    ],
)
def test_databases_are_tables_of_bytes(tmp_path, messages, problem, monkeypatch):
    monkeypatch.setattr(pose_files, "MAX_TOPICS", 1)
    bag = database(tmp_path, [TOPICS, TOPIC, *messages.split("; ")])
    with pytest.raises(InvalidArgumentError, match=problem):
        read_poses(bag)


def test_rows_that_share_pages_are_counted(tmp_path, monkeypatch):
    """The pages of a large value are a list, whose start each row names."""
    size, page, rows = 12 * 4092, 4096, 6
    insert = f"INSERT INTO messages VALUES(1, 0, zeroblob({size}))"
    bag = database(tmp_path, [TOPICS, TOPIC, MESSAGES, *[insert] * rows])
    data = (bag / "x.db3").read_bytes()
    root = data[2 * page : 3 * page]
    cells = [int.from_bytes(root[k : k + 2]) for k in range(8, 8 + 2 * rows, 2)]
    ends = [page, *cells[:-1]]
    starts = [root[end - 4 : end] for end in ends]
    for end in ends:
        root = root[: end - 4] + starts[0] + root[end:]
    data = (
        data[:28]
        + (int.from_bytes(starts[1]) - 1).to_bytes(4)
        + data[32 : 2 * page]
        + root
        + data[3 * page :]
    )
    (bag / "x.db3").write_bytes(data[: page * (int.from_bytes(starts[1]) - 1)])
    read = []
    monkeypatch.setattr(pose_files, "_poses", lambda message, _: read.append(message) or [])
    monkeypatch.setattr(pose_files, "MAX_BAG_BYTES", rows * size)
    with pytest.raises(InvalidArgumentError, match="has no messages"):
        read_poses(bag)
    assert [message[-1] for message in read] == [bytes(size)] * rows
    monkeypatch.setattr(pose_files, "MAX_BAG_BYTES", rows * size - 1)
    with pytest.raises(InvalidArgumentError, match="unpacks to more than"):
        read_poses(bag)
