"""The shipped meshes of objects: made by their script, one body each, and standing stably."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from drake_pregrasp.geometry.shapes import load_shape
from drake_pregrasp.resources import resource_folder

MODELS = resource_folder("models")
HOUSEHOLD = [  # All stand or lie as their files say.
    *("mug", "bottle", "bowl", "can", "pan", "screwdriver"),
    *("hammer", "drill", "torus", "wedge", "carton", "ball"),
]


@pytest.mark.slow
def test_script_makes_the_shipped_files(tmp_path: Path) -> None:
    pytest.importorskip("manifold3d")
    subprocess.run([sys.executable, str(MODELS / "make_meshes.py"), str(tmp_path)], check=True)
    made = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert made == {path.name: path.read_bytes() for path in MODELS.glob("*.obj")}


@pytest.mark.parametrize("name", HOUSEHOLD)
def test_household_shapes_stand_and_fit_a_hand(name: str) -> None:
    shape = load_shape(MODELS / f"{name}.obj")
    mesh, (x, y, _) = shape.mesh, shape.p_OCoM
    assert mesh.body_count == 1
    assert 12 <= len(mesh.faces) <= 2000
    bottom = mesh.vertices[mesh.vertices[:, 2] < mesh.bounds[0, 2] + 1e-5, :2]
    assert np.all(bottom.min(axis=0) <= [x + 1e-6, y + 1e-6])
    assert np.all(bottom.max(axis=0) >= [x - 1e-6, y - 1e-6])
    assert 0.028 <= np.min(mesh.extents[:2]) <= 0.11
