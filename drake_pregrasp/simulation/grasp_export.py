"""Commanded motion and postures of a grasp, as a file of arrays for other simulators."""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.tree import RigidBody

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError, first_line
from drake_pregrasp.grasping.grasp_state import GraspPhase, describe_give_up
from drake_pregrasp.resources import read_bounded
from drake_pregrasp.simulation.output import replacing, writing
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.simulation.run_log import pose_values
from drake_pregrasp.simulation.simulation_diagram import make_diagram, make_simulator

MAX_BYTES = 50_000_000
"""Largest size of a file whose postures are read, in bytes."""

_VECTOR_BYTES = 100_000  # Of each of them, unpacked.
_UNIT_TOLERANCE = 1e-3  # On the length of a quaternion.

POSTURES = ("pregrasp", "grasp", "squeeze")
"""Names of the postures, in the order of time."""


def export_grasp(resolved: ResolvedScenario, path: Path) -> dict[str, Any]:
    """Simulates a grasp, writes its arrays to an `.npz` file, and returns them.

    - `joint_names`: names of the nq joints, in the order of all positions.
    - `time`, `phase`: time of each control tick, and its phase as in `grasp.csv`, shape (k,).
    - `q_desired`, `v_desired`: commanded positions and velocities, shape (k, nq).
    - `q`, `v`: measured positions and velocities, shape (k, nq).
    - `X_WO`: pose of the object, shape (k, 7): position, and quaternion w, x, y, z.
    - `gave_up`: reason why the hand gave up; empty if it did not.
    - `pregrasp_q`, `grasp_q`, `squeeze_q`: postures, shape (nq,): the last command before closing,
      the joints when all fingers touch, and the command at the start of the lift.
    - `pregrasp_time` and the others: their times.
    - `pregrasp_X_WO` and the others: poses of the object at these times, shape (7,).
    - `pregrasp_X_WP` and the others: poses of the palm, on which the fingers hang, shape (7,).
    - `palm_name`: name of the palm.
    - `vertices`, `faces`: mesh of the object in O, so that its scale is 1.
    - `mass`, `friction`: mass of the object in kg, and its Coulomb coefficient.

    Args:
        resolved: Scenario with a hand.
        path: File to write.

    Raises:
        InvalidArgumentError: If the scenario has no hand, or the hand lifts nothing.
        OutputError: If the file cannot be written.
    """
    if resolved.hand is None:
        raise InvalidArgumentError("hand: there is none, whose motion could be exported")
    arrays = commanded_motion(resolved)
    arrays |= _postures(resolved, arrays) | _object(resolved)
    with writing(path), replacing(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, **arrays)
    return arrays


def commanded_motion(resolved: ResolvedScenario) -> dict[str, Any]:
    """Simulates a scenario with a hand, and returns its motion at each control tick.

    Args:
        resolved: Scenario with a hand.
    """
    assert resolved.hand is not None
    diagram, scenario = make_diagram(resolved), resolved.scenario
    simulator, period = make_simulator(diagram, scenario), scenario.grasp.period
    controller = diagram.GetSubsystemByName("hand_controller")
    station, context = diagram.GetSubsystemByName("object_plant"), simulator.get_mutable_context()
    ports = [controller.GetOutputPort(port) for port in ("desired_state", "grasp_report")]
    ports += [station.GetOutputPort(port) for port in ("hand_state", "X_WO")]
    rows = []
    for tick in range(int(scenario.simulation_duration / period + 1e-9) + 1):
        simulator.AdvanceTo(tick * period)
        desired, report, state, X_WO = (
            port.Eval(port.get_system().GetMyContextFromRoot(context)) for port in ports
        )
        # A copy, because Drake overwrites the poses of ports.
        X_WO = RigidTransform(X_WO)
        rows.append((tick * period, *np.split(desired, 2), *np.split(state, 2), report, X_WO))
    time, q_desired, v_desired, q, v, report, X_WO = zip(*rows, strict=True)
    return {
        "joint_names": np.array([j.name() for j in resolved.hand.instances.moving_joints()]),
        "time": np.array(time),
        "q_desired": np.array(q_desired),
        "v_desired": np.array(v_desired),
        "q": np.array(q),
        "v": np.array(v),
        "phase": np.array(report)[:, 0],
        "X_WO": np.array([pose_values(X) for X in X_WO]),
        "gave_up": np.array(describe_give_up(int(report[-1][2]), report[-1][3]) or ""),
    }


