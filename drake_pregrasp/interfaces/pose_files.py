"""Poses of an object from a CSV file, an MCAP file or a rosbag2 folder."""

import json
import math
import sqlite3
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from io import BytesIO
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, TypeAlias

from drake_pregrasp.errors import InvalidArgumentError, first_line, printable
from drake_pregrasp.estimation.recorded_poses import (
    CLOCK,
    MAX_ROWS,
    RecordedPoses,
    check_pose,
    read_recorded_poses,
)
from drake_pregrasp.interfaces import PACKAGES
from drake_pregrasp.resources import check_inside, read_bounded, require_packages

MAX_BAG_BYTES = 100_000_000
"""Largest size of an MCAP file or of a rosbag2, packed and unpacked, in bytes."""

MAX_SECONDS = 8
"""Longest processing time to read an MCAP file or a rosbag2, in seconds."""

MAX_MESSAGE_BYTES = 1_000_000
"""Largest size of a message with poses, in bytes."""

MAX_RECORDS = 2_000_000
"""Largest number of records of an MCAP file, also in its chunks."""

MAX_POSES = 1_000_000
"""Largest number of poses of all frames together."""

MAX_NAME = 300
"""Largest number of characters of the name of a topic or of a frame."""

MAX_TOPICS = 1000
"""Largest number of topics with poses, and of frames."""

_LISTED = 8  # Choices in a message.
_MAGIC = 8  # Bytes before the first record of an MCAP file.
_RECORD = struct.Struct("<BQ")  # Opcode and length of a record, before its content.
_FOXGLOVE = "foxglove."

# Fields of the messages that hold poses, of ROS 2 as CDR and of Foxglove as JSON: stamp, names of
# parent frame and frame, position, and orientation.
_STAMPED = ("header.stamp", "header.frame_id")
_POSE = ("", "pose.position", "pose.orientation")
_ROS_TRANSFORM = (*_STAMPED, "child_frame_id", "transform.translation", "transform.rotation")
_TRANSFORM = ("timestamp", "parent_frame_id", "child_frame_id", "translation", "rotation")
_KINDS = {
    "geometry_msgs/msg/PoseStamped": (*_STAMPED, *_POSE),
    "geometry_msgs/msg/TransformStamped": _ROS_TRANSFORM,
    "tf2_msgs/msg/TFMessage": _ROS_TRANSFORM,
    "foxglove.PoseInFrame": ("timestamp", "frame_id", *_POSE),
    "foxglove.FrameTransform": _TRANSFORM,
    "foxglove.FrameTransforms": _TRANSFORM,
}

Pose: TypeAlias = tuple[float, ...]
"""Values of `COLUMNS` without the time."""

_Message: TypeAlias = tuple[str, str, int, bytes]  # Topic, kind, nanoseconds, content.


class Track(NamedTuple):
    """Names of the poses of one frame: their topic, the frame and its parent."""

    topic: str
    frame: str
    parent: str

    def __str__(self) -> str:
        """Returns the names as messages state them."""
        return f"topic={self.topic!r}, frame={self.frame!r}, parent={self.parent!r}"


def read_poses(path: Path, topic: str = "", frame: str = "") -> RecordedPoses:
    """Reads the poses of an object from a file of any known format.

    Times of an MCAP file or a rosbag2 count from the first pose. They are the stamps of messages,
    or the times at which messages were recorded if all stamps are zero. The first pose of a time
    counts, because transforms are often sent again.

    Args:
        path: CSV file (`read_recorded_poses`), MCAP file, or folder with the files of a rosbag2.
        topic: Topic of the poses in an MCAP file or a rosbag2; empty for the only one.
        frame: Name of the object's frame in messages with transforms; empty for the only one.

    Raises:
        InvalidArgumentError: If the file is invalid or too large, has no such poses or several, or
            if a package that reads it is not installed.
    """
    if not path.is_dir() and path.suffix.lower() != ".mcap":
        if topic or frame:
            raise InvalidArgumentError(f"{path}: a CSV file has neither topics nor frames")
        return read_recorded_poses(path)
    require_packages(*PACKAGES, extra="interfaces", purpose=str(path))
    try:
        track, poses = _only_track(path, topic, frame)
        start, rows, previous = min(poses), list[list[float]](), -math.inf
        for number, stamp in enumerate(sorted(poses)):
            row = [(stamp - start) / 1e9, *poses[stamp]]
            check_pose(f"{track}, pose {number}", row, previous)
            previous = row[0]
            rows.append(row)
    except InvalidArgumentError as error:
        raise InvalidArgumentError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from error
    except Exception as error:  # The libraries raise errors of many kinds.
        said = printable(first_line(error))
        raise InvalidArgumentError(f"{path}: cannot be read: {said}") from error
    return RecordedPoses.from_rows(rows)


