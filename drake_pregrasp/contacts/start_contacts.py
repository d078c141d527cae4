"""Start contacts of a hand: the fingers, their places and the palm's yaw by force closure."""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.distance import pdist

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.contacts.assignment import palm_turn, turned_within
from drake_pregrasp.contacts.hand_above_object import HandAboveObject, StartContacts
from drake_pregrasp.contacts.start_candidates import AWAY, TIE, StartCandidates
from drake_pregrasp.errors import Lack, NoGraspError
from drake_pregrasp.geometry.solids import SignedDistance
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.force_closure import (
    largest_load,
    min_weight_margin,
    needed_friction,
    torsional_friction_of,
)
from drake_pregrasp.quality.grasp_stiffness import turn_by_force
from drake_pregrasp.quality.margin_bounds import moved_least_norm_margin
from drake_pregrasp.regions.constraints import OPPOSITE, Limit

_YAWS = 24  # Yaws of the palm that are tried in a full turn.
_COARSE, _FINE = 300, 3000  # Largest numbers of candidates, for all yaws and for the best ones.
_COARSE_SWEEPS, _FINE_SWEEPS = 2, 4  # Largest numbers of rounds in which fingers move in turn.
_FINALISTS = 6  # Yaws whose exact margins are compared, and all if none has a grasp.
_TURNS = 4  # Largest number of times that the yaw follows the contacts, and these the reach.
# Costs and gains in units of the force-closure margin:
_FINGER = 0.25  # Gain of one more finger, which shares the load.
_LOAD, _STRONG = 0.5, 2.0  # Gain of strength for the object's weight once more, up to so often.
_TURN = 0.05  # Cost of a palm that turns by a radian.
_TURN_BY_LOAD = 6.0  # Cost of an object that turns by a radian as its load changes.
_FARTHEST = 0.25  # Turn in radians from which on all count as this one: springs are not linear.
_NEIGHBOURS = 8  # Number of places near each contact that may hold more of the weight.
_ENOUGH = 1.1  # Strength for the object's weight at which fingers that hold too little stop.
_SLACK = 0.5  # Largest angle between a palm's yaw and that to which its contacts turn it.
_DIGITS = 6  # Decimals of compared scores: rounding must not choose between equal ones.


def choose_start_contacts(
    surface: ObjectSurface, solid: SignedDistance, hand: HandAboveObject
) -> StartContacts:
    """Returns the start contacts of a hand on an object.

    At each yaw of the palm, fingers first take the permitted candidates nearest to their home. Then
    each in turn moves to the place with the best bound of the force-closure margin beside the
    others. For the best yaws the palm turns with the contacts until they are in reach there, and
    the exact margins decide. A finger stays away if it has no room or lowers the margin; the palm
    then turns with the others. If this leads to no grasp from any yaw, the palm keeps its yaw,
    unless its contacts would turn it far. Lower places are preferred if a finger nearly tips the
    object. Places at the edge of reach and under parts of the object cost more, unless this leaves
    no grasp. So do places from which the noise of a pose would move a finger at once. A grasp in
    which a change of the load turns the object far, as the fingers yield, is worth less. Then all
    other yaws are tried, too, if the best ones have none. If a finger did not get there with its
    joints, or touched the object with another link before its tip, all such contacts are left out.

    Args:
        surface: The object's surface.
        solid: The object in O.
        hand: The hand.

    Raises:
        NoGraspError: If no contacts have force closure and hold the weight.
    """
    coarse = _Search(surface, solid, hand, _COARSE, _COARSE_SWEEPS)
    fine = _Search(surface, solid, hand, _FINE, _FINE_SWEEPS)
    tried = [coarse.settled(yaw) for yaw in coarse.yaws()]
    ranked, grasps = sorted(tried, key=lambda trial: -round(trial.bound, _DIGITS)), list[_Trial]()
    for count, trial in enumerate(ranked):
        if count >= _FINALISTS and (
            hand.clearance_weight > 0 or any(grasp.load >= 1 for grasp in grasps)
        ):
            break
        if (grasp := fine.grasp_at(trial.yaw)) is not None:
            grasps.append(grasp)
    if not grasps:
        settled = [fine.settled(trial.yaw) for trial in ranked]
        grasps = [grasp for trial in settled if (grasp := fine.kept(trial)) is not None]
    if grasps:
        best = max(grasps, key=lambda grasp: (grasp.load >= 1, round(grasp.score, _DIGITS)))
        if best.load < 1:
            best = fine.strengthened(max(grasps, key=lambda grasp: grasp.load))
        if best.load >= 1 and not (hand.avoids_links or fine.has_clear_links(best)):
            return choose_start_contacts(surface, solid, replace(hand, avoids_links=True))
        if best.load >= 1:
            return fine.contacts_of(best)
        held = f"hold {best.load:.2g} of its weight with friction {hand.friction:g}"
    problem = NoGraspError(Lack.FRICTION, f"the best contacts {held}") if grasps else coarse.lack()
    if hand.clearance_weight > 0:
        return choose_start_contacts(surface, solid, replace(hand, clearance_weight=0.0))
    raise problem


