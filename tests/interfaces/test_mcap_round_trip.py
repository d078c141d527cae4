"""A run written as MCAP is shown by Foxglove, and replayed as a pose stream."""

import base64
import json

import numpy as np
import pytest
from simulation_runs import contacts, points, run_log

from drake_pregrasp import InvalidArgumentError, box_surface, load_scenario, run
from drake_pregrasp.config.object_config import PoseStream
from drake_pregrasp.interfaces.mcap_log import OBJECT_FRAME, McapLog

reader = pytest.importorskip("mcap.reader")
pytest.importorskip("rosbags")

PERIOD = 0.0333333  # Of ticks that are not at whole nanoseconds.
SCHEMAS = {
    "/object": "foxglove.SceneUpdate",
    "/tf": "foxglove.FrameTransforms",
    "/goals": "foxglove.SceneUpdate",
    "/regions": "foxglove.PointCloud",
    "/measures": "drake_pregrasp.Measures",
}


def short_run(name, folder, motion=None, **options):
    text = f"{{planner: {{period: {PERIOD}, static_duration: 0.3}}}}"
    scenario = load_scenario(name, text=text)
    scenario.simulation_duration = 1.0
    scenario.motion = motion or scenario.motion
    return run(scenario, name="run", out=folder, recording=False, **options)


def test_a_log_that_cannot_be_started_leaves_no_open_file(tmp_path, monkeypatch):
    files = []

    class FullDisk:
        def __init__(self, file):
            files.append(file)

        def start(self, library):
            raise OSError("no space is left")

    monkeypatch.setattr("mcap.writer.Writer", FullDisk)
    surface = box_surface([0.1, 0.1, 0.1], spacing=0.05)
    with pytest.raises(OSError, match="no space is left"):
        McapLog(tmp_path / "run.mcap", surface, np.zeros((1, 3))).open()
    assert files[0].closed


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a_base", "toss"])
def test_a_replayed_run_has_the_same_goals(name, tmp_path):
    first = short_run(name, tmp_path / "first", mcap=True)
    replay = PoseStream(file=str(first.folder / "run.mcap"), frame=OBJECT_FRAME)
    second = short_run(name, tmp_path / "second", replay)
    logs = run_log(first), run_log(second)
    assert np.ptp(points(logs[0], "wo"), axis=0).max() > 5e-4
    for row in range(len(logs[0]["time"])):
        np.testing.assert_allclose(
            contacts(logs[0], row), contacts(logs[1], row), atol=1e-9, rtol=0
        )


@pytest.mark.slow
def test_foxglove_is_shown_what_is_logged(tmp_path):
    stops = iter([False] * 10)
    result = short_run("a_base", tmp_path, mcap=True, should_stop=lambda: next(stops, True))
    assert not result.completed  # An interrupted run, too, leaves a whole file.
    log, last, count = run_log(result), {}, dict.fromkeys(SCHEMAS, 0)
    with (result.folder / "run.mcap").open("rb") as file:
        for schema, channel, message in reader.make_reader(
            file, validate_crcs=True
        ).iter_messages():
            assert schema.name == SCHEMAS[channel.topic]
            assert json.loads(schema.data)["type"] == "object"
            count[channel.topic] += 1
            last[channel.topic] = json.loads(message.data), message.log_time
            if channel.topic == "/regions":
                cloud, row = last["/regions"][0], count["/goals"] - 1
    ticks = len(log["time"])
    assert count["/tf"] == count["/goals"] == count["/measures"] == ticks
    assert 1 < count["/regions"] < ticks
    measures, time = last["/measures"]
    assert time == round(log["time"][-1] * 1e9)
    np.testing.assert_array_equal([measures[name] for name in log], [log[name][-1] for name in log])
    spheres = last["/goals"][0]["entities"][0]["spheres"]
    places = [[ball["pose"]["position"][axis] for axis in "xyz"] for ball in spheres]
    np.testing.assert_array_equal(places, contacts(log, -1))
    data = np.frombuffer(base64.b64decode(cloud["data"]), dtype=np.uint8).reshape(-1, 16)
    assert cloud["point_stride"] == 16
    sizes = [log[f"region{i}_size"][row] for i in range(5)]
    _, drawn = np.unique(data[:, 12:], axis=0, return_counts=True)
    assert sorted(drawn) == sorted(sizes)
    np.testing.assert_allclose(np.abs(data[:, :12].copy().view("<f4")).max(axis=1), 0.05, rtol=1e-6)


def test_a_missing_extra_is_named_before_anything_is_written(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(
        InvalidArgumentError, match=r"run.mcap needs mcap .*'drake_pregrasp\[interfaces\]'"
    ):
        short_run("a_base", tmp_path, mcap=True)
    assert not list(tmp_path.iterdir())
