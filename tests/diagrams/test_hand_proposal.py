"""Drives of a proposed description."""

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PdControllerGains, RevoluteJoint

from drake_pregrasp.diagrams.hand_proposal import _drive


def test_the_inertia_of_a_rotor_is_that_behind_its_gears():
    plant = MultibodyPlant(0.01)
    frames = plant.world_frame(), plant.AddRigidBody("link").body_frame()
    joint = plant.AddJoint(RevoluteJoint("joint", *frames, np.array([0.0, 0.0, 1.0])))
    actuator = plant.AddJointActuator("joint", joint, 2.0)
    actuator.set_default_rotor_inertia(1e-6)
    actuator.set_default_gear_ratio(100.0)
    actuator.set_controller_gains(PdControllerGains(p=4.0, d=0.0))
    stiffness, damping, inertia, effort = _drive(actuator, is_arm=False)
    assert (stiffness, effort) == (4.0, 2.0)
    assert inertia == pytest.approx(0.01)
    assert damping == pytest.approx(2 * np.sqrt(4.0 * 0.01))