def _postures(resolved: ResolvedScenario, motion: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the postures before closing, at the touch, and at the end of the squeeze."""
    if not np.any(motion["phase"] == GraspPhase.LIFT):
        why = str(motion["gave_up"]) or "it did not lift the object in the time of the scenario"
        raise InvalidArgumentError(f"the hand has no grasp to export: {why}")
    ticks = posture_ticks(motion["phase"])
    found = motion["q_desired"][ticks[0]], motion["q"][ticks[1]], motion["q_desired"][ticks[2]]
    assert resolved.hand is not None
    palm = palm_body(resolved)
    plant, arrays = resolved.hand.kinematics.plant, {"palm_name": np.array(palm.name())}
    context = plant.CreateDefaultContext()
    for name, tick, q in zip(POSTURES, ticks, found, strict=True):
        plant.SetPositions(context, q)
        arrays[f"{name}_time"], arrays[f"{name}_q"] = motion["time"][tick], q
        arrays[f"{name}_X_WO"] = motion["X_WO"][tick]
        arrays[f"{name}_X_WP"] = pose_values(plant.EvalBodyPoseInWorld(context, palm))
    return arrays


def posture_ticks(phase: FloatArray) -> tuple[int, int, int]:
    """Returns the ticks of the postures of the grasp that lifts first.

    Earlier attempts of the same run may have closed, and given way.

    Args:
        phase: Phase at each tick, shape (k,), of a run that lifts.
    """
    lift = int(np.argmax(phase == GraspPhase.LIFT))
    squeeze = _last_start(phase[:lift], GraspPhase.SQUEEZE)
    close = _last_start(phase[:squeeze], GraspPhase.CLOSE)
    return max(0, close - 1), squeeze, lift


def _last_start(phase: FloatArray, wanted: GraspPhase) -> int:
    starts = (phase == wanted) & (np.diff(phase, prepend=np.nan) != 0)
    return int(np.flatnonzero(starts)[-1])


def palm_body(resolved: ResolvedScenario) -> RigidBody:
    """Returns the link on which the fingers of a scenario's hand hang."""
    assert resolved.hand is not None
    first = int(min(resolved.hand.kinematics.own_joints(0)))
    return resolved.hand.instances.moving_joints()[first].parent_body()


def _object(resolved: ResolvedScenario) -> dict[str, FloatArray]:
    mesh, scenario = resolved.shape.mesh, resolved.scenario
    return {
        "vertices": np.array(mesh.vertices),
        "faces": np.array(mesh.faces),
        "mass": np.array(scenario.object.mass),
        "friction": np.array(scenario.grasp.friction),
    }


def read_postures(path: Path) -> dict[str, FloatArray]:
    """Returns the postures in a file of `export_grasp`: arrays such as `grasp_q`, `grasp_X_WO`.

    Raises:
        InvalidArgumentError: If it is no such file, or is larger than `MAX_BYTES`.
    """
    content = io.BytesIO(read_bounded(path, MAX_BYTES))
    try:
        with ZipFile(content) as file:
            arrays = {
                f"{name}_{part}": _vector(file, f"{name}_{part}")
                for name in POSTURES
                for part in ("q", "X_WO")
            }
    except Exception as error:  # Readers of zip files and arrays raise various types.
        problem = f"{path}: is no file of drake-pregrasp export: {first_line(error)}"
        raise InvalidArgumentError(problem) from error
    for name, array in arrays.items():
        if array.ndim != 1 or not np.all(np.isfinite(array)):
            raise InvalidArgumentError(f"{path}: {name} must be a vector of finite numbers")
        # Places and unit quaternions.
        if name.endswith("X_WO") and (array.shape != (7,) or not _is_unit(array[3:])):
            raise InvalidArgumentError(
                f"{path}: {name} must be x, y, z and a unit quaternion, not {array[:7].tolist()}"
            )
    return arrays


def _vector(file: ZipFile, name: str) -> FloatArray:
    member = file.getinfo(f"{name}.npy")
    if member.file_size > _VECTOR_BYTES:
        raise ValueError(f"{name} has {member.file_size} bytes; at most {_VECTOR_BYTES}")
    with file.open(member) as stream:
        array = np.lib.format.read_array(stream, allow_pickle=False)
    return np.array(array, dtype=float)


def _is_unit(wxyz: FloatArray) -> bool:
    return bool(abs(np.linalg.norm(wxyz) - 1.0) < _UNIT_TOLERANCE)
