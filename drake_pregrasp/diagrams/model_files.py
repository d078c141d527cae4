"""What a hand's model of unknown origin may name: files that are near, of known kinds, not large.

Drake's parser follows every name that a model holds, to anywhere on this machine. So a model is
read once before, as text.
"""

import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from pathlib import Path

from pydrake.multibody.parsing import PackageMap

from drake_pregrasp.diagrams.hand_parsing import add_packages
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.resources import check_inside, read_bounded, read_bounded_text

MAX_MODEL_BYTES = 5_000_000
"""Bytes of a model."""

MAX_PART_BYTES = 50_000_000
"""Bytes of a file that a model names."""

MODEL_SUFFIXES = (".sdf", ".urdf")
"""What a model's name ends with."""

PART_SUFFIXES = (".obj", ".mtl", ".gltf", ".glb", ".bin", ".vtk", ".stl", ".dae", ".png", ".jpg")
"""What the names of files end with that a model names."""

_PACKAGES = ("package://", "model://")
_ATTRIBUTES = ("filename", "file", "uri", "url")
_MATERIAL_FILE = re.compile(r"^\s*mtllib\s+(.+?)\s*$", re.MULTILINE)
_TEXTURE_FILE = re.compile(r"^\s*(?:map_\w+|bump|disp|norm|decal|refl)\s.*?(\S+)\s*$", re.MULTILINE)


def check_model_files(model: Path, folders: Sequence[Path]) -> list[Path]:
    """Raises an error unless all that a model names may be read.

    Args:
        model: A URDF or SDF.
        folders: What files may be in, or below, beside the packages that the model is in.

    Returns:
        The files that it names, whether they are there or not; sorted.

    Raises:
        InvalidArgumentError: If a file is elsewhere, of another kind, or too large; the message
            names it.
    """
    if model.suffix.lower() not in MODEL_SUFFIXES:
        kinds = " or ".join(MODEL_SUFFIXES)
        raise InvalidArgumentError(f"model: {model} is no model of a hand: it must be {kinds}")
    packages = PackageMap()
    try:
        add_packages(packages, model)
    except RuntimeError as error:
        raise InvalidArgumentError(f"model: {model}: {error}") from error
    roots = [Path(packages.GetPath(name)) for name in packages.GetPackageNames()]
    allowed = [*folders, *roots]
    check_inside(model, allowed)
    text = read_bounded_text(model, MAX_MODEL_BYTES)
    todo = [(model.parent, name) for name in _names_in_xml(model, text)]
    seen: set[Path] = set()
    while todo:
        folder, name = todo.pop()
        path = _located(model, name, folder, packages).resolve()
        if path in seen:
            continue
        seen.add(path)
        try:
            check_inside(path, allowed)
        except InvalidArgumentError as error:
            raise InvalidArgumentError(f"model: {model} names {name}: {error}") from error
        if path.suffix.lower() not in PART_SUFFIXES:
            raise InvalidArgumentError(
                f"model: {model} names {name}, which must be one of: {', '.join(PART_SUFFIXES)}"
            )
        if path.exists():
            todo += [(path.parent, inner) for inner in names_in_part(path)]
    return sorted(seen)


def _names_in_xml(model: Path, text: str) -> Iterator[str]:
    if "<!DOCTYPE" in text:
        raise InvalidArgumentError(f"model: {model} has a DOCTYPE, which no model needs")
    try:
        root = ET.fromstring(text)
    except (ET.ParseError, ValueError) as error:
        raise InvalidArgumentError(f"model: {model} is no model of a hand: {error}") from error
    for element in root.iter():
        tag = _local(str(element.tag))
        if tag == "include":
            raise InvalidArgumentError(f"model: {model} includes others; write them into one file")
        if (tag == "uri" or tag.endswith("_map")) and (element.text or "").strip():
            yield str(element.text).strip()
        for name, value in element.attrib.items():
            if _local(name) in _ATTRIBUTES and tag != "plugin":
                yield value.strip()


def names_in_part(path: Path) -> list[str]:
    """Returns what a mesh names: buffers, materials and textures.

    Raises:
        InvalidArgumentError: If it can't be read.
    """
    data = read_bounded(path, MAX_PART_BYTES)
    kind = path.suffix.lower()
    text = data.decode("utf-8", errors="replace")
    if kind == ".obj":
        return _MATERIAL_FILE.findall(text)
    if kind == ".mtl":
        return _TEXTURE_FILE.findall(text)
    if kind != ".gltf":
        return []
    try:
        tree = json.loads(text)
        parts = [*tree.get("buffers", []), *tree.get("images", [])]
        uris = [str(part["uri"]) for part in parts if "uri" in part]
    except (ValueError, TypeError, AttributeError, RecursionError) as error:
        raise InvalidArgumentError(f"{path} can't be read as glTF: {error}") from error
    return [uri for uri in uris if not uri.startswith("data:")]


def _located(model: Path, name: str, folder: Path, packages: PackageMap) -> Path:
    for scheme in _PACKAGES:
        if name.startswith(scheme):
            package, _, rest = name.removeprefix(scheme).partition("/")
            if packages.Contains(package):
                return Path(packages.GetPath(package)) / rest
            raise InvalidArgumentError(f"model: {model} names {name}: no such package is here")
    path = name.removeprefix("file://")
    if "://" in path or "\0" in path:
        raise InvalidArgumentError(f"model: {model} names {name}: only files and packages are read")
    return folder / path


def _local(name: str) -> str:
    return name.rpartition("}")[2]
