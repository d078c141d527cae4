"""The hand that the planner plans for."""

from dataclasses import dataclass, field

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from drake_pregrasp.diagrams.config_fields import zeros


@dataclass
class HandConfig:
    """The hand's frame H, in which fingers have their reach."""

    # Where H is: relative to the object's estimated origin if it follows, else in W; in metres.
    position: list[float] = field(
        default_factory=zeros,
        metadata={"length": 3, "at_least": -10, "at_most": 10},
    )

    # Its orientation in W, as roll, pitch and yaw, in radians. It stays.
    rpy: list[float] = field(
        default_factory=zeros,
        metadata={"length": 3, "at_least": -10, "at_most": 10},
    )

    # Whether it follows the object.
    follow: bool = True

    # Where the fingertips are at the start in H, one row each, in metres. If given, each finger
    # gets the contact that makes all of them together travel least, so that no two cross.
    fingertips: list[list[float]] = field(
        default_factory=list, metadata={"elements": {"length": 3, "at_least": -10, "at_most": 10}}
    )

    def initial_X_WH(self, X_WO: RigidTransform) -> RigidTransform:
        """Returns the pose of H in W when the object is at X_WO."""
        p_WH = np.array(self.position) + (X_WO.translation() if self.follow else 0)
        return RigidTransform(RollPitchYaw(self.rpy), p_WH)
