"""Reads many broken recordings, and reports the outcomes.

    python -m tests.fuzz.recordings --count 100000 --seed 0

Each is to be read, or refused in one printable line, within a time and a memory.
"""

import contextlib
import functools
import json
import random
import shutil
import sqlite3
import struct
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from command_line import Result, main
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore
from scenario_files import GOOD, checked, outcome_of

from drake_pregrasp.interfaces.pose_files import read_poses

POSE = "geometry_msgs/msg/PoseStamped"
ROWS = 5
NUMBERS = ("nan", "1e999", "1_0", "-", "", "0x1", "١", "1e-400", '"1', "2" * 400, "1\n", "\0", "😀")
VALUES = (None, True, "1", [], {}, -1, 10**400, float("nan"), float("inf"), "a" * 400, [[]], 0.5)
STATEMENTS = (
    "DROP TABLE messages",
    "DROP TABLE topics; CREATE TABLE topics(id, name, type AS ('x' || name))",
    "UPDATE messages SET data = 4000000000",
    "UPDATE messages SET data = 'text', timestamp = NULL",
    "UPDATE messages SET timestamp = 'now'",
    "UPDATE messages SET data = zeroblob(900000)",
    "UPDATE messages SET data = substr(data, 1, 40)",
    "UPDATE messages SET topic_id = id",
    "UPDATE topics SET name = x'ff', type = 7",
    "UPDATE topics SET name = zeroblob(2000)",
    "INSERT INTO messages SELECT id + 9, topic_id, timestamp, data FROM messages",
    "ALTER TABLE messages RENAME TO m; CREATE VIEW messages AS SELECT * FROM m",
    "ALTER TABLE messages ADD COLUMN more AS (zeroblob(1000))",
    "CREATE TABLE other AS SELECT * FROM messages; CREATE INDEX i ON messages(data)",
)
NASTY = (b"\xff" * 8, bytes(8), b"\xff" * 4, b"\x7f" + b"\xff" * 7, b"\x00\x00\x00\x80", b"\xc1")


@functools.cache
def _cdr() -> bytes:
    store = get_typestore(Stores.ROS2_HUMBLE)
    t = store.types
    time = t["builtin_interfaces/msg/Time"](sec=1, nanosec=5)
    turn = t["geometry_msgs/msg/Quaternion"](w=1.0, x=0.0, y=0.0, z=0.0)
    pose = t["geometry_msgs/msg/Pose"](t["geometry_msgs/msg/Point"](0.1, 0.2, 0.3), turn)
    message = t[POSE](t["std_msgs/msg/Header"](stamp=time, frame_id="base"), pose)
    return bytes(store.serialize_cdr(message, POSE))


def _json(chance: random.Random) -> bytes:
    """Returns a message of Foxglove; one of its values may be another one."""
    turn = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    pose = {"position": {"x": 0.1, "y": 0.2, "z": 0.3}, "orientation": turn}
    stamp = {"sec": chance.randrange(10**6), "nsec": 0}
    message = {"timestamp": stamp, "frame_id": "world", "pose": pose}
    if chance.random() < 0.3:
        inner = chance.choice([message, pose, turn, pose["position"], stamp])
        inner[chance.choice([*inner, "transforms"])] = chance.choice(VALUES)
    return json.dumps(message).encode()


def _mcap(chance: random.Random, folder: Path) -> Path:
    path, is_json = folder / "x.mcap", chance.random() < 0.7
    options = {
        "compression": chance.choice(list(CompressionType)),
        "use_chunking": chance.random() < 0.7,
    }
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=chance.choice([200, 10**6]), **options)
        writer.start()
        kind, coding = ("foxglove.PoseInFrame", "json") if is_json else (POSE, "cdr")
        schema = writer.register_schema(kind, "jsonschema", b"{}")
        channel = writer.register_channel("/cup", coding, schema)
        for k in range(ROWS):
            writer.add_message(channel, k, _json(chance) if is_json else _cdr(), k)
        writer.finish()
    return path


def _bag(chance: random.Random, folder: Path) -> Path:
    path = folder / "bag" / "x.db3"
    shutil.rmtree(path.parent, ignore_errors=True)
    path.parent.mkdir()
    with contextlib.closing(sqlite3.connect(path)) as made:
        made.executescript("PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; BEGIN")
        made.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type)")
        made.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data)")
        made.execute("INSERT INTO topics VALUES(1, '/cup', ?)", [POSE])
        for k in range(ROWS):
            made.execute("INSERT INTO messages VALUES(?, 1, ?, ?)", [k, k, _cdr()])
        made.commit()
        with contextlib.suppress(sqlite3.Error):
            for statement in chance.sample(STATEMENTS, chance.choice([0, 1, 2])):
                made.executescript(statement)
    return path


def _csv(chance: random.Random, folder: Path) -> Path:
    table = [["time", "x", "y", "z", "qw", "qx", "qy", "qz"]]
    table += [[str(k), "0", "0.1", "-2e-1", "1", "0", "0", "0"] for k in range(ROWS)]
    for _ in range(chance.choice([0, 1, 3])):
        row = chance.choice(table)
        row[chance.randrange(len(row))] = chance.choice([*NUMBERS, "time", "x"])
    (folder / "x.csv").write_text("\n".join(map(",".join, table)), encoding="utf-8")
    return folder / "x.csv"


def _changed(chance: random.Random, data: bytes) -> bytes:
    """Returns some bytes with others in them, or with a part left out, repeated or moved."""
    changed = bytearray(data)
    for _ in range(chance.choice([0, 1, 1, 2, 5])):
        start = chance.randrange(len(changed) + 1)
        end = min(len(changed), start + chance.choice([1, 4, 8, 50, 5000]))
        new = chance.choice(
            [
                b"",
                bytes([chance.randrange(256)]),
                2 * changed[start:end],
                *NASTY,
                struct.pack("<Q", start),
            ]
        )
        changed[start : chance.choice([start + len(new), end])] = new
    return bytes(changed)


def check(seed: int, number: int, folder: Path) -> tuple[str, str, str]:
    """Makes and reads a recording."""
    chance = random.Random(f"{seed} {number}")
    kind = ("csv", "mcap", "mcap", "db3")[number % 4]
    file = {"csv": _csv, "mcap": _mcap, "db3": _bag}[kind](chance, folder)
    file.write_bytes(_changed(chance, file.read_bytes()))
    path = file.parent if kind == "db3" else file
    outcome, said = outcome_of(lambda: read_poses(path))
    return kind, outcome, "" if outcome in GOOD else said


def results(seed: int, first: int, end: int) -> Iterator[Result]:
    """Yields what came of the recordings of a seed from a number up to another."""
    with tempfile.TemporaryDirectory() as folder:
        for number in range(4):  # Imports what it needs.
            check(seed, number, Path(folder))
    yield from checked(check, seed, first, end)


if __name__ == "__main__":
    sys.exit(main(__doc__, results))
