"""Whether the filter's errors are as large as it says, over many seeded runs.

The normalised estimation error squared (NEES), eᵀ P⁻¹ e of position and velocity, or of orientation
and angular velocity, is chi-square distributed with 6 degrees of freedom if the filter's
assumptions hold; the normalised innovation squared (NIS), νᵀ S⁻¹ ν, with 3 (Bar-Shalom, Li and
Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, section 5.4).
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.planner_config import EstimatorConfig, filter_noise, tracker_settings
from drake_pregrasp.diagrams.object_plant import ObjectPlant
from drake_pregrasp.estimation.pose_filter import PoseFilterNoise, PoseMeasurement
from drake_pregrasp.estimation.pose_track import PoseTrack
from drake_pregrasp.estimation.pose_tracker import update_track
from drake_pregrasp.simulation.scenario_file import load_scenario

PERIOD = 0.05
"""Seconds between measurements."""

TICKS = 100
"""Measurements of a run; errors are those after the last, innovations those of the second half."""

CONFIDENCE = 0.95
"""Of the bands."""

CONSTANT = 1e-6
"""Acceleration density, linear and angular, for an object that moves evenly."""


class Motion(NamedTuple):
    """A true motion: positions and velocities, shape (K, 3), orientations and angular velocities.

    Attributes:
        p_WO: In metres.
        v_WO: In m/s.
        R_WO: Orientations.
        w_WO: In rad/s.
    """

    p_WO: FloatArray
    v_WO: FloatArray
    R_WO: Rotation
    w_WO: FloatArray


class Consistency(NamedTuple):
    """Mean squares over all runs, of position and of orientation, and the bands they belong in.

    Attributes:
        runs: How many runs.
        nees: Shape (2,), 6 expected.
        nees_band: Shape (2,), its lowest and highest value, for a consistent filter.
        nis: Shape (2,), 3 expected.
        nis_band: Shape (2,).
    """

    runs: int
    nees: FloatArray
    nees_band: FloatArray
    nis: FloatArray
    nis_band: FloatArray


def even_noise() -> PoseFilterNoise:
    """Returns the assumptions for an object that moves evenly, as on the conveyor."""
    return filter_noise(EstimatorConfig(acceleration=CONSTANT, angular_acceleration=CONSTANT))


def conveyor_motion(scenario: str = "a_base") -> Motion:
    """Returns the motion of a scenario's object on the simulated conveyor, by friction."""
    config = load_scenario(scenario)
    plant = ObjectPlant(config.object, config.motion, config.plant_config)
    simulator = Simulator(plant)
    ApplySimulatorConfig(config.simulator_config, simulator)
    simulator.Initialize()
    poses = []
    for k in range(TICKS + 1):
        simulator.AdvanceTo(k * PERIOD)
        X_WO = plant.GetOutputPort("X_WO").Eval(simulator.get_context())
        poses.append(X_WO.GetAsMatrix34())
    X = np.array(poses)
    p_WO, R_WO = X[:, :, 3], Rotation.from_matrix(X[:, :, :3])
    turns: FloatArray = (R_WO[1:] * R_WO[:-1].inv()).as_rotvec()
    v_WO, w_WO = np.diff(p_WO, axis=0) / PERIOD, turns / PERIOD
    return Motion(p_WO[1:], v_WO, R_WO[1:], w_WO)


def random_motion(noise: PoseFilterNoise, rng: np.random.Generator) -> Motion:
    """Returns a motion that is drawn from what the filter assumes."""
    p, v = np.zeros(3), rng.normal(scale=noise.initial_velocity, size=3)
    R, w = Rotation.random(rng=rng), rng.normal(scale=noise.initial_angular_velocity, size=3)
    steps = []
    for _ in range(TICKS):
        steps.append((p, v, R, w))
        dp, dv = _accelerated(noise.acceleration, rng)
        turn, dw = _accelerated(noise.angular_acceleration, rng)
        p, v = p + v * PERIOD + dp, v + dv
        R, w = Rotation.from_rotvec(w * PERIOD + turn) * R, w + dw
    p_WO, v_WO, R_WO, w_WO = zip(*steps, strict=True)
    return Motion(np.array(p_WO), np.array(v_WO), Rotation.concatenate(R_WO), np.array(w_WO))


def consistency(
    noise: PoseFilterNoise, motion: Callable[[np.random.Generator], Motion], seeds: int
) -> Consistency:
    """Returns how consistent the tracker is, over that many seeds.

    Args:
        noise: What it assumes; measurements have the noise it assumes of them.
        motion: Gives a run's motion.
        seeds: How many runs.
    """
    ends = []
    innovations = []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        nees, nis = _run(noise, motion(rng), rng)
        ends.append(nees)
        innovations.extend(nis)
    share = np.array([1 - CONFIDENCE, 1 + CONFIDENCE]) / 2
    count = len(innovations)
    return Consistency(
        runs=seeds,
        nees=np.mean(ends, axis=0),
        nees_band=chi2.ppf(share, 6 * seeds) / seeds,
        nis=np.mean(innovations, axis=0),
        nis_band=chi2.ppf(share, 3 * count) / count,
    )


def _run(
    noise: PoseFilterNoise, motion: Motion, rng: np.random.Generator
) -> tuple[FloatArray, list[FloatArray]]:
    settings = replace(tracker_settings(EstimatorConfig()), noise=noise)
    track = PoseTrack.empty(memory=1)
    nis = []
    for k in range(TICKS):
        p = motion.p_WO[k] + rng.normal(scale=noise.position, size=3)
        R = Rotation.from_rotvec(rng.normal(scale=noise.orientation, size=3)) * motion.R_WO[k]
        track = update_track(
            track, PoseMeasurement(k * PERIOD, p, R.as_matrix()), k * PERIOD, settings
        )
        if k >= TICKS // 2:
            nis.append(track.innovation_squared)
    belief, last = track.newest, TICKS - 1
    e = np.concatenate([motion.p_WO[last] - belief.p_WCoM, motion.v_WO[last] - belief.v_WCoM])
    theta = (motion.R_WO[last] * Rotation.from_matrix(belief.R_WO).inv()).as_rotvec()
    e_R = np.concatenate([theta, motion.w_WO[last] - belief.w_WO])
    nees = [
        e @ np.linalg.solve(belief.P_position, e),
        e_R @ np.linalg.solve(belief.P_orientation, e_R),
    ]
    return np.array(nees), nis


def _accelerated(density: float, rng: np.random.Generator) -> FloatArray:
    """Returns what white acceleration of that density adds to place and velocity, shape (2, 3)."""
    covariance = density**2 * np.array([[PERIOD**3 / 3, PERIOD**2 / 2], [PERIOD**2 / 2, PERIOD]])
    added: FloatArray = np.linalg.cholesky(covariance) @ rng.normal(size=(2, 3))
    return added
