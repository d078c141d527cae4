"""Correction of an estimate by touch: laws of a least-squares fit with a prior."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_pregrasp.geometry.rotations import rotation_matrix
from drake_pregrasp.grasping.touch_correction import (
    LARGEST_SHIFT,
    LARGEST_TURN,
    corrected_pose,
    is_settled,
    limited_offset,
    touch_correction,
    touch_rows,
)

N = 5
gaps_of_all = st.lists(st.floats(-0.02, 0.02), min_size=N, max_size=N).map(np.array)
masks = st.lists(st.booleans(), min_size=N, max_size=N).map(np.array)
arms = st.lists(st.floats(-0.05, 0.05), min_size=N, max_size=N).map(np.array)
turns = st.floats(-np.pi, np.pi)


def rows_of(azimuths, arm):
    return np.column_stack([np.cos(azimuths), np.sin(azimuths), np.broadcast_to(arm, N)])


AROUND = 2 * np.pi * np.arange(N) / N
NONE = np.zeros(3)


def test_rows_are_displacements_of_the_surface_along_its_normals():
    rng = np.random.default_rng(0)
    R_WG, p_CoMT = rotation_matrix(rng.normal(size=3)), 0.05 * rng.normal(size=(N, 3))
    nhat = rotation_matrix(rng.normal(size=3))[np.arange(N) % 3]
    for change in 1e-5 * np.eye(3):
        R, p = corrected_pose(R_WG, NONE, NONE, change)
        moved = p_CoMT @ (R - R_WG).T + p
        along = np.sum(moved * (nhat @ R_WG.T), axis=1)
        np.testing.assert_allclose(touch_rows(p_CoMT, nhat, R_WG) @ change, along, atol=1e-10)


@given(gaps_of_all, arms)
def test_without_touch_nothing_is_corrected(gaps, arm):
    assert not touch_correction(gaps, rows_of(AROUND, arm), np.zeros(N, dtype=bool), NONE).any()


@given(gaps_of_all, arms, masks, st.floats(-0.02, 0.02))
def test_gaps_of_fingers_that_do_not_touch_do_not_matter(gaps, arm, touching, other):
    rows = rows_of(AROUND, arm)
    changed = np.where(touching, gaps, other)
    np.testing.assert_allclose(
        touch_correction(changed, rows, touching, NONE),
        touch_correction(gaps, rows, touching, NONE),
        atol=1e-15,
    )


@given(st.floats(0.001, 0.02), st.floats(0.0, 0.01), turns, st.floats(-0.05, 0.05))
def test_one_touch_moves_the_surface_to_the_fingertip_and_a_farther_one_moves_it_farther(
    gap, more, azimuth, arm
):
    rows, first = rows_of(azimuth + AROUND, arm), np.arange(N) == 0
    moved, farther = (
        rows[0] @ touch_correction(np.full(N, size), rows, first, NONE)
        for size in (gap, gap + more)
    )
    assert 0.98 * gap <= moved <= gap
    assert farther - moved == pytest.approx(more * moved / gap, abs=1e-12)


@given(gaps_of_all, arms, masks, turns)
def test_a_turned_scene_has_a_turned_correction(gaps, arm, touching, turn):
    x, y, yaw = touch_correction(gaps, rows_of(AROUND, arm), touching, NONE)
    turned = touch_correction(gaps, rows_of(AROUND + turn, arm), touching, NONE)
    c, s = np.cos(turn), np.sin(turn)
    np.testing.assert_allclose(turned, [c * x - s * y, s * x + c * y, yaw], atol=1e-12)


@given(st.floats(-0.02, 0.02), turns, st.floats(-0.05, 0.05))
def test_touches_from_opposite_sides_cancel(gap, azimuth, arm):
    rows = rows_of(azimuth + np.pi * np.arange(N), [arm, -arm, arm, -arm, 0.0])
    touching = np.arange(N) < 2
    assert touch_correction(np.full(N, gap), rows, touching, NONE) == pytest.approx(
        np.zeros(3), abs=1e-12
    )


@given(st.floats(-0.02, -0.002), turns, st.floats(-0.05, 0.05))
def test_a_finger_inside_that_feels_nothing_moves_the_surface_like_a_less_certain_touch(
    gap, azimuth, arm
):
    rows, first, gaps = rows_of(azimuth + AROUND, arm), np.arange(N) == 0, np.full(N, gap)
    by_touch = rows[0] @ touch_correction(gaps, rows, first, NONE)
    found = rows[0] @ touch_correction(gaps, rows, np.zeros(N, dtype=bool), NONE, first)
    assert gap <= by_touch < found < 0.8 * gap


@pytest.mark.parametrize("depth", [0.003, 0.01])
def test_a_finger_beyond_an_edge_does_not_turn_an_object_that_others_touch(depth):
    """Two fingers and a thumb touch opposite faces; a third finger is in front of the same face."""
    normals = np.array([[1, 0], [1, 0], [1, 0], [-1, 0], [0, 1]])
    rows = np.column_stack([normals, [0.03, 0.005, -0.03, 0.0, 0.0]])
    gaps = np.where(np.arange(N) == 2, -depth, 0.0)
    touching, inside = np.isin(np.arange(N), [0, 1, 3]), np.arange(N) == 2
    change = touch_correction(gaps, rows, touching, NONE, inside)
    assert np.max(np.abs((rows @ change)[touching])) < 0.1 * depth
    # A finger that touched there would turn it by more.
    turned = touch_correction(gaps, rows, touching | inside, NONE)
    assert abs(change[2]) < 0.5 * abs(turned[2])


@given(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(-0.15, 0.15), arms)
def test_a_displaced_object_is_found_by_touches_from_all_sides(x, y, yaw, arm):
    arm = arm + 0.03 * np.array([1, -1, 1, -1, 0])
    rows = rows_of(AROUND, arm)
    found = touch_correction(rows @ [x, y, yaw], rows, np.ones(N, dtype=bool), NONE)
    assert np.max(np.abs(rows @ (found - [x, y, yaw]))) < 1e-3


@given(gaps_of_all, arms, masks, st.floats(1e-4, 1e-2), st.integers(1, 200))
def test_an_offset_moves_by_limited_steps_within_its_bounds(gaps, arm, touching, step, count):
    rows, offset = rows_of(AROUND, arm), np.zeros(3)
    for _ in range(count):
        before, change = offset, touch_correction(10 * gaps, rows, touching, offset)
        offset = limited_offset(before, change, step)
        assert np.hypot(*(offset - before)[:2]) <= step + 1e-12
        assert np.hypot(*offset[:2]) <= LARGEST_SHIFT + 1e-12
        assert abs(offset[2]) <= LARGEST_TURN
    assert is_settled(np.zeros(3))
    assert not is_settled(np.array([0.003, 0.0, 0.0]))


@given(gaps_of_all, arms, masks, st.floats(1e-3, 1e-2))
def test_in_many_steps_an_offset_goes_no_farther_than_in_one(gaps, arm, touching, step):
    rows, offset = rows_of(AROUND, arm), NONE
    whole = touch_correction(gaps, rows, touching, NONE)
    for _ in range(200):
        left = gaps - rows @ offset
        offset = limited_offset(offset, touch_correction(left, rows, touching, offset), step)
    near = limited_offset(NONE, whole, np.inf)
    assert is_settled(offset - near)


@given(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(-0.3, 0.3), turns)
def test_an_offset_displaces_the_centre_of_mass_and_turns_the_object_about_it(x, y, yaw, azimuth):
    p_OCoM, p_WO = np.array([0.02, -0.01, 0.05]), np.array([0.1, 0.2, 0.3])
    R_WO = rotation_matrix(np.array([0.0, 0.0, azimuth]))
    R, p = corrected_pose(R_WO, p_WO, p_OCoM, np.array([x, y, yaw]))
    np.testing.assert_allclose(R, rotation_matrix(np.array([0.0, 0.0, azimuth + yaw])), atol=1e-12)
    np.testing.assert_allclose(p + R @ p_OCoM - p_WO - R_WO @ p_OCoM, [x, y, 0.0], atol=1e-12)
