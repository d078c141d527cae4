"""The shipped hand with five fingers, its controller over a cube, and poses of its tips."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import BusValue

from drake_pregrasp import BoxSolid, GraspConfig, HandController, HandModel, load_hand

HAND = HandModel(load_hand("package://drake_pregrasp/five_finger_hand.yaml"))
FRAMES = HAND.kinematics.tip_frames
AROUND = 2 * np.pi * np.arange(5) / 5
RAYS = np.stack([np.cos(AROUND), np.sin(AROUND), 0 * AROUND], axis=1)
RING = 0.05 * RAYS
X_WO = RigidTransform([0.0, 0.0, 0.05])


def hand_controller(config=None, **changes):
    arguments = {
        "object_solid": BoxSolid(np.zeros(3), np.eye(3), np.full(3, 0.1)),
        "mass": 0.4,
        "p_OCoM": np.zeros(3),
        "fixed": [],
        "X_WO": X_WO,
        "p_OC": RING,
        "target_period": 0.05,
        "plant_time_step": 0.01,
    }
    return HandController(config or GraspConfig(), HAND, **(arguments | changes))


def bus(points, normals=None, names=FRAMES):
    """A bus of poses at points, with their z axes against the normals if there are any."""
    value = BusValue()
    for index, (name, point) in enumerate(zip(names, points, strict=False)):
        R = RotationMatrix()
        if normals is not None:
            R = RotationMatrix.MakeFromOneVector(-np.array(normals[index], dtype=float), 2)
        value.Set(name, AbstractValue.Make(RigidTransform(R, point)))
    return value


def points_of(value, names=FRAMES):
    found = [value.Find(name) for name in names]
    return np.array([X.translation() for X in found if X is not None])
