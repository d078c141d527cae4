"""Smooths a recorded pose stream."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from drake_pregrasp.config.planner_config import EstimatorConfig, filter_noise
from drake_pregrasp.config.yaml_text import parse_entries
from drake_pregrasp.errors import ScenarioError
from drake_pregrasp.estimation.pose_smoother import filter_poses, smooth
from drake_pregrasp.estimation.recorded_poses import COLUMNS
from drake_pregrasp.interfaces.pose_files import read_poses
from drake_pregrasp.simulation.output import check_new, write_named_text
from drake_pregrasp.simulation.schema_check import load_checked

VELOCITY_COLUMNS = ("vx", "vy", "vz", "wx", "wy", "wz")
"""Further columns of the smoothed file: velocities of O in W, in m/s and rad/s."""

CARRIED = EstimatorConfig(
    acceleration=0.5,
    angular_acceleration=3.0,
    manoeuvre_rate=0.0,
)
"""Default settings of the filter, for an object that a person carries. Smoothing has one model."""


_SETTINGS = "position_std", "orientation_std", "acceleration", "angular_acceleration", "gravity"


def load_estimator(text: str) -> EstimatorConfig:
    """Returns the settings `CARRIED` with the overrides of a YAML text.

    Raises:
        ScenarioError: If a key or a value is invalid, or if a key has no effect on smoothing.
    """
    source = "--estimator"
    data = parse_entries(source, text)
    config = load_checked(source, "", data, CARRIED)
    for key in data:
        if key not in _SETTINGS:
            problem = f"{data[key]} has no effect on smoothing; keys are: {', '.join(_SETTINGS)}"
            raise ScenarioError(source, key, problem)
    return config


def smooth_file(
    source: Path, target: Path, config: EstimatorConfig, *, topic: str = "", frame: str = ""
) -> int:
    """Smooths a file of poses, and returns the number of poses.

    The written file is also a pose stream, with velocities in further columns.

    Args:
        source: CSV file with the columns `COLUMNS`, or an MCAP file or a rosbag2.
        target: CSV file to write, which must not be there yet.
        config: Settings of the filter.
        topic: Topic of the poses in an MCAP file or a rosbag2; empty for the only one.
        frame: Name of the object's frame in messages with transforms; empty for the only one.

    Raises:
        InvalidArgumentError: If the source cannot be read or is invalid.
        OutputError: If the target is there already, or cannot be written.
    """
    check_new(target)
    track = read_poses(source, topic=topic, frame=frame)
    noise = replace(filter_noise(config), manoeuvre_rate=0.0)
    beliefs = smooth(filter_poses(track.times, track.p_WO, track.R_WO.as_matrix(), noise), noise)
    lines = [",".join((*COLUMNS, *VELOCITY_COLUMNS))]
    for belief in beliefs:
        quaternion = np.roll(Rotation.from_matrix(belief.R_WO[0]).as_quat(), 1)
        w_WO, v_WO = belief.V_WCoM[0].reshape(2, 3)
        row = [belief.time, *belief.p_WCoM[0], *quaternion, *v_WO, *w_WO]
        lines.append(",".join(repr(float(value)) for value in row))
    write_named_text(target, "\n".join(lines) + "\n")
    return len(beliefs)
