"""Sliders and buttons of a live run in Meshcat."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.geometry import Meshcat

from drake_pregrasp.config.object_config import Conveyor, PoseStream
from drake_pregrasp.errors import OutputError
from drake_pregrasp.live.live_run import LiveRun
from drake_pregrasp.simulation.scenario import Scenario

_SMALLEST_STD = 1e-5  # Noise that the estimator assumes at least, in metres and radians.
_IDLE = 0.02  # Seconds between looks at the controls while the run is paused.


@dataclass(frozen=True)
class Slider:
    """A slider: its name and range, and functions that read and apply its value."""

    name: str
    low: float
    high: float
    step: float
    value: Callable[[Scenario], float]
    apply: Callable[[LiveRun, float], None]


def _setting(name: str, low: float, high: float, step: float, *fields: str, unit: float) -> Slider:
    """Returns a slider for one field or more of a scenario, in a unit of its own."""

    def value(scenario: Scenario) -> float:
        return float(attrgetter(fields[0])(scenario)) / unit

    def apply(run: LiveRun, new: float) -> None:
        def edit(scenario: Scenario) -> None:
            for field in fields:
                owner, _, key = field.rpartition(".")
                is_std_of_estimator = "estimator" in owner and key.endswith("_std")
                least = _SMALLEST_STD if is_std_of_estimator else 0.0
                setattr(attrgetter(owner)(scenario), key, max(new * unit, least))

        run.change(edit)

    return Slider(name, low, high, step, value, apply)


def _velocity(name: str, limit: float, which: str, *, unit: float) -> Slider:
    """Returns a slider for the `linear` or the `angular` velocity of the conveyor."""

    def value(scenario: Scenario) -> float:
        assert isinstance(scenario.motion, Conveyor)
        _, linear, angular = scenario.motion.velocities()[-1]
        return {"linear": linear, "angular": angular}[which] / unit

    def apply(run: LiveRun, new: float) -> None:
        run.set_velocity(**{which: new * unit})

    return Slider(name, -limit, limit, 1, value, apply)


def _set_rate(run: LiveRun, rate: float) -> None:
    def edit(scenario: Scenario) -> None:
        scenario.planner.period = 1 / rate
        if isinstance(scenario.motion, Conveyor) and not scenario.has_hand:
            # Ticks are at time steps of the plant, which are not longer than by default.
            steps = np.ceil(scenario.planner.period / Scenario().plant_config.time_step)
            scenario.plant_config.time_step = float(scenario.planner.period / steps)

    run.change(edit)


_DEGREE = float(np.pi / 180)
_VELOCITIES = (
    _velocity("speed [mm/s]", 100, "linear", unit=1e-3),
    _velocity("turn rate [deg/s]", 60, "angular", unit=_DEGREE),
)
_POSITION_STD = ("sensor.position_std", "planner.estimator.position_std")
_ORIENTATION_STD = ("sensor.orientation_std", "planner.estimator.orientation_std")
_SETTINGS = (
    _setting("noise [mm]", 0, 10, 0.1, *_POSITION_STD, unit=1e-3),
    _setting("noise [deg]", 0, 5, 0.1, *_ORIENTATION_STD, unit=_DEGREE),
    Slider("planning rate [Hz]", 5, 50, 5, lambda s: 1 / s.planner.period, _set_rate),
    _setting("spread [mm]", 1, 100, 1, "planner.position_spread", unit=1e-3),
)
_LOOKAHEAD = _setting("look-ahead [ms]", 0, 500, 10, "planner.estimator.lookahead", unit=1e-3)


class LiveControls:
    """Connects sliders and buttons in Meshcat with a live run.

    Args:
        run: The live run.
        meshcat: Its viewer.
        out: Folder for saved recordings.
    """

    def __init__(self, run: LiveRun, meshcat: Meshcat, *, out: Path) -> None:
        self._run, self._meshcat, self._out = run, meshcat, out
        self.is_paused, self.is_stopped = False, False
        scenario = run.scenario
        sliders = [*(_VELOCITIES if isinstance(scenario.motion, Conveyor) else ()), *_SETTINGS]
        if not scenario.has_hand:  # A hand looks ahead itself.
            sliders.append(_LOOKAHEAD)
        self._sliders = {slider.name: slider for slider in sliders}
        self._buttons: dict[str, Callable[[], object]] = {
            "pause / resume": self._switch_pause,
            "step": self._step,
            "reset": self._reset,
            "next strategy": run.next_strategy,
            "object: hide / show": run.switch_sight,
        }
        for contact in range(run.num_contacts):
            label = f"finger {contact}: lose / give back"
            self._buttons[label] = partial(run.switch_finger, contact)
        if not isinstance(scenario.motion, PoseStream):  # A replayed object goes on its way.
            self._buttons["object: nudge"] = run.nudge
        if scenario.has_hand:
            self._buttons["hand: close"] = run.close
        self._buttons |= {"save the recording": self._save, "stop": self._stop}
        self._add()

    def serve(self, should_stop: Callable[[], bool] = lambda: False) -> None:
        """Runs until somebody stops it, in the page or with `should_stop`."""
        while not (self.is_stopped or should_stop()):
            self.apply()
            if not self.is_paused and self._run.time >= self._run.end:
                self._run.timeline.tell("end of the scenario: reset, or resume")
                self.is_paused, self._run.end = True, float("inf")
            if self.is_paused:
                time.sleep(_IDLE)
            else:
                self._run.advance()

    def apply(self) -> None:
        """Applies what was moved and pressed since the last time."""
        for name, slider in self._sliders.items():
            value = self._meshcat.GetSliderValue(name)
            if value != self._values[name]:
                self._values[name] = value
                slider.apply(self._run, value)
        for name, action in self._buttons.items():
            before, self._clicks[name] = self._clicks[name], self._meshcat.GetButtonClicks(name)
            for _ in range(self._clicks[name] - before):
                action()

    def timeline(self) -> dict[str, Any]:
        """Returns what the page shows now."""
        run = self._run
        pace = "paused" if self.is_paused else f"{run.rate:.2f} × real time"
        return run.timeline.now() | {"note": f"{pace}, strategy {run.scenario.planner.strategy}"}

    def _add(self) -> None:
        scenario, add = self._run.scenario, self._meshcat.AddSlider
        self._values = {
            s.name: add(s.name, s.low, s.high, s.step, s.value(scenario))
            for s in self._sliders.values()
        }
        for name in self._buttons:
            self._meshcat.AddButton(name)
        self._clicks = dict.fromkeys(self._buttons, 0)

    def _switch_pause(self) -> None:
        self.is_paused = not self.is_paused
        self._run.keep_pace()

    def _step(self) -> None:
        self.is_paused = True
        self._run.advance()

    def _reset(self) -> None:
        self.is_paused = False
        self._run.reset()

    def _stop(self) -> None:
        self.is_stopped = True

    def _save(self) -> None:
        self._meshcat.DeleteAddedControls()  # The recording has no use for them.
        try:
            told = f"saved in {self._run.save(self._out)}"
        except OutputError as error:
            told = str(error)
        self._add()
        self._run.timeline.tell(told)
