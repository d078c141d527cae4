"""Weighted centroids of safe regions, or their best points, for any weights.

Candidates of a region are copied next to each other, one region after another. Each strategy writes
its weights at these places; `centroids` stretches, blends and applies them.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.contacts.centroids import TIE
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import FLAT
from drake_pregrasp.fast.compiling import compiled


class Members(NamedTuple):
    """The candidates in the regions of the contacts that move, one region after another.

    Attributes:
        contacts: Indices of these contacts, shape (k,).
        active: Mask of the contacts that take part in the grasp, shape (n,).
        r: Lever arms of all contacts, shape (n, 3), in units of length.
        ends: First place of each of the k regions, and M, shape (k + 1,).
        candidates: Index of the candidate at each place, shape (M,).
        q: Its lever arm, shape (3, M), in units of length.
        areas: Surface area that it represents, shape (M,), in m².
    """

    contacts: IntArray
    active: BoolArray
    r: FloatArray
    ends: IntArray
    candidates: IntArray
    q: FloatArray
    areas: FloatArray


WriteWeights = Callable[[SelectionInput, Members, FloatArray], object]
"""Writes the weights of a strategy at the places of the members, shape (M,)."""


@compiled(
    "Tuple((i8[::1], i8[::1], f8[:,::1], f8[::1]))(i8[::1], i8[::1], i8[::1], f8[:,::1], f8[::1])"
)
def members_of(contacts, places, labels, q, areas):  # type: ignore[no-untyped-def]
    """Returns ends, candidates, q and areas of `Members`.

    Args:
        contacts: Indices of the contacts that move, shape (k,).
        places: Memory for a number of each contact, shape (n + 1,).
        labels: Region of each candidate, shape (N,).
        q: Lever arms of the candidates, shape (N, 3), in units of length.
        areas: Surface area that each candidate represents, shape (N,), in m².
    """
    ends = np.zeros(len(contacts) + 1, np.int64)
    for i in range(len(places)):
        places[i] = -1  # The last one, too, is that of the label of no region.
    for k in range(len(contacts)):
        places[contacts[k]] = k
    for label in labels:
        if places[label] >= 0:
            ends[places[label] + 1] += 1
    for k in range(len(contacts)):
        ends[k + 1] += ends[k]
    size, filled = ends[-1], ends.copy()
    candidates, own_q, own_areas = np.empty(size, np.int64), np.empty((3, size)), np.empty(size)
    for j in range(len(labels)):
        k = places[labels[j]]
        if k >= 0:
            to = filled[k]
            filled[k] += 1
            candidates[to], own_areas[to] = j, areas[j]
            own_q[0, to], own_q[1, to], own_q[2, to] = q[j, 0], q[j, 1], q[j, 2]
    return ends, candidates, own_q, own_areas


@compiled("void(f8[:,::1], f8, i8[::1], f8[:,::1], f8[::1])")
def write_position_weights(covariance, unit, ends, q, b):  # type: ignore[no-untyped-def]
    """Writes exp(-qᵀ P q / 2) over its largest value in the region, with P the precision.

    Args:
        covariance: Covariance of the position, shape (3, 3), in m².
        unit: Unit of length, in metres.
        ends: As the next one, part of `Members`.
        q: Lever arms of the candidates.
        b: Result, shape (M,).
    """
    s, u, v = covariance[0, 0], covariance[0, 1], covariance[0, 2]
    t, w, r = covariance[1, 1], covariance[1, 2], covariance[2, 2]
    # The inverse by its cofactors; elements off the diagonal count twice.
    xx, yy, zz = t * r - w * w, s * r - v * v, s * t - u * u
    xy, xz, yz = 2.0 * (w * v - u * r), 2.0 * (u * w - t * v), 2.0 * (u * v - s * w)
    scale = -0.5 * unit * unit / (s * xx + 0.5 * (u * xy + v * xz))
    for region in range(len(ends) - 1):
        most = -np.inf
        for k in range(ends[region], ends[region + 1]):
            x, y, z = q[0, k], q[1, k], q[2, k]
            square = xx * x * x + yy * y * y + zz * z * z
            b[k] = scale * (square + xy * x * y + xz * x * z + yz * y * z)
            most = max(most, b[k])
        for k in range(ends[region], ends[region + 1]):
            b[k] = math.exp(b[k] - most)


@compiled()
def add_weights(share, stretch, power, areas, b, weights):  # type: ignore[no-untyped-def]
    """Adds a strategy's share of the weights, which are at most 1, over one region."""
    least, most, difference, whole = np.inf, -np.inf, 0.0, 0.0
    for k in range(len(b)):
        least, most = min(least, b[k]), max(most, b[k])
    base = 0.0
    if stretch:
        base = least
        for k in range(len(b)):
            difference += (b[k] - least) * areas[k]
            whole += b[k] * areas[k]
        if not difference > FLAT * whole:
            return
    scale = most - base
    if not scale > 0.0:
        return
    scale = 1.0 / scale
    if power == 1.0:
        for k in range(len(b)):
            weight = (b[k] - base) * scale
            weights[k] += share * (weight if weight > 0.0 else 0.0)
    else:
        for k in range(len(b)):
            weights[k] += share * max((b[k] - base) * scale, 0.0) ** power


@compiled(
    "f8[:,::1](f8[::1], b1[::1], f8[::1], b1, i8[::1], f8[:,::1], f8[::1], f8[:,::1], f8[::1])"
)
def centroids(shares, stretches, powers, best_point, ends, q, areas, b, weights):  # type: ignore[no-untyped-def]
    """Returns the centroids of regions or their best points, shape (k, 3), in units of length.

    Args:
        shares: Share of each strategy in the weights, shape (s,).
        stretches: Whether to subtract a region's smallest weight, shape (s,).
        powers: Exponents of the weights, shape (s,).
        best_point: Whether to return the candidates with the largest weights.
        ends: As the next two, part of `Members`.
        q: Lever arms.
        areas: Surface areas.
        b: Weights of each strategy at the places, shape (s, M).
        weights: Memory, shape (M,).
    """
    goals = np.zeros((len(ends) - 1, 3))
    for k in range(len(weights)):
        weights[k] = 0.0
    for region in range(len(goals)):
        start, stop, most, best, whole = ends[region], ends[region + 1], 0.0, -1, 0.0
        own_areas, own_weights = areas[start:stop], weights[start:stop]
        for s in range(len(b)):
            add_weights(
                shares[s], stretches[s], powers[s], own_areas, b[s, start:stop], own_weights
            )
        for k in range(start, stop):
            most = max(most, weights[k])
        gx, gy, gz = 0.0, 0.0, 0.0
        for k in range(start, stop):
            weight = areas[k] * (weights[k] if most > 0.0 else 1.0)
            gx, gy, gz = gx + weight * q[0, k], gy + weight * q[1, k], gz + weight * q[2, k]
            whole += weight
        goals[region, 0], goals[region, 1], goals[region, 2] = gx / whole, gy / whole, gz / whole
        if best_point:
            for k in range(start, stop):
                if best < 0 and weights[k] >= most * (1.0 - TIE):
                    best = k
                    for axis in range(3):
                        goals[region, axis] = q[axis, k]
    return goals
