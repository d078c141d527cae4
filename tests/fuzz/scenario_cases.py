"""Scenario files, good and bad, each a function of a seed and a number."""

import copy
import functools
import io
import json
import math
import random
import re
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import trimesh
from scenario_values import NASTY, some_text

from drake_pregrasp.resources import resource_folder
from drake_pregrasp.simulation.scenario import Scenario


def _exported(kind: str, **options: Any) -> bytes:
    """Returns a bracket in a format; glTF with its buffers inside."""
    data = trimesh.load_mesh(_MODELS / "bracket.obj").export(file_type=kind, **options)
    data = data["model.gltf"] if kind == "gltf" else data
    return data if isinstance(data, bytes) else data.encode()


SCENARIOS = tuple(sorted(resource_folder("scenarios").glob("*.yaml")))
_MODELS = resource_folder("models")
_DATA: Mapping[str, bytes] = {
    name: (_MODELS / name).read_bytes()
    for name in ("bracket.obj", "carried_by_hand.csv", "five_finger_hand.sdf")
}
_HAND = (_MODELS / "five_finger_hand.yaml").read_bytes()
_HAND = _HAND.replace(b"package://drake_pregrasp/five_finger_hand.sdf", b"own.sdf")
_TOKENS = (b"&a ", b"*a", b"<<: ", b"!!", b"[", b"]", b"{", b"}", b": ", b"- ", b"\n", b"\t", b"\0")
_MORE = (b"\xff", b"\xef\xbb\xbf", b"\x1b[2J", b"---\n", b"...\n", b"%YAML 9\n", b"nan", b"1e999")


_GRASP = (resource_folder("scenarios") / "hands.yaml").read_bytes()
_GRASP = _GRASP.replace(b"package://drake_pregrasp/five_finger_hand.yaml", b"x.yaml")
_MESHES: Mapping[str, bytes] = {
    "x.obj": b"mtllib x.mtl\nusemtl m\n" + _DATA["bracket.obj"],
    "text.stl": _exported("stl_ascii"),
    **{f"x.{kind}": _exported(kind) for kind in ("stl", "off", "glb", "ply")},
    "x.gltf": _exported("gltf", embed_buffers=True),
    "text.ply": _exported("ply", encoding="ascii"),
    "x.dae": _DATA["bracket.obj"],
}
_MATERIALS = b"newmtl m\nKd 1 0.5 0\nd 0.5\nmap_Kd x.png\n"
_NUMBER = re.compile(rb"-?\d+\.?\d*(?:e-?\d+)?")
_NUMBERS = (*b"nan inf -1 0 1e308 -1e308 1e-320 99999999999 1e5".split(), b"")
_MESH = "<visual name='x'><geometry><mesh><uri>x.obj</uri></mesh></geometry></visual>"
_SDF = _DATA["five_finger_hand.sdf"].decode()
_SDF = _SDF.replace('<link name="palm">', '<link name="palm">' + _MESH)
_BODIES = {
    "sdf": _SDF,
    **{name: (Path(__file__).parent / f"model.{name}").read_text() for name in ("urdf", "xml")},
}


@dataclass
class Case:
    """A scenario file and what lies beside it.

    Attributes:
        kind: How it was made.
        text: The file's content.
        name: The entry to load; None for the only one.
        files: Other files by their names.
    """

    kind: str
    text: bytes
    name: str | None = None
    files: dict[str, bytes] = field(default_factory=dict)


def make_case(seed: int, number: int) -> Case:
    """Returns the case of that number."""
    rng = random.Random(f"{seed} {number}")
    kinds = list(_KINDS)
    kind = rng.choices(kinds, [_KINDS[name][1] for name in kinds])[0]
    return _KINDS[kind][0](kind, rng)


def _made(kind: str, rng: random.Random) -> Case:
    return Case(kind, f"case: {some_text(rng, Scenario)}\n".encode())


def _spoilt(kind: str, rng: random.Random) -> Case:
    bad = rng.choice((0.01, 0.03, 0.1))
    return Case(kind, f"case: {some_text(rng, Scenario, bad)}\n".encode(errors="replace"))


def _bytes(kind: str, rng: random.Random) -> Case:
    data = rng.choice(SCENARIOS).read_bytes()
    names = [line[:-1].decode() for line in data.splitlines() if line[-1:] == b":" and line[0] > 32]
    return Case(kind, mutated(data, rng), rng.choice([name for name in names if name[0] != "_"]))


