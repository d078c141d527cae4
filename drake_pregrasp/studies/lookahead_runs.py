"""Runs of fast objects, and how far off the goals are when a hand gets there."""

from typing import NamedTuple

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, EventStatus
from scipy.spatial.transform import Rotation

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.contacts.selection_input import is_active
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import load_scenario
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.ticks import tick_index

PERIOD = 0.0125
"""Seconds between planning ticks; the hand's delays are multiples of it."""

_NOISE = "position_std: 0.001, orientation_std: 0.01"
CASES = {
    "conveyor": (
        "conveyor_profile",
        f"""
        simulation_duration: 3.0
        motion: {{profile: [[0, 0, 0], [0.5, 0.5, 1.5], [1.5, 0.5, 1.5], [2.5, -0.5, -1.5]]}}
        sensor: {{{_NOISE}}}
        planner:
          period: {PERIOD}
          static_duration: 0.1
          estimator: {{{_NOISE}, acceleration: 0.25, angular_acceleration: 1.0}}
        plant_config: {{time_step: {PERIOD / 4}}}
        """,
    ),
    "toss": (
        "toss",
        f"""
        simulation_duration: 0.8
        sensor: {{{_NOISE}}}
        planner: {{period: {PERIOD}, estimator: {{{_NOISE}}}}}
        plant_config: {{time_step: {PERIOD / 8}}}
        """,
    ),
    "toss, gravity unknown": (
        "toss",
        f"""
        simulation_duration: 0.8
        sensor: {{{_NOISE}}}
        planner:
          period: {PERIOD}
          estimator: {{{_NOISE}, gravity: 0.0, acceleration: 3.0}}
        plant_config: {{time_step: {PERIOD / 8}}}
        """,
    ),
}
"""For each case the shipped scenario, and what differs in it."""


class LookaheadJob(NamedTuple):
    """A run to make: a key of `CASES`, how far goals look ahead in seconds, and a seed."""

    case: str
    lookahead: float
    seed: int


class LookaheadRun(NamedTuple):
    """What a run's K ticks have shown; all positions in metres.

    Attributes:
        p_WC: Goals of the n contacts, shape (K, n, 3).
        active: Which of them count, shape (K, n).
        p_WO: True positions, shape (K, 3).
        R_WO: True orientations as quaternions x, y, z, w, shape (K, 4).
        p_WO_estimated: Positions of the estimate that the goals belong to, shape (K, 3).
        R_WO_estimated: Its orientations, shape (K, 4).
        p_WO_covariance: Covariance that it comes with, shape (K, 3, 3), in m².
    """

    p_WC: FloatArray
    active: BoolArray
    p_WO: FloatArray
    R_WO: FloatArray
    p_WO_estimated: FloatArray
    R_WO_estimated: FloatArray
    p_WO_covariance: FloatArray

    def goal_errors(self, delay: int, start: int) -> FloatArray:
        """Distances at the moment of contact between goals and where they should be, in metres.

        A goal issued at tick k is reached at tick k + delay. It should then be at the same point of
        the object: the goal in O as estimated, at the pose that the object truly has by then.

        Args:
            delay: Of the hand, in ticks.
            start: First tick whose goals count.

        Returns:
            One distance for each tick and active contact.
        """
        errors = []
        for k in range(start, len(self.p_WC) - delay):
            p_WC = self.p_WC[k, self.active[k]]
            R_OW = Rotation.from_quat(self.R_WO_estimated[k]).inv()
            p_OC = R_OW.apply(p_WC - self.p_WO_estimated[k])
            R_WO = Rotation.from_quat(self.R_WO[k + delay])
            errors.append(np.linalg.norm(self.p_WO[k + delay] + R_WO.apply(p_OC) - p_WC, axis=1))
        return np.concatenate(errors)

    def normalised_errors(self, delay: int, start: int) -> FloatArray:
        """Squared errors of the predicted positions, measured by their covariance, e' Σ⁻¹ e.

        If the covariance is right they are chi-square distributed: 3 on average.
        """
        last = len(self.p_WC) - delay
        e = self.p_WO[start + delay :] - self.p_WO_estimated[start:last]
        weighted = np.linalg.solve(self.p_WO_covariance[start:last], e[:, :, None])[:, :, 0]
        squares: FloatArray = np.sum(e * weighted, axis=1)
        return squares


def lookahead_scenario(job: LookaheadJob) -> Scenario:
    """Returns the scenario of a job."""
    name, text = CASES[job.case]
    scenario = load_scenario(name, text=text)
    scenario.planner.estimator.lookahead = job.lookahead
    scenario.random_seed = job.seed
    return scenario


def run_lookahead(job: LookaheadJob) -> LookaheadRun:
    """Simulates a job."""
    scenario = lookahead_scenario(job)
    diagram = make_diagram(scenario, scenario.make_surface())
    planner = diagram.GetSubsystemByName("pregrasp_planner")
    plant = diagram.GetSubsystemByName("object_plant")
    ticks: dict[int, list[FloatArray | BoolArray]] = {}

    def monitor(context: Context) -> EventStatus:
        tick = tick_index(context.get_time(), PERIOD)
        if tick not in ticks:
            goals = planner.GetMyContextFromRoot(context)
            X_WO = plant.GetOutputPort("X_WO").Eval(plant.GetMyContextFromRoot(context))
            estimate = planner.GetOutputPort("X_WO_estimated").Eval(goals)
            values = (
                planner.GetOutputPort("p_WC").Eval(goals).reshape(-1, 3),
                is_active(planner.GetOutputPort("contact_status").Eval(goals)),
                X_WO.translation(),
                Rotation.from_matrix(X_WO.rotation().matrix()).as_quat(),
                estimate.translation(),
                Rotation.from_matrix(estimate.rotation().matrix()).as_quat(),
                planner.GetOutputPort("p_WO_covariance").Eval(goals).reshape(3, 3),
            )
            ticks[tick] = [value.copy() for value in values]  # Drake's own change with time.
        return EventStatus.DidNothing()

    simulator = Simulator(diagram)
    simulator.set_monitor(monitor)
    simulator.Initialize()
    simulator.AdvanceTo(scenario.simulation_duration)
    return LookaheadRun(*(np.array(values) for values in zip(*ticks.values(), strict=True)))
