"""Sliders and buttons of a live run in Meshcat."""

import dataclasses
import math
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial, reduce
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.geometry import Meshcat

from drake_pregrasp.config.object_config import Conveyor, PoseStream, Toss
from drake_pregrasp.errors import OutputError
from drake_pregrasp.live.live_run import LiveRun
from drake_pregrasp.simulation.scenario import Scenario

_IDLE = 0.02  # Seconds between looks at the controls while the run is paused.
_STEPS = 200  # Smallest number of steps of a slider.
_UNITS = {
    "mm": 1e-3,
    "ms": 1e-3,
    "mm/s": 1e-3,
    "m/s": 1.0,
    "deg": math.pi / 180,
    "deg/s": math.pi / 180,
}


@dataclass(frozen=True)
class Slider:
    """A slider of the fields that share a name, such as the noise of sensor and estimator.

    Attributes:
        name: Name and unit, as the page shows them.
        low: Lowest value, in the unit.
        high: Highest value, in the unit.
        step: Difference of two values next to each other, in the unit.
        unit: The unit in SI.
        fields: Dotted path of each field, with indices of lists, and its metadata.
    """

    name: str
    low: float
    high: float
    step: float
    unit: float
    fields: dict[str, Mapping[str, Any]]

    def value(self, scenario: Scenario) -> float:
        """Returns the value of the first field, or the magnitude of a vector, in the unit."""
        path = next(iter(self.fields))
        if (index := _velocity_index(path, scenario)) is not None:
            assert isinstance(scenario.motion, Conveyor)
            return scenario.motion.velocities()[-1][1 + index] / self.unit
        value = value_at(scenario, path)
        return float(np.linalg.norm(value) if isinstance(value, list) else value) / self.unit

    def apply(self, run: LiveRun, value: float) -> None:
        """Changes the run's fields to a value in the slider's unit, within the slider's range.

        A value that is not finite is ignored: any program on this machine can send one.
        """
        if not math.isfinite(value):
            return
        value = min(max(value, self.low), self.high) * self.unit
        if (index := _velocity_index(next(iter(self.fields)), run.scenario)) is not None:
            run.set_velocity(**{("linear", "angular")[index]: value})
            return

        def edit(scenario: Scenario) -> None:
            for path, rules in self.fields.items():
                owner, _, key = path.rpartition(".")
                # A field that excludes the slider's end gets the tenth of a step beside it.
                is_excluded = value <= rules.get("above", -math.inf)
                after = rules["above"] + self.step * self.unit / 10 if is_excluded else value
                before = value_at(scenario, path)
                if isinstance(before, list):  # A vector keeps its direction.
                    after = (np.array(before) * after / np.linalg.norm(before)).tolist()
                setattr(value_at(scenario, owner), key, after)
            if "planner.period" in self.fields:
                _fit_time_step(scenario)

        run.change(edit)


def make_sliders(scenario: Scenario) -> list[Slider]:
    """Returns a slider for each name of a field that declares typical values."""
    groups: dict[str, dict[str, Mapping[str, Any]]] = {}
    for path, rules in _adjustable(scenario):
        # A hand looks ahead itself.
        if not (scenario.has_hand and path == "planner.estimator.lookahead"):
            label = f"{path.rpartition('.')[2].replace('_', ' ')} [{rules['unit']}]"
            groups.setdefault(label, {})[path] = rules
    sliders = []
    for label, fields in groups.items():
        rules = next(iter(fields.values()))
        unit = _UNITS[rules["unit"]]
        low, high = (round(bound / unit, 6) for bound in rules["typical"])
        sliders.append(Slider(label, low, high, _round_step(high - low), unit, fields))
    return sliders


def value_at(config: Any, path: str) -> Any:
    """Returns the value at a dotted path, such as `depth_sensor.cameras.0.bias`."""
    keys = path.split(".")
    return reduce(lambda at, key: at[int(key)] if key.isdigit() else getattr(at, key), keys, config)


