"""DexGraspBench's test of the postures of a grasp, in MuJoCo (extra `mujoco`).

The protocol is that of `setting: fc` in `config/task/eval.yaml` and `src/task/eval_func` of
github.com/JYChen18/DexGraspBench at commit 1e7a5a6: without gravity and table, the hand moves from
its pregrasp over the grasp to the squeeze, and then a force acts on the object.
"""

from collections.abc import Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform
from pydrake.planning import RobotDiagramBuilder

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.diagrams.hand_instances import HandInstances
from drake_pregrasp.diagrams.object_body import add_object
from drake_pregrasp.diagrams.object_contact import separate_contacts
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.convex_pieces import convex_pieces
from drake_pregrasp.simulation.grasp_export import POSTURES
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.systems.mujoco_model import MujocoModel, import_mujoco, mujoco_model

MASS = 0.1
"""Mass of the object, in kg."""

FRICTION = (0.6, 0.6, 0.02)
"""Coefficients along the surface (two) and about its normal, the latter in metres."""

FORCE = 1.0
"""Force on the object, in newtons: its mass times 10 m/s², as in the protocol."""

MOST_MOVED, MOST_TURNED = 0.05, 15.0
"""Bounds on the object's motion from its initial pose, in metres and degrees."""

_MOVES, _MOVE_TIME = 10, 0.04  # Steps from one posture to the next, and seconds of each.
_LOADS, _LOAD_TIME = 10, 0.2  # Times at which a loaded object is looked at, and seconds between.
_TIME_STEP = 5e-4  # The protocol's 4 ms are too long for the stiff drives of carriers, in seconds.
_CONDIM = 4  # Contacts resist sliding and twisting.


class LoadedGrasp(NamedTuple):
    """Result of one direction of the force.

    Attributes:
        direction: Direction of the force in W, shape (3,).
        moved: Largest distance of the object's origin from its initial place, in metres.
        turned: Largest angle from its initial orientation, in degrees.
        held: Whether both were within their bounds.
    """

    direction: FloatArray
    moved: float
    turned: float
    held: bool


def posture_test(resolved: ResolvedScenario, postures: Mapping[str, Any]) -> list[LoadedGrasp]:
    """Returns the results of the six directions of the force, along the axes of W.

    The base stays where it is in the squeeze. The joints have the drives of the hand.

    Args:
        resolved: Scenario of the grasp, with its hand and its object.
        postures: Arrays of `export_grasp`.

    Raises:
        InvalidArgumentError: If the extra `mujoco` is not installed, or cannot simulate the hand,
            or the postures are those of another hand.
    """
    assert resolved.hand is not None
    x, y, z, *wxyz = postures[f"{POSTURES[-1]}_X_WO"]
    X_WO = RigidTransform(Quaternion(np.array(wxyz) / np.linalg.norm(wxyz)), [x, y, z])
    path = [np.array(postures[f"{name}_q"]) for name in POSTURES]
    count, base = resolved.hand.kinematics.num_positions, resolved.hand.base.joints
    if sizes := {len(q) for q in path} - {count}:
        raise InvalidArgumentError(f"postures have {sizes.pop()} joints, and the hand has {count}")
    for q in path:
        q[base] = path[-1][base]
    own, hand, body = _model(resolved, X_WO)
    results = []
    for direction in (sign * axis for axis in np.eye(3) for sign in (-1.0, 1.0)):
        results.append(_loaded(own, hand, body, path, direction))
    return results


def _model(resolved: ResolvedScenario, X_WO: RigidTransform) -> tuple[MujocoModel, Any, int]:
    """Returns the model, the positions of the hand's joints in the plant, and MuJoCo's object."""
    assert resolved.hand is not None
    hand, mesh = resolved.hand, resolved.shape.mesh
    builder = RobotDiagramBuilder(time_step=_TIME_STEP)
    plant, scene_graph = builder.plant(), builder.scene_graph()
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    body = add_object(plant, resolved.shape, MASS)
    models = hand.add_to(plant)
    plant.Finalize()
    instances, inspector = HandInstances(plant, models), scene_graph.model_inspector()
    separate_contacts(plant, scene_graph, body, is_convex=mesh.is_convex)
    hand.separate_links(instances, scene_graph)
    plant.SetDefaultFloatingBaseBodyPose(body, X_WO)
    _, surface = plant.GetCollisionGeometriesForBody(body)
    own = mujoco_model(plant, inspector, {surface: convex_pieces(mesh)})
    own.model.pair_dim[:], own.model.pair_friction[:, :3] = _CONDIM, FRICTION
    places = [joint.position_start() for joint in instances.moving_joints()]
    builder.Build()
    return own, own.q[places], int(own.bodies[body.index()])


def _loaded(
    own: MujocoModel, hand: Any, body: int, path: list[FloatArray], direction: FloatArray
) -> LoadedGrasp:
    mujoco = import_mujoco()
    model, data = own.model, mujoco.MjData(own.model)
    data.qpos[hand] = path[0]
    mujoco.mj_forward(model, data)
    p_WO, wxyz = data.xpos[body].copy(), data.xquat[body].copy()
    # The hand's drives in the order of its positions.
    drives = [int(np.flatnonzero(own.driven == index)[0]) for index in hand]

    def advance(q: FloatArray, seconds: float) -> None:
        data.ctrl[drives] = own.gains[drives, 0] * q
        mujoco.mj_step(model, data, round(seconds / model.opt.timestep))

    for start, end in pairwise(path):
        for step in range(1, _MOVES + 1):
            advance(start + step / _MOVES * (end - start), _MOVE_TIME)
    data.xfrc_applied[body, :3] = FORCE * direction
    moved = turned = 0.0
    for _ in range(_LOADS):
        advance(path[-1], _LOAD_TIME)
        moved = max(moved, float(np.linalg.norm(data.xpos[body] - p_WO)))
        cosine = min(1.0, abs(float(data.xquat[body] @ wxyz)))
        turned = max(turned, float(np.degrees(2 * np.arccos(cosine))))
    return LoadedGrasp(direction, moved, turned, moved < MOST_MOVED and turned < MOST_TURNED)
