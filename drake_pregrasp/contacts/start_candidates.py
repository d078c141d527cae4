"""Candidates for the start contacts of a hand: which finger may have them, and their costs."""

import math

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.contacts.contact_pairs import OppositePoints, Pair
from drake_pregrasp.contacts.hand_above_object import HandAboveObject
from drake_pregrasp.contacts.tipping import tipping_shares
from drake_pregrasp.geometry.mesh_surface import INTRUSION, mean_slopes
from drake_pregrasp.geometry.solids import EVERYWHERE, SignedDistance, rounded_box_distances
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.regions.constraints import (
    ALONG,
    OPPOSITE,
    RADIUS,
    REACH_SOLID,
    SECTOR,
    Limit,
)
from drake_pregrasp.regions.finger_reach import reached

AWAY = -1
"""Candidate of a finger that stays away."""

TIE = 1e-6
"""Difference of compared costs and gains that rounding can make: it must not choose."""

# Costs in units of the force-closure margin:
_COMFORT = 0.2  # Cost of fingertips that are the hand's radius away from their homes.
_FLAT = 2.0  # Cost of contacts with a mean slope of 1 around them.
_EDGE, _RESERVE = 0.1, 0.1  # Cost of a contact out of reach after a turn by this, in radians.
_BARRED = 1.0  # Cost of a contact that is not permitted after one of these shifts, in metres: the
_SHIFTS = 0.003 * np.vstack([np.eye(3), -np.eye(3)])  # noise of a pose would move it at once.
_COVER = 0.1  # Cost of a contact with a part of the object over its fingertip's centre.
_TIPPING = 0.4  # Cost of a contact for each tipping moment beyond the first of these shares of it;
_SAFE, _TIPPED = 0.75, 2.0  # from the second on none: a ball rolls wherever a finger presses.
_OVER = 0.01 * np.arange(1, 11)  # Heights over contacts at which such parts are found, in metres.


