"""How long a run may be, so that its log and its recording have an end."""

from drake_pregrasp.errors import ScenarioError
from drake_pregrasp.planning.surface import ObjectSurface
from drake_pregrasp.simulation.scenario import Scenario

MAX_TICKS = 5_000_000
"""Planning ticks of a run, and control ticks of its hand: each is a row of a log."""

MAX_STEPS = 100_000_000
"""Time steps of its plant."""

MAX_FRAMES = 100_000
"""Frames of its recording, which is kept in memory."""

MAX_TILES = 100_000
"""Tiles that its recording draws regions with."""


def check_size(source: str, scenario: Scenario) -> None:
    """Raises a `ScenarioError` if a run is too long.

    Args:
        source: Where the scenario is from, for the message.
        scenario: Loaded, with keys and types checked.
    """
    duration = scenario.simulation_duration
    checks = [
        ("planner.period", scenario.planner.period, MAX_TICKS, "ticks"),
        ("plant_config.time_step", scenario.plant_config.time_step, MAX_STEPS, "steps"),
    ]
    if scenario.grasp.has_hand:
        checks.append(("grasp.period", scenario.grasp.period, MAX_TICKS, "ticks"))
    for key, period, most, what in checks:
        _check_number(source, key, period, duration / period, most, what)


def check_recording(source: str, scenario: Scenario, surface: ObjectSurface) -> None:
    """Raises a `ScenarioError` if a run is too much to record.

    Args:
        source: Where the scenario is from, for the message.
        scenario: Loaded, with keys and types checked.
        surface: The object's.
    """
    period, tile = scenario.recording.publish_period, scenario.recording.tile_size
    frames = scenario.simulation_duration / period
    _check_number(source, "recording.publish_period", period, frames, MAX_FRAMES, "frames")
    tiles = float(surface.areas.sum()) / tile**2
    _check_number(source, "recording.tile_size", tile, tiles, MAX_TILES, "tiles")


def _check_number(source: str, key: str, value: float, count: float, most: int, what: str) -> None:
    if count > most:
        problem = f"{value:g} makes {count:.3g} {what}, at most {most}; choose a larger one"
        raise ScenarioError(source, key, f"{problem}, or a shorter simulation_duration")