def _only_track(path: Path, topic: str, frame: str) -> tuple[Track, dict[int, Pose]]:
    """Returns the poses of one frame by their stamps."""
    from rosbags.typesys import Stores, get_typestore

    typestore = get_typestore(Stores.ROS2_HUMBLE)  # Its messages are those of all distributions.
    tracks: dict[Track, dict[tuple[int, int], Pose]] = {}  # By stamps, and log times of those at 0.
    total = 0
    for message in _messages(path):
        if len(message[-1]) > MAX_MESSAGE_BYTES:
            raise InvalidArgumentError(f"has a message of more than {MAX_MESSAGE_BYTES / 1e6:g} MB")
        for track, stamp, values in _poses(message, typestore):
            poses = tracks.setdefault(track, {})
            key = stamp, 0 if stamp else message[2]
            total += key not in poses
            poses.setdefault(key, values)
            if len(poses) > MAX_ROWS or total > MAX_POSES:
                raise InvalidArgumentError(
                    f"{track}: has more than {MAX_ROWS} poses (all frames: {MAX_POSES}); take fewer"
                )
            if len(tracks) > MAX_TOPICS or max(map(len, track)) > MAX_NAME:
                raise InvalidArgumentError(
                    f"has more than {MAX_TOPICS} frames, or a name of more than {MAX_NAME}"
                    " characters; keep only the object's"
                )
    chosen = [t for t in tracks if topic in ("", t.topic) and frame in ("", t.frame)]
    if len(chosen) != 1:
        if not tracks:
            raise InvalidArgumentError(f"has no messages of {', '.join(_KINDS)}")
        found = "; ".join(map(str, sorted(chosen or tracks)[:_LISTED]))
        is_named = len({(t.topic, t.frame) for t in chosen}) == 1
        remedy = "keep one parent only" if is_named else "name one of them by topic and frame"
        raise InvalidArgumentError(f"has {found}: {remedy}")
    poses = tracks[chosen[0]]
    if not any(stamp for stamp, _ in poses):  # Whoever recorded it has not set them.
        return chosen[0], {log_time: pose for (_, log_time), pose in poses.items()}
    stamps = sorted(stamp for stamp, _ in poses)  # Some are not 0.
    if stamps[0] == 0 and not 0 < stamps[1] < 1e9 * CLOCK:
        raise InvalidArgumentError(f"{chosen[0]}: has poses with and without stamps")
    return chosen[0], {stamp: pose for (stamp, _), pose in poses.items()}


def _messages(path: Path) -> Iterator[_Message]:
    """Yields the messages with poses of an MCAP file, or of all files in a folder."""
    files = [path]
    if path.is_dir():
        regular = sorted(file for file in path.iterdir() if file.is_file())
        files = [file for file in regular if file.suffix.lower() in (".mcap", ".db3")]
    sizes = [file.stat().st_size for file in files]
    if sum(sizes) > MAX_BAG_BYTES:
        raise InvalidArgumentError(f"has more than {MAX_BAG_BYTES / 1e6:g} MB; keep only poses")
    is_late = _deadline()
    for file, size in zip(files, sizes, strict=True):
        check_inside(file, [path])
        if file.suffix.lower() == ".db3":
            yield from _sqlite_messages(file, is_late)
        else:
            yield from _mcap_messages(read_bounded(file, size), is_late)


def _deadline() -> Callable[[], bool]:
    """Returns a function that tells whether `MAX_SECONDS` of processing time have passed."""
    end = time.thread_time() + MAX_SECONDS
    return lambda: time.thread_time() > end


def _mcap_messages(data: bytes, is_late: Callable[[], bool]) -> Iterator[_Message]:
    """Yields messages of an MCAP file; the library's own loops do not limit memory and time."""
    from mcap.data_stream import ReadDataStream
    from mcap.opcode import Opcode
    from mcap.records import Channel, Chunk, Message, Schema
    from mcap.stream_reader import read_magic

    read_magic(ReadDataStream(BytesIO(data)))
    kinds: dict[int, str] = {}
    topics: dict[int, tuple[str, str]] = {}
    count, unpacked, open_records = 0, 0, [_records(memoryview(data)[_MAGIC:])]
    while open_records:
        for opcode, body in open_records[-1]:
            count += 1
            if count > MAX_RECORDS or is_late():
                raise InvalidArgumentError(
                    f"has more than {MAX_RECORDS} records, or takes over {MAX_SECONDS} s to read"
                )
            if opcode == Opcode.MESSAGE and int.from_bytes(body[:2], "little") in topics:
                message = Message.read(ReadDataStream(BytesIO(body)), len(body))
                yield *topics[message.channel_id], message.log_time, message.data
            elif opcode == Opcode.CHUNK:
                if len(open_records) > 1:
                    raise InvalidArgumentError("has a chunk inside of a chunk")
                chunk = Chunk.read(ReadDataStream(BytesIO(body)))
                unpacked += chunk.uncompressed_size
                if unpacked > MAX_BAG_BYTES:
                    raise InvalidArgumentError(f"unpacks to more than {MAX_BAG_BYTES / 1e6:g} MB")
                open_records.append(_records(_unpacked(chunk)))
                break
            elif opcode == Opcode.SCHEMA:
                schema = Schema.read(ReadDataStream(BytesIO(body)))
                kinds[schema.id] = schema.name
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(ReadDataStream(BytesIO(body)))
                kind = kinds.get(channel.schema_id, "")
                encoding = "json" if kind.startswith(_FOXGLOVE) else "cdr"
                if kind in _KINDS and channel.message_encoding == encoding:
                    topics[channel.id] = (channel.topic, kind)
        else:
            open_records.pop()


