"""A hand over an object, as far as its start contacts depend on it, and these contacts."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.contacts.assignment import FREE_TURN
from drake_pregrasp.contacts.contact_pairs import Pair
from drake_pregrasp.regions.constraints import RegionConstraints


@dataclass(frozen=True, eq=False)
class HandAboveObject:
    """A hand with its palm over an object, as far as its start contacts depend on it.

    Attributes:
        constraints_at: Function from a yaw of the palm, in radians, to the constraints of the
            contacts in O, with fingertips.
        p_OT_at: Function from a yaw to the fingertips at home in O, shape (n, 3), in metres.
        azimuths: Azimuths of the fingers about the palm's axis at yaw 0, shape (n,), in radians.
        R_AO: Orientation of the object in the frame A of the approach. The palm's axis is z of A.
        wrench: Weight of the object: force in N and torque about the centre of mass in N m, in O,
            shape (6,).
        friction: Coulomb's coefficient.
        normal_forces: Smallest and largest normal force of each finger, shape (2, n), in newtons.
        touch_force: Largest force of a finger that touches the object first, in newtons.
        yaw: Yaw of the palm at home, in radians; of equal grasps, the nearest one is chosen.
        yaw_range: Smallest and largest yaw of the palm, in radians.
        least_fingers: Smallest number of fingers of a grasp.
        holds_palm: Function that tells whether the hand can hold its palm at a yaw.
        p_AO: Position of the object's origin in A, shape (3,), in metres.
        fits_palm: Function from a yaw and points in O, shape (k, 3), to the mask of those at whose
            height the palm has room over the table, shape (k,). Both of two opposite contacts have
            to be there: jaws bring the palm to the height of their middle.
        workspace_gaps: Function from a yaw, centres of each fingertip in O, shape (n, k, 3), and
            the largest gap that is sought, to the distances from what its joints reach, shape
            (n, k), in metres; 0 where they reach, and inf beyond the largest gap.
        link_gaps: Function from a yaw, the index of a finger, and centres of its tip in O, shape
            (k, 3), to the least gaps of its other links to the object, shape (k,), in metres; -inf
            where its joints do not get there.
        compliance: Function from a yaw, the index of a finger, and a centre of its tip in O, shape
            (3,), to the compliance of the tip there as drives yield, in O, shape (3, 3), in m/N;
            NaN where its joints do not get there.
        load_change: Change of the load, in any direction, by which a held object should turn
            little, in newtons.
        least_link_gaps: Least of these gaps with which the tip touches first, and with which the
            finger stands off, in metres.
        patch_radii: Radii of the patches of soft fingertips, and 0 for hard ones, shape (n,), in
            metres; None if all are hard.
        pairs: Pairs of contacts that must be opposite each other.
        opening: Largest distance of such contacts, in metres.
        avoids_links: Whether contacts at which a gap is less than `least_link_gaps` are left out:
            it takes time to find them all.
        clearance_weight: Factor of the costs of places at the edge of reach, and under parts of the
            object.
    """

    constraints_at: Callable[[float], RegionConstraints]
    p_OT_at: Callable[[float], FloatArray]
    azimuths: FloatArray
    R_AO: FloatArray
    wrench: FloatArray
    friction: float
    normal_forces: FloatArray
    touch_force: float
    yaw: float = 0.0
    yaw_range: tuple[float, float] = FREE_TURN
    least_fingers: int = 3
    holds_palm: Callable[[float], bool] = lambda yaw: True
    p_AO: FloatArray = field(default_factory=lambda: np.zeros(3))
    fits_palm: Callable[[float, FloatArray], BoolArray] = lambda yaw, p_OC: np.ones(
        len(p_OC), dtype=bool
    )
    workspace_gaps: Callable[[float, FloatArray, float], FloatArray] = lambda yaw, p_OT, largest: (
        np.zeros(p_OT.shape[:2])
    )
    link_gaps: Callable[[float, int, FloatArray], FloatArray] = lambda yaw, finger, p_OT: np.full(
        len(p_OT), np.inf
    )
    compliance: Callable[[float, int, FloatArray], FloatArray] = lambda yaw, finger, p_OT: np.zeros(
        (3, 3)
    )
    load_change: float = 0.0
    least_link_gaps: tuple[float, float] = (0.0, 0.0)
    patch_radii: FloatArray | None = None
    pairs: tuple[Pair, ...] = ()
    opening: float = np.inf
    avoids_links: bool = False
    clearance_weight: float = 1.0

    @property
    def jaws(self) -> list[Pair]:
        """The pairs of opposite contacts."""
        return [pair for pair in self.pairs if pair.distance == 0]


@dataclass(frozen=True, eq=False)
class StartContacts:
    """Start contacts of a hand.

    Attributes:
        p_OC: Contacts in O, in the order of the fingers, shape (n, 3), in metres.
        has_contact: Mask of the fingers that take part, shape (n,); the others stay away.
        yaw: Yaw of the palm, in radians.
        margin: Min-weight margin of force closure of the fingers that take part.
        score: What the choice maximizes: the margin, with strength, stiffness, fingers and comfort.
        yaw_slack: Angle by which the yaw is off that of `palm_turn` without slack, in radians.
    """

    p_OC: FloatArray
    has_contact: BoolArray
    yaw: float
    margin: float
    score: float
    yaw_slack: float = 0.0