def _bomb(kind: str, rng: random.Random) -> Case:
    levels, width = rng.randint(1, 30), rng.randint(1, 12)
    merge = rng.random() < 0.5
    start = "{description: x}" if merge else "[1, 2]"
    lines = [f"_a0: &a0 {start}"]
    for level in range(1, levels):
        aliases = ", ".join([f"*a{level - 1}"] * width)
        value = f"{{<<: [{aliases}]}}" if merge else f"[{aliases}]"
        lines.append(f"_a{level}: &a{level} {value}")
    last = f"*a{levels - 1}"
    key = rng.choice(("initial_contacts", "description", "planner", "damage", "object", "zzz"))
    lines.append(f"case: {{<<: {last}}}" if merge else f"case: {{{key}: {last}}}")
    deep = rng.choice((0, 0, 0, 10, 100, 10_000))
    opening, closing = rng.choice((("[", "]"), ("{a: ", "}"), ("- ", "")))
    lines += [f"_deep: {opening * deep}1{closing * deep}"] if deep else []
    return Case(kind, "\n".join(lines).encode() + b"\n")


def _mesh(kind: str, rng: random.Random) -> Case:
    name, files = _mesh_files(rng)
    return Case(kind, f"case: {{object: !Mesh {{file: {name}}}}}\n".encode(), None, files)


def _mesh_files(rng: random.Random) -> tuple[str, dict[str, bytes]]:
    """Returns the name of a mesh that is changed, and the files."""
    name = rng.choice(list(_MESHES))
    data = _MESHES[name]
    if name.endswith(("gltf", "glb")) and rng.random() < 0.7:
        tree, rest = data, b""
        if name.endswith("glb"):  # Its header ends with the length and the kind of the tree.
            length = int.from_bytes(data[12:16], "little")
            tree, rest = data[20 : 20 + length], data[20 + length :]
        tree = json.dumps(_altered(json.loads(tree), rng)).encode()
        if name.endswith("glb"):
            tree = data[:12] + len(tree).to_bytes(4, "little") + data[16:20] + tree
        data = tree + rest
    elif name.startswith("text") or name.endswith((".obj", ".off", ".gltf")):
        data = _changed(data, rng)
    else:
        data = mutated(data, rng)
    return name, {name: data, "x.mtl": _changed(_MATERIALS, rng)}


def _altered(tree: Any, rng: random.Random) -> Any:
    """Returns what JSON holds with some values left out, moved or replaced."""
    wild = (-4, 0, 3, 2**31, 1e308, -1.5, None, "x", "../x", [], {}, [[]], True, math.nan)
    for _ in range(rng.choice((1, 1, 2, 4))):
        places, todo = [], [tree]
        while todo:
            inner = todo.pop()
            keys = list(inner) if isinstance(inner, dict) else range(len(inner))
            places += [(inner, key) for key in keys]
            todo += [inner[key] for key in keys if isinstance(inner[key], dict | list)]
        (inner, key), (other, place) = rng.choice(places), rng.choice(places)
        inner[key] = copy.deepcopy(other[place]) if rng.random() < 0.3 else rng.choice(wild)
        if rng.random() < 0.3:
            del inner[key]
    return tree


def _stream(kind: str, rng: random.Random) -> Case:
    name = rng.choice(("x.csv", *_bags()))
    data = _changed(_DATA["carried_by_hand.csv"], rng)
    if name != "x.csv":
        data = mutated(_bags()[name], rng)
    file = name.partition("/")[0]
    return Case(
        kind, f"case: {{motion: !PoseStream {{file: {file}}}}}\n".encode(), None, {name: data}
    )


