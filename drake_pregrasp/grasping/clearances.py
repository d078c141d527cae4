"""Constraints on a hand's velocities that keep its links clear of what is near."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.geometry.rotations import skew

LINK_CLEARANCE = 0.005
"""Least gap of links to everything but the hand, in metres: more than the error of an estimate."""

TIP_CLEARANCE = 0.002
"""Least gap of fingertips to everything but the hand, in metres; their goals keep a larger one."""

FINGER_CLEARANCE = 0.0005
"""Least gap between different fingers, in metres: their positions are known."""

INFLUENCE = 0.025
"""Distance below which motions are limited, in metres."""

TIP_LEAD = 0.002
"""Least distance by which a fingertip is nearer to the object than its links, in metres."""

_BRAKING = 1.125  # Ratio of the braking at the start of the influence to that of the fingertips.

RETREAT = 0.05
"""Largest speed at which a clearance that is violated is restored, in m/s."""


def approach_rate(acceleration: float) -> float:
    """Returns the largest ratio c of the speed at which a gap closes to the gap g, in 1/s.

    A link that closes its gap at c g brakes with c² g: most at the start of the influence.

    Args:
        acceleration: Largest acceleration of fingertips on the way to goals, in m/s².
    """
    return math.sqrt(_BRAKING * acceleration / INFLUENCE)


@dataclass(frozen=True, eq=False)
class Links:
    """The links of a hand; the object has the next index, and everything else the last one.

    Attributes:
        finger: Index of each link's finger, or `BASE`, shape (m,).
        is_tip: Whether each link is a fingertip, shape (m,).
        is_last: Whether no joint moves the link relative to its fingertip, shape (m,).
        moves: Whether each joint moves each link; 0 for the object and the rest, shape (m + 2, nq).
    """

    finger: IntArray
    is_tip: BoolArray
    is_last: BoolArray
    moves: FloatArray


class NearPairs(NamedTuple):
    """Pairs of a link and something near.

    Attributes:
        link: Index of the link, shape (k,).
        other: Index of the other thing in `Links`, shape (k,).
        gaps: Signed distances, shape (k,), in metres.
        p_WQ: A point of the line between the nearest points, shape (k, 3), in metres.
        normals: Unit vectors along it in W, from the other thing to the link, shape (k, 3).
    """

    link: IntArray
    other: IntArray
    gaps: FloatArray
    p_WQ: FloatArray
    normals: FloatArray


class Clearances(NamedTuple):
    """Linear constraints that keep a hand clear: rows v >= least for its joint velocities v.

    Attributes:
        rows: Gradients of signed distances, shape (k, nq).
        least: Least rates of change of the distances by the hand's own motion, shape (k,), in m/s.
        fingers: Index of a finger that each row keeps clear, -1 for the base, shape (k,).
    """

    rows: FloatArray
    least: FloatArray
    fingers: IntArray


def clearances(
    links: Links,
    near: NearPairs,
    screws: FloatArray,
    V_W: FloatArray,
    holding: BoolArray,
    rate: float,
) -> Clearances:
    """Returns the constraints on the hand's velocities.

    The rate of a gap is its normal n times the velocity of the link at C less that of the other
    thing there, where what moves with (w, v) at the origin of W has the velocity v + w x p.

    Args:
        links: The links of the hand.
        near: Pairs that are nearer than `INFLUENCE`.
        screws: Screws of the hand's joints (`HandPose`), shape (6, nq).
        V_W: Angular velocity of the object, and velocity at the origin of W, shape (6,).
        holding: Whether each fingertip holds the object or closes on it, shape (n,): it may touch
            it, but its links stay farther from it.
        rate: Largest ratio of the speed at which a gap closes to the gap that is left, in 1/s.
    """
    link, other, gaps, p_WQ, normals = near
    m = len(links.finger)
    is_object, among_fingers, finger = other == m, other < m, links.finger[link]
    is_tip = links.is_tip[link]
    least_gaps = np.where(is_tip, TIP_CLEARANCE, LINK_CLEARANCE)
    least_gaps[among_fingers] = FINGER_CLEARANCE
    moments = (skew(p_WQ) @ normals[:, :, None])[:, :, 0]
    along = np.concatenate([moments, normals], axis=1)
    rates = (along @ screws) * (links.moves[link] - links.moves[other])
    drift = is_object * (along @ V_W)
    speeds = np.minimum(rate * (least_gaps - gaps), RETREAT) + drift
    if not holding.any():
        return Clearances(rates, speeds, finger)
    holds = np.append(holding, False)[finger]  # The base is the last one.
    # The fingertip on the last link comes first, wherever the object is.
    touching = np.full(len(holding) + 1, -1)
    touching[finger[is_object & is_tip]] = np.flatnonzero(is_object & is_tip)
    behind = is_object & ~is_tip & links.is_last[link] & holds & (touching[finger] >= 0)
    tip = touching[finger[behind]]
    rates[behind] -= rates[tip]
    leads = rate * (TIP_LEAD - (gaps[behind] - gaps[tip]))
    speeds[behind] = np.minimum(leads, 0.0) + drift[behind] - drift[tip]
    kept = among_fingers | ~(is_tip & holds)
    return Clearances(rates[kept], speeds[kept], finger[kept])
