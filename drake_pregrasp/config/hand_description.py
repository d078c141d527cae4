"""Schema of hand descriptions, the files that `hand.file` of a scenario names.

A description adds to a model file what the model does not contain; docs/own_hand.md has an example.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.limits_config import ReachConfig, SectorReach
from drake_pregrasp.config.object_config import POINT, zeros
from drake_pregrasp.contacts.contact_pairs import Pair
from drake_pregrasp.geometry.box_surface import BOX_FACES
from drake_pregrasp.grasping.grasp_state import GraspSettings

_ANGLE = {"at_least": -10, "at_most": 10}
_PLANNED_PATCH = 0.5  # Share of the radius of a pad that grasps are planned with.


@dataclass
class Mount:
    """Place of a hand without axes of its own on axes that this package adds."""

    # Name of the hand's link that is joined to the wrist; empty if the model has the axes itself.
    link: str = ""

    # Position of the link in the frame of the wrist, in metres. At yaw 0 the wrist has the axes of
    # W, and is `palm_height` over the object's centre of mass.
    position: list[float] = field(default_factory=zeros, metadata=POINT)

    # Orientation of the link, as roll, pitch and yaw in the wrist, in radians.
    rpy: list[float] = field(default_factory=zeros, metadata=POINT)


@dataclass
class Carrier:
    """Four axes that carry a palm over the object."""

    # Names of the joints that slide along x, y and z of the approach (of W from above), and
    # turn about z.
    joints: list[str] = field(
        default_factory=lambda: ["x", "y", "z", "yaw"], metadata={"length": 4}
    )

    # Height of the carrier over the object's centre of mass, in metres; more for objects that are
    # so high that the carrier would come nearer than `top_clearance` to their top.
    palm_height: float = field(default=0.155, metadata={"at_least": 0, "at_most": 10})

    # Least height of the carrier over the object's top, in metres, before `grasp.palm_shifts`.
    top_clearance: float = field(default=0.05, metadata={"at_least": 0, "at_most": 10})

    # Place of a hand whose model lacks these joints.
    mount: Mount = field(default_factory=Mount)


@dataclass
class Arm:
    """An arm that carries a palm over the object."""

    # Name of the palm's frame P.
    palm: str = field(default="", metadata={"required": True})

    # Names of the arm's joints. All other joints belong to fingers.
    joints: list[str] = field(default_factory=list, metadata={"required": True, "min_length": 6})

    # Home positions of the arm, toward which it moves as far as the palm's pose allows.
    home: list[float] = field(default_factory=list, metadata={"required": True, **_ANGLE})

    # Position of the palm over the object's centre of mass at yaw 0, along the axes of W, in
    # metres; higher for objects so high that the palm would come nearer than `top_clearance` to
    # their top.
    palm_position: list[float] = field(default_factory=zeros, metadata={"required": True, **POINT})

    # Orientation of the palm at yaw 0, as roll, pitch and yaw in W, in radians.
    palm_rpy: list[float] = field(default_factory=zeros, metadata=POINT)

    # Whether the heights of the palm and of the fingers' reach are over the object's top, and not
    # over its centre of mass.
    over_top: bool = False

    # Least height of the palm over the object's top, in metres, without `over_top` and before
    # `grasp.palm_shifts`.
    top_clearance: float = field(default=0.05, metadata={"at_least": 0, "at_most": 10})


BaseConfig = Carrier | Arm


@dataclass
class Closing:
    """Limits of a finger that closes, for all scenarios."""

    # Largest speed of the fingertip, in m/s.
    speed: float = field(default=0.1, metadata={"above": 0, "at_most": 10})

    # Largest normal force, in newtons.
    force: float = field(default=12.0, metadata={"above": 0, "at_most": 1e4})

    # Depth below the estimated surface to which the fingertip searches for contact, and distance
    # from it beyond which a finger that does not press has lost the object, in metres.
    depth: float = field(default=0.006, metadata={"above": 0, "at_most": 1})


@dataclass
class Fingertip:
    """A fingertip and its finger."""

    # Name of the frame at the centre of the fingertip; links have frames of their names.
    frame: str = field(default="", metadata={"required": True})

    # Link to which this frame is added; empty if the model has the frame.
    link: str = ""

    # Centre of the fingertip in that link, in metres.
    center: list[float] = field(default_factory=zeros, metadata=POINT)

    # Radius of the fingertip, in metres.
    radius: float = field(default=0.01, metadata={"required": True, "above": 0, "at_most": 0.1})

    # Radius of the patch in which a soft, flat fingertip touches, in metres: that of a round pad.
    # Friction then resists turns about the normal as well; half the radius is planned with. 0: a
    # hard fingertip touches at a point.
    patch_radius: float = field(default=0.0, metadata={"at_least": 0, "at_most": 0.1})

    # Home positions of the joints that move only this fingertip, in the order of the model, in
    # radians (or metres).
    home: list[float] = field(default_factory=list, metadata={"required": True, **_ANGLE})

    # Reach of the finger in the frame H. Its origin is that of O, z is up, and its axes are those
    # of W at yaw 0. H turns with a palm that turns without limits; for a palm of limited range, the
    # yaw of H is the middle of that range.
    reach: ReachConfig = field(default_factory=SectorReach, metadata={"required": True})

    # Distance from the object's z axis at which the fingertip waits, above the object, while it has
    # no contact, in metres. 0: the mean distance of the fingertips at home.
    withdrawn_radius: float = field(default=0.0, metadata={"at_least": 0, "at_most": 1})

    closing: Closing = field(default_factory=Closing)

    # Faces of the object, such as +z, that the fingertip must not touch.
    forbidden_faces: list[str] = field(default_factory=list, metadata={"one_of": BOX_FACES})

    @property
    def planned_patch(self) -> float:
        """Radius of the patch that grasps are planned with, in metres.

        On a curved or uneven surface, a pad touches with a part of its face.
        """
        return _PLANNED_PATCH * self.patch_radius

    def raised(self, height: float) -> "Fingertip":
        """Returns the fingertip with its reach raised by a height in metres."""
        if isinstance(self.reach, SectorReach):  # It has all heights.
            return self
        x, y, z = self.reach.center
        return replace(self, reach=replace(self.reach, center=[x, y, z + height]))


def least_fingers(fingertips: Sequence[Fingertip]) -> int:
    """Returns the least number of fingers that can hold an object.

    Two hard fingers do not resist a moment about the line through them. Two suffice if a fingertip
    is soft.
    """
    return 2 if any(tip.patch_radius > 0 for tip in fingertips) else GraspSettings.least_fingers


@dataclass
class Drive:
    """Position drive of joints, which replaces the drives of the model and the joints' damping."""

    # Names of the joints; empty for all that no other drive names. If there is a drive or a mount,
    # each joint needs a drive.
    joints: list[str] = field(default_factory=list)

    # Gains of the error of position, in N m/rad, and of velocity, in N m s/rad. For joints that
    # slide, here and below, metres replace radians, newtons N m, and kg kg m².
    stiffness: float = field(default=4.0, metadata={"above": 0, "at_most": 1e6})
    damping: float = field(default=0.12, metadata={"above": 0, "at_most": 1e6})

    # Inertia of the rotor behind its gears, in kg m².
    rotor_inertia: float = field(default=5e-4, metadata={"at_least": 0, "at_most": 100})

    # Largest torque, in N m.
    effort: float = field(default=1.0, metadata={"above": 0, "at_most": 1e6})

    # Largest speed and acceleration, in rad/s and rad/s²; 0 for those of the model.
    speed: float = field(default=0.0, metadata={"at_least": 0, "at_most": 1e6})
    acceleration: float = field(default=0.0, metadata={"at_least": 0, "at_most": 1e6})


