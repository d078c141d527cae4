"""Models of hands of unknown origin: checked, and copied without anything that was not checked.

Drake's parser follows every name that a model holds, to anywhere on this machine. So Drake is given
a copy only: an XML tree of elements and attributes on a list, and meshes that are written anew.
"""

import hashlib
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from drake_pregrasp.diagrams import model_elements
from drake_pregrasp.diagrams.package_files import (
    MAX_DEPTH,
    MAX_ELEMENTS,
    find_packages,
    located,
    parse_xml,
)
from drake_pregrasp.errors import InvalidArgumentError, printable
from drake_pregrasp.geometry.meshes import MESH_SUFFIXES, companions, read_pieces
from drake_pregrasp.resources import (
    check_inside,
    copies_folder,
    file_url,
    real_path,
    resource_folder,
)
from drake_pregrasp.robots.robot_meshes import write_obj
from drake_pregrasp.robots.urdf_repair import DRAKE

MAX_PART_BYTES = 50_000_000
"""Largest size of all mesh files of a hand together, in bytes."""

MAX_VALUE = 1000
"""Largest number of characters of an attribute, or of the text of an element."""

MAX_LINKS = 200
"""Largest number of links of a hand."""

MAX_GEOMETRIES = 1000
"""Largest number of visual and collision geometries of a hand, together."""

MAX_OTHERS = 300
"""Largest number of joints; and of actuators, frames, constraints, filters and directives, each."""

MAX_TRIANGLES = 100_000
"""Largest number of triangles of all mesh files of a hand together, except visual ones."""

MAX_VISUAL_TRIANGLES = 500_000
"""Largest number of triangles of all visual meshes that are shown; others are left out."""

MAX_CELLS = 1000
"""Largest number of cells into which Drake splits a hand's hydroelastic geometries: the sum of
(size / resolution hint)², and a tenth of the triangles of a geometry with a mesh file."""

MAX_FILES = 20
"""Largest number of files that a hand's models include, and its directives name, together."""

_KINDS = {"sdf": "sdf", "robot": "urdf", "mujoco": "xml"}  # Formats by the tags of roots.
_MESH_NAMES = {"urdf": "filename", "xml": "file"}  # Attributes; SDF has an element.

_TAGS = {"sdf": model_elements.SDF, "urdf": model_elements.URDF, "xml": model_elements.MJCF}
"""Elements of each format that are copied; others are left out."""

_COUNTED: Mapping[str, tuple[str, int]] = {
    **dict.fromkeys(("link", "body"), ("links", MAX_LINKS)),
    **dict.fromkeys(("visual", "collision", "geom"), ("geometries", MAX_GEOMETRIES)),
    **{name: (f"elements <{name}>", MAX_OTHERS) for name in model_elements.COUNTED},
}


@dataclass(frozen=True)
class CheckedModel:
    """A copy of a model that holds only what was checked.

    Attributes:
        text: The copy, in XML. The only files that it names are meshes that this process wrote.
        kind: Its format, as Drake's parser calls it: `sdf`, `urdf` or `xml`.
        files: Files that the copy was made from, the model first.
        left_out: Lines that say what was left out of which file.
    """

    text: str
    kind: str
    files: tuple[Path, ...]
    left_out: tuple[str, ...]


@dataclass
class Totals:
    """Amounts of all models of a hand together, to which the limits apply.

    Attributes:
        files: Files that were read.
        counts: Number of things of each kind.
        cells: Number of cells; see `MAX_CELLS`.
        meshes: Copies of mesh files, by their paths and whether they are visual.
        faces: Number of triangles of each copy, by its URI.
        left_out: Lines that say what was left out of which file.
    """

    files: list[Path] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    cells: float = 0.0
    meshes: dict[tuple[Path, bool], Path] = field(default_factory=dict)
    faces: dict[str, int] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)

    def add(self, what: str, most: int, number: int = 1) -> None:
        """Counts things of a kind.

        Args:
            what: Name of the kind, in the plural.
            most: Largest number of these things.
            number: Number of things to add.

        Raises:
            InvalidArgumentError: If there are too many.
        """
        self.counts[what] += number
        if self.counts[what] > most:
            raise InvalidArgumentError(
                f"more than {most} {what}, in all parts of the hand together; leave some out"
            )


def checked_model(model: Path, allowed: Sequence[Path], totals: Totals) -> CheckedModel:
    """Returns a checked copy of a model.

    Args:
        model: Path of an SDF, a URDF or an MJCF.
        allowed: Folders that files may be in, or below.
        totals: Totals of the hand's models so far, to which this model is added.

    Raises:
        InvalidArgumentError: If the model is too large, or names a file that is elsewhere, is too
            large, or cannot be read as a mesh; the message names file, element and value.
    """
    check_inside(model, allowed)
    return _Copier(model, find_packages(model), allowed, totals).copy()


class _NotShownError(Exception):
    """A visual mesh is of an unknown format or too large to be shown."""


