"""Initial state of the object, and its expected path without a simulation."""

from collections.abc import Mapping

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, RigidBody

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.object_config import (
    GRAVITY,
    Conveyor,
    MotionConfig,
    PoseStream,
    Push,
    Toss,
)
from drake_pregrasp.diagrams.object_body import resting_position
from drake_pregrasp.estimation.recorded_poses import RecordedPoses
from drake_pregrasp.geometry.motion_profiles import VelocityProfile
from drake_pregrasp.geometry.shapes import Shape

_SAMPLES = 50  # Positions of the path.
_POSES = 200  # Poses on a conveyor.


Motion = Conveyor | Toss | Push | RecordedPoses
"""Motion of an object, for which no file has to be read."""


def read_motion(motion: MotionConfig | RecordedPoses) -> Motion:
    """Returns a motion whose recorded poses have been read.

    Raises:
        InvalidArgumentError: If their file cannot be read, or holds no valid poses.
    """
    return motion.read() if isinstance(motion, PoseStream) else motion


def expected_path(motion: Motion, duration: float, shape: Shape) -> FloatArray:
    """Returns expected positions of the centre of mass in W, shape (k, 3), in metres.

    Args:
        motion: Motion of the object.
        duration: Duration of the run, in seconds.
        shape: Shape of the object in O.
    """
    times = np.linspace(0.0, duration, _SAMPLES)
    p_OCoM = shape.p_OCoM
    start = resting_position(shape) + p_OCoM
    if isinstance(motion, Conveyor):
        path = [X_WO @ p_OCoM for _, X_WO in expected_poses(motion, duration, shape)]
    elif isinstance(motion, Toss):
        position, velocity = np.array(motion.position), np.array(motion.velocity)
        if motion.table:
            drop = max(0.0, position[2] - start[2])
            rise = velocity[2] / GRAVITY
            times = times * min(1.0, (rise + np.sqrt(rise**2 + 2 * drop / GRAVITY)) / duration)
        fall = np.array([0.0, 0.0, -GRAVITY])
        path = [position + t * velocity + t**2 / 2 * fall for t in times]
    elif isinstance(motion, Push):
        distances = np.linspace(0.0, motion.distance, _SAMPLES)
        path = [start + distance * motion.unit_vector() for distance in distances]
    else:
        poses = map(motion.at, times)
        path = [p_WO + R_WO.apply(p_OCoM) for p_WO, R_WO in poses]
    return np.array(path)


def expected_poses(
    motion: Motion, duration: float, shape: Shape
) -> list[tuple[float, RigidTransform]]:
    """Returns times in seconds and poses X_WO of the object, as far as its motion is prescribed.

    On a conveyor these are samples of the whole path; otherwise it is the initial pose only.

    Args:
        motion: Motion of the object.
        duration: Duration of the run, in seconds.
        shape: Shape of the object in O.
    """
    start = initial_pose(motion, shape)
    if not isinstance(motion, Conveyor):
        return [(0.0, start)]
    profile, x = VelocityProfile(motion.velocities()), motion.position[0]
    on_table, poses = RigidTransform([-x, 0.0, 0.0]) @ start, []
    for time in np.linspace(0.0, duration, _POSES).tolist():
        slid, turned = profile.at(time)[0]
        X_WD = RigidTransform(RotationMatrix.MakeZRotation(turned), [x + slid, 0.0, 0.0])
        poses.append((time, X_WD @ on_table))
    return poses


def initial_pose(motion: Motion, shape: Shape) -> RigidTransform:
    """Returns the initial pose of the object O in W."""
    if isinstance(motion, Toss):
        R_WO = RollPitchYaw(motion.rpy).ToRotationMatrix()
        return RigidTransform(R_WO, np.array(motion.position) - R_WO @ shape.p_OCoM)
    if isinstance(motion, RecordedPoses):
        position, rotation = motion.at(0.0)
        return RigidTransform(RotationMatrix(rotation.as_matrix()), position)
    X_WO = RigidTransform(resting_position(shape))
    if isinstance(motion, Conveyor):
        place = np.array([*motion.position, 0.0])
        return RigidTransform(RotationMatrix.MakeZRotation(motion.yaw), place) @ X_WO
    return X_WO


def initial_velocities(
    plant: MultibodyPlant,
    body: RigidBody,
    motion: Motion,
    rates: Mapping[ModelInstanceIndex, FloatArray],
    *,
    steps: int = 1,
) -> FloatArray:
    """Returns the generalized velocities at the start, shape (nv,).

    A conveyor moves from the start on, and the object with it.

    In time steps of h, a tossed body falls by g t (t + h)/2. A toss that is faster by g h/2 upwards
    makes the parabola of the centre of mass exact at the steps. The orientation of a tumbling body
    still has an error of the order of h.

    Args:
        plant: The plant, finalized.
        body: The object's body B.
        motion: Motion of the object.
        rates: Rates of the joints of models that carry or push the object, or are obstacles.
        steps: Number of steps of the engine in one of the plant.
    """
    velocities, context = np.zeros(plant.num_velocities()), plant.CreateDefaultContext()
    for instance, v in rates.items():
        plant.SetVelocitiesInArray(instance, v, velocities)
    plant.SetVelocities(context, velocities)
    X_WB = body.EvalPoseInWorld(context)
    V_WB = SpatialVelocity.Zero()
    if isinstance(motion, Conveyor):
        turntable = plant.GetBodyByName("turntable")
        p_WD = turntable.EvalPoseInWorld(context).translation()
        V_WB = turntable.EvalSpatialVelocityInWorld(context).Shift(X_WB.translation() - p_WD)
    elif isinstance(motion, Toss):
        half_step = -plant.gravity_field().gravity_vector() * plant.time_step() / (2 * steps)
        V_WBcm = SpatialVelocity(w=motion.spin, v=np.array(motion.velocity) + half_step)
        V_WB = V_WBcm.Shift(X_WB.rotation() @ -body.default_com())
    plant.SetVelocitiesInArray(body.model_instance(), V_WB.get_coeffs(), velocities)
    return velocities
