"""The random objects of the package pybullet: one body each, closed and at rest."""

import importlib.util
import sys

import numpy as np
import pytest

from drake_pregrasp.config.object_config import Mesh
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.random_objects import object_url, random_object

needs_objects = pytest.mark.skipif(
    any(importlib.util.find_spec(name) is None for name in ("pybullet_data", "manifold3d")),
    reason="the extra `objects` is not installed",
)


@needs_objects
@pytest.mark.parametrize("index", [1, 17, 36, 96])
def test_objects_are_single_bodies_that_lie_stably(index: int) -> None:
    """In their files, the parts of these objects only touch, or cross."""
    shape = random_object(object_url(index))
    assert shape.mesh.body_count == 1
    np.testing.assert_allclose(shape.p_OCoM, 0, atol=1e-9)
    bottom = shape.mesh.bounds[0, 2]
    touching = shape.mesh.vertices[shape.mesh.vertices[:, 2] < bottom + 1e-6]
    # The centre of mass is over the support, and no other face of the hull is nearer to it.
    assert len(touching) >= 3
    assert np.all(touching[:, :2].min(axis=0) < 0)
    assert np.all(touching[:, :2].max(axis=0) > 0)
    hull = shape.mesh.convex_hull
    heights = np.einsum("ij,ij->i", hull.triangles[:, 0], hull.face_normals)
    assert -bottom == pytest.approx(np.min(heights), abs=1e-9)
    assert "pybullet" not in sys.modules


@needs_objects
def test_size_and_scale() -> None:
    one, two = Mesh(object_url(17)).make_shape(), Mesh(object_url(17), scale=2.0).make_shape()
    assert 0.09 < np.max(one.mesh.extents) < 0.16
    np.testing.assert_allclose(two.mesh.extents, 2 * one.mesh.extents, rtol=0.01)


@pytest.mark.parametrize("name", ["1000.obj", "17.obj", "../017.obj", "017.stl", ""])
def test_unknown_objects_are_refused(name: str) -> None:
    with pytest.raises(InvalidArgumentError, match="there are objects:"):
        Mesh(f"objects://random/{name}").make_shape()


def test_missing_package_is_named_with_its_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InvalidArgumentError, match=r"pip install 'drake_pregrasp\[objects\]'"):
        Mesh("objects://random/999.obj").make_shape()
