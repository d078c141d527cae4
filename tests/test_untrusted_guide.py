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
CHECKED = (
    "simulation/yaml_text",
    "config/validation",
    "simulation/scenario_check",
    "geometry/meshes",
    "geometry/closed_surfaces",
    "estimation/recorded_poses",
    "interfaces/pose_files",
    "diagrams/model_files",
)


def test_limits_are_those_of_the_code():
    for name, value in ROWS.items():
        module, constant = name.rsplit(".", 1)
        found = getattr(importlib.import_module(f"drake_pregrasp.{module}"), constant)
        assert float(value.replace(",", "")) == found, name


def test_no_limit_is_left_out():
    for module in CHECKED:
        source = (PACKAGE / f"{module}.py").read_text(encoding="utf-8")
        for constant in re.findall(r"^(MAX_\w+) =", source, re.MULTILINE):
            name = f"{module.replace('/', '.')}.{constant}"
            assert name in ROWS or constant == "MAX_DISTANCE", name


def test_kinds_of_files_are_named():
    for suffix in MESH_SUFFIXES:
        assert f"`{suffix}`" in TEXT
