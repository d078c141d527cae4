"""Simulation of a scenario whose settings change while it runs."""

import copy
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat, MeshcatAnimation
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, System

from drake_pregrasp.arrays import TIME_ROUNDING, FloatArray, tick_index
from drake_pregrasp.config.finger_config import DamageEvent
from drake_pregrasp.config.object_config import Conveyor
from drake_pregrasp.contacts.strategies import STRATEGIES
from drake_pregrasp.diagrams.object_plant import DRAKE
from drake_pregrasp.errors import PregraspError
from drake_pregrasp.estimation.fault_settings import FOREVER
from drake_pregrasp.geometry.motion_profiles import VelocityProfile
from drake_pregrasp.simulation.output import make_folder, make_numbered_folder, write_text
from drake_pregrasp.simulation.recording import camera_view, make_timeline, recording_html
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario, resolve_scenario
from drake_pregrasp.simulation.run import check_name
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import dump_scenario
from drake_pregrasp.simulation.simulation_diagram import make_diagram, make_simulator
from drake_pregrasp.systems.loggers import TickRecord
from drake_pregrasp.systems.object_drag import ObjectDrag

RECORDED = 600.0
"""Longest recording of a live run, in seconds: it is kept in memory."""

_RAMP = 0.2  # Duration of a change of the conveyor's velocity, in seconds.
_BELOW_ALL = -10.0  # Ceiling of cameras below which there are no points, in metres.
_TILE = 0.01  # Smallest size of tiles, in metres: a page loads hundreds fast, but not thousands.
_DRAGGED_STEP = 0.005  # Longest time step for a drag: in longer ones, objects fall into the table.
_NO_PULL = np.full(3, np.nan), np.full(3, np.nan)
_NUDGE = 0.4  # Speed that a nudge adds to the object, in m/s: a cube slides 1 cm, and does not tip.


