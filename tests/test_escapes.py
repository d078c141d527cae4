"""Untrusted files cannot copy the content of other files into a run folder."""
# ruff: noqa: E501

import base64
import json
import re
from pathlib import Path

import pytest
import trimesh
import yaml

from drake_pregrasp.cli import main
from drake_pregrasp.resources import resource_folder

pytestmark = pytest.mark.slow

CANARY = "canary-of-another-folder"
MODELS = resource_folder("models")
BOX = trimesh.creation.box([0.1, 0.1, 0.1])
OBJ = BOX.export(file_type="obj")
SDF = (MODELS / "five_finger_hand.sdf").read_text()
HAND = (MODELS / "five_finger_hand.yaml").read_text().replace("package://drake_pregrasp/", "")
SECRETS = {
    "secret.txt": CANARY,
    "secret.obj": f"# {CANARY}\no {CANARY}\nmtllib secret.mtl\n{OBJ}",
    "secret.mtl": f"newmtl {CANARY}\nKd 1 0 0\n",
    "secret.png": f"\x89PNG {CANARY}",
    "secret.bin": CANARY * 50,
    "secret.sdf": SDF.replace('<visual name="disc">', f'<visual name="{CANARY}">'),
    "secret.yaml": f"description: {CANARY}\n",
    "secret.csv": f"time,x,y,z,qw,qx,qy,qz\n0,0,0,0,1,0,0,0\n{CANARY}\n",
    "secret.xml": f"<mujoco><worldbody><body name='{CANARY}'/></worldbody></mujoco>",
}

VISUAL = '<visual name="theirs">{}</visual>'
URI = VISUAL.format("<geometry><mesh><uri>{}</uri></mesh></geometry>")
BALL = "<geometry><sphere><radius>0.01</radius></sphere></geometry>"
MATERIAL = VISUAL.format(BALL + "<material>{}</material>")
TAIL = "</link></robot>"
URDF = '<robot name="hand" xmlns:drake="http://drake.mit.edu"><link name="a">{}' + TAIL
MJCF = '<mujoco model="hand">{}<worldbody><body name="a"><geom size="0.1"/></body></worldbody></mujoco>'


def palm(inside, before=""):
    """Returns the shipped hand with something more in its palm, and before its root."""
    link = '<link name="palm">'
    assert link in SDF
    text = SDF.replace(link, link + inside)
    return {"five_finger_hand.sdf": text.replace('<?xml version="1.0"?>', before, 1)}


def mesh(name, data, **others):
    return {**palm(URI.format(name)), name: data, **others}


def library(text):
    """Returns a hand with an OBJ file that begins with a text."""
    return mesh("own.obj", f"{text}\n{OBJ}")


def material(text):
    return mesh("own.obj", f"mtllib own.mtl\nusemtl own\n{OBJ}", **{"own.mtl": text})


def gltf(change):
    files = {name: bytes(data) for name, data in BOX.export(file_type="gltf").items()}
    tree = json.loads(files.pop("model.gltf"))
    change(tree)
    return mesh("own.gltf", json.dumps(tree), **files)


def renamed(uri):
    return gltf(lambda tree: [buffer.update(uri=uri) for buffer in tree["buffers"]])


