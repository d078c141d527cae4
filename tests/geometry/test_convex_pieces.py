"""Convex pieces fill a mesh, and little else."""

import sys

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.convex_pieces import convex_pieces
from drake_pregrasp.geometry.mesh_solid import MeshSolid
from drake_pregrasp.geometry.shapes import box_shape, load_shape
from drake_pregrasp.resources import resource_folder


def mesh_of(name):
    return load_shape(resource_folder("models") / f"{name}.obj").mesh


@pytest.mark.slow
@pytest.mark.parametrize("name", ["bracket", "mug"])
def test_pieces_fill_the_mesh_and_its_hollows_stay_free(name):
    pytest.importorskip("coacd", reason="needs the extra mujoco")
    mesh = mesh_of(name)
    points = np.random.default_rng(0).uniform(*mesh.bounds, (2000, 3))
    depth = -MeshSolid.of(mesh).distance_and_gradient(points)[0]
    planes = [ConvexHull(piece).equations for piece in convex_pieces(mesh)]
    filled = np.any([np.all(points @ p[:, :3].T + p[:, 3] <= 0, axis=1) for p in planes], axis=0)
    assert np.mean(filled[depth > 0]) > 0.99
    assert np.mean(filled[depth < -0.03 * np.max(mesh.extents)]) < 0.01


def test_a_convex_mesh_is_its_own_piece_without_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "coacd", None)
    (vertices,) = convex_pieces(box_shape([0.1, 0.2, 0.3]).mesh)
    np.testing.assert_allclose(np.sort(np.unique(np.abs(vertices))), [0.05, 0.1, 0.15])


def test_a_mesh_that_is_not_convex_needs_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "coacd", None)
    with pytest.raises(InvalidArgumentError, match=r"pip install 'drake_pregrasp\[mujoco\]'"):
        convex_pieces(mesh_of("bracket"))
