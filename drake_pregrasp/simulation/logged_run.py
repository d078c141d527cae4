"""A simulation with its logs: what every run does, whatever is made of it afterwards."""

import contextlib
import time
from collections.abc import Callable
from pathlib import Path

from pydrake.geometry import Meshcat
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import Context, EventStatus

from drake_pregrasp.simulation.output import without_solver_chatter
from drake_pregrasp.simulation.phases import static_end
from drake_pregrasp.simulation.run_log import GraspLog, RunLog
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.systems.loggers import GraspRecord, TickRecord


class LoggedRun:
    """A scenario's diagram that logs what happens when it is simulated.

    Args:
        scenario: What to simulate; it has been checked.
        meshcat: Where to draw and record, if at all.
        on_tick: Called at each planning tick.

    Attributes:
        surface: The object's.
        diagram: Of the simulation.
        completed: Whether it went on to its end.
        wall_seconds: What that took.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        meshcat: Meshcat | None = None,
        on_tick: Callable[[TickRecord], None] | None = None,
    ) -> None:
        self._scenario = scenario
        self._sinks = _Sinks(on_tick)
        self.surface = scenario.make_surface()
        self.completed = False
        self.wall_seconds = 0.0
        self.diagram = make_diagram(
            scenario,
            self.surface,
            sink=self._sinks.add_tick,
            grasp_sink=self._sinks.add_grasp,
            meshcat=meshcat,
        )

    @property
    def log(self) -> RunLog:
        """The planning ticks, once it is simulated."""
        return self._sinks.log

    @property
    def grasp_log(self) -> GraspLog | None:
        """What the hand did, once it is simulated; nothing without one."""
        return self._sinks.grasp_log

    def simulate(self, folder: Path, should_stop: Callable[[], bool] | None = None) -> None:
        """Simulates it, once.

        Args:
            folder: Where `log.csv` goes and, with a hand, `grasp.csv`.
            should_stop: Asked after each step; the run ends early once it returns true.

        Raises:
            OutputError: If a log can't be written.
        """
        scenario, count = self._scenario, self._scenario.num_contacts
        with contextlib.ExitStack() as logs:
            self._sinks.log = logs.enter_context(
                RunLog(
                    folder / "log.csv",
                    count,
                    static_end=static_end(scenario),
                    deadline=scenario.planner.period,
                )
            )
            if scenario.grasp.has_hand:
                self._sinks.grasp_log = logs.enter_context(GraspLog(folder / "grasp.csv", count))
                logs.enter_context(without_solver_chatter())
            self._advance(should_stop)

    def _advance(self, should_stop: Callable[[], bool] | None) -> None:
        simulator = Simulator(self.diagram)
        ApplySimulatorConfig(self._scenario.simulator_config, simulator)
        stopped = False

        def monitor(context: Context) -> EventStatus:
            nonlocal stopped
            stopped = should_stop is not None and should_stop()
            if stopped:
                return EventStatus.ReachedTermination(self.diagram, "stopped on request")
            return EventStatus.DidNothing()

        simulator.set_monitor(monitor)
        start = time.perf_counter()
        simulator.Initialize()
        simulator.AdvanceTo(self._scenario.simulation_duration)
        self.completed = not stopped
        self.wall_seconds = time.perf_counter() - start


class _Sinks:
    """Where records go. It doesn't know the diagram: the two would keep each other alive."""

    def __init__(self, on_tick: Callable[[TickRecord], None] | None) -> None:
        self._on_tick = on_tick
        self.log: RunLog
        self.grasp_log: GraspLog | None = None

    def add_tick(self, record: TickRecord) -> None:
        self.log.append(record)
        if self._on_tick is not None:
            self._on_tick(record)

    def add_grasp(self, record: GraspRecord) -> None:
        if self.grasp_log is not None:
            self.grasp_log.append(record)
