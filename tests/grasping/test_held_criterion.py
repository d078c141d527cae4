"""An object is held if it keeps its place in every part of the grasp, and through a shake."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from drake_pregrasp.grasping.grasp_state import GraspPhase
from drake_pregrasp.grasping.held_criterion import (
    HOLD_DURATION,
    LARGEST_DEG,
    LARGEST_MM,
    PARTS,
    SHAKE,
    SHAKE_END,
    SHAKE_PERIOD,
    GraspTicks,
    held_measures,
    part_moved,
    shake_force,
)

CLOSE, TOUCH, LIFT, HOLD = 2.0, 3.0, 3.5, 4.5
TIME = np.arange(0.0, HOLD + SHAKE_END + 0.005, 0.02)
STARTS = dict(zip(PARTS, (0.0, CLOSE, TOUCH, LIFT, HOLD, HOLD + HOLD_DURATION), strict=True))
P_OCOM = np.array([0.01, -0.02, 0.03])


def poses(p, R):
    return np.hstack([p, np.roll(R.as_quat(), 1, axis=1)])


def measures(*, mm=0.0, deg=0.0, drift=0.0, since=np.inf, until=TIME[-1], **options):
    """Measures of an object that is off its place by a distance and an angle from a time on.

    A belt carries it on a curve, and the hand lifts it along another one.
    """
    time = TIME[until + 1e-9 >= TIME]
    phases = np.select(
        [time < 2.2, time < TOUCH, time < LIFT, time < HOLD],
        [GraspPhase.TRACK, GraspPhase.CLOSE, GraspPhase.SQUEEZE, GraspPhase.LIFT],
        GraspPhase.HOLD,
    )
    begun = np.select([time < 2.2, time < TOUCH, time < LIFT, time < HOLD], [0, 2.2, 3, 3.5], HOLD)
    R_WD = Rotation.from_rotvec(np.outer(np.minimum(time, LIFT), [0.0, 0.0, 0.3]))
    p_WD = np.outer(np.minimum(time, LIFT), [0.05, 0.01, 0.0])
    R_WG = R_WD * Rotation.from_euler("zx", [0.4, 0.2])
    p_WG = p_WD + np.outer(np.clip(time - LIFT, 0, 1), [0.0, 0.0, 0.1])
    offset = mm * (time >= since - 1e-9) + drift * np.maximum(time - HOLD, 0)
    turned = np.radians(deg) * (time >= since - 1e-9)
    R_WO = R_WG * Rotation.from_rotvec(np.outer(turned, [0.6, 0.0, 0.8]))
    p_GCoM = np.array([0.02, 0.01, 0.05]) + np.outer(1e-3 * offset, [0.0, 0.6, 0.8])
    p_WCoM = p_WG + R_WG.apply(p_GCoM)
    ticks = GraspTicks(
        time,
        options.pop("phases", phases),
        begun,
        poses(p_WCoM - R_WO.apply(P_OCOM), R_WO),
        options.pop("X_WD", poses(p_WD, R_WD)),
        poses(p_WG, R_WG),
    )
    how = {"is_carried": True, "falls": False, "shakes": True, **options}
    return held_measures(ticks, P_OCOM, CLOSE, **how)


def test_an_object_that_keeps_its_place_is_held():
    found = measures()
    assert found.pop("held") is True
    assert found.pop("slips_after_s") > 1e6
    np.testing.assert_allclose(list(found.values()), 0, atol=1e-4)


@pytest.mark.slow
@given(st.sampled_from(PARTS), st.floats(0.1, 20), st.floats(0.1, 20))
def test_what_moves_or_turns_is_seen_until_there_is_another_place_to_be_in(part, mm, deg):
    assume(abs(mm - LARGEST_MM) > 1e-6 and abs(deg - LARGEST_DEG) > 1e-5)  # Else rounding decides.
    found = measures(mm=mm, deg=deg, since=STARTS[part] + 0.1)
    after = PARTS[PARTS.index(part) :]
    place = next(p for p in (PARTS[:3], PARTS[3:5], PARTS[5:]) if part in p)
    for each in PARTS:
        off = each in after and each in place
        assert found[f"moved_{each}_mm"] == pytest.approx(mm * off, abs=1e-6)
        assert found[f"turned_{each}_deg"] == pytest.approx(deg * off, abs=1e-5)
    assert found["held"] == (mm <= LARGEST_MM and deg <= LARGEST_DEG)
    assert part_moved(found) == (None if found["held"] else part)


def test_it_is_held_only_once_the_shake_is_over_and_the_hand_has_not_opened():
    assert measures(until=TIME[-2])["held"] is None
    assert measures(shakes=False)["held"] is None
    assert measures(until=TIME[-2], mm=LARGEST_MM + 0.01, since=4.0)["held"] is False
    assert measures(until=1.0)["moved_closing_mm"] is None
    opened = np.where(TIME < CLOSE + 1, GraspPhase.TRACK, GraspPhase.BACK_OFF)
    assert measures(phases=opened)["held"] is False


def test_before_the_command_only_what_a_conveyor_carries_has_a_place():
    found = measures(mm=9.0, since=1.0, is_carried=False)
    assert (found["held"], found["moved_before_mm"]) == (True, None)
    assert not measures(mm=9.0, since=2.5, is_carried=False)["held"]


@pytest.mark.parametrize("part", PARTS[1:3])
def test_in_the_air_an_object_should_stay_in_the_frame_that_falls_with_it(part):
    still = poses(np.zeros((len(TIME), 3)), Rotation.from_rotvec(np.zeros((len(TIME), 3))))
    in_air = {"is_carried": False, "X_WD": still}
    assert measures(falls=False, **in_air)[f"moved_{part}_mm"] > LARGEST_MM
    found = measures(falls=True, **in_air)
    assert found["held"]
    assert found[f"moved_{part}_mm"] == pytest.approx(0, abs=1e-4)
    assert not measures(mm=9.0, since=STARTS[part] + 0.1, falls=True, **in_air)["held"]


@pytest.mark.slow
@given(st.floats(0.001, 0.4))
def test_a_drift_is_extrapolated(drift):
    found = measures(drift=drift)
    assert found["drift_mm_per_min"] == pytest.approx(60 * drift)
    assert found["slips_after_s"] == pytest.approx(LARGEST_MM / drift)
    short = measures(drift=drift, until=HOLD + 1.0)
    assert (short["drift_mm_per_min"], short["slips_after_s"]) == (None, None)


def test_the_shake_has_six_directions_and_no_steps():
    time = np.arange(0.0, SHAKE_END + 1.0, 1e-3)
    force = np.array([shake_force(t) for t in time])
    np.testing.assert_array_equal(force[(time < HOLD_DURATION) | (time > SHAKE_END)], 0)
    np.testing.assert_allclose(np.max(force, axis=0), SHAKE, rtol=1e-4)
    np.testing.assert_allclose(np.min(force, axis=0), -SHAKE, rtol=1e-4)
    assert np.all(np.sum(force != 0, axis=1) <= 1)
    assert np.abs(np.diff(force, axis=0)).max() < 1.01e-3 * SHAKE * 2 * np.pi / SHAKE_PERIOD
