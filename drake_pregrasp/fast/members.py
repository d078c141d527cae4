"""The candidates in the regions of contacts, at which strategies write their weights."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.contacts.selection_input import SelectionInput
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
    "Tuple((i8[::1], i8[::1], f8[:,::1]))(i8, i8[::1], Array(i8, 1, 'C', readonly=True), f8[:,::1])"
)
def members_of(count, places, labels, values):  # type: ignore[no-untyped-def]
    """Returns ends and candidates of `Members`, and their lever arms and areas, shape (4, M).

    Adjacent candidates of one region are copied at once.

    Args:
        count: Number k of the contacts that move.
        places: Index from 0 to k - 1 of each contact that moves, -1 of the others; the last
            element is -1, for the label `NO_REGION`, shape (n + 1,).
        labels: Region of each candidate, shape (N,).
        values: Lever arm and area of each candidate, shape (4, N).
    """
    N, num_runs, ends = len(labels), 0, np.zeros(count + 1, np.int64)
    runs = np.empty(N + 1, np.int64)  # First candidates of runs of equal labels.
    for j in range(N):
        if j == 0 or labels[j] != labels[j - 1]:
            runs[num_runs] = j
            num_runs += 1
    runs[num_runs] = N
    for run in range(num_runs):
        k = places[labels[runs[run]]]
        if k >= 0:
            ends[k + 1] += runs[run + 1] - runs[run]
    for k in range(count):
        ends[k + 1] += ends[k]
    filled = ends.copy()
    candidates, copies = np.empty(ends[-1], np.int64), np.empty((len(values), ends[-1]))
    for run in range(num_runs):
        start, size = runs[run], runs[run + 1] - runs[run]
        k = places[labels[start]]
        if k >= 0:
            to, filled[k] = filled[k], filled[k] + size
            own = candidates[to:]
            for j in range(size):
                own[j] = start + j
            for v in range(len(values)):
                copy, value = copies[v, to:], values[v, start:]
                for j in range(size):
                    copy[j] = value[j]
    return ends, candidates, copies
