"""A hand that knows the object from a camera and from touches alone."""

import numpy as np
import pytest
from simulation_runs import points, run_log, run_text

from drake_pregrasp import TrackingStatus, load_scenario, resolve


@pytest.mark.slow
def test_a_hand_lifts_what_it_sees_and_feels(tmp_path):
    """The table tells the height of a misplaced camera at once, and touches tell the rest."""
    bias = load_scenario("see_and_feel").depth_sensor.cameras[0].bias
    result = run_text("see_and_feel", "random_seed: 3", tmp_path)
    log = run_log(result)
    errors = points(log, "wo_estimated") - points(log, "wo")
    np.testing.assert_allclose(errors[40], [*bias[:2], 0.0], atol=1e-3)
    np.testing.assert_allclose(errors[-1, :2], 0.0, atol=1e-3)
    assert log["tracking_status"][-1] == TrackingStatus.TRACKING
    grasp = result.summary["grasp"]
    assert grasp["phase"] == "hold"
    assert grasp["lift_height_mm"] > 90
    assert grasp["moved_closing_mm"] < 2


@pytest.mark.slow
@pytest.mark.parametrize("name", ["see_by_profile", "feel_wrong_scale"])
def test_touch_corrects_a_pose_sensor_and_a_wrong_mesh_does_no_harm(name, tmp_path):
    result = run_text(name, "random_seed: 3", tmp_path)
    log = run_log(result)
    errors = points(log, "wo_estimated") - points(log, "wo")
    np.testing.assert_allclose(errors[-1], 0.0, atol=2.5e-3)
    assert result.summary["grasp"]["phase"] == "hold"
    assert result.summary["grasp"]["moved_closing_mm"] < 2


@pytest.mark.slow
def test_a_hand_takes_a_box_that_it_sees_a_person_bring(tmp_path):
    """Of the pose, the position is compared: the box looks the same after a quarter turn."""
    text = "simulation_duration: 20.0, grasp: {shake: true}"
    result = run_text("see_handed_over", text, tmp_path)
    assert result.summary["grasp"]["held"] is True
    log = run_log(result)
    errors = np.linalg.norm(points(log, "wo_estimated") - points(log, "wo"), axis=1)
    assert np.max(errors[log["time"] > 3.0]) < 3e-3
    assert np.all(log["tracking_status"][log["time"] > 3.0] == TrackingStatus.TRACKING)


@pytest.mark.slow
def test_a_wrong_mesh_has_another_size_than_the_object():
    resolved = resolve(load_scenario("feel_wrong_scale"))
    true, seen = resolved.shape.mesh.extents, resolved.seen_solid.corners
    np.testing.assert_allclose(np.ptp(seen, axis=0), 1.02 * true)
    assert resolve(load_scenario("a_base")).seen_solid is None