@dataclass(frozen=True, eq=False)
class _Trial:
    """Assignment of candidates to fingers at a yaw of the palm.

    `candidates` holds the index of each finger's candidate, or `AWAY`. Bounds contain an upper
    bound of the margin; the last trials have exact margins, loads and scores, and a `yaw_slack` as
    `StartContacts`.
    """

    yaw: float
    candidates: IntArray
    bound: float
    margin: float = 0.0
    load: float = 0.0
    yaw_slack: float = 0.0
    score: float = 0.0

    @property
    def fingers(self) -> IntArray:
        """Fingers with a candidate."""
        return np.flatnonzero(self.candidates != AWAY)


class _Turned(NamedTuple):
    """A trial after its palm has turned, and whether all contacts are in reach there."""

    trial: _Trial
    has_reach: bool


class _Search:
    """Search of start contacts among candidates.

    Args:
        surface: The object's surface.
        solid: The object in O.
        hand: The hand.
        most: Largest number K of candidates.
        sweeps: Largest number of rounds in which each finger moves to its best place.
    """

    def __init__(
        self,
        surface: ObjectSurface,
        solid: SignedDistance,
        hand: HandAboveObject,
        most: int,
        sweeps: int,
    ) -> None:
        self._hand, self._n, self._sweeps = hand, len(hand.azimuths), sweeps
        self._candidates = StartCandidates(surface, solid, hand, most)
        self._p, self._normals = self._candidates.p_OQ, self._candidates.nhat_OQ
        self._arms = self._p - surface.p_OCoM
        self._patch_radii = np.zeros(self._n) if hand.patch_radii is None else hand.patch_radii

    def yaws(self) -> FloatArray:
        """Returns the yaws of the palm to try, in radians."""
        turns = 2 * np.pi / _YAWS * (np.arange(_YAWS) - _YAWS // 2)
        yaws = (self._hand.yaw + turns).tolist()
        return np.unique([turned_within(yaw, self._hand.yaw_range) for yaw in yaws])

    def settled(self, yaw: float, before: IntArray | None = None) -> _Trial:
        """Returns a trial at a yaw, in which fingers at first keep permitted candidates."""
        candidates = self._candidates
        free, costs = candidates.limits_at(yaw) == Limit.NONE, candidates.costs_at(yaw)
        homes, assigned = candidates.homes_at(yaw), np.full(self._n, AWAY)
        if before is not None:
            assigned = candidates.kept(homes, free, before)
        for pair in self._hand.pairs:
            both = [pair.first, pair.second]
            if np.any(assigned[both] == AWAY):
                assigned[both] = AWAY
                room = np.array([candidates.has_room(homes, i, assigned) for i in both])
                assigned[both] = candidates.best_pair(homes, pair, free[both] & room, costs)
        for finger in np.argsort(np.sum(free, axis=1), kind="stable").tolist():
            choices = np.flatnonzero(free[finger] & candidates.has_room(homes, finger, assigned))
            if assigned[finger] == AWAY and len(choices):
                own = costs[finger, choices]
                assigned[finger] = choices[np.argmax(own <= np.min(own) + TIE)]
        assigned_fingers, bound = np.flatnonzero(assigned != AWAY), -np.inf
        for _ in range(self._sweeps):
            last = bound
            for finger in assigned_fingers.tolist():
                choices = np.flatnonzero(
                    free[finger] & candidates.has_room(homes, finger, assigned)
                )
                others = assigned_fingers[assigned_fingers != finger]
                cost = costs[finger, choices] + np.sum(costs[others, assigned[others]])
                bounds = self._bounds(finger, assigned, choices) - cost / self._n
                bound = float(np.max(bounds))
                assigned[finger] = choices[np.argmax(bounds >= bound - TIE)]
            if bound <= last:
                break
        return _Trial(yaw, assigned, bound + _FINGER * len(assigned_fingers))

    def _bounds(self, finger: int, assigned: IntArray, choices: IntArray) -> FloatArray:
        """Returns bounds of the margin with a finger at each choice, in [-1, 1], shape (k,)."""
        assigned_fingers = np.flatnonzero(assigned != AWAY)
        cones, model = self._cones(assigned)
        bounds = moved_least_norm_margin(
            *cones,
            moved=int(np.searchsorted(assigned_fingers, finger)),
            p_CoMQ=self._arms[choices],
            nhat_Q=self._normals[choices],
            **model,
        )
        # A negative bound b becomes b/(1 - b), as in the strategy `margin`.
        return np.where(bounds >= 0, bounds, 1 / (1 - np.minimum(bounds, 0)) - 1)

    def grasp_at(self, yaw: float) -> _Trial | None:
        """Returns a grasp near a yaw; None if it has too few fingers or no force closure."""
        trial = self.settled(yaw)
        for _ in range(_TURNS if len(trial.fingers) >= self._hand.least_fingers else 0):
            turned = self._turned(trial)
            if turned.has_reach:
                return self._judged(turned.trial)
            trial = self.settled(turned.trial.yaw, trial.candidates)
        return None

    def kept(self, trial: _Trial) -> _Trial | None:
        """Returns a grasp of a trial whose palm keeps its yaw; None if there is none.

        There is none for jaws, which reach contacts only on their own line.
        """
        if len(trial.fingers) < self._hand.least_fingers or self._hand.jaws:
            return None
        slack = abs(self._turned(trial).trial.yaw - trial.yaw)
        return self._judged(replace(trial, yaw_slack=slack)) if slack <= _SLACK else None

    def _turned(self, trial: _Trial) -> _Turned:
        """Returns a trial at the yaw to which the palm turns with its contacts (`palm_turn`).

        Fingers that stay away do not count, because their goals turn with the palm.
        """
        hand, fingers, candidates = self._hand, trial.fingers, self._candidates
        p_OT = candidates.standing_off(fingers, trial.candidates[fingers])
        p_AT = p_OT @ hand.R_AO.T + hand.p_AO
        yaw = palm_turn(p_AT, hand.azimuths[fingers], trial.yaw, hand.yaw_range)
        free = candidates.limits_at(yaw) == Limit.NONE
        kept = candidates.kept(candidates.homes_at(yaw), free, trial.candidates)
        return _Turned(
            replace(trial, yaw=yaw, yaw_slack=0.0), np.array_equal(kept, trial.candidates)
        )

    def _nearest_candidates(self, trial: _Trial) -> IntArray:
        """Returns the assigned candidates, or those nearest to home for fingers that stay away."""
        closed = self._candidates.limits_at(trial.yaw) == Limit.FORBIDDEN
        discomforts = self._candidates.discomforts_at(trial.yaw)
        nearest = np.argmin(np.where(closed, np.inf, discomforts), axis=1)
        return np.where(trial.candidates == AWAY, nearest, trial.candidates)

    def _judged(self, trial: _Trial) -> _Trial | None:
        """Returns a trial with its margin, without fingers that lower it; None if there is none."""
        hand, fingers = self._hand, np.arange(self._n)
        if len(trial.fingers) < hand.least_fingers or not hand.holds_palm(trial.yaw):
            return None
        trial = replace(trial, margin=self._margin(trial.candidates))
        while len(trial.fingers) > hand.least_fingers:
            fewer = [np.where(fingers == i, AWAY, trial.candidates) for i in trial.fingers]
            margins = [self._margin(assigned) for assigned in fewer]
            if max(margins) <= trial.margin + _FINGER:
                break
            best = replace(trial, candidates=fewer[int(np.argmax(margins))], margin=max(margins))
            turned = self._turned(best)
            if not (turned.has_reach and hand.holds_palm(turned.trial.yaw)):
                break
            trial = turned.trial
        if trial.margin <= TIE:  # Rounding is no force closure.
            return None
        assigned_fingers, assigned = trial.fingers, trial.candidates[trial.fingers]
        load = self._load(trial.candidates)
        score = trial.margin + _LOAD * min(load, _STRONG) + _FINGER * len(assigned_fingers)
        costs = self._candidates.costs_at(trial.yaw)[assigned_fingers, assigned]
        score -= float(np.sum(costs)) / self._n
        score -= _TURN * abs(trial.yaw - hand.yaw) + _TURN_BY_LOAD * self._turn_by_load(trial)
        return replace(trial, load=load, score=score)

    def strengthened(self, trial: _Trial) -> _Trial:
        """Returns a grasp whose fingers moved to nearby places that hold more of the weight.

        The margin does not know the weight: the strongest places can be just beside the best ones.
        If force closure is lost on the way, the grasp stays as it is.
        """
        free = self._candidates.limits_at(trial.yaw) == Limit.NONE
        homes, before, strong = self._candidates.homes_at(trial.yaw), 0.0, trial
        while before < strong.load < _ENOUGH:
            before = strong.load
            for finger in strong.fingers.tolist():
                room = np.flatnonzero(
                    free[finger] & self._candidates.has_room(homes, finger, strong.candidates)
                )
                gaps = np.linalg.norm(self._p[room] - self._p[strong.candidates[finger]], axis=1)
                for candidate in room[np.argsort(gaps)[:_NEIGHBOURS]].tolist():
                    assigned = np.where(np.arange(self._n) == finger, candidate, strong.candidates)
                    if (load := self._load(assigned)) > strong.load:
                        strong = replace(strong, candidates=assigned, load=load)
        turned = self._turned(strong)
        grasp = self._judged(turned.trial) if turned.has_reach else self.kept(strong)
        return grasp or trial

    def _load(self, assigned: IntArray) -> float:
        cones, model = self._cones(assigned)
        forces = self._hand.normal_forces[:, assigned != AWAY]
        return largest_load(*cones, wrench=self._hand.wrench, normal_forces=forces, **model)

    def _margin(self, assigned: IntArray) -> float:
        cones, model = self._cones(assigned)
        return min_weight_margin(*cones, **model)

    def _turn_by_load(self, trial: _Trial) -> float:
        """Returns the turn of the object by a change of its load, up to the largest, in radians.

        It is the largest if the joints of a finger do not bring its tip to its contact.
        """
        hand, fingers, assigned = self._hand, trial.fingers, trial.candidates[trial.fingers]
        places = zip(fingers.tolist(), self._candidates.touching(fingers, assigned), strict=True)
        compliances = np.array([hand.compliance(trial.yaw, *place) for place in places])
        if not np.all(np.isfinite(compliances)):
            return _FARTHEST
        turn = turn_by_force(
            *(self._arms[assigned], self._normals[assigned], compliances),
            torsional_arms=torsional_friction_of(1.0, self._patch_radii[fingers]),
            force=hand.load_change,
        )
        return min(turn, _FARTHEST)

    def _cones(
        self, assigned: IntArray
    ) -> tuple[tuple[FloatArray, FloatArray, float], dict[str, Any]]:
        """Returns lever arms, normals and friction of the assigned fingers, and their model."""
        fingers, friction = assigned != AWAY, self._hand.friction
        cones = self._arms[assigned[fingers]], self._normals[assigned[fingers]], friction
        radii = self._patch_radii[fingers]
        if not np.any(radii > 0):
            return cones, {"model": "hard_finger"}
        torsional = torsional_friction_of(friction, radii)
        return cones, {"model": "soft_finger", "torsional_friction": torsional}

    def has_clear_links(self, trial: _Trial) -> bool:
        """Returns whether all fingers of a trial touch the object with their tips first."""
        return all(
            self._candidates.has_clear_links(trial.yaw, finger, trial.candidates[[finger]])[0]
            for finger in trial.fingers.tolist()
        )

    def contacts_of(self, trial: _Trial) -> StartContacts:
        """Returns the contacts of a trial."""
        p_OC = self._p[self._nearest_candidates(trial)]
        return StartContacts(
            p_OC, trial.candidates != AWAY, trial.yaw, trial.margin, trial.score, trial.yaw_slack
        )

    def _missing_reach(self) -> str:
        """Returns in words by how much fingers that are needed miss the object."""
        gaps = [np.sort(self._candidates.reach_gaps_at(yaw)) for yaw in self.yaws()]
        gap = 1e3 * min(own[self._hand.least_fingers - 1] for own in gaps)
        if not gap < np.inf:
            return "face no side that they may touch"
        return f"end {gap:.3g} mm off" if gap > 0 else "get there with too small measures"

    def _missing_room(self, limits: list[IntArray]) -> str:
        """Returns in words by how much fingertips are too large, or too near to each other."""
        least, yaws = self._hand.least_fingers, self.yaws()
        lacking = [np.sort(self._candidates.lacking_room_at(yaw))[least - 1] for yaw in yaws]
        if 0 < (missing := 1e3 * min(lacking)) < np.inf:
            return (
                f", and the missing ones are {missing:.3g} mm too large for their roomiest places"
            )
        free = [at == Limit.NONE for at in limits if np.any(at == Limit.NONE)]
        spreads = (self._candidates.spread(mask, least) for mask in free)
        apart, needed = max(spreads, default=(np.inf, 0.0))
        if apart > needed:
            return ""
        there = f"{least} places in reach are at most {1e3 * apart:.3g} mm apart"
        return f", {there}, and fingertips need {1e3 * needed:.3g} mm"

    def lack(self) -> NoGraspError:
        """Returns what is missing, if there is no grasp."""
        least, friction = self._hand.least_fingers, self._hand.friction
        points = self._candidates.opposite
        widths = [points.least_width(pair) for pair in self._hand.pairs]
        if (widest := self._hand.opening) < (width := max(widths, default=0.0)) < np.inf:
            detail = f"the jaws open {1e3 * widest:.3g} mm between their standoffs; the narrowest"
            detail = f"{detail} place between opposite sides is {1e3 * width:.3g} mm wide"
            return NoGraspError(Lack.OPENING, detail)
        limits = [self._candidates.limits_at(yaw) for yaw in self.yaws()]
        opposite = (self._normals @ self._normals.T < OPPOSITE).astype(np.float32)

        def lacks(masks: list[BoolArray]) -> tuple[int, bool]:
            """Returns how many fingers have a place, and whether none of these are opposite."""
            places = (mask.astype(np.float32) for mask in masks)
            facing = any(np.any(place @ opposite @ place.T > 0) for place in places)
            return max(int(np.sum(np.any(mask, axis=1))) for mask in masks), not facing

        reached, one_sided = lacks([~np.isin(at, (Limit.FORBIDDEN, Limit.REACH)) for at in limits])
        if reached < least:
            detail = f"at most {reached} fingers reach it at any yaw; {least} are needed"
            return NoGraspError(
                Lack.REACH, f"{detail}, and the missing ones {self._missing_reach()}"
            )
        if one_sided and np.any(opposite):
            apart = 1e3 * np.max(pdist(self._candidates.across(self._hand.p_OT_at(self._hand.yaw))))
            from_planes = self._p @ self._normals.T - np.sum(self._p * self._normals, axis=1)
            width = 1e3 * np.min(np.abs(from_planes[opposite > 0]))
            detail = (
                f"at no yaw do fingers reach two opposite sides, which are {width:.3g} mm apart"
            )
            return NoGraspError(Lack.OPENING, f"{detail}; tips at home are {apart:.3g} mm apart")
        trials = list(map(self.settled, self.yaws()))
        most = max(len(trial.fingers) for trial in trials)
        _, one_sided = lacks([at == Limit.NONE for at in limits])
        if most < least or (one_sided and np.any(opposite)):
            where = " on two opposite sides" if most >= least else ""
            detail = f"at most {most} fingertips have room beside each other, table and object"
            detail = f"{detail}{where}; {least} are needed{self._missing_room(limits)}"
            return NoGraspError(Lack.ROOM, detail)
        cones = [self._cones(t.candidates) for t in trials if len(t.fingers) >= least]
        needed = needed_friction([(p, n, model) for (p, n, _), model in cones], friction)
        if needed <= friction:
            detail = "contacts with force closure are in reach only at yaws that the palm leaves"
            return NoGraspError(Lack.REACH, f"{detail}: it turns with the contacts")
        detail = f"no contacts in reach have force closure with friction {friction:g}"
        return NoGraspError(Lack.FRICTION, f"{detail}; they need {needed:.2g}")
