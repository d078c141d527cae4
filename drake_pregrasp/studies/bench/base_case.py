"""How fast the whole base case simulates, and what its parts take.

Diagrams of which each has one part more than the one before advance in turn, a little each time.
What the last of them takes is the whole, and the differences are the parts. Drake's own share is in
the part for which its systems work.
"""

import tempfile
import time
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_pregrasp.config.sensor_config import SensorConfig
from drake_pregrasp.diagrams.object_plant import ObjectPlant
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.simulation.recording import start_meshcat
from drake_pregrasp.simulation.run_log import RunLog
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import load_scenario
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.studies.bench.implemented_surface import implemented
from drake_pregrasp.systems.pose_estimator import PoseEstimator
from drake_pregrasp.systems.pose_sensor import NoiseSource, NoisyPoseSensor

PARTS = (
    "physics",
    "sensor and estimator",
    "planner",
    "measures and records",
    "log.csv",
    "recording",
)
"""In the order in which they are added."""

WITHOUT_RECORDING, WITH_RECORDING = PARTS[-2:]
"""The last parts of a whole simulation."""

_WARM_UP = 10
"""Ticks that don't count."""


class RunJob(NamedTuple):
    """Simulations of the base case.

    Attributes:
        implementation: Of the kernel.
        period: Seconds between planning ticks.
        duration: Seconds to simulate in each round.
        rounds: How many times all diagrams advance in turn.
    """

    implementation: str
    period: float
    duration: float
    rounds: int


class RunTime(NamedTuple):
    """How long the base case takes.

    Attributes:
        implementation: Of the kernel.
        rate: Planning ticks a second.
        seconds: What one simulated second takes up to and with each of `PARTS`, in seconds, the
            medians over the rounds.
        parts: What each part adds in seconds of this thread's processor time, which other
            processes take none of, the medians of the differences in each round.
    """

    implementation: str
    rate: float
    seconds: Mapping[str, float]
    parts: Mapping[str, float]

    def factor(self, last_part: str) -> float:
        """Returns the seconds simulated in one second, with the parts up to that one."""
        return 1 / self.seconds[last_part]


def time_run(job: RunJob) -> RunTime:
    """Times the base case, whose contacts adapt from the start, up to each part in turn."""
    scenario = load_scenario("a_base")
    scenario.planner.period = job.period
    scenario.planner.static_duration = 0.0
    scenario.simulation_duration = _WARM_UP * job.period + job.rounds * job.duration
    surface = implemented(scenario.make_surface(), job.implementation)
    seconds: dict[str, list[float]] = {part: [] for part in PARTS}
    own_seconds: dict[str, list[float]] = {part: [] for part in PARTS}
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        logs = [
            stack.enter_context(RunLog(folder / f"{k}.csv", scenario.num_contacts))
            for k in range(2)
        ]
        simulators = {
            part: _simulator(scenario, diagram)
            for part, diagram in _diagrams(scenario, surface, logs).items()
        }
        for simulator in simulators.values():
            simulator.AdvanceTo(_WARM_UP * job.period)
        for round_ in range(job.rounds):
            end = _WARM_UP * job.period + (round_ + 1) * job.duration
            for part, simulator in simulators.items():
                start, own_start = time.perf_counter(), time.thread_time()
                simulator.AdvanceTo(end)
                seconds[part].append((time.perf_counter() - start) / job.duration)
                own_seconds[part].append((time.thread_time() - own_start) / job.duration)
    medians = np.median(list(seconds.values()), axis=1).tolist()
    added = np.diff(list(own_seconds.values()), axis=0, prepend=0)
    return RunTime(
        job.implementation,
        1 / job.period,
        dict(zip(PARTS, medians, strict=True)),
        dict(zip(PARTS, np.median(added, axis=1).tolist(), strict=True)),
    )


def _diagrams(scenario: Scenario, surface: ObjectSurface, logs: list[RunLog]) -> dict[str, Diagram]:
    """Returns the diagrams that end with each of `PARTS`."""
    diagrams = (
        _plant_alone(scenario),
        _plant_and_estimator(scenario, surface),
        make_diagram(scenario, surface),
        make_diagram(scenario, surface, sink=lambda record: None),
        make_diagram(scenario, surface, sink=logs[0].append),
        make_diagram(scenario, surface, sink=logs[1].append, meshcat=start_meshcat()),
    )
    return dict(zip(PARTS, diagrams, strict=True))


def _plant_alone(scenario: Scenario) -> Diagram:
    builder = DiagramBuilder()
    builder.AddSystem(ObjectPlant(scenario.object, scenario.motion, scenario.plant_config))
    return builder.Build()


def _plant_and_estimator(scenario: Scenario, surface: ObjectSurface) -> Diagram:
    period = scenario.planner.period
    builder = DiagramBuilder()
    plant = builder.AddSystem(ObjectPlant(scenario.object, scenario.motion, scenario.plant_config))
    noise = builder.AddSystem(
        NoiseSource(size=NoisyPoseSensor.NOISE_SIZE, period=period, seed=scenario.random_seed)
    )
    sensor = builder.AddSystem(
        NoisyPoseSensor(SensorConfig(scenario.sensor.position_std, scenario.sensor.orientation_std))
    )
    estimator = builder.AddSystem(
        PoseEstimator(scenario.planner.estimator, period=period, p_OCoM=surface.p_OCoM)
    )
    builder.Connect(plant.GetOutputPort("X_WO"), sensor.GetInputPort("X_WO"))
    builder.Connect(noise.get_output_port(), sensor.GetInputPort("noise"))
    builder.Connect(sensor.GetOutputPort("X_WO_measured"), estimator.GetInputPort("X_WO_measured"))
    return builder.Build()


def _simulator(scenario: Scenario, diagram: Diagram) -> Simulator:
    simulator = Simulator(diagram)
    ApplySimulatorConfig(scenario.simulator_config, simulator)
    simulator.set_target_realtime_rate(0)
    simulator.Initialize()
    return simulator
