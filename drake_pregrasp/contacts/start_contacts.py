"""First contacts of a hand: the fingers, their places and the palm's yaw by force closure."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.contacts.assignment import FREE_TURN, palm_turn
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.force_closure import (
    largest_load,
    min_weight_margin,
    moved_least_norm_margin,
)
from drake_pregrasp.regions.constraints import OPPOSITE, Limit, RegionConstraints

_YAWS = 24  # Yaws of the palm that are tried in a full turn.
_COARSE, _FINE = 250, 3000  # Largest numbers of candidates, for all yaws and for the best ones.
_COARSE_SWEEPS, _FINE_SWEEPS = 2, 4  # Largest numbers of rounds in which fingers move in turn.
_FINALISTS = 5  # Yaws whose exact margins are compared.
_TURNS = 4  # Largest number of times that the yaw follows the contacts, and these the reach.
# What is worth as much as a margin of one:
_COMFORT = 0.2  # fingertips nearer to their homes by the hand's radius,
_FINGER = 0.25  # one more finger, which shares the load although it may lower the margin,
_LOAD = 0.5  # strength for the object's weight once more, up to `_STRONG` times,
_TURN = 0.02  # and a palm that turns less by a radian.
_STRONG = 2.0
_AWAY = -1  # Seat of a finger that stays away.


class Lack(StrEnum):
    """What is missing for a grasp.

    Attributes:
        REACH: Too few fingers reach the allowed surface.
        OPENING: Fingers reach the object, but not two opposite sides of it at once.
        ROOM: Fingertips in reach have no room beside each other, obstacles and the object.
        FRICTION: Contacts have no force closure, or do not hold the weight.
    """

    REACH = "reach"
    OPENING = "opening"
    ROOM = "room"
    FRICTION = "friction"


class NoGraspError(InvalidArgumentError):
    """A hand has no first contacts on an object.

    Args:
        lack: What is missing.
        detail: What there is instead.
    """

    def __init__(self, lack: Lack, detail: str) -> None:
        super().__init__(f"no grasp for lack of {lack}: {detail}")
        self.lack = lack


@dataclass(frozen=True, eq=False)
class HandOverObject:
    """A hand with its palm over an object, as far as its first contacts depend on it.

    Attributes:
        constraints_at: Function from a yaw of the palm, in radians, to the constraints of the
            contacts in O, with fingertips.
        p_OT_at: Function from a yaw to the fingertips at home in O, shape (n, 3), in metres.
        azimuths: Azimuths of the fingers about the palm's axis at yaw 0, shape (n,), in radians.
        R_WO: Orientation of the object. The palm's axis is z of W.
        wrench: Weight of the object: force in N and torque about the centre of mass in N m, in O,
            shape (6,).
        friction: Coulomb's coefficient.
        normal_forces: Smallest and largest normal force of each finger, shape (2, n), in newtons.
        yaw: Yaw of the palm, in radians; of equal grasps, the nearest one is chosen.
        yaw_range: Smallest and largest yaw of the palm, in radians.
        least_fingers: Smallest number of fingers of a grasp.
        holds_palm: Function that tells whether the hand can hold its palm at a yaw.
        in_workspace: Function from a yaw and centres of each fingertip in O, shape (n, k, 3), to
            the mask of those that its joints reach, shape (n, k).
    """

    constraints_at: Callable[[float], RegionConstraints]
    p_OT_at: Callable[[float], FloatArray]
    azimuths: FloatArray
    R_WO: FloatArray
    wrench: FloatArray
    friction: float
    normal_forces: FloatArray
    yaw: float = 0.0
    yaw_range: tuple[float, float] = FREE_TURN
    least_fingers: int = 3
    holds_palm: Callable[[float], bool] = lambda yaw: True
    in_workspace: Callable[[float, FloatArray], BoolArray] = lambda yaw, p_OT: np.ones(
        p_OT.shape[:2], dtype=bool
    )


@dataclass(frozen=True, eq=False)
class StartContacts:
    """First contacts of a hand.

    Attributes:
        p_OC: Contacts in O, in the order of the fingers, shape (n, 3), in metres.
        has_contact: Mask of the fingers that take part, shape (n,); the others stay away.
        yaw: Yaw of the palm, in radians.
        margin: Min-weight margin of force closure of the fingers that take part.
    """

    p_OC: FloatArray
    has_contact: BoolArray
    yaw: float
    margin: float


def choose_start_contacts(
    surface: ObjectSurface, hand: HandOverObject, fits: BoolArray | None = None
) -> StartContacts:
    """Returns the first contacts of a hand on an object.

    At each yaw of the palm, fingers first take the permitted candidates nearest to their home. Then
    each in turn moves to the place with the best bound of the force-closure margin beside the
    others. For the best yaws the palm turns with the contacts until they are in reach there, and
    the exact margins decide. A finger stays away if it has no room, or lowers the margin.

    Args:
        surface: The object's surface.
        hand: The hand.
        fits: Mask of the candidates where the object leaves room for fingertips, shape (N,); None
            for all.

    Raises:
        NoGraspError: If no contacts have force closure and hold the weight.
    """
    usable = surface.is_clear_of_forbidden_points & (True if fits is None else fits)
    coarse = _Search(surface, hand, usable, _COARSE, _COARSE_SWEEPS)
    fine = _Search(surface, hand, usable, _FINE, _FINE_SWEEPS)
    tried = [coarse.settled(yaw) for yaw in coarse.yaws()]
    ranked = sorted(tried, key=lambda trial: -trial.bound)[:_FINALISTS]
    grasps = [grasp for trial in ranked if (grasp := fine.grasp_at(trial.yaw)) is not None]
    if not grasps:
        raise coarse.lack()
    best = max(grasps, key=lambda grasp: (grasp.load >= 1, grasp.score))
    if best.load < 1:
        share = f"hold {best.load:.2g} of its weight with friction {hand.friction:g}"
        raise NoGraspError(Lack.FRICTION, f"the best contacts {share}")
    return fine.contacts_of(best)


@dataclass(frozen=True, eq=False)
class _Trial:
    """Seats of fingers at a yaw, with a bound of their margin, less the discomfort."""

    yaw: float
    seats: IntArray
    bound: float
    margin: float = 0.0
    score: float = 0.0
    load: float = 0.0


class _Search:
    """Candidates as seats for the fingers of a hand.

    Args:
        surface: The object's surface.
        hand: The hand.
        usable: Mask of the candidates for fingertips, shape (N,).
        most: Largest number of candidates.
        sweeps: Largest number of rounds in which each finger moves to its best place.
    """

    def __init__(
        self, surface: ObjectSurface, hand: HandOverObject, usable: BoolArray, most: int, sweeps: int
    ) -> None:
        index = np.flatnonzero(usable)
        if len(index) > most:
            index = np.sort(np.random.default_rng(0).choice(index, most, replace=False))
        constraints = hand.constraints_at(hand.yaw)
        self._sweeps = sweeps
        self._hand, self._up, self._n = hand, hand.R_WO[2], len(hand.azimuths)
        self._p, self._normals, self._p_OCoM = surface.p_OQ[index], surface.nhat_OQ[index], surface.p_OCoM
        self._radii, self._standoff = constraints.tip_radii, constraints.standoff
        self._room = self._radii[:, None] + self._radii + constraints.tip_gap
        self._centres = self._p + self._radii[:, None, None] * self._normals
        # From above there is no way to a place under another fingertip.
        self._level = self._across(self._centres)

    def _across(self, vectors: FloatArray) -> FloatArray:
        """Returns the parts of vectors across z of W, shape (..., 3)."""
        across: FloatArray = vectors - (vectors @ self._up)[..., None] * self._up
        return across

    def yaws(self) -> FloatArray:
        """Returns the yaws to try, those nearest to the palm's first, in radians."""
        low, high = self._hand.yaw_range
        steps = np.arange(_YAWS) - _YAWS // 2
        yaws = self._hand.yaw + 2 * np.pi / _YAWS * steps[np.argsort(np.abs(steps), kind="stable")]
        return yaws[(yaws >= low) & (yaws <= high)] if np.any((yaws >= low) & (yaws <= high)) else np.array([(low+high)/2])

    def limits_at(self, yaw: float) -> IntArray:
        """Returns the `Limit` that keeps each finger from each candidate, shape (n, K)."""
        constraints = self._hand.constraints_at(yaw)
        limits = np.array(
            [constraints.limits_at(i, self._p, self._normals)[0] for i in range(self._n)]
        )
        away = self._centres + self._standoff * self._normals
        for centres in (self._centres, away):
            within = self._hand.in_workspace(yaw, centres)
            limits[~within & (limits != Limit.FORBIDDEN)] = Limit.REACH
        return limits

    def discomforts_at(self, yaw: float) -> FloatArray:
        """Returns how far each fingertip at each candidate is from home, shape (n, K).

        Home is at the height of the centre of mass. The unit is the hand's radius at home.
        """
        home = self._across(self._hand.p_OT_at(yaw))
        radius = float(np.mean(np.linalg.norm(home, axis=1)))
        home = home + (self._p_OCoM @ self._up) * self._up
        away: FloatArray = np.linalg.norm(self._centres - home[:, None], axis=2)
        return away / radius

    def settled(self, yaw: float, before: IntArray | None = None) -> _Trial:
        """Returns a trial at a yaw, in which fingers at first keep the seats that are permitted."""
        free, discomforts = self.limits_at(yaw) == Limit.NONE, self.discomforts_at(yaw)
        fingers, seats = np.arange(self._n), np.full(self._n, _AWAY)
        if before is not None:
            seats = np.where(free[fingers, before], before, _AWAY)
        for finger in np.argsort(np.sum(free, axis=1), kind="stable").tolist():
            choices = np.flatnonzero(free[finger] & self._room_beside(finger, seats))
            if seats[finger] == _AWAY and len(choices):
                seats[finger] = choices[np.argmin(discomforts[finger, choices])]
        bound = -np.inf
        for _ in range(self._sweeps):
            before = bound
            for finger in fingers[seats != _AWAY].tolist():
                choices = np.flatnonzero(free[finger] & self._room_beside(finger, seats))
                bounds = self._bounds(finger, seats, choices)
                others = np.delete(fingers, finger)[np.delete(seats, finger) != _AWAY]
                bounds -= _COMFORT / self._n * (discomforts[finger, choices] + np.sum(discomforts[others, seats[others]]))
                seats[finger], bound = choices[np.argmax(bounds)], float(np.max(bounds))
            if bound <= before + 1e-6:
                break
        return _Trial(yaw, seats, bound)

    def _room_beside(self, finger: int, seats: IntArray) -> BoolArray:
        """Returns the mask of candidates with room beside other seated fingers, shape (K,)."""
        room = np.ones(len(self._p), dtype=bool)
        for other in np.flatnonzero(seats != _AWAY).tolist():
            if other != finger:
                away = self._level[finger] - self._level[other, seats[other]]
                room &= np.linalg.norm(away, axis=1) > self._room[finger, other]
        return room

    def _bounds(self, finger: int, seats: IntArray, choices: IntArray) -> FloatArray:
        """Returns bounds of the margin with a finger at each choice, in [-1, 1], shape (k,)."""
        seated = np.flatnonzero(seats != _AWAY)
        arms = self._p - self._p_OCoM
        bounds = moved_least_norm_margin(
            arms[seats[seated]],
            self._normals[seats[seated]],
            self._hand.friction,
            moved=int(np.searchsorted(seated, finger)),
            p_CoMQ=arms[choices],
            nhat_Q=self._normals[choices],
        )
        # From (-inf, 0) to (-1, 0), as the strategy `margin` does.
        return np.where(bounds >= 0, bounds, -1 / (1 - 1 / np.minimum(bounds, -1e-12)))

    def grasp_at(self, yaw: float) -> _Trial | None:
        """Returns a grasp near a yaw, or None if it has too few fingers or no force closure."""
        trial = self.settled(yaw)
        for _ in range(_TURNS):
            turned = self._turned(trial)
            settled = np.flatnonzero(trial.seats != _AWAY)
            free = self.limits_at(turned) == Limit.NONE
            if np.all(free[settled, trial.seats[settled]]):
                return self._judged(replace(trial, yaw=turned))
            trial = self.settled(turned, trial.seats)
        return None

    def _turned(self, trial: _Trial) -> float:
        """Returns the yaw to which the palm turns with the contacts, in radians."""
        p_GT_W = self._p[self._placeholders(trial)] @ self._hand.R_WO.T
        return palm_turn(p_GT_W, self._hand.azimuths, trial.yaw, self._hand.yaw_range)

    def _placeholders(self, trial: _Trial) -> IntArray:
        """Returns the seats, for fingers that stay away the candidates nearest to their home."""
        closed = self.limits_at(trial.yaw) == Limit.FORBIDDEN
        nearest = np.argmin(np.where(closed, np.inf, self.discomforts_at(trial.yaw)), axis=1)
        return np.where(trial.seats == _AWAY, nearest, trial.seats)

    def _judged(self, trial: _Trial) -> _Trial | None:
        """Returns a trial with its margin and its load, without fingers that lower the margin."""
        hand, seats = self._hand, trial.seats.copy()
        if np.sum(seats != _AWAY) < hand.least_fingers or not hand.holds_palm(trial.yaw):
            return None
        margin = self._margin(seats)
        while np.sum(seats != _AWAY) > hand.least_fingers:
            fewer = [np.where(np.arange(self._n) == i, _AWAY, seats) for i in np.flatnonzero(seats != _AWAY)]
            margins = [self._margin(left) for left in fewer]
            if max(margins) <= margin + _FINGER:
                break
            seats, margin = fewer[int(np.argmax(margins))], max(margins)
        if margin <= 0:
            return None
        there = np.flatnonzero(seats != _AWAY)
        load = largest_load(
            self._p[seats[there]] - self._p_OCoM,
            self._normals[seats[there]],
            hand.friction,
            wrench=hand.wrench,
            normal_forces=hand.normal_forces[:, there],
        )
        discomfort = float(np.sum(self.discomforts_at(trial.yaw)[there, seats[there]])) / self._n
        score = margin + _LOAD * min(load, _STRONG) + _FINGER * len(there)
        score -= _COMFORT * discomfort + _TURN * abs(trial.yaw - hand.yaw)
        return replace(trial, seats=seats, margin=margin, load=load, score=score)

    def _margin(self, seats: IntArray) -> float:
        taken = seats[seats != _AWAY]
        arms, normals = self._p[taken] - self._p_OCoM, self._normals[taken]
        return min_weight_margin(arms, normals, self._hand.friction)

    def contacts_of(self, trial: _Trial) -> StartContacts:
        """Returns the contacts of a trial."""
        p_OC = self._p[self._placeholders(trial)]
        return StartContacts(p_OC, trial.seats != _AWAY, trial.yaw, trial.margin)

    def lack(self) -> NoGraspError:
        """Returns what is missing if there is no grasp."""
        limits = [self.limits_at(yaw) for yaw in self.yaws()]
        least, mu = self._hand.least_fingers, self._hand.friction
        opposite = (self._normals @ self._normals.T < OPPOSITE).astype(np.float32)

        def faced(free: BoolArray) -> bool:
            pairs = free.astype(np.float32) @ opposite @ free.T.astype(np.float32)
            return bool(np.any(pairs[~np.eye(self._n, dtype=bool)]))

        reached = [~np.isin(limit, (Limit.FORBIDDEN, Limit.REACH)) for limit in limits]
        if (most := max(int(np.sum(np.any(free, axis=1))) for free in reached)) < least:
            return NoGraspError(Lack.REACH, f"at most {most} fingers reach it at any yaw of the palm, {least} are needed")
        if np.any(opposite) and not any(map(faced, reached)):
            return NoGraspError(Lack.OPENING, "at no yaw of the palm do fingers reach two opposite sides of it")
        free = [limit == Limit.NONE for limit in limits]
        trials = [self.settled(yaw) for yaw in self.yaws()]
        if (most := max(int(np.sum(trial.seats != _AWAY)) for trial in trials)) < least or (np.any(opposite) and not any(map(faced, free))):
            return NoGraspError(Lack.ROOM, f"at most {most} fingertips have room on it, {least} are needed")
        return NoGraspError(Lack.FRICTION, f"with friction {mu:g} no contacts in reach have force closure")
