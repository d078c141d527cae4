"""The page on untrusted files names what the code accepts."""

from pages import DOCS

from drake_pregrasp.geometry.meshes import MESH_SUFFIXES


def test_kinds_of_files_are_named():
    text = (DOCS / "untrusted_files.md").read_text(encoding="utf-8")
    for suffix in MESH_SUFFIXES:
        assert f"`{suffix}`" in text
