"""What no single key of a motion shows."""

import itertools
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from drake_pregrasp.diagrams.motion_config import Conveyor, MotionConfig, PoseStream, Push, Toss
from drake_pregrasp.diagrams.push_motion import push_direction
from drake_pregrasp.errors import InvalidArgumentError, ScenarioError
from drake_pregrasp.planning.recorded_poses import read_recorded_poses
from drake_pregrasp.planning.surface import ObjectSurface
from drake_pregrasp.resources import resolve_path

PROFILE_LIMITS = ((1, 10.0, "m/s"), (2, 100.0, "rad/s"))
"""For each velocity in a row of a profile: its place there, its largest value, and the unit."""


def check_motion(source: str, motion: MotionConfig, surface: ObjectSurface) -> None:
    """Raises a `ScenarioError` unless the object can be moved so.

    Args:
        source: Where the scenario is from, for the message.
        motion: Loaded, with keys and types checked.
        surface: The object's.
    """
    if isinstance(motion, Conveyor):
        _check_profile(source, motion.profile)
    elif isinstance(motion, Toss):
        R_WO = Rotation.from_euler("xyz", motion.rpy)
        below = -float(np.min(R_WO.apply(surface.mesh.vertices - surface.p_OCoM)[:, 2]))
        if motion.table and motion.position[2] < below:
            raise ScenarioError(
                source,
                "motion.position[2]",
                f"{motion.position[2]} must be at least {below:.4g}, to start above the table",
            )
    elif isinstance(motion, Push):
        rear = -float(np.min((surface.mesh.vertices - surface.p_OCoM) @ push_direction(motion)))
        if motion.start_distance < rear:
            raise ScenarioError(
                source,
                "motion.start_distance",
                f"{motion.start_distance} must be at least {rear:.4g}, where the object ends",
            )
    elif isinstance(motion, PoseStream):
        try:
            read_recorded_poses(resolve_path(motion.file, Path.cwd()))
        except InvalidArgumentError as error:
            raise ScenarioError(source, "motion.file", str(error)) from error


def _check_profile(source: str, profile: list[list[float]]) -> None:
    key = "motion.profile"
    if profile and profile[0][0] != 0:
        raise ScenarioError(source, f"{key}[0][0]", f"{profile[0][0]} must be 0, the first time")
    for index, (row, following) in enumerate(itertools.pairwise(profile), start=1):
        if not following[0] > row[0]:
            raise ScenarioError(
                source,
                f"{key}[{index}][0]",
                f"{following[0]} must be more than {row[0]}, the time before it",
            )
    for index, row in enumerate(profile):
        for place, limit, unit in PROFILE_LIMITS:
            if abs(row[place]) > limit:
                raise ScenarioError(
                    source,
                    f"{key}[{index}][{place}]",
                    f"{row[place]} must be from {-limit:g} to {limit:g} {unit}",
                )