def _records(view: memoryview) -> Iterator[tuple[int, memoryview]]:
    """Yields opcode and content of the records of an MCAP file or of a chunk."""
    start = 0
    while start + _RECORD.size <= len(view):  # The last magic bytes are no record.
        opcode, length = _RECORD.unpack_from(view, start)
        start += _RECORD.size + length
        yield opcode, view[start - length : start]


def _unpacked(chunk: Any) -> memoryview:
    """Returns the content of a chunk of an MCAP file, which is at most as large as it says."""
    import lz4.frame
    import zstandard

    data, size = chunk.data, chunk.uncompressed_size
    if chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size)
    elif chunk.compression == "zstd":
        data = zstandard.ZstdDecompressor().stream_reader(data).read(size)
    elif chunk.compression:
        raise InvalidArgumentError(f"has chunks of an unknown compression {chunk.compression!r}")
    return memoryview(data)[:size]


def _sqlite_messages(file: Path, is_late: Callable[[], bool]) -> Iterator[_Message]:
    """Yields messages of an SQLite file, of which only plain tables are read."""
    uri = f"{file.absolute().as_uri()}?mode=ro&immutable=1"
    with closing(sqlite3.connect(uri, uri=True)) as database:
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_MESSAGE_BYTES)
        database.set_progress_handler(is_late, 100)
        for table in ("topics", "messages"):
            query = "SELECT rootpage > 0 FROM sqlite_master WHERE type = 'table' AND name = ?"
            is_table = database.execute(query, (table,)).fetchall() == [(1,)]
            # Generated columns are hidden; others are only read.
            if not is_table or any(c[-1] for c in database.execute(f"PRAGMA table_xinfo({table})")):
                raise InvalidArgumentError(f"{file.name}: {table} is no table of plain columns")
        reads = (sqlite3.SQLITE_SELECT, sqlite3.SQLITE_READ)
        denied = {True: sqlite3.SQLITE_OK, False: sqlite3.SQLITE_DENY}
        database.set_authorizer(lambda action, *_: denied[action in reads])
        topics = {
            number: (str(name), kind)
            for number, name, kind in database.execute("SELECT id, name, type FROM topics")
            if kind in _KINDS
        }
        if len(topics) > MAX_TOPICS:
            raise InvalidArgumentError(f"has more than {MAX_TOPICS} topics with poses")
        query = "SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN"
        total = 0
        for number, stamp, data in database.execute(
            f"{query} ({','.join('?' * len(topics))})", tuple(topics)
        ):
            if not (isinstance(data, bytes) and isinstance(stamp, int)):
                raise InvalidArgumentError(f"{file.name}: has a message that is not of bytes")
            total += len(data)
            if total > MAX_BAG_BYTES:
                raise InvalidArgumentError(f"unpacks to more than {MAX_BAG_BYTES / 1e6:g} MB")
            yield *topics[number], stamp, data


def _poses(message: _Message, typestore: Any) -> Iterator[tuple[Track, int, Pose]]:
    """Yields the frames of the poses in a message, their stamps in nanoseconds, and the poses."""
    topic, kind, _, data = message
    is_json = kind.startswith(_FOXGLOVE)
    if is_json:
        value = json.loads(data, object_hook=lambda entries: SimpleNamespace(**entries))
    else:
        value = typestore.deserialize_cdr(data, kind)
    for part in getattr(value, "transforms", [value]):
        fields: list[Any] = [attrgetter(field)(part) if field else "" for field in _KINDS[kind]]
        stamp, parent, frame, p, q = fields
        fraction = stamp.nsec if is_json else stamp.nanosec
        values = (p.x, p.y, p.z, q.w, q.x, q.y, q.z)
        if not all(type(x) in (int, float) and math.isfinite(x) for x in values):
            raise InvalidArgumentError(f"topic {topic!r}: has a value that is no finite number")
        if not type(stamp.sec) is type(fraction) is int:
            raise InvalidArgumentError(f"topic {topic!r}: has a time that is no whole number")
        nanoseconds = stamp.sec * 10**9 + fraction
        yield Track(topic, str(frame), str(parent)), nanoseconds, tuple(map(float, values))
