"""Runs of fast objects: errors of goals that a delayed hand reaches."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from pydrake.systems.analysis import Simulator
from scipy.stats import chi2

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.selection_input import is_active
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import load_scenario, read_mapping
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.systems.loggers import TickRecord

PERIOD = 0.0125
"""Planning period in seconds; the hand's delays are multiples of it."""

SETTLED = 8
"""First tick whose goals count: after 0.1 s, the velocity estimate has converged."""

CASES = read_mapping(Path(__file__).with_name("lookahead_cases.yaml"))
"""Shipped scenario and overrides of each case, by the case's name."""


class LookaheadRun(NamedTuple):
    """Records of K ticks of a run, and what they do not hold.

    Attributes:
        records: Records of all ticks.
        p_WO_covariance: Covariances of the estimated positions, shape (K, 3, 3), in m².
    """

    records: Sequence[TickRecord]
    p_WO_covariance: FloatArray

    def goal_errors(self, delay: int, start: int) -> FloatArray:
        """Returns the errors of goals at the time when a delayed hand reaches them.

        The hand reaches the goal of tick k at tick k + delay. The goal's point of the object, from
        the estimated pose of tick k, is then at the true pose of tick k + delay.

        Args:
            delay: Delay of the hand, in ticks.
            start: First tick whose goals count.

        Returns:
            Distance between goal and point in metres, for each tick and active contact.
        """
        errors = []
        for record, later in zip(self.records[start:], self.records[start + delay :], strict=False):
            p_WC = record.p_WC[is_active(record.contact_status)]
            moved = later.X_WO @ record.X_WO_estimated.inverse()
            errors.append(np.linalg.norm((moved @ p_WC.T).T - p_WC, axis=1))
        return np.concatenate(errors)

    def normalised_errors(self, delay: int, start: int) -> FloatArray:
        """Returns squared errors of the predicted positions, normalised by covariance: e' Σ⁻¹ e.

        With a correct covariance they are chi-square distributed with mean 3.
        """
        p_WO = np.array([record.X_WO.translation() for record in self.records])
        predicted = np.array([record.X_WO_estimated.translation() for record in self.records])
        last = len(p_WO) - delay
        e = p_WO[start + delay :] - predicted[start:last]
        weighted = np.linalg.solve(self.p_WO_covariance[start:last], e[:, :, None])[:, :, 0]
        squares: FloatArray = np.sum(e * weighted, axis=1)
        return squares


def lookahead_scenario(case: str, lookahead: float, seed: int) -> Scenario:
    """Returns the scenario of a case, a key of `CASES`, with a look-ahead in seconds and a seed."""
    scenario = load_scenario(CASES[case]["scenario"], text=yaml.dump(CASES[case]["overrides"]))
    scenario.planner.estimator.lookahead = lookahead
    scenario.random_seed = seed
    return scenario


def run_lookahead(scenario: Scenario) -> LookaheadRun:
    """Simulates a scenario of `lookahead_scenario`."""
    records: list[TickRecord] = []
    covariances: list[FloatArray] = []

    def add(record: TickRecord) -> None:
        context = planner.GetMyContextFromRoot(simulator.get_context())
        covariances.append(covariance.Eval(context).reshape(3, 3).copy())
        records.append(record)

    diagram = make_diagram(scenario, scenario.make_surface(), sink=add)
    planner = diagram.GetSubsystemByName("pregrasp_planner")
    covariance = planner.GetOutputPort("p_WO_covariance")
    simulator = Simulator(diagram)
    simulator.AdvanceTo(scenario.simulation_duration)
    return LookaheadRun(records, np.array(covariances))


@dataclass(frozen=True)
class LookaheadErrors:
    """Computes the rows of a case and a look-ahead, one for each delay of the hand.

    Attributes:
        seeds: Seeds of the measurement noise, all of which contribute to each row.
        delays: Delays of the hand in ticks, by the look-ahead in seconds.
    """

    seeds: Sequence[int]
    delays: dict[float, list[int]]

    def __call__(self, job: dict[str, Any]) -> list[dict[str, Any]]:
        """Returns the rows of a `case` and a `lookahead`, in seconds and metres."""
        runs = [run_lookahead(lookahead_scenario(**job, seed=seed)) for seed in self.seeds]
        return [_goal_row(runs, delay) for delay in self.delays[job["lookahead"]]]


def _goal_row(runs: Sequence[LookaheadRun], delay: int) -> dict[str, float]:
    errors = np.concatenate([run.goal_errors(delay, SETTLED) for run in runs])
    squares = np.concatenate([run.normalised_errors(delay, SETTLED) for run in runs])
    return {
        "delay": PERIOD * delay,
        "median": float(np.median(errors)),
        "p95": float(np.percentile(errors, 95)),
        "normalised": float(np.mean(squares)) / 3,
        "inside": float(np.mean(squares < chi2.ppf(0.95, 3))),
    }
