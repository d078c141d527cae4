"""The shipped hand with five fingers, and its controller over a cube."""

import numpy as np
from pydrake.math import RigidTransform

from drake_pregrasp import BoxSolid, GraspConfig, HandController, HandModel, load_hand

HAND = HandModel(load_hand("package://drake_pregrasp/five_finger_hand.yaml"))
FRAMES = HAND.kinematics.tip_frames
AROUND = 2 * np.pi * np.arange(5) / 5
RING = 0.05 * np.stack([np.cos(AROUND), np.sin(AROUND), 0 * AROUND], axis=1)
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
