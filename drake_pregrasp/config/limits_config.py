"""What holds contact goals back, and what keeps them apart."""

from dataclasses import dataclass, field

import numpy as np
from pydrake.math import RollPitchYaw

from drake_pregrasp.config.object_config import zeros
from drake_pregrasp.contacts.goal_limits import ContactLimits, CoupledPair
from drake_pregrasp.contacts.quality_guard import GUARDS, guard_measure
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.box_surface import BOX_FACES
from drake_pregrasp.geometry.mesh_surface import AxisArea
from drake_pregrasp.geometry.solids import BallSolid, BoxSolid, Solid
from drake_pregrasp.regions.constraints import FingerReach

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


_LENGTH = {"at_least": 0, "at_most": 10}


@dataclass
class Pair:
    """Two contacts of one finger, as its tip and the joint before it, at a fixed distance."""

    # Index of the contact that moves freely.
    first: int = field(default=0, metadata={"required": True, "at_least": 0})

    # Index of the contact that follows it.
    second: int = field(default=0, metadata={"required": True, "at_least": 0})

    # Their distance, in metres.
    distance: float = field(default=0.0, metadata={"required": True, "above": 0, "at_most": 10})

    # By how much it may be off, in metres.
    tolerance: float = field(default=0.0005, metadata={"at_least": 1e-5, "at_most": 1})


@dataclass
class LimitsConfig:
    """What holds contact goals back, and what keeps them apart."""

    # Largest speed of a goal over the object, in m/s; 0 for no limit.
    max_speed: float = field(default=0.0, metadata=_LENGTH)

    # Largest step of a goal over the object in one tick, in metres; 0 for no limit.
    max_step: float = field(default=0.0, metadata=_LENGTH)

    # A goal stays as long as what it should move to is nearer than that, in metres.
    deadband: float = field(default=0.0, metadata=_LENGTH)

    # Radius of each fingertip, in metres: tips at active contacts don't overlap. Empty: points.
    tip_radii: list[float] = field(default_factory=list, metadata=_LENGTH)

    # Between fingertips and obstacles, in metres.
    clearance: float = field(default=0.004, metadata=_LENGTH)

    # Between fingertips, at least, in metres.
    tip_gap: float = field(default=0.0, metadata=_LENGTH)

    # How far from the surface fingertips wait, in metres: they stay clear of obstacles there, too.
    standoff: float = field(default=0.0, metadata=_LENGTH)

    # For how long from now on contacts stay clear of obstacles, as these and the object move on, in
    # seconds.
    horizon: float = field(default=0.0, metadata={"at_least": 0, "at_most": 60})

    # What each finger reaches, in the hand's frame H. Empty: everything.
    reach: list[ReachConfig] = field(default_factory=list)

    # For each contact the names of faces, as +z, that it may not touch, while others may. A face of
    # a mesh is all ground whose normal is nearest to that axis of O. Empty: none.
    forbidden_faces: list[list[str]] = field(
        default_factory=list, metadata={"elements": {"one_of": BOX_FACES}}
    )

    # Contacts that keep a distance.
    pairs: list[Pair] = field(default_factory=list)

    # What no step may make worse, as hysteresis in quality: measures of the complete grasp matrix,
    # and the force-closure margin.
    guard: list[str] = field(default_factory=list, metadata={"one_of": GUARDS})

    # Whether a contact without a region moves to the nearest place that it may have.
    recover: bool = False

    def closed(self) -> list[list[AxisArea]]:
        """Returns the ground that is forbidden to single contacts."""
        return [[AxisArea(face) for face in faces] for faces in self.forbidden_faces]

    def make_limits(self, period: float, friction: float) -> ContactLimits:
        """Returns the limits for goals that are planned once a period, in seconds.

        Args:
            period: In seconds.
            friction: Coulomb's coefficient, for the margin.
        """
        if min(self.max_step, self.max_speed) < 0:
            raise InvalidArgumentError("max_step and max_speed must be at least 0")
        steps = [self.max_step, self.max_speed * period]
        return ContactLimits(
            max_step=min((step for step in steps if step > 0), default=np.inf),
            deadband=self.deadband,
            pairs=tuple(
                CoupledPair(p.first, p.second, p.distance, p.tolerance) for p in self.pairs
            ),
            recover=self.recover,
            guard=guard_measure(self.guard, friction),
        )
