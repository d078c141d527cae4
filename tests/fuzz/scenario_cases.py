"""Scenario files, good and bad, each a function of a seed and a number."""

import base64
import json
import random
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import trimesh
from scenario_values import NASTY, some_text

from drake_pregrasp.resources import resource_folder
from drake_pregrasp.simulation.scenario import Scenario


def _exported(kind: str) -> bytes:
    """Returns a bracket in a format; glTF with its buffers inside."""
    mesh = trimesh.load_mesh(_MODELS / "bracket.obj")
    if kind != "gltf":
        data = mesh.export(file_type=kind)
        return data if isinstance(data, bytes) else data.encode()
    files = mesh.export(file_type="gltf")
    tree = json.loads(files["model.gltf"])
    for buffer in tree["buffers"]:
        text = base64.b64encode(files[buffer["uri"]]).decode()
        buffer["uri"] = f"data:application/octet-stream;base64,{text}"
    return json.dumps(tree).encode()


SCENARIOS = tuple(sorted(resource_folder("scenarios").glob("*.yaml")))
_MODELS = resource_folder("models")
_DATA: Mapping[str, bytes] = {
    name: (_MODELS / name).read_bytes()
    for name in ("bracket.obj", "carried_by_hand.csv", "five_finger_hand.sdf")
}
_HAND = (
    (_MODELS / "five_finger_hand.yaml")
    .read_bytes()
    .replace(b"package://drake_pregrasp/five_finger_hand.sdf", b"own.sdf")
)
_TOKENS = (b"&a ", b"*a", b"<<: ", b"!!", b"[", b"]", b"{", b"}", b": ", b"- ", b"\n", b"\t", b"\0")
_MORE = (b"\xff", b"\xef\xbb\xbf", b"\x1b[2J", b"---\n", b"...\n", b"%YAML 9\n", b"nan", b"1e999")


_GRASP = (
    (resource_folder("scenarios") / "hands.yaml")
    .read_bytes()
    .replace(b"package://drake_pregrasp/five_finger_hand.yaml", b"x.yaml")
)
_MESHES: Mapping[str, bytes] = {
    "x.obj": _DATA["bracket.obj"],
    **{f"x.{kind}": _exported(kind) for kind in ("stl", "ply", "off", "glb")},
    "x.gltf": _exported("gltf"),
    "x.dae": _DATA["bracket.obj"],
    "x.zip": _DATA["bracket.obj"],
}
_NUMBER = re.compile(rb"-?\d+\.?\d*(?:e-?\d+)?")
_NUMBERS = (
    b"nan",
    b"inf",
    b"-1",
    b"0",
    b"1e308",
    b"-1e308",
    b"1e-320",
    b"99999999999",
    b"1e5",
    b"",
)


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
    name = rng.choice(list(_MESHES))
    data = _MESHES[name]
    text = f"case: {{object: !Mesh {{file: {name}}}}}\n".encode()
    is_text = name.endswith((".obj", ".off", ".gltf"))
    return Case(kind, text, None, {name: _changed(data, rng) if is_text else mutated(data, rng)})


def _stream(kind: str, rng: random.Random) -> Case:
    files = {"x.csv": _changed(_DATA["carried_by_hand.csv"], rng)}
    return Case(kind, b"case: {motion: !PoseStream {file: x.csv}}\n", None, files)


def _hand(kind: str, rng: random.Random) -> Case:
    model, hand = _DATA["five_finger_hand.sdf"], _HAND
    if rng.random() < 0.6:
        model = _changed(model, rng)
    else:
        hand = _changed(hand, rng)
    return Case(kind, _GRASP, "grasp_five_finger", {"x.yaml": hand, "own.sdf": model})


def _changed(data: bytes, rng: random.Random) -> bytes:
    """Returns text with other numbers in places, or other bytes."""
    if rng.random() < 0.3:
        return mutated(data, rng)
    places = list(_NUMBER.finditer(data))
    for match in sorted(rng.sample(places, rng.choice((1, 1, 3))), key=lambda m: -m.start()):
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
    "made": (_made, 0.15),
    "spoilt": (_spoilt, 0.35),
    "bytes": (_bytes, 0.3),
    "bomb": (_bomb, 0.1),
    "mesh": (_mesh, 0.04),
    "stream": (_stream, 0.04),
    "hand": (_hand, 0.02),
}