@dataclass
class LockedJoint:
    """A joint that does not move."""

    # Name of the joint.
    joint: str = field(default="", metadata={"required": True})

    # Its position, in radians or metres.
    position: float = field(default=0.0, metadata=_ANGLE)


@dataclass
class HandDescription:
    """A hand with its carrier or arm."""

    # An SDF, a URDF or an MJCF, or Drake model directives (.dmd.yaml) with several models: a path
    # from this file's folder, package://drake_pregrasp/... for a shipped model, or
    # robots://allegro_hand.urdf and others of the extra `robots`. Or the list of directives.
    # Where models have a link, joint or frame of the same name, keys name it as model::name.
    model: str = field(default="", metadata={"required": True, "path": True})

    # Base of the palm: !Carrier or !Arm.
    base: BaseConfig = field(default_factory=Carrier, metadata={"required": True})

    # Fingertips, one for each contact.
    fingertips: list[Fingertip] = field(
        default_factory=list, metadata={"required": True, "min_length": 2}
    )

    # Drives of joints that have none in the model, or others.
    drives: list[Drive] = field(default_factory=list)

    # Joints that are replaced by fixed ones, such as those of a wrist under a carrier.
    locked: list[LockedJoint] = field(default_factory=list)

    @property
    def patch_radii(self) -> FloatArray:
        """`planned_patch` of each fingertip, 0 for hard ones, shape (n,), in metres."""
        return np.array([tip.planned_patch for tip in self.fingertips])

    @property
    def jaws(self) -> list[Pair]:
        """Pairs of contacts that must be opposite each other.

        Two fingers with one joint each, and no others, are the jaws of a parallel gripper: their
        contacts are on a line along which both jaws move.
        """
        joints = [len(tip.home) for tip in self.fingertips]
        return [Pair(0, 1)] if joints == [1, 1] else []

    @property
    def palm_height(self) -> float:
        """Height of the palm over the object's centre of mass, in metres."""
        if isinstance(self.base, Carrier):
            return self.base.palm_height
        return self.base.palm_position[2]

    def over_object(self, top: float, shift: float = 0.0, least: float = 0.0) -> "HandDescription":
        """Returns the description with the heights of palm and reach over the centre of mass.

        Args:
            top: Height of the object's top over its centre of mass, in metres.
            shift: How much higher the palm is than without a shift, in metres.
            least: Least height over the top of a palm that a shift lowers, in metres.
        """
        is_over_top = isinstance(self.base, Arm) and self.base.over_top
        needed = top + self.base.top_clearance - self.palm_height
        rise = top if is_over_top else max(0.0, needed)
        rise = max(rise + shift, min(rise, top + least - self.palm_height))
        if isinstance(self.base, Carrier):
            base: BaseConfig = replace(self.base, palm_height=self.palm_height + rise)
        else:
            x, y, z = self.base.palm_position
            base = replace(self.base, palm_position=[x, y, z + rise], over_top=False)
        return replace(self, base=base, fingertips=[tip.raised(rise) for tip in self.fingertips])
