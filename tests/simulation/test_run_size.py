"""Limits on the size of runs, recordings and samples."""

import pytest

from drake_pregrasp import ScenarioError, box_surface, load_resolved, load_scenario, resolve
from drake_pregrasp.config.surface_config import MAX_BOX_POINTS
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.box_surface import MAX_POINTS
from drake_pregrasp.simulation.scenario_check import check_recording


def test_a_recording_that_is_too_large_is_refused():
    scenario = load_scenario("a_base")
    surface = resolve(scenario).surface
    check_recording("scenario", scenario, surface)
    scenario.recording.publish_period = 1e-4
    with pytest.raises(ScenarioError, match=r"publish_period: 0.0001 makes 6e\+05 frames"):
        check_recording("scenario", scenario, surface)
    scenario.recording.publish_period, scenario.recording.tile_size = 0.05, 1e-4
    with pytest.raises(ScenarioError, match=r"recording.tile_size: 0.0001 makes 4e\+06 tiles"):
        check_recording("scenario", scenario, surface)


def test_points_of_a_box_are_counted_before_they_are_made():
    for spacings in ({"spacing": 1e-9}, {"spacing": 0.01, "forbidden_spacing": 1e-200}):
        with pytest.raises(InvalidArgumentError, match=f"at most {MAX_POINTS}; choose a larger"):
            box_surface([0.1, 0.1, 0.1], **spacings)
    with pytest.raises(InvalidArgumentError, match="at most 100;"):
        box_surface([0.1, 0.1, 0.1], spacing=0.01, max_points=100)
    text = "{object: {size: [0.25, 0.25, 0.25]}, surface: {spacing: 0.001}}"
    with pytest.raises(ScenarioError, match=rf"surface.spacing: .* at most {MAX_BOX_POINTS};"):
        load_resolved("a_base", text=text)
