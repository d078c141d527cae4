"""Surfaces of scenarios are cached until their files or settings change."""

import os

import trimesh

from drake_pregrasp.config.object_config import Mesh
from drake_pregrasp.config.surface_config import SurfaceConfig


def test_a_mesh_that_is_written_anew_has_a_new_surface(tmp_path):
    file, config = tmp_path / "box.stl", SurfaceConfig(spacing=0.02)
    trimesh.creation.box([0.1, 0.1, 0.1]).export(file)
    first = config.make_surface(Mesh(str(file)))
    assert config.make_surface(Mesh(str(file))) is first
    trimesh.creation.box([0.1, 0.1, 0.2]).export(file)
    os.utime(file, (1, 1))
    assert config.make_surface(Mesh(str(file))).mesh.volume > 1.5 * first.mesh.volume
