"""Exported motion and postures of a grasp, and their test in MuJoCo."""

import numpy as np
import pytest

from drake_pregrasp import InvalidArgumentError, load_resolved
from drake_pregrasp.cli import main
from drake_pregrasp.grasping.grasp_state import GraspPhase
from drake_pregrasp.simulation.grasp_export import (
    POSTURES,
    export_grasp,
    posture_ticks,
    read_postures,
)
from drake_pregrasp.simulation.posture_test import FORCE, MASS, posture_test

TRACK, CLOSE, SQUEEZE = GraspPhase.TRACK, GraspPhase.CLOSE, GraspPhase.SQUEEZE
LIFT, HOLD = GraspPhase.LIFT, GraspPhase.HOLD


@pytest.fixture(scope="module")
def grasp():
    return load_resolved("grasp_five_finger", text="{simulation_duration: 7.5}")


@pytest.fixture(scope="module")
def exported(grasp, tmp_path_factory):
    """Arrays of a grasp, and their file."""
    path = tmp_path_factory.mktemp("export") / "grasp.npz"
    return export_grasp(grasp, path), path


pytestmark = pytest.mark.slow


def test_the_commanded_motion_is_that_of_every_control_tick(grasp, exported):
    arrays, path = exported
    assert len(arrays["time"]) == round(7.5 / grasp.scenario.grasp.period) + 1
    speed = np.gradient(arrays["q_desired"], arrays["time"], axis=0)
    assert np.median(np.abs(speed - arrays["v_desired"])) < 0.01
    error = np.abs(arrays["q_desired"] - arrays["q"])[arrays["phase"] <= GraspPhase.TRACK]
    assert np.max(error[50:]) < 0.03
    with np.load(path, allow_pickle=False) as file:
        assert {name: file[name].shape for name in file} == {k: v.shape for k, v in arrays.items()}


def test_the_palm_comes_to_the_object_and_goes_with_it(grasp, exported):
    arrays, _ = exported
    p_OP = [arrays[f"{name}_X_WP"][:3] - arrays[f"{name}_X_WO"][:3] for name in POSTURES]
    np.testing.assert_allclose(p_OP, np.broadcast_to(p_OP[0], (3, 3)), atol=0.01)
    np.testing.assert_allclose(arrays["vertices"], grasp.shape.mesh.vertices)
    assert arrays["joint_names"].tolist()[:4] == ["x", "y", "z", "yaw"]


def test_postures_hold_in_six_directions_but_not_with_an_open_hand(grasp, exported):
    pytest.importorskip("mujoco", reason="needs the extra mujoco")
    postures = read_postures(exported[1])
    results = posture_test(grasp, postures)
    assert all(result.held for result in results)
    assert sorted(np.sum([r.direction for r in results], axis=0)) == [0, 0, 0]
    opened = postures | {f"{name}_q": postures["pregrasp_q"] for name in POSTURES}
    *_, down, _ = posture_test(grasp, opened)
    # Nothing is under the object, so the force accelerates it for two seconds.
    assert not down.held
    assert down.moved == pytest.approx(FORCE / MASS * 2.0**2 / 2, rel=1e-3)


@pytest.mark.parametrize(
    ("phase", "ticks"),
    [
        ([TRACK, TRACK, CLOSE, CLOSE, SQUEEZE, LIFT, HOLD], (1, 4, 5)),
        ([TRACK, CLOSE, TRACK, TRACK, CLOSE, SQUEEZE, SQUEEZE, LIFT], (3, 5, 7)),
        ([TRACK, CLOSE, SQUEEZE, TRACK, CLOSE, SQUEEZE, LIFT, HOLD], (3, 5, 6)),
        ([CLOSE, CLOSE, SQUEEZE, LIFT], (0, 2, 3)),
        ([TRACK, CLOSE, SQUEEZE, LIFT, TRACK, CLOSE, SQUEEZE, LIFT], (0, 2, 3)),
    ],
)
def test_postures_are_those_of_the_attempt_that_lifts(phase, ticks):
    assert posture_ticks(np.array(phase, dtype=float)) == ticks


def test_postures_of_another_hand_are_refused(grasp, exported):
    pytest.importorskip("mujoco", reason="needs the extra mujoco")
    postures = read_postures(exported[1])
    with pytest.raises(InvalidArgumentError, match="joints"):
        posture_test(grasp, postures | {"grasp_q": postures["grasp_q"][:-1]})


def test_a_hand_that_lifts_nothing_has_no_grasp(grasp, tmp_path):
    resolved = load_resolved("grasp_five_finger", text="{simulation_duration: 1.0}")
    with pytest.raises(InvalidArgumentError, match="no grasp to export"):
        export_grasp(resolved, tmp_path / "grasp.npz")


@pytest.mark.parametrize("content", [b"", b"no arrays", b"PK\x03\x04", b"\x93NUMPY\x01\x00"])
def test_another_file_is_refused_in_one_line(content, tmp_path):
    path = tmp_path / "grasp.npz"
    path.write_bytes(content)
    with pytest.raises(InvalidArgumentError, match=r"grasp\.npz: is no file of drake-pregrasp"):
        read_postures(path)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"squeeze_q": np.zeros(1_000_000)}, "squeeze_q has 8000128 bytes; at most 100000"),
        ({"squeeze_q": np.zeros((2, 2))}, "squeeze_q must be a vector of finite numbers"),
        ({"squeeze_q": np.array([np.nan])}, "squeeze_q must be a vector of finite numbers"),
        ({"squeeze_q": np.array(["two"])}, "is no file of drake-pregrasp export"),
        ({"squeeze_q": np.array([None])}, "is no file of drake-pregrasp export"),
        ({"squeeze_q": np.zeros(2, dtype="f8,i4")}, "is no file of drake-pregrasp export"),
        ({"squeeze_X_WO": np.zeros(2)}, "squeeze_X_WO must be x, y, z and a unit quaternion"),
        ({"squeeze_X_WO": np.zeros(7)}, "squeeze_X_WO must be x, y, z and a unit quaternion"),
    ],
)
def test_other_arrays_are_refused_in_one_line(change, problem, tmp_path):
    arrays = {f"{name}_q": np.zeros(3) for name in POSTURES}
    arrays |= {f"{name}_X_WO": np.array([0, 0, 0, 1, 0, 0, 0]) for name in POSTURES}
    path = tmp_path / "grasp.npz"
    np.savez_compressed(path, **arrays)
    assert read_postures(path).keys() == arrays.keys()
    np.savez_compressed(path, **arrays | change)
    with pytest.raises(InvalidArgumentError, match=problem) as error:
        read_postures(path)
    assert "grasp.npz" in str(error.value)
    assert "\n" not in str(error.value)


def test_commands_export_and_replay_a_run(tmp_path, capsys):
    pytest.importorskip("mujoco", reason="needs the extra mujoco")
    out, text = ["--out", str(tmp_path)], ["--scenario_text", "{simulation_duration: 7.5}"]
    assert main(["export", "grasp_five_finger", *text, *out]) == 0
    folder = tmp_path / "grasp_five_finger"
    assert (folder / "grasp.npz").is_file()
    assert main(["replay", str(folder), "--postures"]) == 0
    assert "postures    hold" in capsys.readouterr().out
    assert main(["replay", str(folder), *out]) == 0
    assert "verdicts    agree" in capsys.readouterr().out
    assert (tmp_path / "grasp_five_finger-mujoco" / "grasp.csv").is_file()
    assert main(["replay", str(tmp_path)]) == 2
    assert "is no run folder" in capsys.readouterr().err
