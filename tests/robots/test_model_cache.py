"""Models are made once, and appear in the cache atomically."""

import os
import subprocess
import sys
import time

import pytest

from drake_pregrasp.errors import InvalidArgumentError, OutputError
from drake_pregrasp.robots import robot_data, robot_models
from drake_pregrasp.robots.robot_models import cache_folder, cached, source_digest


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path


def fill(folder):
    (folder / "model.urdf").write_text("complete")


def test_a_cached_model_is_not_made_again():
    made = []
    for _ in range(2):
        model = cached("arm-1", lambda folder: (fill(folder), made.append(folder)))
        assert (model / "model.urdf").read_text() == "complete"
    assert len(made) == 1
    assert cached("arm-2", fill) != model  # Another version is another model.


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_an_interrupted_one_leaves_nothing(error):
    def half(folder):
        (folder / "model.urdf").write_text("half")
        raise error

    with pytest.raises(error):
        cached("arm-1", half)
    assert list(cache_folder().iterdir()) == []
    assert (cached("arm-1", fill) / "model.urdf").read_text() == "complete"


@pytest.mark.slow
def test_a_killed_one_is_not_taken_for_complete_and_swept_away_in_time():
    script = """if True:
        import os
        from drake_pregrasp.robots.robot_models import cached

        def killed(folder):
            (folder / "model.urdf").write_text("half")
            os._exit(9)

        cached("arm-1", killed)
    """
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 9
    (partial,) = cache_folder().iterdir()
    assert (cached("arm-1", fill) / "model.urdf").read_text() == "complete"
    assert partial.is_dir()  # It could be another process's that is still at work.
    old = time.time() - 1e5
    os.utime(partial, (old, old))
    cached("arm-2", fill)
    assert not partial.exists()


@pytest.mark.slow
def test_two_processes_at_once_get_the_same_complete_model(tmp_path):
    script = """if True:
        import time
        from drake_pregrasp.robots.robot_models import cached

        def slowly(folder):
            (folder / "model.urdf").write_text("comp")
            time.sleep(0.5)
            (folder / "model.urdf").write_text("complete")

        print((cached("arm-1", slowly) / "model.urdf").read_text())
    """
    command = [sys.executable, "-c", script]
    runs = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(3)]
    outputs = [run.communicate()[0].strip() for run in runs]
    assert outputs == ["complete"] * 3
    assert [path.name for path in cache_folder().iterdir()] == ["arm-1"]


def test_a_folder_that_cannot_be_written_is_told_in_a_line(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(OutputError, match="cannot be written") as error:
        cached("arm-1", fill)
    assert "\n" not in str(error.value)


def test_a_change_of_the_source_is_another_version(tmp_path):
    (tmp_path / "a.py").write_text("x = 1")
    before = source_digest(tmp_path)
    assert source_digest(tmp_path) == before
    (tmp_path / "a.py").write_text("x = 2")
    assert source_digest(tmp_path) != before


def test_unknown_robots_and_a_missing_package_are_told_in_a_line(monkeypatch):
    with pytest.raises(InvalidArgumentError, match=r"no robot robots://shadow.urdf; there are: ro"):
        robot_models.robot_model("robots://shadow.urdf")
    monkeypatch.setattr(robot_data, "PACKAGE", "example-robot-data-that-is-not-there")
    with pytest.raises(InvalidArgumentError, match=r"pip install 'drake_pregrasp\[robots\]'"):
        robot_models.robot_model("robots://panda.urdf")
