"""Home positions of fingers: fingertips that surround an object, from the kinematics alone."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.regions.finger_measures import FingerChain

OBJECT_RADIUS = 0.03
"""Radius of the object that fingertips surround, in metres."""

_GAP = 0.02  # Distance of fingertips from the object, in metres.
_TOLERANCE = 0.008  # Error of a fingertip's place that costs 1, in metres.
_OUTWARD, _DOWNWARD, _MIDDLE = 4.0, 1.0, 2.0  # Costs of directions of a finger, and of its limits.
_WIDEST_GAP = np.pi + 0.2  # Angle between neighbouring fingers beyond which none oppose others.
_ONE_SIDED = 100.0  # Cost of a larger angle, per radian.
_PALM_HEIGHT = 0.06  # Least height of the first joints over the object's centre, in metres.
_APART = 0.003  # Least gap between fingertips, in metres.
_CROWDED = 50.0  # Cost of two fingertips with less between them; the gap that is missing adds.
_CENTERS = 400  # Largest number of places of the object that are tried along an axis.
_SAMPLES = 1000  # Number of positions of a finger among which the best are sought.
_FINER = 5  # Places along each edge of the grid around the best place.
_ROUNDS, _TRIES = 6, 300  # Rounds of refinement, and positions that each of them tries.


@dataclass(frozen=True, eq=False)
class Finger:
    """A finger on a palm that rests in a frame U.

    Attributes:
        chain: Kinematics of the fingertip.
        origins: Origins of the joints with the joints at `chain.home`, in U, shape (k, 3), in
            metres.
        radius: Radius of the fingertip, in metres.
    """

    chain: FingerChain
    origins: FloatArray
    radius: float


@dataclass(frozen=True, eq=False)
class Grip:
    """Place of an object in a hand, and positions in which fingertips surround it.

    Attributes:
        axis: Direction from the object to the palm in U, a unit vector, shape (3,).
        center: Centre of the object in U, shape (3,), in metres.
        homes: Positions of the joints of each finger, in radians or metres.
        p_UT: Centres of the fingertips there, in U, shape (n, 3), in metres.
        cost: Cost of these positions; see `find_grip`.
    """

    axis: FloatArray
    center: FloatArray
    homes: list[FloatArray]
    p_UT: FloatArray
    cost: float


@dataclass(frozen=True, eq=False)
class _Postures:
    """Positions of a finger's joints, shape (m, k), with places and directions, shape (m, 3)."""

    q: FloatArray
    tips: FloatArray
    outward: FloatArray
    last: FloatArray
    limits: FloatArray
    root: FloatArray


def find_grip(
    fingers: Sequence[Finger], axes: Sequence[FloatArray], *, on_axis: bool = False
) -> Grip:
    """Returns the place of an object at which fingers surround it best.

    Fingertips should be `_GAP` off the sides of the object, at the height of its centre, with
    bent fingers outside of them, last links along the axis, and joints near the middles of their
    ranges. Some fingers should oppose others.

    Args:
        fingers: The fingers.
        axes: Directions from the object to the palm that are tried, in U.
        on_axis: Whether the object is on the axis through the origin of U.
    """
    postures = [_postures(finger, finger.chain.samples[:_SAMPLES]) for finger in fingers]
    tips = np.concatenate([posture.tips for posture in postures])
    grips = []
    for axis in axes:
        centers, step = _centers(tips, axis, on_axis)
        coarse = _best(fingers, postures, centers, axis)
        around = np.linspace(-step, step, _FINER)
        finer = np.stack(np.meshgrid(*3 * [around]), axis=-1).reshape(-1, 3)
        finer = np.outer(finer @ axis, axis) if on_axis else finer
        grips.append(_best(fingers, postures, coarse.center + finer, axis))
    return _refined(fingers, min(grips, key=lambda grip: grip.cost))


def _best(
    fingers: Sequence[Finger], postures: Sequence[_Postures], centers: FloatArray, axis: FloatArray
) -> Grip:
    """Returns the grip of least cost among places of the object."""
    total, chosen = np.zeros(len(centers)), []
    places = np.empty((0, len(centers), 3))
    for finger, own in zip(fingers, postures, strict=True):
        costs, best = _costs(finger, own, centers, axis, fingers, places)
        total += costs
        chosen.append(best)
        places = np.concatenate([places, own.tips[best][None]])
    total += _one_sided_costs(places - centers, axis)
    least = int(np.argmin(total))
    homes = [p.q[c[least]] for p, c in zip(postures, chosen, strict=True)]
    return Grip(axis, centers[least], homes, places[:, least], float(total[least]))


def _centers(tips: FloatArray, axis: FloatArray, on_axis: bool) -> tuple[FloatArray, float]:
    """Returns places of an object that fingertips may surround, shape (m, 3), and their step."""
    if on_axis:
        heights = np.linspace(np.min(tips @ axis), np.max(tips @ axis), _CENTERS)
        return heights[:, None] * axis, float(heights[1] - heights[0])
    low, high = np.quantile(tips, [0.02, 0.98], axis=0)
    step = max(float((np.prod(high - low) / _CENTERS) ** (1 / 3)), 0.004)
    grids = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*grids, indexing="ij"), axis=-1).reshape(-1, 3), step


