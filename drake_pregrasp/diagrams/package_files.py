"""Files of models of unknown origin: bounded XML, and the packages that models name."""

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from pydrake.multibody.parsing import PackageMap

from drake_pregrasp.errors import InvalidArgumentError, first_line
from drake_pregrasp.resources import (
    missing_package,
    python_package,
    read_bounded_text,
    resource_folder,
)

MAX_MODEL_BYTES = 5_000_000
"""Largest size of a model, in bytes."""

MAX_ELEMENTS = 20_000
"""Largest number of XML elements of a model."""

MAX_DEPTH = 64
"""Largest number of levels of elements in a model."""

_EXTRAS = {"gymnasium_robotics": "shadow"}  # Extras that install the data of packages.


def find_packages(model: Path) -> dict[str, Path]:
    """Returns the folders of the packages that a model may name, by the packages' names.

    They are this package, the packages that the model is in, and the packages in the environment
    variable ROS_PACKAGE_PATH. A package also has the name of its folder, by which models of
    `example-robot-data` name it, though its `package.xml` has another one.

    Raises:
        InvalidArgumentError: If a `package.xml` above the model cannot be read.
    """
    others = PackageMap.MakeEmpty()
    others.PopulateFromRosPackagePath()
    found = {name: Path(others.GetPath(name)) for name in others.GetPackageNames()}
    for folder in reversed(model.parents):
        file = folder / "package.xml"
        # A link could lead to any file.
        if file.is_file() and not file.is_symlink():
            found[(parse_xml(file).findtext("name") or "").strip()] = folder
    folders = {folder.name: folder for folder in found.values()}
    return {**folders, **found, "drake_pregrasp": resource_folder("models")}


class _BoundedTree(ElementTree.TreeBuilder):
    """Builds a tree of bounded size, without comments, processing instructions and entities."""

    _count = _depth = 0

    def start(self, tag: str, attributes: dict[str, str], /) -> Element:
        self._count += 1
        self._depth += 1
        if self._count > MAX_ELEMENTS or self._depth > MAX_DEPTH:
            raise InvalidArgumentError(
                f"more than {MAX_ELEMENTS} elements, or {MAX_DEPTH} levels of them; leave some out"
            )
        return super().start(tag, attributes)

    def end(self, tag: str, /) -> Element:
        self._depth -= 1
        return super().end(tag)

    def doctype(self, name: str, *_: object) -> None:
        raise InvalidArgumentError(f"it has a DOCTYPE, {name}; leave it out")


def parse_xml(file: Path) -> Element:
    """Returns the root of an XML file of bounded size, without entities.

    Raises:
        InvalidArgumentError: If it cannot be read, or exceeds a limit.
    """
    try:
        text = read_bounded_text(file, MAX_MODEL_BYTES)
        return ElementTree.fromstring(text, ElementTree.XMLParser(target=_BoundedTree()))
    except (ElementTree.ParseError, ValueError) as error:
        problem = first_line(error)
        raise InvalidArgumentError(f"model: {file} is no model of a hand: {problem}") from error


def located(name: str, packages: Mapping[str, Path]) -> Path:
    """Returns the path of a file that a model names; it may be relative to the model's folder.

    Args:
        name: A path, or a URL with `package://`, `model://` or `file://`.
        packages: Folders of packages by their names, besides installed Python packages.

    Raises:
        InvalidArgumentError: If it is a URL of another kind, or there is no such package.
    """
    scheme, separator, rest = name.partition("://")
    if separator and scheme in ("package", "model"):
        package, _, rest = rest.partition("/")
        folder = packages.get(package) or python_package(package)
        if folder is None:
            if package in _EXTRAS:
                raise missing_package(package, extra=_EXTRAS[package], purpose=name)
            raise InvalidArgumentError(
                f"names {name}: no such package is here; install it, or add its folder to"
                f" ROS_PACKAGE_PATH; there are: {', '.join(sorted(packages))}"
            )
        return folder / rest
    path = name.removeprefix("file://")
    if "://" in path or "\0" in path:
        raise InvalidArgumentError(f"names {name}: only files and packages are read")
    return Path(path)
