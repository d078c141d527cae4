"""Checks of what a scenario says of its sensors."""

import numpy as np

from drake_pregrasp.config.camera_config import camera_problems, sight_problems
from drake_pregrasp.config.object_config import Conveyor
from drake_pregrasp.config.sensor_config import Camera, fault_problems
from drake_pregrasp.diagrams.expected_path import Motion, expected_path
from drake_pregrasp.errors import Problems
from drake_pregrasp.geometry.shapes import Shape
from drake_pregrasp.simulation.scenario import Scenario


def sensor_problems(scenario: Scenario) -> Problems:
    """Yields the key and a description of each reason why sensors do not fit.

    Args:
        scenario: Scenario whose keys, types and ranges have been checked.
    """
    sensor, cameras = scenario.sensor, scenario.depth_sensor
    for name, problem in fault_problems(sensor.faults, scenario.planner.period):
        yield f"sensor.faults.{name}", problem
    for name, problem in camera_problems(cameras):
        yield f"depth_sensor.{name}", problem
    if not isinstance(scenario.motion, Conveyor):
        return
    if isinstance(sensor, Camera) and sensor.position[2] <= 0:
        yield "sensor.position", f"{sensor.position} must be above the table, whose top is z = 0"
    for index, camera in enumerate(cameras.cameras):
        if camera.bias[2] > cameras.table_margin:
            beyond = f"beyond table_margin, {cameras.table_margin}"
            problem = f"{camera.bias} lifts points of the table {beyond}: they would count"
            yield f"depth_sensor.cameras[{index}].bias", problem


def unseen_problems(scenario: Scenario, motion: Motion, shape: Shape) -> Problems:
    """Yields the cameras that do not see the object anywhere on its expected path.

    Args:
        scenario: Scenario whose other values have been checked.
        motion: Motion of the object.
        shape: Shape of the object.
    """
    if not scenario.depth_sensor.cameras:
        return
    path = expected_path(motion, scenario.simulation_duration, shape)
    radius = float(np.max(np.linalg.norm(shape.mesh.vertices - shape.p_OCoM, axis=1)))
    for name, problem in sight_problems(scenario.depth_sensor, path, radius):
        yield f"depth_sensor.{name}", problem
