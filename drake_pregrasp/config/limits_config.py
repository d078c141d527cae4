"""Configuration of the limits on contact goals, and of the fingers' reach."""

from dataclasses import dataclass, field

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.object_config import POINT, BoxFields, zeros
from drake_pregrasp.contacts.contact_pairs import Pair
from drake_pregrasp.contacts.goal_limits import ContactLimits
from drake_pregrasp.contacts.quality_guard import GUARDS, guard_measure
from drake_pregrasp.contacts.reassignment import ReassignmentRule
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.box_surface import BOX_FACES
from drake_pregrasp.geometry.mesh_surface import AxisArea
from drake_pregrasp.geometry.solids import BallSolid, Solid
from drake_pregrasp.quality.force_closure import LargestMinimum, largest_minimum
from drake_pregrasp.regions.finger_measures import FINGER_MEASURES
from drake_pregrasp.regions.finger_reach import FingerReach
from drake_pregrasp.regions.independent_regions import SlipRadii, slip_radii_within

_HALF_TURN = 3.1416  # Largest angle between two directions, in radians.


@dataclass
class _Incidence:
    """Bounds on the angles between a finger or its hand's axis and the surface's normal."""

    # Direction from the hand outward along the finger, in H; of any length. The angles need it.
    direction: list[float] = field(
        default_factory=list, metadata={"at_least": -10, "at_most": 10}, kw_only=True
    )

    # Largest angle between `direction` and the surface's outward normal, in radians.
    incidence: float = field(
        default=_HALF_TURN, metadata={"above": 0, "at_most": _HALF_TURN}, kw_only=True
    )

    # Largest angle between this normal and the xy plane of H, in radians: small for a hand that
    # catches objects which come along z of H, and pass between its fingertips.
    elevation: float = field(
        default=_HALF_TURN / 2, metadata={"above": 0, "at_most": _HALF_TURN / 2}, kw_only=True
    )

    def _reach_in(self, solid: Solid) -> FingerReach:
        if len(self.direction) not in (0, 3):
            raise InvalidArgumentError(
                f"direction {self.direction} must have 3 elements, or none without angles"
            )
        direction = np.array(self.direction) if self.direction else None
        return FingerReach(solid, direction, incidence=self.incidence, elevation=self.elevation)


@dataclass
class BallReach(_Incidence):
    """Reach of a finger: a ball."""

    # Centre of the ball in the hand frame H, in metres.
    center: list[float] = field(default_factory=zeros, metadata={"required": True, **POINT})

    # Radius, in metres.
    radius: float = field(default=0.0, metadata={"required": True, "above": 0, "at_most": 10})

    def make_reach(self) -> FingerReach:
        """Returns the reach, in H."""
        return self._reach_in(BallSolid(np.array(self.center), self.radius))


@dataclass
class BoxReach(BoxFields, _Incidence):
    """Reach of a finger: a box in the hand frame H."""

    def make_reach(self) -> FingerReach:
        """Returns the reach, in H."""
        return self._reach_in(self.make_solid())


