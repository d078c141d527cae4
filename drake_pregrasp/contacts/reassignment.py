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
    """Conditions under which fingers exchange contacts, or take those of an equivalent grasp.

    Each finger has a place in the hand frame H, `FingerReach.place`. The cost of a grasp is the sum
    of the squared distances of contacts from the places of their fingers.
    """

    # Root-mean-square distance of the contacts from the places of their fingers from which on
    # fingers change contacts, in metres; 0: never.
    beyond: float = field(default=0.0, metadata={"at_least": 0, "at_most": 10})

    # Least share of the cost by which a change lowers it.
    gain: float = field(default=0.5, metadata={"above": 0, "at_most": 1})

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

    In a change, fingers that are not lost take the contacts in their order around the axis of the
    hand, as they are or after a symmetry of the object. The shorter ways around the axis keep the
    order of the fingers, so that none crosses another. No change lowers the number of contacts that
    the limits of their fingers permit, or leaves none. Lost fingers are not assigned; a symmetry
    moves their contacts too, so that there is room when they come back.

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
    n, p_HC = len(fingers), (goals.p_OC[fingers] - p_OH) @ R_OH
    reaches = [constraints.reach[finger] for finger in fingers.tolist()]
    at_home = [r.place(p) if r is not None else p for r, p in zip(reaches, p_HC, strict=True)]
    places = np.reshape(at_home, (n, 3))
    cost = np.sum((p_HC - places) ** 2)
    if cost <= n * rule.beyond**2:
        return goals
    p_OE = p_OCoM + (goals.p_OC - p_OCoM) @ symmetries.swapaxes(1, 2)
    p_HE, azimuths = (p_OE[:, fingers] - p_OH) @ R_OH, _azimuths(p_HC)
    # Fingers take the contacts in their order around the axis: from the first on, the second, ...
    around = np.argsort(_azimuths(p_HE), axis=1, kind="stable")
    contact_of = np.empty((len(symmetries), n, n), dtype=np.int64)
    order = np.argsort(azimuths, kind="stable")
    for shift in range(n):
        contact_of[:, shift, order] = np.roll(around, -shift, axis=1)
    p_HD = np.take_along_axis(p_HE[:, None], contact_of[..., None], axis=2)
    shares = np.sum((p_HD - places) ** 2, axis=(2, 3)).ravel() / cost
    ends = (azimuths + wrapped(_azimuths(p_HD) - azimuths))[..., order].reshape(-1, n)
    in_order = np.all(np.diff(ends, axis=1) > -SLACK, axis=1)
    in_order &= np.ptp(ends, axis=1) < 2 * np.pi
    worthwhile = np.flatnonzero(in_order & (shares <= 1 - rule.gain))
    if not len(worthwhile):
        return goals
    fewest = max(1, _num_permitted(selection, fingers, goals.p_OC))
    ranks = np.argsort(shares[worthwhile].round(_DIGITS), kind="stable")
    for change in worthwhile[ranks[:_TRIED]].tolist():
        symmetry, shift = divmod(change, n)
        after = goals.p_OC.copy()
        if symmetry > 0:  # It may be slightly off.
            after = selection.surface.project(p_OE[symmetry])[0]
        after[fingers] = after[fingers[contact_of[symmetry, shift]]]
        if _num_permitted(selection, fingers, after) >= fewest:
            unknown = np.zeros(len(after), dtype=bool)
            judged = judged_goals(selection, after, unknown, ContactLimits())
            return replace(judged, reassigned=True)
    return goals


def _azimuths(p_H: FloatArray) -> FloatArray:
    """Returns the azimuths of points about z of H, shape (...,), in radians."""
    azimuths: FloatArray = np.arctan2(p_H[..., 1], p_H[..., 0])
    return azimuths


def _num_permitted(selection: SelectionInput, fingers: IntArray, p_OC: FloatArray) -> int:
    """Returns the number of contacts that the limits of some fingers permit."""
    return int(np.sum(selection.limits_of(fingers, p_OC[fingers])[0] == Limit.NONE))
