"""Re-assignment of contacts to fingers: equivalent grasps, and grasps with fingers exchanged.

Section V.D of the paper names both: a grasp whose fingers are exchanged is another solution for the
same contacts, and a symmetry of the object maps a grasp to an equivalent one elsewhere.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from drake_pregrasp.arrays import SLACK, FloatArray, IntArray
from drake_pregrasp.contacts.assignment import wrapped
from drake_pregrasp.contacts.goal_limits import ContactLimits, judged_goals
from drake_pregrasp.contacts.selection_input import ContactGoals, SelectionInput
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.regions.constraints import Limit
from drake_pregrasp.regions.finger_reach import FingerReach

_PROBES = 40  # Candidates that sort out most rotations before all candidates are tested.
_DEVIATION = 0.005  # Largest error of a symmetry, as a share of the object's size.
_NEAR = 8  # Candidates that are compared with a rotated one.
_ALIKE = 0.9  # Smallest cosine between the normals of two candidates of the same smooth surface.
_TRIED = 8  # Largest number of changes that are tested for the limits of the fingers in a tick.
_DIGITS = 9  # To which shares of the cost count; of equal changes, the first one is made.


@dataclass
class ReassignmentRule:
    """When fingers exchange their contacts, or take those of an equivalent grasp.

    Each finger has a place in the hand frame H, `FingerReach.place`. The cost of a grasp is the sum
    of the squared distances of contacts from the places of their fingers.
    """

    # Root-mean-square distance of the contacts from the places of their fingers from which on
    # fingers change contacts, in metres; 0: never.
    beyond: float = field(default=0.0, metadata={"at_least": 0, "at_most": 10})

    # Least share of the cost by which a change lowers it.
    gain: float = field(default=0.5, metadata={"at_least": 0, "at_most": 1})

    # Least time between two changes, in seconds.
    every: float = field(default=1.0, metadata={"at_least": 0, "at_most": 1e6})

    # Whether symmetries of the object count; else fingers only exchange contacts.
    symmetric: bool = True

    def check(self, reach: Sequence[FingerReach | None], has_pairs: bool) -> None:
        """Raises an `InvalidArgumentError` if contacts cannot be re-assigned.

        Args:
            reach: Reach of each finger, or None if it is unlimited; empty for all.
            has_pairs: Whether there are pairs of coupled contacts.
        """
        if self.beyond <= 0:
            return
        if has_pairs:
            raise InvalidArgumentError("contacts of pairs cannot be re-assigned")
        if not reach:
            raise InvalidArgumentError("re-assignment needs the reach of the fingers")


def surface_symmetries(surface: ObjectSurface) -> FloatArray:
    """Returns the rotations about the centre of mass that map the allowed surface to itself.

    Tested are the rotations of a cube, and those by multiples of 30 and 72 degrees and half turns
    of prisms, each along the axes of O and along the principal axes of the allowed surface.

    Args:
        surface: The object's surface.

    Returns:
        Rotation matrices in O, shape (s, 3, 3); the identity comes first.
    """
    arms, size = surface.p_OQ - surface.p_OCoM, surface.longest_lever_arm
    axes = np.linalg.eigh(arms.T @ (surface.areas[:, None] * arms))[1]
    groups = [Rotation.create_group("O")]
    groups += [Rotation.create_group(prism, axis=a) for prism in ("D12", "D5") for a in "XYZ"]
    rotations = np.concatenate([group.as_matrix() for group in groups])
    rotations = np.concatenate([np.eye(3)[None], rotations, axes @ rotations @ axes.T])
    _, first = np.unique(rotations.round(3) + 0.0, axis=0, return_index=True)
    rotations, tree = rotations[np.sort(first)], cKDTree(arms)
    for probes in (np.random.default_rng(0).permutation(len(arms))[:_PROBES], slice(None)):
        points = arms[probes] @ rotations.swapaxes(1, 2)
        normals = surface.nhat_OQ[probes] @ rotations.swapaxes(1, 2)
        reach = 2 * surface.patch_reach
        _, near = tree.query(points, min(_NEAR, len(arms)), distance_upper_bound=reach)
        near[near == len(arms)] = 0
        # On planes, cylinders and balls, a chord is at right angles to the mean of the normals.
        away, others = points[..., None, :] - arms[near], surface.nhat_OQ[near]
        means = (normals[..., None, :] + others) / 2
        fits = np.abs(np.sum(away * means, axis=-1)) <= _DEVIATION * size
        fits &= np.sum(normals[..., None, :] * others, axis=-1) >= _ALIKE
        fits &= np.linalg.norm(away, axis=-1) <= reach
        rotations = rotations[fits.any(axis=-1).all(axis=-1)]
    return rotations


def reassigned_goals(
    selection: SelectionInput, goals: ContactGoals, rule: ReassignmentRule, symmetries: FloatArray
) -> ContactGoals:
    """Returns the goals of the fingers after the change of least cost, or the same goals.

    In a change, all fingers that are not lost go on by the same number of contacts around the axis
    of the hand, after a symmetry of the object. The shorter ways around the axis keep the order of
    the fingers, so that none crosses another. No change lowers the number of contacts that the
    limits of their fingers permit, or leaves none.

    Args:
        selection: Surface and regions of this tick, with the reach of the fingers.
        goals: Goals of this tick.
        rule: When contacts are re-assigned.
        symmetries: Rotations from `surface_symmetries`, shape (s, 3, 3).
    """
    constraints, p_OCoM = selection.regions.constraints, selection.surface.p_OCoM
    if constraints.reach_pose is None:
        return goals
    R_OH, p_OH = constraints.reach_pose
    fingers = np.flatnonzero(~selection.regions.lost)
    n, before = len(fingers), goals.p_OC[fingers]
    p_HC = (before - p_OH) @ R_OH
    reaches = [constraints.reach[finger] for finger in fingers.tolist()]
    places = [r.place(p) if r is not None else p for r, p in zip(reaches, p_HC, strict=True)]
    cost = np.sum((p_HC - places) ** 2)
    if cost <= n * rule.beyond**2:
        return goals
    azimuths = np.arctan2(p_HC[:, 1], p_HC[:, 0])
    order = np.argsort(azimuths, kind="stable")
    contact_of = np.empty((n, n), dtype=np.int64)  # Of each finger, after each shift.
    for shift in range(n):
        contact_of[shift, order] = np.roll(order, -shift)
    equivalent = p_OCoM + (before - p_OCoM) @ symmetries.swapaxes(1, 2)
    changes = equivalent[:, contact_of].reshape(-1, n, 3)
    p_HD = (changes - p_OH) @ R_OH
    shares = np.sum((p_HD - places) ** 2, axis=(1, 2)) / cost
    turns = wrapped(np.arctan2(p_HD[..., 1], p_HD[..., 0]) - azimuths)
    ends = (azimuths + turns)[:, order]
    in_order = np.all(np.diff(ends, axis=1) > -SLACK, axis=1)
    in_order &= np.ptp(ends, axis=1) < 2 * np.pi
    worthwhile = np.flatnonzero(in_order & (shares <= 1 - rule.gain))
    if not len(worthwhile):
        return goals
    fewest = max(1, _num_permitted(selection, fingers, before))
    ranks = np.argsort(shares[worthwhile].round(_DIGITS), kind="stable")
    for change in worthwhile[ranks[:_TRIED]]:
        after = goals.p_OC.copy()
        after[fingers] = changes[change]
        if change >= n:  # Not the identity: a symmetry may be slightly off.
            after[fingers] = selection.surface.project(changes[change])[0]
        if _num_permitted(selection, fingers, after[fingers]) >= fewest:
            unknown = np.zeros(len(after), dtype=bool)
            judged = judged_goals(selection, after, unknown, ContactLimits())
            return replace(judged, reassigned=True)
    return goals


def _num_permitted(selection: SelectionInput, fingers: IntArray, p_OC: FloatArray) -> int:
    """Returns the number of contacts that the limits of their fingers permit."""
    return int(np.sum(selection.limits_of(fingers, p_OC)[0] == Limit.NONE))