@functools.cache
def _bags() -> Mapping[str, bytes]:
    """Returns recorded poses as files of MCAP, of Foxglove and of ROS 2, and of rosbag2."""
    try:
        import rosbags.rosbag2 as bags
        from mcap.writer import CompressionType, Writer
        from rosbags.typesys import Stores, get_typestore
    except ModuleNotFoundError:
        return {}
    store, files = get_typestore(Stores.ROS2_HUMBLE), {}
    pose = {"position": dict.fromkeys("xyz", 0.1), "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
    for compression in CompressionType:
        stream = io.BytesIO()
        writer = Writer(stream, compression=compression)
        writer.start()
        schema = writer.register_schema("foxglove.PoseInFrame", "jsonschema", b"{}")
        channel = writer.register_channel("/cup", "json", schema)
        for sec in range(5):
            message = {"timestamp": {"sec": sec, "nsec": 0}, "frame_id": "world", "pose": pose}
            writer.add_message(channel, sec, json.dumps(message).encode(), sec)
        writer.finish()
        files[f"{compression.name}.mcap"] = stream.getvalue()
    kind, types = "tf2_msgs/msg/TFMessage", store.types
    turn = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    move = types["geometry_msgs/msg/Transform"](types["geometry_msgs/msg/Vector3"](0, 0, 0), turn)
    with tempfile.TemporaryDirectory() as folder:
        for storage in bags.StoragePlugin:
            with bags.Writer(Path(folder, storage.name), version=9, storage_plugin=storage) as bag:
                connection = bag.add_connection("/tf", kind, typestore=store)
                for sec in range(5):
                    time = types["builtin_interfaces/msg/Time"](sec, 0)
                    header = types["std_msgs/msg/Header"](time, "world")
                    one = types["geometry_msgs/msg/TransformStamped"](header, "cup", move)
                    bag.write(connection, sec, store.serialize_cdr(types[kind]([one]), kind))
            for file in Path(folder, storage.name).glob("*.[dm]*[3p]"):
                files[f"{storage.name}/{file.name}"] = file.read_bytes()
    return files


def _hand(kind: str, rng: random.Random) -> Case:
    suffix = rng.choice(list(_BODIES))
    model, hand = _BODIES[suffix], _HAND.replace(b"own.sdf", f"own.{suffix}".encode())
    way = rng.random()
    if way < 0.6:
        model = _altered_model(model, rng)
    data = _changed(model.encode(), rng) if 0.4 < way < 0.9 else model.encode()
    mesh, files = "x.obj", {"x.obj": _MESHES["x.obj"], "x.mtl": _MATERIALS}
    if way > 0.9:
        mesh, files = _mesh_files(rng)
    data = data.replace(b"x.obj", mesh.encode())
    files |= {"x.yaml": _changed(hand, rng) if 0.8 < way < 0.9 else hand, f"own.{suffix}": data}
    return Case(kind, _GRASP, "grasp_five_finger", files)


def _altered_model(text: str, rng: random.Random) -> str:
    """Returns XML with some elements left out, repeated, moved or renamed, or other values."""
    root = ElementTree.fromstring(text)
    for _ in range(rng.choice((1, 1, 2, 4))):
        elements = list(root.iter())
        parent, other = rng.choice(elements), rng.choice(elements)
        way = rng.randrange(6)
        if way == 0 and len(parent):
            parent.remove(rng.choice(list(parent)))
        elif way == 1 and sum(1 for _ in other.iter()) < 50:
            parent.extend([copy.deepcopy(other) for _ in range(rng.choice((1, 1, 2, 50, 500)))])
        elif way == 2:
            parent.tag = rng.choice((other.tag, "include", "mesh", "uri", "x"))
        elif way == 3 and parent.attrib:
            parent.set(rng.choice(list(parent.attrib)), rng.choice(_NUMBERS).decode())
        elif way == 4:
            parent.text = rng.choice(("nan", "-1", "0 0 0 0 0 0", "../x.obj", "x" * 2000))
        else:
            parent.attrib = dict(other.attrib)
    return ElementTree.tostring(root, encoding="unicode")


def _changed(data: bytes, rng: random.Random) -> bytes:
    """Returns text with other numbers, bytes or lines."""
    way = rng.random()
    if way < 0.3:
        return mutated(data, rng)
    if way < 0.5:
        lines = data.splitlines(keepends=True)
        start, end = sorted(rng.choices(range(len(lines) + 1), k=2))
        moved = lines[start:end] * rng.choice((0, 1, 2, 20))
        rest = lines[:start] + lines[end:]
        place = rng.randrange(len(rest) + 1)
        return b"".join(rest[:place] + moved + rest[place:])
    places = list(_NUMBER.finditer(data))
    for match in sorted(
        rng.sample(places, min(len(places), rng.choice((1, 1, 3)))), key=lambda m: -m.start()
    ):
        data = data[: match.start()] + rng.choice(_NUMBERS) + data[match.end() :]
    return data


def mutated(data: bytes, rng: random.Random) -> bytes:
    """Returns data with some bytes, words or lines changed, left out, doubled or moved."""
    for _ in range(rng.choice((1, 1, 2, 4, 16))):
        start = rng.randrange(len(data) + 1)
        end = min(len(data), start + rng.choice((0, 1, 1, 4, 40)))
        way = rng.randrange(5)
        if way == 0:
            middle = bytes([rng.randrange(256)])
        elif way == 1:
            middle = rng.choice(_TOKENS + _MORE)
        elif way == 2:
            middle = data[start:end] * 2
        elif way == 3:
            middle = rng.choice(NASTY).encode(errors="replace")
        else:
            middle = b""
        data = data[:start] + middle + data[end:]
    return data


_KINDS: Mapping[str, tuple[Callable[[str, random.Random], Case], float]] = {
    "made": (_made, 0.1),
    "spoilt": (_spoilt, 0.15),
    "bytes": (_bytes, 0.15),
    "bomb": (_bomb, 0.05),
    "mesh": (_mesh, 0.3),
    "stream": (_stream, 0.1),
    "hand": (_hand, 0.15),
}
