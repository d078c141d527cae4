"""The page on untrusted files states the limits of the code."""

import importlib
import re
from pathlib import Path

import drake_pregrasp
from drake_pregrasp.geometry.meshes import MESH_SUFFIXES

PACKAGE = Path(drake_pregrasp.__file__).parent
TEXT = (PACKAGE.parent / "docs" / "untrusted_files.md").read_text(encoding="utf-8")
ROWS = dict(
    reversed(row)
    for row in re.findall(r"^\| [^|]+ \| ([\d,.]+) \| `([\w.]+)` \|$", TEXT, re.MULTILINE)
)


def test_limits_are_those_of_the_code():
    for name, value in ROWS.items():
        module, constant = name.rsplit(".", 1)
        found = getattr(importlib.import_module(f"drake_pregrasp.{module}"), constant)
        assert float(value.replace(",", "")) == found, name


def test_the_page_names_the_modules_of_limits_on_files():
    named = {name.rsplit(".", 1)[0] for name in ROWS}
    for folder in ("simulation", "interfaces", "diagrams", "estimation"):
        for file in (PACKAGE / folder).glob("*.py"):
            source = file.read_text(encoding="utf-8")
            if re.search(r"^MAX_\w+ =", source, re.MULTILINE) and "read_" in source:
                assert f"{folder}.{file.stem}" in named


def test_kinds_of_files_are_named():
    for suffix in MESH_SUFFIXES:
        assert f"`{suffix}`" in TEXT
