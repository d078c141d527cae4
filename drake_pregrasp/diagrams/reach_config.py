"""What fingers reach: elements of `planner.limits.reach`, in the hand's frame H."""

from dataclasses import dataclass, field

import numpy as np
from pydrake.math import RollPitchYaw

from drake_pregrasp.diagrams.config_fields import zeros
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.planning.finger_reach import FingerReach
from drake_pregrasp.planning.solids import BallSolid, BoxSolid, Solid

_POINT = {"length": 3, "at_least": -10, "at_most": 10}
_HALF_TURN = 3.1416  # Radians; what is larger than half a turn can't be an angle between ways.


@dataclass
class _Incidence:
    """A bound on the angle at which a finger may meet the surface."""

    # The way in which the finger stands off the hand, in H; of any length. Needed for `incidence`.
    direction: list[float] = field(
        default_factory=list, metadata={"at_least": -10, "at_most": 10}, kw_only=True
    )

    # Largest angle between that and the surface's outward normal, in radians.
    incidence: float = field(
        default=_HALF_TURN, metadata={"above": 0, "at_most": _HALF_TURN}, kw_only=True
    )

    def _reach_in(self, solid: Solid) -> FingerReach:
        if len(self.direction) not in (0, 3):
            raise InvalidArgumentError(
                f"direction {self.direction} must have 3 elements, or none without incidence"
            )
        direction = np.array(self.direction) if self.direction else None
        return FingerReach(solid=solid, direction=direction, incidence=self.incidence)


@dataclass
class BallReach(_Incidence):
    """A finger that reaches everything inside a ball."""

    # The ball's centre in the hand's frame H, in metres.
    center: list[float] = field(default_factory=zeros, metadata={"required": True, **_POINT})

    # Its radius, in metres.
    radius: float = field(default=0.0, metadata={"required": True, "above": 0, "at_most": 10})

    def make_reach(self) -> FingerReach:
        """Returns the reach, in H."""
        return self._reach_in(BallSolid(np.array(self.center), self.radius))


@dataclass
class BoxReach(_Incidence):
    """A finger that reaches everything inside a box."""

    # Edge lengths, in metres.
    size: list[float] = field(
        default_factory=zeros,
        metadata={"required": True, "length": 3, "above": 0, "at_most": 10},
    )

    # Its centre in the hand's frame H, in metres.
    center: list[float] = field(default_factory=zeros, metadata=_POINT)

    # Its orientation in H, as roll, pitch and yaw, in radians.
    rpy: list[float] = field(
        default_factory=zeros, metadata={"length": 3, "at_least": -10, "at_most": 10}
    )

    def make_reach(self) -> FingerReach:
        """Returns the reach, in H."""
        R_HB = RollPitchYaw(self.rpy).ToRotationMatrix().matrix()
        return self._reach_in(BoxSolid(np.array(self.center), R_HB, np.array(self.size)))


@dataclass
class SectorReach:
    """A finger of a radial hand: it reaches what is not too far aside from its own azimuth."""

    # Where the finger is about z of H, in radians.
    azimuth: float = field(default=0.0, metadata={"required": True, "at_least": -10, "at_most": 10})

    # Largest angle between that and the azimuth of the tip at its standoff, in radians.
    half_angle: float = field(default=1.13, metadata={"above": 0, "at_most": _HALF_TURN})

    # Largest angle between the finger's way out and the surface's outward normal, in radians. A
    # finger that stands farther off a face reaches round its edge, and touches with a link.
    incidence: float = field(default=1.22, metadata={"above": 0, "at_most": _HALF_TURN})

    def make_reach(self) -> FingerReach:
        """Returns the reach, in H."""
        direction = np.array([np.cos(self.azimuth), np.sin(self.azimuth), 0.0])
        return FingerReach(
            direction=direction, half_angle=self.half_angle, incidence=self.incidence
        )


ReachConfig = BallReach | BoxReach | SectorReach
