import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.estimation import recorded_poses
from drake_pregrasp.estimation.recorded_poses import RecordedPoses, read_recorded_poses
from drake_pregrasp.resources import resource_folder

HEADER = "time,x,y,z,qw,qx,qy,qz\n"
GOOD = "0,1,2,3,1,0,0,0\n"


def read(tmp_path, text):
    file = tmp_path / "poses.csv"
    file.write_bytes(text.encode() if isinstance(text, str) else text)
    return read_recorded_poses(file)


@pytest.mark.parametrize(
    "text",
    [
        HEADER + GOOD + "0.5,1e-1,-2,0,0,0,0,-1\n\n",
        "\ufefftime, qz,qy,qx,qw,z,y,x,note\r\n0,0,0,0,1,3,2,1,here\r\n.5,-1,0,0,0,0,-2,.1,me\r\n",
    ],
)
def test_rows_become_poses_whatever_the_order_of_the_columns(tmp_path, text):
    track = read(tmp_path, text)
    np.testing.assert_array_equal(track.times, [0, 0.5])
    np.testing.assert_array_equal(track.p_WO, [[1, 2, 3], [0.1, -2, 0]])
    expected = [np.eye(3), np.diag([-1, -1, 1])]
    np.testing.assert_allclose(track.R_WO.as_matrix(), expected, atol=1e-15)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "row 1: lacks the column time; the header must be time,x,y,z,qw,qx,qy,qz"),
        ("time,x,y,qw,qx,qy,qz\n", "row 1: lacks the column z"),
        (HEADER, "has no poses; at least one row must follow"),
        (HEADER + GOOD + "1,2,3\n", "row 3: has 3 cells; the header has 8"),
        (HEADER + "0,1,two,3,1,0,0,0\n", "row 2, column y: 'two' must be a finite number"),
        (HEADER + "0,1,,3,1,0,0,0\n", "row 2, column y: '' must be a finite number"),
        (HEADER + "0,1,2,nan,1,0,0,0\n", "row 2, column z: 'nan' must be a finite number"),
        (HEADER + "0,1,2,3,inf,0,0,0\n", "row 2, column qw: 'inf' must be a finite number"),
        (HEADER + GOOD + GOOD, "row 3, column time: 0 must be more than 0 before it"),
        (HEADER + "1.7e18,1,2,3,1,0,0,0\n", "column time: 1.7e+18 s is more than 1e+10 s from 0"),
        (HEADER + "0,1,2,350,1,0,0,0\n", "column z: 350 m is more than 100 m away; positions"),
        (HEADER + "0,1,2,3,0,0,0,0\n", "columns qw to qz: a quaternion of length 0 must have"),
        (HEADER + "0,1,2,3,1,0.2,0,0\n", "a quaternion of length 1.02 must have length 1"),
        (HEADER + "0,1_0,2,3,1,0,0,0\n", "row 2, column x: '1_0' must be a finite number"),
        (HEADER + "0,١,2,3,1,0,0,0\n", "row 2, column x: '١' must be a finite number"),
        ("time," + HEADER + "9," + GOOD, "row 1: has the column time more than once"),
        (b"\xff\xfe\x00", "cannot be read"),
        (HEADER + 'a"' + "b" * 200_000 + "\n", "row 2: has more than 10000 characters"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path, text, problem):
    with pytest.raises(InvalidArgumentError) as caught:
        read(tmp_path, text)
    assert str(caught.value).startswith(str(tmp_path / "poses.csv"))
    assert problem in str(caught.value)
    assert "\n" not in str(caught.value)


def test_poses_by_another_clock_are_refused_since_the_object_would_stand_still(tmp_path):
    for start, is_used in ((-5.0, False), (-1.9, True), (0.0, True), (99.0, True), (1.7e9, False)):
        rows = f"{start},0,0,0,1,0,0,0\n{start + 2},1,0,0,1,0,0,0\n"
        track = read(tmp_path, HEADER + rows)
        if is_used:
            track.check_moves_within(10.0)
        else:
            with pytest.raises(InvalidArgumentError, match="times count from the start of the run"):
                track.check_moves_within(10.0)
    read(tmp_path, HEADER + "99,0,0,0,1,0,0,0\n").check_moves_within(10.0)  # It stands still.


def test_files_that_are_not_there_or_too_long_are_refused(tmp_path, monkeypatch):
    with pytest.raises(InvalidArgumentError, match="cannot be read"):
        read_recorded_poses(tmp_path / "none.csv")
    monkeypatch.setattr(recorded_poses, "MAX_ROWS", 2)
    rows = [f"{k},0,0,0,1,0,0,0\n" for k in range(3)]
    assert len(read(tmp_path, HEADER + "".join(rows[:2])).times) == 2
    with pytest.raises(InvalidArgumentError, match="more than 2 rows"):
        read(tmp_path, HEADER + "".join(rows))


@given(st.floats(-1, 5))
def test_between_poses_the_object_moves_and_turns_steadily(time):
    times = np.array([0.0, 1.0, 3.0])
    p = np.array([[0.0, 0, 0], [1, 2, 3], [-1, 0, 4]])
    R = Rotation.from_rotvec([[0, 0, 0], [0.5, 1, 0], [2, -1, 1]])
    p_WO, R_WO = RecordedPoses(times, p, R).at(time)
    np.testing.assert_allclose(
        p_WO, [np.interp(time, times, p[:, axis]) for axis in range(3)], atol=1e-12
    )
    expected = Slerp(times, R)(np.clip(time, 0, 3))
    np.testing.assert_allclose(R_WO.as_matrix(), expected.as_matrix(), atol=1e-12)


def test_the_shipped_stream_is_what_its_formula_says():
    track = read_recorded_poses(resource_folder("models") / "carried_by_hand.csv")
    s = track.times / 6
    swell = np.sin(np.pi * s) ** 2
    np.testing.assert_allclose(track.p_WO[:, 0], 0.4 * swell * np.cos(2 * np.pi * s), atol=1e-6)
    np.testing.assert_allclose(track.p_WO[:, 1], 0.25 * np.sin(2 * np.pi * s), atol=1e-6)
    tremor = 0.01 * np.sin(3 * np.pi * track.times) * np.sin(np.pi * s)
    np.testing.assert_allclose(track.p_WO[:, 2], 0.25 + 0.15 * swell + tremor, atol=1e-6)
    angles = [2 * swell, 0.3 * np.sin(2 * np.pi * s), 0.25 * np.sin(4 * np.pi * s)]
    expected = Rotation.from_euler("ZYX", np.column_stack(angles))
    assert np.max((expected.inv() * track.R_WO).magnitude()) < 1e-5