class LiveRun:
    """Runs a scenario in real time, and continues from its present state after each change.

    A change builds the diagram of the changed scenario, and copies the state of the diagram before.
    So there is one way to simulate: a live run without changes has the states of `run`.

    Args:
        resolved: Scenario to simulate.
        name: Name of the run, for the title and for its folder.
        meshcat: Viewer that shows the run.

    Attributes:
        scenario: The scenario with all changes so far.
        timeline: Timeline of the run since its start.
        last: Record of the last planning tick.
        end: Time at which the run pauses by itself, in seconds; on a conveyor it does not.
        is_hidden: Whether the sensor does not see the object.
    """

    def __init__(self, resolved: ResolvedScenario, *, name: str, meshcat: Meshcat) -> None:
        check_name(name)
        scenario = resolved.scenario
        self._name, self._meshcat, self._first = name, meshcat, scenario
        self._resolved, self._camera = resolved, camera_view(resolved, live=True)
        self._diagram: Diagram | None = None
        self._velocity: list[float] | None = None  # Of the conveyor, if it was changed.
        self._pull: tuple[FloatArray, FloatArray] | None = None  # Points A in O and T in W.
        self.scenario = copy.deepcopy(scenario)
        self.scenario.recording.tile_size = max(_TILE, scenario.recording.tile_size)
        self._start()

    def _start(self) -> None:
        self.is_hidden, self._is_recording = False, True
        has_end = not isinstance(self._first.motion, Conveyor)
        self.end = self._first.simulation_duration if has_end else math.inf
        self.timeline = make_timeline(self._resolved, self._name, self._camera)
        self._meshcat.DeleteRecording()
        self._simulator = self._simulate()
        self._simulator.Initialize()

    def reset(self) -> None:
        """Starts again with the changed settings, the scenario's fingers and the next seed."""
        scenario, first = self.scenario, copy.deepcopy(self._first)
        scenario.random_seed += 1
        scenario.damage, scenario.grasp.close_at = first.damage, first.grasp.close_at
        scenario.sensor.faults = first.sensor.faults
        scenario.depth_sensor.ceiling = first.depth_sensor.ceiling
        if self._velocity is not None and isinstance(scenario.motion, Conveyor):
            scenario.motion.profile = [[0.0, *self._velocity]]
        self._start()

    @property
    def time(self) -> float:
        """Simulated time, in seconds."""
        return float(self._simulator.get_context().get_time())

    @property
    def rate(self) -> float:
        """Achieved real-time rate since the last pause or change."""
        return float(self._simulator.get_actual_realtime_rate())

    def advance(self) -> None:
        """Simulates until the next planning tick."""
        period = self.scenario.planner.period
        if self.can_drag:
            self._set_pull()
        self._simulator.AdvanceTo(period * (tick_index(self.time, period) + 1))
        if self._is_recording and self.time > RECORDED:
            self._meshcat.StopRecording()
            self._is_recording = False

    def keep_pace(self) -> None:
        """Measures real time from now on, after a pause."""
        self._simulator.ResetStatistics()

    def change(self, edit: Callable[[Scenario], object]) -> bool:
        """Changes the scenario, and continues from the present state.

        The timeline tells why a change is refused, such as a planning rate below the sensor's.

        Args:
            edit: Function that changes the scenario that it gets.

        Returns:
            Whether the change was made; if it was refused, everything is as before.
        """
        before, resolved = self.scenario, self._resolved
        diagram, simulator = self._diagram, self._simulator
        self.scenario = copy.deepcopy(before)
        edit(self.scenario)
        try:
            self._simulator = self._simulate()
            _copy_state(simulator, self._simulator)
            self._simulator.Initialize()
        except PregraspError as error:
            self.scenario, self._resolved = before, resolved
            self._diagram, self._simulator = diagram, simulator
            self.timeline.tell(f"refused: {error}")
            return False
        return True

    def set_velocity(self, *, linear: float | None = None, angular: float | None = None) -> None:
        """Changes the velocities of the conveyor, in m/s and rad/s; None keeps one."""
        motion, now = self.scenario.motion, self.time
        assert isinstance(motion, Conveyor)
        rows = motion.velocities()
        last = self._velocity or rows[-1][1:]
        given = (linear, angular)
        wanted = [old if new is None else new for old, new in zip(last, given, strict=True)]
        present = VelocityProfile(rows).at(now)[1].tolist()
        past = [row for row in rows if row[0] < now]
        profile = [*past, [now, *present], [now + _RAMP, *wanted]]
        if self.change(lambda scenario: setattr(scenario.motion, "profile", profile)):
            self._velocity = wanted

    def next_strategy(self) -> None:
        """Changes to the next strategy, in the order of `STRATEGIES`."""
        names = list(STRATEGIES)
        planner = self.scenario.planner
        index = names.index(planner.strategy) if planner.strategy in names else -1
        name = names[(index + 1) % len(names)]
        self.change(lambda scenario: setattr(scenario.planner, "strategy", name))

    def switch_finger(self, contact: int) -> None:
        """Takes a finger away, or gives it back."""
        damage = copy.deepcopy(self.scenario.damage)
        if contact not in self._resolved.remaining_contacts(self.time):
            for event in damage:
                event.contacts = [k for k in event.contacts if k != contact]
            damage = [event for event in damage if event.contacts]
        else:
            damage.append(DamageEvent(at=self.time, contacts=[contact]))
        self.change(lambda scenario: setattr(scenario, "damage", damage))
        if self.timeline.has_closed:
            name = self.timeline.finger_names[contact]
            self.timeline.tell(f"a hand that has closed keeps {name} where it is")

    def switch_sight(self) -> None:
        """Hides the object from the sensor, or shows it again."""
        faults, ceiling = self._first.sensor.faults, self._first.depth_sensor.ceiling
        if not self.is_hidden:
            faults = replace(faults, nan_probability=1.0, start=self.time, end=FOREVER)
            ceiling = _BELOW_ALL

        def edit(scenario: Scenario) -> None:
            scenario.sensor.faults, scenario.depth_sensor.ceiling = faults, ceiling

        if self.change(edit):
            self.is_hidden = not self.is_hidden

    def close(self) -> None:
        """Lets the hand close now."""
        self.change(lambda scenario: setattr(scenario.grasp, "close_at", self.time))

    def nudge(self) -> None:
        """Pushes the object in a random horizontal direction."""
        station = self._object_plant()
        model, dynamics = station.plant.GetModelInstanceByName("object"), station.dynamics
        angle = np.random.default_rng(round(1e3 * self.time)).uniform(0, 2 * np.pi)
        context = dynamics.GetMyMutableContextFromRoot(self._simulator.get_mutable_context())
        push = [0.0, 0.0, 0.0, _NUDGE * np.cos(angle), _NUDGE * np.sin(angle), 0.0]
        dynamics.SetVelocities(context, model, dynamics.GetVelocities(context, model) + push)
        self.timeline.tell("object is nudged")

    @property
    def can_drag(self) -> bool:
        """Whether the mouse can drag the object: Drake simulates it, in short time steps."""
        return bool(self._object_plant().HasSubsystemNamed("object_drag"))

    def drag(self, p_WA: FloatArray, p_WT: FloatArray) -> None:
        """Pulls a point A of the object towards a target T, until it is let go.

        Args:
            p_WA: A in W at the last planning tick, shape (3,), in metres. Only the first call since
                the object was let go chooses A, inside of the object's bounding box.
            p_WT: T in W, shape (3,), in metres.
        """
        if (pull := self._pull) is None:
            bounds = self._resolved.shape.mesh.bounds
            p_OA = np.clip(self.last.X_WO.inverse() @ p_WA, *bounds)
        else:
            p_OA = pull[0]
        self._pull = p_OA, p_WT

    def let_go(self) -> None:
        """Ends a drag."""
        self._pull = None

    def _set_pull(self) -> None:
        system = self._object_plant().GetSubsystemByName("object_drag")
        context = system.GetMyMutableContextFromRoot(self._simulator.get_mutable_context())
        system.set_pull(context, *(self._pull or _NO_PULL))

    def _object_plant(self) -> Diagram:
        assert self._diagram is not None
        plant: Diagram = self._diagram.GetSubsystemByName("object_plant")
        return plant

    def save(self, out: Path) -> Path:
        """Writes the recording and the scenario to a new folder, and returns the recording.

        The folder is `out/NAME-live-1`, or with the next free number.

        Raises:
            OutputError: If the folder cannot be written.
        """
        make_folder(out)
        folder = make_numbered_folder(out / f"{self._name}-live")
        page = recording_html(self._meshcat, self.timeline)
        frames = 1 / self.scenario.recording.publish_period
        self._meshcat.SetAnimation(MeshcatAnimation(frames))  # Browsers show the present again.
        if self._is_recording:
            self._meshcat.StartRecording(frames, set_visualizations_while_recording=True)
        write_text(folder / "recording.html", page)
        scenario = copy.deepcopy(self.scenario)
        scenario.simulation_duration = end = max(self.time, scenario.planner.period)
        scenario.damage = [
            replace(event, until=event.until if event.until <= end else 0.0)
            for event in scenario.damage
            if event.at <= end
        ]
        write_text(folder / "scenario.yaml", dump_scenario(self._name, scenario))
        return folder / "recording.html"

    def _add_tick(self, record: TickRecord) -> None:
        self.last = record
        self.timeline.add_tick(record)

    def _simulate(self) -> Simulator:
        """Returns a simulator of the scenario, whose diagram keeps the drawings of the last one."""
        self._resolved = resolve_scenario(self.scenario, keep=self._resolved)
        is_fine = self._resolved.plant_config.time_step <= _DRAGGED_STEP + TIME_ROUNDING
        can_drag = self.scenario.engine == DRAKE and is_fine
        self._diagram = make_diagram(
            self._resolved,
            sink=self._add_tick,
            grasp_sink=self.timeline.add_grasp if self.scenario.has_hand else None,
            picture_sink=self.timeline.add_picture,
            meshcat=self._meshcat,
            record=self._is_recording,
            live=True,
            camera=self._camera,
            continues=self._diagram,
            forces=[("object_drag", ObjectDrag)] if can_drag else [],
        )
        simulator = make_simulator(self._diagram, self.scenario)
        simulator.set_target_realtime_rate(1.0)
        return simulator


def _copy_state(old: Simulator, new: Simulator) -> None:
    """Copies the time, and the state of the systems with the same names in both diagrams.

    All memory of this package and of its plants is discrete. State of another size is not copied.
    """
    before, context = old.get_context(), new.get_mutable_context()
    context.SetTime(before.get_time())
    known = {system.GetSystemPathname(): system for system in _leaves(old.get_system())}
    for system in _leaves(new.get_system()):
        if (source := known.get(system.GetSystemPathname())) is None:
            continue
        given = source.GetMyContextFromRoot(before)
        own = system.GetMyMutableContextFromRoot(context)
        for index in range(min(given.num_discrete_state_groups(), own.num_discrete_state_groups())):
            values = given.get_discrete_state(index).value()
            if len(values) == own.get_discrete_state(index).size():
                own.SetDiscreteState(index, values)


def _leaves(system: System) -> Iterator[System]:
    if isinstance(system, Diagram):
        for part in system.GetSystems():
            yield from _leaves(part)
    else:
        yield system