class StartCandidates:
    """Candidates for the fingers of a hand.

    Args:
        surface: The object's surface.
        solid: The object in O.
        hand: The hand.
        most: Largest number K of candidates.

    Attributes:
        p_OQ: The candidates, shape (K, 3), in metres.
        nhat_OQ: Outward unit normals there, shape (K, 3).
        opposite: The candidates as points of which opposite ones are sought.
    """

    def __init__(
        self, surface: ObjectSurface, solid: SignedDistance, hand: HandAboveObject, most: int
    ) -> None:
        index = np.flatnonzero(surface.is_clear_of_forbidden_points)
        if len(index) > most:
            index = np.sort(np.random.default_rng(0).choice(index, most, replace=False))
        limits = hand.constraints_at(hand.yaw)
        self._hand, self._n = hand, len(hand.azimuths)
        self.p_OQ, self.nhat_OQ = surface.p_OQ[index], surface.nhat_OQ[index]
        self._p_OCoM, self._up = surface.p_OCoM, hand.R_AO[2]
        between = math.sqrt(surface.mesh.area / max(1, len(index)))  # Distance of neighbours.
        self.opposite = OppositePoints(self.p_OQ, self.nhat_OQ, between / 2, self._up)
        self._ways = [  # Centres of fingertips at the contact, half-way to the standoff, and there.
            self.p_OQ + (limits.tip_radii[:, None, None] + share * limits.standoff) * self.nhat_OQ
            for share in ALONG
        ]
        # Along the palm's axis there is no way to a place under another fingertip.
        self._level = self.across(self._ways[0])
        # Contacts nearer to each other have no safe regions (`neighbour_half_spaces`).
        largest = np.maximum(limits.tip_radii[:, None], limits.tip_radii)
        self._room = 2 * largest + limits.tip_gap
        gaps = [solid.distance(p.reshape(-1, 3)).reshape(self._n, -1) for p in self._ways]
        self._spare = np.min(gaps, axis=0) - (limits.tip_radii[:, None] - INTRUSION)
        radius = float(np.mean(limits.tip_radii)) / 2
        self._slopes = _FLAT * mean_slopes(self.p_OQ, self.nhat_OQ, solid, radius)
        shares = tipping_shares(
            self.p_OQ,
            self.nhat_OQ,
            p_OV=np.asarray(surface.mesh.vertices),
            p_OCoM=surface.p_OCoM,
            weight=hand.wrench[:3],
            force=hand.touch_force,
        )
        self._tipping = _TIPPING * (np.clip(shares, _SAFE, _TIPPED) - _SAFE)
        over = self._ways[0] + _OVER[:, None, None, None] * self._up
        gaps = np.min(solid.distance(over.reshape(-1, 3)).reshape(over.shape[:-1]), axis=0)
        self._cover = _COVER * np.maximum(0.0, 1 - gaps / limits.tip_radii[:, None])

    def across(self, vectors: FloatArray) -> FloatArray:
        """Returns the parts of vectors in O across the palm's axis, shape (..., 3)."""
        across: FloatArray = vectors - (vectors @ self._up)[..., None] * self._up
        return across

    def touching(self, fingers: IntArray, candidates: IntArray) -> FloatArray:
        """Returns centres of fingertips that touch a candidate each, in O, shape (k, 3)."""
        return self._ways[0][fingers, candidates]

    def standing_off(self, fingers: IntArray, candidates: IntArray) -> FloatArray:
        """Returns centres of fingertips at their standoff from a candidate each, in O, (k, 3)."""
        return self._ways[-1][fingers, candidates]

    def homes_at(self, yaw: float) -> FloatArray:
        """Returns the fingertips at home in O, across the palm's axis, shape (n, 3), in metres."""
        return self.across(self._hand.p_OT_at(yaw))

    def limits_at(self, yaw: float) -> IntArray:
        """Returns the `Limit` that keeps each finger from each candidate, shape (n, K)."""
        constraints, fingers = self._hand.constraints_at(yaw), range(self._n)
        limits = np.array([constraints.limits_at(i, self.p_OQ, self.nhat_OQ)[0] for i in fingers])
        for centres in (self._ways[0], self._ways[-1]):
            beyond = self._hand.workspace_gaps(yaw, centres, 0.0) > 0
            limits[beyond & (limits != Limit.FORBIDDEN)] = Limit.REACH
        for pair in self._hand.jaws:
            both = limits[[pair.first, pair.second]]
            too_low = ~self._hand.fits_palm(yaw, self.p_OQ) & (both != Limit.FORBIDDEN)
            limits[[pair.first, pair.second]] = np.where(too_low, Limit.REACH, both)
        limits[(self._spare < 0) & (limits == Limit.NONE)] = Limit.WALL
        for finger in range(self._n) if self._hand.avoids_links else ():
            free = np.flatnonzero(limits[finger] == Limit.NONE)
            limits[finger, free[~self.has_clear_links(yaw, finger, free)]] = Limit.WALL
        return limits

    def has_clear_links(self, yaw: float, finger: int, candidates: IntArray) -> BoolArray:
        """Returns whether a finger's links are clear at candidates and standoffs, shape (k,).

        A standoff to which its joints do not get counts as clear: the palm goes with the fingers.
        """
        touching, standing_off = (
            self._hand.link_gaps(yaw, finger, centres[finger, candidates])
            for centres in (self._ways[0], self._ways[-1])
        )
        least, least_off = self._hand.least_link_gaps
        return (touching >= least) & ((standing_off >= least_off) | np.isneginf(standing_off))

    def reach_gaps_at(self, yaw: float) -> FloatArray:
        """Returns by how much each finger misses the nearest candidate on a side that it may touch.

        Args:
            yaw: Yaw of the palm, in radians.

        Returns:
            The gaps, shape (n,), in metres; inf if there is no such side.
        """
        constraints, p, nhat = self._hand.constraints_at(yaw), self.p_OQ, self.nhat_OQ
        predicates, gaps = constraints.predicates, np.full(self._n, np.inf)
        ends = (self._hand.workspace_gaps(yaw, self._ways[end], np.inf) for end in (0, -1))
        beyond = np.maximum(*ends)
        for i, row in enumerate(predicates.contacts[:, REACH_SOLID.start : SECTOR.stop]):
            angles = np.concatenate([EVERYWHERE, row[19:]])
            faces = reached(angles, p, nhat, self._ways[-1][i])
            faces &= constraints.limits_at(i, p, nhat)[0] != Limit.FORBIDDEN
            off = np.maximum(rounded_box_distances(row[:19], p), beyond[i])
            gaps[i] = np.min(off[faces], initial=np.inf)
        return gaps

    def lacking_room_at(self, yaw: float) -> FloatArray:
        """Returns by how much each fingertip is too large for its roomiest candidate in reach.

        Args:
            yaw: Yaw of the palm, in radians.

        Returns:
            The amounts between obstacles and the object, shape (n,), in metres; negative if it
            fits, and inf if nothing is in reach.
        """
        predicates = self._hand.constraints_at(yaw).predicates
        needed = predicates.contacts[:, RADIUS] + predicates.clearance
        spare = self._spare
        for row in predicates.solids[:, :19]:
            for centres in self._ways:
                gaps = rounded_box_distances(row, centres.reshape(-1, 3)).reshape(self._n, -1)
                spare = np.minimum(spare, gaps - needed[:, None])
        in_reach = ~np.isin(self.limits_at(yaw), (Limit.FORBIDDEN, Limit.REACH))
        spare = np.where(in_reach, spare, -np.inf)
        return np.asarray(-np.max(spare, axis=1))

    def spread(self, free: BoolArray, count: int) -> tuple[float, float]:
        """Returns how far some places in reach are apart, and what two fingertips need, in metres.

        Places are added one by one, each as far as possible from those before.

        Args:
            free: Mask of the candidates that each finger may have, shape (n, K).
            count: Number of places.
        """
        p_OT = self._level[free]
        first = np.argmax(np.linalg.norm(p_OT - p_OT[0], axis=1))
        nearest = np.linalg.norm(p_OT - p_OT[first], axis=1)
        for _ in range(count - 2):
            nearest = np.minimum(nearest, np.linalg.norm(p_OT - p_OT[np.argmax(nearest)], axis=1))
        return float(np.max(nearest)), float(np.min(self._room))

    def discomforts_at(self, yaw: float) -> FloatArray:
        """Returns the cost of each fingertip's path from home to each candidate, shape (n, K).

        Home is at the height of the centre of mass, and the unit of length is the hand's radius at
        home. Contacts on edges, on thin parts, at the edge of reach, near obstacles and under parts
        cost more.
        """
        home = self.homes_at(yaw)
        from_axis = home - self.across(self._p_OCoM)
        radius = float(np.mean(np.linalg.norm(from_axis, axis=1)))
        away = self._ways[0] - home[:, None] - (self._p_OCoM @ self._up) * self._up
        costs: FloatArray = _COMFORT * np.linalg.norm(away, axis=2) / radius
        costs += self._slopes + self._hand.clearance_weight * self._cover
        constraints = self._hand.constraints_at(yaw)
        for i, cost in enumerate(costs):
            shifted = [constraints.limits_at(i, self.p_OQ + d, self.nhat_OQ)[0] for d in _SHIFTS]
            cost += _BARRED * np.any(np.array(shifted) != Limit.NONE, axis=0)
        for turn in (-_RESERVE, _RESERVE) if self._hand.clearance_weight else ():
            turned = self._hand.constraints_at(yaw + turn)
            limits = [turned.limits_at(i, self.p_OQ, self.nhat_OQ)[0] for i in range(self._n)]
            costs += self._hand.clearance_weight * _EDGE * (np.array(limits) == Limit.REACH)
        return costs

    def costs_at(self, yaw: float) -> FloatArray:
        """Returns `discomforts_at`, with the costs of fingers that tip the object, shape (n, K)."""
        costs: FloatArray = self.discomforts_at(yaw) + self._tipping
        return costs

    def best_pair(
        self, homes: FloatArray, pair: Pair, free: BoolArray, costs: FloatArray
    ) -> IntArray:
        """Returns the best candidates of a pair, which are opposite each other, or `AWAY`, (2,).

        Args:
            homes: Fingertips at home, from `homes_at`, shape (n, 3), in metres.
            pair: The pair.
            free: Mask of the candidates that each one of the pair may have, shape (2, K).
            costs: Cost of each candidate, shape (n, K).
        """
        a, b = np.flatnonzero(free[0]), np.flatnonzero(free[1])
        off, width = self.opposite.errors(pair, a[:, None], b)
        # Pads touch at the angle off/width, as at a slope of the surface.
        costs = costs[pair.first, a, None] + costs[pair.second, b] + _FLAT * off / width
        # Neither do they cross; see `has_room`.
        between = homes[pair.first] - homes[pair.second]
        along = [self._level[i, k] @ between for i, k in ((pair.first, a), (pair.second, b))]
        costs[along[0][:, None] <= along[1]] = np.inf
        away = self._level[pair.first, a][:, None] - self._level[pair.second, b]
        costs[np.linalg.norm(away, axis=2) <= self._room[pair.first, pair.second]] = np.inf
        if not np.any(costs < np.inf):
            return np.full(2, AWAY)
        best = int(np.argmax(costs <= np.min(costs) + TIE))
        return np.array([a[best // len(b)], b[best % len(b)]])

    def has_room(self, homes: FloatArray, finger: int, assigned: IntArray) -> BoolArray:
        """Returns the mask of candidates with room beside the other fingertips, shape (K,).

        A finger of a pair has room only opposite the other one. Fingers do not cross: seen along
        the palm's axis, the vector to each other fingertip turns by less than a right angle from
        home to the contacts. On straight paths at the same pace, fingertips then keep at least
        1/√2 of the lesser of their distances at both ends.

        Args:
            homes: Fingertips at home, from `homes_at`, shape (n, 3), in metres.
            finger: Index of the finger.
            assigned: Candidate of each finger, or `AWAY`, shape (n,).
        """
        room = np.ones(len(self.p_OQ), dtype=bool)
        for other in np.flatnonzero(assigned != AWAY).tolist():
            if other != finger:
                candidate, least = assigned[other], self._room[finger, other]
                away = self._level[finger] - self._level[other, candidate]
                room &= np.linalg.norm(away, axis=1) > least
                room &= away @ (homes[finger] - homes[other]) > 0
                is_apart = np.linalg.norm(self.p_OQ - self.p_OQ[candidate], axis=1) > least
                room &= is_apart | (self.nhat_OQ @ self.nhat_OQ[candidate] < OPPOSITE)
        for pair in self._hand.pairs:
            partner = {pair.first: pair.second, pair.second: pair.first}.get(finger, finger)
            if partner != finger and assigned[partner] != AWAY:
                everywhere = np.arange(len(self.p_OQ))
                room &= self.opposite.errors(pair, assigned[partner], everywhere)[0] < np.inf
        return room

    def kept(self, homes: FloatArray, free: BoolArray, before: IntArray) -> IntArray:
        """Returns candidates at a new yaw: those of before, as far as they are still permitted.

        Args:
            homes: Fingertips at home at the new yaw, from `homes_at`, shape (n, 3), in metres.
            free: Mask of the candidates that each finger may have there, shape (n, K).
            before: Candidate of each finger, or `AWAY`, shape (n,).
        """
        assigned = np.full(self._n, AWAY)
        for finger in np.flatnonzero(before != AWAY).tolist():
            candidate = before[finger]
            if free[finger, candidate] and self.has_room(homes, finger, assigned)[candidate]:
                assigned[finger] = candidate
        return assigned