def _postures(finger: Finger, q: FloatArray) -> _Postures:
    chain = finger.chain
    tips, before = chain.tips(q)[0], chain.displacements(q)[:-1]
    origins = np.stack(
        [R @ p + shift for p, (R, shift) in zip(finger.origins, before, strict=True)]
    )
    chord = tips - origins[0]
    chord = chord / np.maximum(np.linalg.norm(chord, axis=1, keepdims=True), 1e-9)
    bends = origins - origins[0]  # Offsets of the joints from the chord of the finger.
    bends = bends - np.sum(bends * chord, axis=2, keepdims=True) * chord
    widest = np.argmax(np.linalg.norm(bends, axis=2), axis=0)
    outward = bends[widest, np.arange(len(q))]
    last = tips - origins[-1]
    last = last / np.maximum(np.linalg.norm(last, axis=1, keepdims=True), 1e-9)
    half = np.maximum((chain.upper - chain.lower) / 2, 1e-9)
    off = np.abs(q - (chain.lower + chain.upper) / 2) / half
    limits = np.mean(off**2 + np.maximum(0.0, off - 0.9) * 100, axis=1)
    return _Postures(q, tips, outward, last, limits, origins[0])


def _costs(
    finger: Finger,
    postures: _Postures,
    centers: FloatArray,
    axis: FloatArray,
    others: Sequence[Finger],
    p_UT: FloatArray,
) -> tuple[FloatArray, IntArray]:
    """Returns the least cost of a finger for each place, and the posture that has it.

    Args:
        finger: The finger.
        postures: Its postures.
        centers: Places of the object in U, shape (m, 3), in metres.
        axis: Direction from the object to the palm in U.
        others: Other fingers, of which more may follow.
        p_UT: Fingertips of the first k of them for each place, shape (k, m, 3), in metres.
    """
    distance = OBJECT_RADIUS + _GAP + finger.radius
    own = _MIDDLE * postures.limits + _DOWNWARD * (1 + postures.last @ axis)
    across = np.eye(3) - np.outer(axis, axis)
    outward = postures.outward @ across
    outward = outward / np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 3e-3)
    heights, level = postures.tips @ axis, postures.tips @ across
    away, lows = np.sum(outward * level, axis=1), _PALM_HEIGHT - postures.root @ axis
    costs, chosen = np.empty(len(centers)), np.empty(len(centers), dtype=np.int64)
    for index, (height, place) in enumerate(zip(centers @ axis, centers @ across, strict=True)):
        length = np.maximum(np.linalg.norm(level - place, axis=1), 1e-9)
        cost = ((length - distance) ** 2 + (heights - height) ** 2) / _TOLERANCE**2 + own
        cost += _OUTWARD * (1 - (away - outward @ place) / length)
        cost += np.maximum(0.0, (lows + height) / _TOLERANCE) ** 2
        for other, p in zip(others, p_UT[:, index], strict=False):
            between = np.linalg.norm(postures.tips - p, axis=1)
            missing = np.maximum(0.0, finger.radius + other.radius + _APART - between)
            cost += (missing > 0) * _CROWDED + (missing / _TOLERANCE) ** 2
        chosen[index] = np.argmin(cost)
        costs[index] = cost[chosen[index]]
    return costs, chosen


def _one_sided_costs(off: FloatArray, axis: FloatArray) -> FloatArray:
    """Returns the costs of fingers that do not oppose each other, shape (m,).

    Args:
        off: Fingertips relative to the object's centre, shape (n, m, 3), in metres.
        axis: Direction from the object to the palm.
    """
    e1 = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    e1 /= np.linalg.norm(e1)
    angles = np.sort(np.arctan2(off @ np.cross(axis, e1), off @ e1), axis=0)
    gaps = np.diff(np.concatenate([angles, angles[:1] + 2 * np.pi]), axis=0)
    cost: FloatArray = _ONE_SIDED * np.maximum(0.0, np.max(gaps, axis=0) - _WIDEST_GAP)
    return cost


def _refined(fingers: Sequence[Finger], grip: Grip) -> Grip:
    """Returns a grip with positions of less cost nearby, at the same place of the object."""
    random, homes, p_UT = np.random.default_rng(0), list(grip.homes), np.array(grip.p_UT)
    for i, finger in enumerate(fingers):
        chain, width, home = finger.chain, 0.1, homes[i]
        others, places = [*fingers[:i], *fingers[i + 1 :]], np.delete(p_UT, i, axis=0)[:, None]
        for _ in range(_ROUNDS):
            step = width * (chain.upper - chain.lower) * random.normal(size=(_TRIES, len(home)))
            q = np.clip(np.vstack([home, home + step]), chain.lower, chain.upper)
            found = _postures(finger, q)
            _, (best,) = _costs(finger, found, grip.center[None], grip.axis, others, places)
            home, width = q[best], 0.5 * width
        homes[i], p_UT[i] = home, chain.tips(home[None])[0][0]
    return replace(grip, homes=homes, p_UT=p_UT)
