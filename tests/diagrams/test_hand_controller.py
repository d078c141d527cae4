"""The hand's controller as others build it: what it takes, and what it refuses."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix

from drake_pregrasp import BoxSolid, GraspConfig, HandController, HandModel, load_hand
from drake_pregrasp.errors import InvalidArgumentError

MODEL = HandModel(load_hand("package://drake_pregrasp/five_finger_hand.yaml"))
AROUND = 2 * np.pi * np.arange(5) / 5
RING = 0.05 * np.stack([np.cos(AROUND), np.sin(AROUND), 0 * AROUND], axis=1)
TURNED = RING @ RotationMatrix.MakeZRotation(0.4).matrix().T


def controller(config=None, **changes):
    arguments = {
        "object_solid": BoxSolid(np.zeros(3), np.eye(3), np.full(3, 0.1)),
        "object_top": 0.05,
        "mass": 0.4,
        "p_OCoM": np.zeros(3),
        "fixed": [],
        "X_WO": RigidTransform([0.0, 0.0, 0.05]),
        "p_OC": RING,
        "target_period": 0.05,
        "plant_time_step": 0.01,
    }
    return HandController(config or GraspConfig(), MODEL, **(arguments | changes))


def test_it_starts_over_the_object_turned_to_its_contacts():
    for p_OC, yaw in ((RING, 0.0), (TURNED, 0.4)):
        np.testing.assert_allclose(controller(p_OC=p_OC).initial[3], yaw, atol=1e-4)


def test_its_wrist_starts_within_its_range():
    config = GraspConfig(wrist_range=[-0.1, 0.2])
    assert controller(config, p_OC=TURNED).initial[3] == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("config", "changes", "problem"),
    [
        (None, {"p_OC": RING[:4]}, r"p_OC must have shape \(5, 3\), not \(4, 3\)"),
        (None, {"p_OCoM": np.zeros(2)}, r"p_OCoM must have shape \(3,\), not \(2,\)"),
        (None, {"mass": 0.0}, "mass must be greater than 0, not 0.0"),
        (None, {"mass": np.nan}, "mass must be greater than 0, not nan"),
        (None, {"plant_time_step": -1.0}, "plant_time_step must be greater than 0"),
        (GraspConfig(least_force=0.2), {}, "touch_force must be less than least_force, 0.2"),
    ],
)
def test_what_makes_no_sense_is_refused(config, changes, problem):
    with pytest.raises(InvalidArgumentError, match=problem):
        controller(config, **changes)
