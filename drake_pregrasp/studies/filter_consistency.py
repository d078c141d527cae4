"""Consistency of the pose filter: its actual errors compared with its covariances.

The normalised estimation error squared (NEES), eᵀ P⁻¹ e of position and velocity, or of orientation
and angular velocity, is chi-square distributed with 6 degrees of freedom if the filter's
assumptions hold; the normalised innovation squared (NIS), νᵀ S⁻¹ ν, with 3 (Bar-Shalom, Li and
Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, section 5.4).
"""

import functools
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd
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
"""Number of measurements in a run; the NEES is that after the last, the NIS of the second half."""

CONFIDENCE = 0.95
"""Probability that the mean of a consistent filter is in its band."""

DEFAULT_NOISE = filter_noise(EstimatorConfig())
"""Default noise model of the filter."""

EVEN_NOISE = filter_noise(EstimatorConfig(acceleration=1e-6, angular_acceleration=1e-6))
"""Noise model for an object with constant velocity, as on the conveyor."""


class Motion(NamedTuple):
    """A true motion of K ticks.

    Attributes:
        p_WO: Positions, shape (K, 3), in metres.
        v_WO: Velocities, shape (K, 3), in m/s.
        R_WO: Orientations, K rotations.
        w_WO: Angular velocities, shape (K, 3), in rad/s.
    """

    p_WO: FloatArray
    v_WO: FloatArray
    R_WO: Rotation
    w_WO: FloatArray


FILTERS: Mapping[str, tuple[PoseFilterNoise, bool]] = {
    "default assumptions, motion drawn from them": (DEFAULT_NOISE, False),
    "even motion assumed, conveyor": (EVEN_NOISE, True),
    "default assumptions, conveyor": (DEFAULT_NOISE, True),
}
"""Noise models of the filter, and whether the object is on the conveyor."""


def run_filter(job: Mapping[str, object]) -> dict[str, float]:
    """Returns the normalised errors of a job: a `filter` of `FILTERS`, run with a `seed`."""
    noise, is_carried = FILTERS[str(job["filter"])]
    rng = np.random.default_rng(int(str(job["seed"])))
    motion = conveyor_motion() if is_carried else random_motion(noise, rng)
    return filter_errors(noise, motion, rng)


def consistency_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Returns the mean normalised errors over runs, and the bands of a consistent filter.

    Args:
        rows: Rows of `run_filter`, with the columns of their jobs.
    """
    groups = rows.groupby("filter", sort=False)
    means, seeds = groups.mean(), groups.size()
    table = {"filter and motion": means.index}
    for name, freedom, samples, digits in (
        ("nees", 6, seeds, 2),
        ("nis", 3, seeds * (TICKS - TICKS // 2), 3),
    ):
        table[name.upper()] = [
            f"{position:.{digits}f}, {orientation:.{digits}f}"
            for position, orientation in means[[f"{name}_position", f"{name}_orientation"]].values
        ]
        table[f"{100 * CONFIDENCE:g} % band of {name.upper()}"] = [
            "{:.{d}f} to {:.{d}f}".format(*band(freedom, n), d=digits) for n in samples
        ]
    return pd.DataFrame(table)


def band(freedom: int, samples: int) -> tuple[float, float]:
    """Returns the band of the mean of chi-square samples.

    Args:
        freedom: Degrees of freedom.
        samples: Number of samples.
    """
    low, high = chi2.interval(CONFIDENCE, freedom * samples)
    return low / samples, high / samples


@functools.cache
def conveyor_motion() -> Motion:
    """Returns the simulated motion of the base case's object, moved by friction of the conveyor."""
    config = load_scenario("a_base")
    plant = ObjectPlant(config.object, config.motion, config.plant_config)
    simulator = Simulator(plant)
    ApplySimulatorConfig(config.simulator_config, simulator)
    poses = []
    for k in range(TICKS + 1):
        simulator.AdvanceTo(k * PERIOD)
        poses.append(
            plant.GetOutputPort("X_WO").Eval(simulator.get_context()).GetAsMatrix34().copy()
        )
    X = np.array(poses)
    p_WO, R_WO = X[:, :, 3], Rotation.from_matrix(X[:, :, :3])
    turns: FloatArray = (R_WO[1:] * R_WO[:-1].inv()).as_rotvec()
    return Motion(p_WO[1:], np.diff(p_WO, axis=0) / PERIOD, R_WO[1:], turns / PERIOD)


def random_motion(noise: PoseFilterNoise, rng: np.random.Generator) -> Motion:
    """Returns a motion drawn from the filter's motion model."""
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


def filter_errors(
    noise: PoseFilterNoise, motion: Motion, rng: np.random.Generator
) -> dict[str, float]:
    """Returns the NEES after the last tick, and the mean NIS of the second half of the ticks.

    Args:
        noise: Noise model of the filter, from which the measurement noise is drawn too.
        motion: The true motion.
        rng: Generator of the measurement noise.
    """
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
    nis_position, nis_orientation = np.mean(nis, axis=0).tolist()
    return {
        "nees_position": float(e @ np.linalg.solve(belief.P_position, e)),
        "nees_orientation": float(e_R @ np.linalg.solve(belief.P_orientation, e_R)),
        "nis_position": nis_position,
        "nis_orientation": nis_orientation,
    }


def _accelerated(density: float, rng: np.random.Generator) -> FloatArray:
    """Draws the changes of position and velocity by white-noise acceleration, shape (2, 3)."""
    covariance = density**2 * np.array([[PERIOD**3 / 3, PERIOD**2 / 2], [PERIOD**2 / 2, PERIOD]])
    return np.linalg.cholesky(covariance) @ rng.normal(size=(2, 3))