def _adjustable(config: Any, owner: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yields the dotted path and metadata of each field that declares typical values."""
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if value == [0.0, 0.0, 0.0]:  # It has no direction.
            continue
        if "typical" in field.metadata:
            yield owner + field.name, field.metadata
        elif dataclasses.is_dataclass(value):
            yield from _adjustable(value, f"{owner}{field.name}.")
        elif isinstance(value, list) and value and dataclasses.is_dataclass(value[0]):
            for index, element in enumerate(value):
                yield from _adjustable(element, f"{owner}{field.name}.{index}.")


def _round_step(width: float) -> float:
    """Returns the largest of 1, 2 and 5 times a power of ten that makes `_STEPS` steps or more."""
    power = 10.0 ** math.floor(math.log10(width / _STEPS) + 1e-9)
    return max(step * power for step in (1, 2, 5) if step * power * _STEPS <= width * (1 + 1e-9))


def _velocity_index(path: str, scenario: Scenario) -> int | None:
    """Returns the place of a conveyor's velocity, which changes over a ramp, or None."""
    velocities = ("motion.linear_velocity", "motion.angular_velocity")
    is_velocity = isinstance(scenario.motion, Conveyor) and path in velocities
    return velocities.index(path) if is_velocity else None


def _fit_time_step(scenario: Scenario) -> None:
    """Makes ticks fall on time steps of the plant, which are not longer than by default."""
    if isinstance(scenario.motion, Conveyor) and not scenario.has_hand:
        steps = math.ceil(scenario.planner.period / Scenario().plant_config.time_step - 1e-9)
        scenario.plant_config.time_step = scenario.planner.period / steps


class LiveControls:
    """Connects sliders and buttons in Meshcat with a live run.

    Args:
        run: The live run.
        meshcat: Its viewer.
        out: Folder for saved recordings.
        tell: Function that is called with the place of each of them, in words.

    Attributes:
        is_paused: Whether the run is paused.
        is_stopped: Whether somebody has stopped it.
        drag: The run's method of this name, as is `let_go`; any thread may call them.
        refused: Number of messages of pages that were malformed, too many, or unauthorized.
    """

    def __init__(
        self,
        run: LiveRun,
        meshcat: Meshcat,
        *,
        out: Path,
        tell: Callable[[str], object] = print,
    ) -> None:
        self._run, self._meshcat, self._out, self._tell = run, meshcat, out, tell
        self.is_paused, self.is_stopped, self.refused = False, False, 0
        self._lock = threading.Lock()  # Each page has a thread, which counts what is refused.
        scenario = run.scenario
        self._sliders = {slider.name: slider for slider in make_sliders(scenario)}
        self._buttons: dict[str, Callable[[], object]] = {
            "stop": self._stop,  # First, so that no panel of Meshcat moves it off the page.
            "save the recording": self._save,
            "pause / resume": self._switch_pause,
            "step": self._step,
            "reset": self._reset,
            "next strategy": run.next_strategy,
            "object: hide / show": run.switch_sight,
        }
        for contact, name in enumerate(run.timeline.finger_names):
            self._buttons[f"{name}: lose / give back"] = partial(run.switch_finger, contact)
        if not isinstance(scenario.motion, PoseStream):  # A replayed object goes on its way.
            self._buttons["object: nudge"] = run.nudge
        if isinstance(scenario.motion, Toss):
            self._buttons["object: throw"] = self._reset
        if scenario.has_hand:
            self._buttons["hand: close"] = run.close
        self.drag, self.let_go = run.drag, run.let_go
        self._add()

    def serve(self, should_stop: Callable[[], bool] = lambda: False) -> None:
        """Runs until the user stops it in the page, or `should_stop` returns true."""
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
        """Applies one of the controls that were pressed or moved since the last time.

        So a flood of messages cannot hold up the run, and `stop` is the first.
        """
        for name, action in self._buttons.items():
            if (clicks := self._meshcat.GetButtonClicks(name)) > self._clicks[name]:
                self.refuse(clicks - self._clicks[name] - 1)
                self._clicks[name] = clicks
                action()
                return
        for name, slider in self._sliders.items():
            if (value := self._meshcat.GetSliderValue(name)) != self._values[name]:
                self._values[name] = value
                slider.apply(self._run, value)
                return

    def refuse(self, count: int) -> None:
        """Adds messages to those that are refused; any thread may call it."""
        with self._lock:
            self.refused += count

    @property
    def can_drag(self) -> bool:
        """Whether the mouse can drag the object; any thread may ask."""
        return self._run.can_drag

    def timeline(self) -> dict[str, Any]:
        """Returns what the page shows now."""
        run = self._run
        pace = "paused" if self.is_paused else f"{run.rate:.2f} × real time"
        note = f"{pace}, strategy {run.scenario.planner.strategy}"
        if self.refused:
            note += f", {self.refused} messages refused"
        return run.timeline.now() | {"note": note}

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
            self._tell(told)
        except OutputError as error:
            told = str(error)
        self._add()
        self._run.timeline.tell(told)
