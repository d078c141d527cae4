"""What no single key of a motion shows."""

import itertools
from pathlib import Path

import numpy as np

from drake_pregrasp.diagrams.motion_config import Conveyor, MotionConfig, PoseStream, Push
from drake_pregrasp.diagrams.push_motion import push_direction
from drake_pregrasp.errors import InvalidArgumentError, ScenarioError
from drake_pregrasp.planning.pose_track import read_pose_track
from drake_pregrasp.planning.surface import ObjectSurface
from drake_pregrasp.resources import resolve_path

MAX_SPEED = 10.0
"""Largest speed in a profile, in m/s."""


def check_motion(source: str, motion: MotionConfig, surface: ObjectSurface) -> None:
    """Raises a `ScenarioError` unless the object can be moved so.

    Args:
        source: Where the scenario is from, for the message.
        motion: Loaded, with keys and types checked.
        surface: The object's.
    """
    if isinstance(motion, Conveyor):
        _check_profile(source, motion.profile)
    elif isinstance(motion, Push):
        rear = -float(np.min(surface.mesh.vertices @ push_direction(motion)))
        if motion.start_distance < rear:
            raise ScenarioError(
                source,
                "motion.start_distance",
                f"{motion.start_distance} must be at least {rear:.4g}, where the object ends",
            )
    elif isinstance(motion, PoseStream):
        try:
            read_pose_track(resolve_path(motion.file, Path.cwd()))
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
    for index, (_, speed, _) in enumerate(profile):
        if abs(speed) > MAX_SPEED:
            raise ScenarioError(
                source,
                f"{key}[{index}][1]",
                f"{speed} must be a speed from {-MAX_SPEED:g} to {MAX_SPEED:g} m/s",
            )