class _Copier:
    """Copies a model once.

    Args:
        model: The model.
        packages: Folders of the packages that it may name, by their names.
        allowed: Folders that files may be in, or below.
        totals: Totals of the hand's models so far.
    """

    def __init__(
        self,
        model: Path,
        packages: Mapping[str, Path],
        allowed: Sequence[Path],
        totals: Totals,
    ) -> None:
        self._model, self._packages, self._allowed = model, packages, allowed
        self._folder, self._strips_path = model.parent, False  # Of the names of meshes.
        self._is_visual = False
        self._totals = totals
        self._totals.files.append(model)
        self._parts = [model]  # The model and what it includes.
        self._left_out: set[str] = set()

    def copy(self, depth: int = 1) -> CheckedModel:
        """Returns the copy.

        Args:
            depth: Level of the root among the elements of all parts of the model, from 1.
        """
        root = parse_xml(self._model)
        if root.tag == "mujoco":
            self._include(root, 1)
        if root.tag not in _KINDS:
            raise self._error(
                f"is no model of a hand: its root is <{root.tag}>; it must be <sdf>, <robot> (URDF)"
                " or <mujoco> (MJCF)"
            )
        self._kind = _KINDS[root.tag]
        for compiler in root.iter("compiler"):
            self._folder = self._located(compiler.get("meshdir", compiler.get("assetdir", "")))
            self._strips_path |= compiler.get("strippath") == "true"
        copied = Element(root.tag, {"xmlns:drake": DRAKE})
        self._fill(copied, root, depth)
        if self._left_out and not self._model.is_relative_to(resource_folder("models")):
            names = printable(", ".join(sorted(self._left_out)), MAX_VALUE)
            self._totals.left_out.append(f"{self._model}: left out, as no hand needs it: {names}")
        text = ElementTree.tostring(copied, encoding="unicode")
        totals = self._totals
        return CheckedModel(text, self._kind, tuple(totals.files), tuple(totals.left_out))

    def _include(self, element: Element, depth: int) -> None:
        """Replaces each `<include>` of an MJCF by what the root of its file contains."""
        self._check_depth(depth)
        for index, child in reversed(list(enumerate(element))):
            if child.tag != "include":
                self._include(child, depth + 1)
                continue
            included = parse_xml(self._included(child.get("file", "")))
            self._include(included, depth)
            element[index : index + 1] = list(included)

    def _check_depth(self, depth: int) -> None:
        if depth > MAX_DEPTH:
            raise self._error(
                f"has more than {MAX_DEPTH} levels of elements, with those that it includes"
            )

    def _included(self, name: str) -> Path:
        """Returns the path of a file that is included, and counts it."""
        path = real_path(self._located(name))
        check_inside(path, self._allowed)
        if path in self._parts:
            raise self._error(f"includes {path} twice")
        self._parts.append(path)
        self._add("files", MAX_FILES)
        self._totals.files.append(path)
        return path

    def _merge(self, copied: Element, include: Element, depth: int) -> None:
        """Adds an `<include merge="true">` of an SDF, with a copy of what it includes."""
        path = self._included(self._value(include, include.findtext("uri") or ""))
        part = _Copier(path, self._packages, self._allowed, self._totals)
        part._parts = self._parts
        merged = ElementTree.SubElement(copied, "include", merge="true")
        ElementTree.SubElement(merged, "uri").text = file_url(written_copy(part.copy(depth)))
        for child in include:
            if child.tag in ("name", "pose", "placement_frame"):
                self._fill(ElementTree.SubElement(merged, child.tag), child, depth)

    def _error(self, problem: str) -> InvalidArgumentError:
        return InvalidArgumentError(f"model: {self._model} {problem}")

    def _add(self, what: str, most: int) -> None:
        try:
            self._totals.add(what, most)
        except InvalidArgumentError as error:
            raise self._error(f"has {error}") from error

    def _fill(self, copied: Element, element: Element, depth: int) -> None:
        """Copies what is allowed of an element's attributes, text and children."""
        self._check_depth(depth)
        for name, value in element.attrib.items():
            if _plain(name) in model_elements.ATTRIBUTES:
                copied.set(_plain(name), self._value(copied, value))
        copied.text = self._value(copied, element.text or "")
        if copied.tag == "mass" or "mass" in copied.attrib:
            text = copied.get("mass") or copied.get("value") or copied.text
            if not all(0 <= mass < math.inf for mass in _numbers(Element("mass", value=text))):
                raise self._error(f"has a mass of {text}; it must be finite and at least 0")
        for child in element:
            tag = _plain(child.tag)
            if tag == "include" and self._kind == "sdf" and child.get("merge") == "true":
                self._merge(copied, child, depth + 1)
                continue
            if tag in model_elements.REFUSED:
                raise self._error(f"has <{tag}>; write out what it stands for, in the same file")
            if tag not in _TAGS[self._kind]:
                self._left_out.update({tag} - {"uri"})  # Of meshes, which get another one.
                continue
            self._add(*_COUNTED.get(tag, ("other elements", MAX_ELEMENTS)))
            part = ElementTree.SubElement(copied, tag)
            self._is_visual |= tag == "visual"
            try:
                self._fill(part, child, depth + 1)
            except _NotShownError as error:
                if tag != "visual":
                    raise
                copied.remove(part)
                self._left_out.add(str(error))
            self._is_visual &= tag != "visual"
        if copied.tag == "mesh":
            self._copy_mesh(copied, element)
        if copied.tag == "collision":
            self._check_cells(copied)

    def _value(self, element: Element, value: str) -> str:
        value = value.strip()
        if len(value) > MAX_VALUE:
            size = f"{len(value)} characters; at most {MAX_VALUE}"
            raise self._error(f"has <{element.tag}> with a value of {size}")
        return value

    def _copy_mesh(self, copied: Element, element: Element) -> None:
        """Names a new mesh file in place of the one that an element names."""
        key = _MESH_NAMES.get(self._kind)
        name = (element.get(key) if key else element.findtext("uri")) or ""
        name = self._value(copied, name)
        if not name:  # As among the defaults of MJCF.
            return
        path = real_path(self._located(name))
        use = path, self._is_visual
        if use not in self._totals.meshes:
            self._totals.meshes[use] = self._write_mesh(name, path)
        written = self._totals.meshes[use]
        if key:
            copied.set(key, str(written) if self._kind == "xml" else file_url(written))
        else:
            ElementTree.SubElement(copied, "uri").text = file_url(written)
        if self._kind == "xml":
            copied.set("name", element.get("name", Path(name).stem))

    def _located(self, name: str) -> Path:
        try:
            path = located(name, self._packages)
        except InvalidArgumentError as error:
            raise self._error(str(error)) from error
        return self._folder / (path.name if self._strips_path and not path.is_absolute() else path)

    def _write_mesh(self, name: str, path: Path) -> Path:
        try:
            check_inside(path, self._allowed)
            if path.suffix.lower() not in MESH_SUFFIXES:
                if self._is_visual:
                    raise _NotShownError(f"visual {path.name}")
                raise InvalidArgumentError(
                    f"convert it, as by trimesh, to {'|'.join(MESH_SUFFIXES)}"
                )
            files = [path, *companions(path)]
            self._totals.files += files
            size = sum(file.stat().st_size for file in files if file.is_file())
            self._totals.add("bytes of meshes", MAX_PART_BYTES, size)
            pieces = read_pieces(path, colors=True)
            faces = sum(len(piece.mesh.faces) for piece in pieces)
            if not self._is_visual:
                self._totals.add("triangles", MAX_TRIANGLES, faces)
            elif self._totals.counts["visual triangles"] + faces > MAX_VISUAL_TRIANGLES:
                raise _NotShownError(f"visual {path.name} of {faces} triangles")
            else:
                self._totals.counts["visual triangles"] += faces
        except (InvalidArgumentError, OSError) as error:
            raise self._error(f"names {name}: {error}") from error
        # Equal files share a copy: a hand may be read many times in a process.
        content = b"".join(
            file.name.encode() + file.read_bytes() for file in files if file.is_file()
        )
        written = copies_folder() / hashlib.sha256(content).hexdigest() / "mesh.obj"
        if not written.is_file():
            written.parent.mkdir(exist_ok=True)
            write_obj(pieces, written)
        self._totals.faces[file_url(written)] = faces
        return written

    def _check_cells(self, collision: Element) -> None:
        """Refuses hydroelastic geometries that Drake would split into too many cells."""
        parts = [part for shape in collision.iter("geometry") for part in shape.iter()]
        size = max((abs(n) for part in parts for n in _numbers(part)), default=0.0)
        totals = self._totals
        for hint in collision.iter("drake:mesh_resolution_hint"):
            totals.cells += sum(min(size / max(n, 1e-9), 1e9) ** 2 for n in _numbers(hint))
        if any("_hydroelastic" in part.tag for part in collision.iter()):
            uris = [uri for part in parts for uri in (part.text, part.get("filename")) if uri]
            totals.cells += sum(totals.faces.get(uri, 0) for uri in uris) / 10
        if not totals.cells <= MAX_CELLS:
            raise self._error(
                f"has hydroelastic geometries of {totals.cells:.0f} cells; at most {MAX_CELLS}:"
                " give them larger <drake:mesh_resolution_hint>, or meshes of fewer triangles"
            )


def written_copy(copy: CheckedModel) -> Path:
    """Writes a copy to a file, which is removed when this process ends, and returns its path."""
    name = hashlib.sha256(copy.text.encode()).hexdigest()
    path = copies_folder() / f"{name}.{copy.kind}"
    if not path.exists():
        path.write_text(copy.text, encoding="utf-8")
    return path


def _plain(name: str) -> str:
    """Returns a name with the prefix `drake:` for Drake's namespace; others stay as they are."""
    space, _, local = name.rpartition("}")
    return f"drake:{local}" if space.endswith("drake.mit.edu") else name


def _numbers(element: Element) -> Iterator[float]:
    for word in " ".join([element.text or "", *element.attrib.values()]).split():
        try:
            yield float(word)
        except ValueError:
            continue
