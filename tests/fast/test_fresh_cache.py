"""Compiled code is thrown away when source has changed that numba doesn't look at."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import drake_pregrasp
from drake_pregrasp.kernels import numba_is_installed
from drake_pregrasp.kernels.compiled import fresh_cache

PACKAGE = Path(drake_pregrasp.__path__[0]).parent
OURS = ("partition.divide-12.py311.nbi", "partition.divide-12.py311.1.nbc")
OTHERS = ("elsewhere.divide-12.py311.nbi", "partition.cpython-311.pyc", "partition.txt")

CALL = """
import json
import numpy as np
from drake_pregrasp.kernels.compiled.weights import gaussian_exponents
written = np.full(1024, np.nan)
gaussian_exponents(np.eye(3), np.zeros((3, 1024)), written)
stats = gaussian_exponents.stats
print(json.dumps([np.isfinite(written).sum().item(), sum(stats.cache_hits.values())]))
"""


@pytest.fixture
def folder(tmp_path):
    for name in (*OURS, *OTHERS):
        (tmp_path / name).write_text(name)
    return tmp_path


def names(folder):
    return {file.name for file in folder.iterdir()}


def discard(folder):
    fresh_cache.discard_if_stale.__wrapped__(str(folder))


def test_only_what_this_package_compiled_is_deleted(folder):
    discard(folder)
    assert names(folder) == {*OTHERS, fresh_cache._STAMP}


def test_what_is_of_the_source_as_it_is_stays(folder, monkeypatch):
    discard(folder)
    for name in OURS:
        (folder / name).write_text(name)
    discard(folder)
    assert names(folder) == {*OURS, *OTHERS, fresh_cache._STAMP}
    monkeypatch.setattr(fresh_cache, "source_digest", lambda: "other")
    discard(folder)
    assert names(folder) == {*OTHERS, fresh_cache._STAMP}


def test_files_that_another_process_deletes_first_are_no_error(folder, monkeypatch):
    there = list(folder.iterdir())
    for name in OURS:
        (folder / name).unlink()
    monkeypatch.setattr(Path, "iterdir", lambda self: iter(there))
    discard(folder)
    monkeypatch.undo()
    assert names(folder) == {*OTHERS, fresh_cache._STAMP}


def test_folders_that_cannot_be_written_are_left_alone(folder, monkeypatch):
    discard(folder / "missing")
    discard(folder / OTHERS[0])

    def refuse(*args, **kwargs):
        raise PermissionError

    monkeypatch.setattr(Path, "unlink", refuse)
    discard(folder)
    assert names(folder) == {*OURS, *OTHERS}
    fresh_cache.discard_if_stale(None)


def test_the_digest_is_of_each_file_and_its_name(tmp_path, monkeypatch):
    monkeypatch.setattr(fresh_cache, "_SOURCES", tmp_path)
    digests = [fresh_cache.source_digest()]
    for name, content in (("a.py", "x"), ("b/c.py", "y"), ("b/c.py", "z"), ("d.py", "")):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(content)
        digests.append(fresh_cache.source_digest())
    (tmp_path / "a.py").rename(tmp_path / "e.py")
    digests.append(fresh_cache.source_digest())
    assert len(set(digests)) == len(digests)
    (tmp_path / "e.txt").write_text("no source")
    assert fresh_cache.source_digest() == digests[-1]


def test_compiled_code_is_made_of_nothing_else():
    sources = Path(fresh_cache.__file__).parent.glob("*.py")
    imports = re.findall(
        r"^from drake_pregrasp\.(\S+) import", "\n".join(f.read_text() for f in sources), re.M
    )
    outside = {name for name in imports if not name.startswith("planning.kernels.")}
    assert outside == {"planning." + fresh_cache._CONSTANTS.stem}


@pytest.mark.skipif(not numba_is_installed(), reason="numba is not installed")
@pytest.mark.parametrize("own_folder", [False, True])
def test_a_constant_of_another_file_changes_what_runs_next(tmp_path, own_folder):
    copy = tmp_path / "drake_pregrasp"
    shutil.copytree(
        PACKAGE / "planning", copy / "planning", ignore=shutil.ignore_patterns("__pycache__")
    )
    shutil.copy(PACKAGE / "errors.py", copy)
    (copy / "__init__.py").touch()  # The package's own imports Drake, which takes a second.
    environment = dict(os.environ, PYTHONPATH=str(tmp_path))
    environment.pop("NUMBA_CACHE_DIR", None)
    if own_folder:
        environment["NUMBA_CACHE_DIR"] = str(tmp_path / "cache")

    def written_and_hits():
        done = subprocess.run(
            [sys.executable, "-c", CALL],
            cwd=tmp_path,
            env=environment,
            check=True,
            capture_output=True,
            text=True,
        )
        return json.loads(done.stdout)

    sorting = copy / "planning" / "kernels" / "sorting.py"
    source = sorting.read_text()
    assert written_and_hits() == [64, 0]
    assert written_and_hits() == [64, 1]
    sorting.write_text(source.replace("BLOCK = 64", "BLOCK = 16"))
    assert written_and_hits() == [16, 0]