@dataclass
class SectorReach:
    """Reach of a finger of a radial hand: a sector about the finger's own azimuth."""

    # Azimuth of the finger about z of H, in radians.
    azimuth: float = field(default=0.0, metadata={"required": True, "at_least": -10, "at_most": 10})

    # Largest angle between the azimuth of the finger and of its tip at the standoff, in radians.
    half_angle: float = field(default=1.13, metadata={"above": 0, "at_most": _HALF_TURN})

    # Largest angle between the finger's direction and the surface's outward normal, in radians.
    # Beyond it a finger reaches around an edge of the object, and touches it with a link.
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
class LimitsConfig:
    """Limits on contact goals. A limit at its default is that of the hand, if there is one."""

    # Largest speed of a goal over the object, in m/s; 0 for no limit.
    max_speed: float = field(default=0.0, metadata=_LENGTH)

    # Largest step of a goal over the object in one tick, in metres; 0 for no limit.
    max_step: float = field(default=0.0, metadata=_LENGTH)

    # A goal stays if its new place is closer than this, in metres.
    deadband: float = field(default=0.0, metadata=_LENGTH)

    # Radius of each fingertip, in metres; fingertips at active contacts do not overlap. Empty:
    # fingertips are points.
    tip_radii: list[float] = field(default_factory=list, metadata=_LENGTH)

    # Clearance between fingertips and obstacles, in metres.
    clearance: float = field(default=0.004, metadata=_LENGTH)

    # Smallest gap between fingertips, in metres.
    tip_gap: float = field(default=0.0, metadata=_LENGTH)

    # Distance from the surface at which fingertips wait, in metres; they are clear of obstacles
    # there too.
    standoff: float = field(default=0.0, metadata=_LENGTH)

    # Seconds from now for which contacts are clear of obstacles, with the predicted motion of both.
    horizon: float = field(default=0.0, metadata={"at_least": 0, "at_most": 60})

    # Reach of each finger in the hand frame H. Empty: unlimited.
    reach: list[ReachConfig] = field(default_factory=list)

    # Least measures of a hand's finger at its contact, with the palm at home over the object; 0 for
    # no limit. Of the fingertip's Jacobian: smallest singular value, in metres; product of the
    # singular values, in m^3; smallest over largest one. Distance of each joint to its limits over
    # their distance; force along the inward normal that the joints' torques allow, in newtons.
    singularity_distance: float = field(default=0.0, metadata=_LENGTH)
    manipulability: float = field(default=0.0, metadata=_LENGTH)
    uniformity: float = field(default=0.0, metadata={"at_least": 0, "at_most": 1})
    joint_range: float = field(default=0.0, metadata={"at_least": 0, "at_most": 0.5})
    finger_force: float = field(default=0.0, metadata={"at_least": 0, "at_most": 1e4})

    # For each contact the names of faces, such as +z, that it must not touch although others may. A
    # face of a mesh is all surface whose normal is closest to that axis of O. Empty: none.
    forbidden_faces: list[list[str]] = field(
        default_factory=list, metadata={"elements": {"one_of": BOX_FACES}}
    )

    # Pairs of contacts at a fixed distance, or opposite each other.
    pairs: list[Pair] = field(default_factory=list)

    # Qualities that no step may reduce: measures of the complete grasp matrix, and the
    # force-closure margin.
    guard: list[str] = field(default_factory=list, metadata={"one_of": GUARDS})

    # Radius in metres within which each contact can slip, while the others stay, without a loss of
    # force closure. No step may reduce it; larger radii count as this one. 0: no limit.
    independent_radius: float = field(default=0.0, metadata=_LENGTH)

    # Whether a contact with an empty region moves to the closest point that it may touch.
    recover: bool = False

    # When fingers exchange contacts, or take those of an equivalent grasp; needs `reach`.
    reassign: ReassignmentRule = field(default_factory=ReassignmentRule)

    def reaches(self) -> list[FingerReach | None]:
        """Returns the reach of each finger in H, or None if it is unlimited; empty for all."""
        return [
            reach if reach is None or isinstance(reach, FingerReach) else reach.make_reach()
            for reach in self.reach
        ]

    def closed(self) -> list[list[AxisArea]]:
        """Returns the areas that are forbidden to single contacts; empty for none."""
        return [[AxisArea(face) for face in faces] for faces in self.forbidden_faces]

    def least_measures(self) -> FloatArray:
        """Returns the least value of each of the `FINGER_MEASURES`, shape (5,); 0 for no limit."""
        return np.array([getattr(self, name) for name in FINGER_MEASURES])

    def make_limits(
        self,
        period: float,
        friction: float,
        *,
        slip_radii: SlipRadii = slip_radii_within,
        solve: LargestMinimum = largest_minimum,
    ) -> ContactLimits:
        """Returns the limits on goals that are planned at a constant rate.

        Args:
            period: Seconds between planning ticks.
            friction: Coulomb's coefficient, for the guards of force closure.
            slip_radii: Implementation of `slip_radii_within`.
            solve: Implementation of `largest_minimum`.
        """
        steps, radius = [self.max_step, self.max_speed * period], self.independent_radius
        return ContactLimits(
            max_step=min((step for step in steps if step > 0), default=np.inf),
            deadband=self.deadband,
            pairs=tuple(self.pairs),
            recover=self.recover,
            guard=guard_measure(self.guard, friction, radius, slip_radii, solve),
        )