def textured(uri):
    def change(tree):
        tree["images"] = [{"uri": uri}]
        tree["textures"] = [{"source": 0}]
        tree["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
        tree["meshes"][0]["primitives"][0]["material"] = 0

    return gltf(change)


def other(text):
    return {"own.urdf" if text.startswith("<robot") else "own.xml": text}


def case(text):
    return {"theirs.yaml": f"case: {text}\n"}


NAMES = yaml.safe_load((Path(__file__).parent / "escapes.yaml").read_text())
PLY = BOX.export(file_type="ply", encoding="ascii")
ESCAPES = {
    **{f"uri {uri}": palm(URI.format(uri)) for uri in NAMES["uris"]},
    **{f"obj {text}": library(text) for text in NAMES["libraries"]},
    **{f"mtl {text}": material(text) for text in NAMES["maps"]},
    **{name: palm(MATERIAL.format(text)) for name, text in NAMES["materials"].items()},
    **{name: palm(text) for name, text in NAMES["links"].items()},
    **{name: palm(*text) for name, text in NAMES["documents"].items()},
    **{f"buffer {uri}": renamed(uri) for uri in NAMES["buffers"]},
    **{f"picture {uri}": textured(uri) for uri in NAMES["pictures"]},
    "extension": gltf(lambda tree: tree.update(extensions={"MSFT_lod": {"uri": "@/secret.png"}})),
    "ply": mesh("own.ply", PLY.replace(b"comment", b"comment TextureFile @/secret.png\ncomment")),
    "stl": mesh("own.stl", BOX.export(file_type="stl_ascii").replace("solid", "solid @/secret.txt", 1)),
    "off": mesh("own.off", BOX.export(file_type="off").replace("OFF", "OFF # @/secret.txt", 1)),
    "dae": mesh("own.dae", NAMES["collada"]),
    **{f"urdf {name}": other(URDF.format(text)) for name, text in NAMES["urdf"].items()},
    **{f"mjcf {name}": other(MJCF.format(text)) for name, text in NAMES["mjcf"].items()},
    **{f"case {text}": case(text) for text in NAMES["cases"]},
    **{f"model {uri}": {"five_finger_hand.yaml": HAND.replace("five_finger_hand.sdf", uri)} for uri in NAMES["models"]},
    "object library": {**case("{object: !Mesh {file: own.obj}}"), "own.obj": f"mtllib @/secret.mtl\n{OBJ}"},
    "object buffer": {**case("{object: !Mesh {file: own.gltf}}"), **renamed("../secret.bin")},
    "object picture": {**case("{object: !Mesh {file: own.gltf}}"), **textured("../secret.png")},
}  # fmt: skip
THEIRS = """case:
  plant_config: {time_step: 0.01}
  initial_contacts: [[1, 0.5, -0.5], [0.1, 1, 0.5], [-1, 0.7, -0.2], [-0.7, -1, 0.2], [0.6, -1, -0.5]]
  hand: {file: five_finger_hand.yaml}
  grasp: {close_at: 4.5}
"""
PLAIN = re.compile(rb"[A-Za-z0-9+/]{40,}={0,2}")


def leaks(data, text):
    """Returns whether a text is in a file, as it is or in base64, as in recordings."""
    found = text.encode() in data
    for match in PLAIN.finditer(data) if not found else ():
        inner = match[0][: len(match[0]) // 4 * 4]
        found |= leaks(base64.b64decode(inner), text)
    return found


def run_theirs(folder, files, capsys, word=CANARY):
    """Runs a scenario of files in a folder; returns its status, and who of the run tells a word."""
    own, out = folder / "own", folder / "out"
    own.mkdir()
    for name, text in SECRETS.items():
        (folder / name).write_text(text, encoding="latin-1")
        (own / name.replace("secret", "link")).symlink_to(folder / name)
    (own / "link").symlink_to(folder)
    (own / "package.xml").write_text("<package><name>own</name></package>")
    hand = {"theirs.yaml": THEIRS, "five_finger_hand.yaml": HAND, "own.obj": OBJ}
    for name in files:
        if name in ("own.urdf", "own.xml"):
            hand["five_finger_hand.yaml"] = HAND.replace("five_finger_hand.sdf", name)
    for name, data in {"five_finger_hand.sdf": SDF, **hand, **files}.items():
        data = data if isinstance(data, bytes) else data.replace("@", str(folder)).encode()
        (own / name).write_bytes(data)
    command = ["run", "--scenario_file", str(own / "theirs.yaml"), "--out", str(out)]
    status = main([*command, "--simulation_duration", "0.02"])
    said = "".join(capsys.readouterr())
    assert word not in said
    assert status == 0 or said.count("\n") <= 2, said
    made = [file for file in out.rglob("*") if file.is_file()]
    assert (status == 0) == any(file.name == "recording.html" for file in made)
    return status, [file.name for file in made if leaks(file.read_bytes(), word)]


def test_there_are_many_escapes():
    assert len(ESCAPES) >= 60


@pytest.mark.parametrize("escape", ESCAPES)
def test_no_other_file_gets_into_a_run(tmp_path, capsys, escape):
    status, told = run_theirs(tmp_path, ESCAPES[escape], capsys)
    assert status in (0, 2)
    assert told == []


def test_what_a_recording_shows_is_found(tmp_path, capsys):
    """A word of the model itself is in the recording: the search above can find one."""
    word = "a-word-of-the-model-itself"
    files = palm(URI.format("own.obj").replace("theirs", word))
    assert run_theirs(tmp_path, files, capsys, word) == (0, ["recording.html"])
