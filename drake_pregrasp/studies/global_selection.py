"""Choosing all contacts at once, anew each time, among the candidates: greedily, with exchange.

One contact after another goes where the score of those so far is best; then each in turn goes where
it is best, until none gains. It is what one would do instead of a planner, beside the methods of
`continuous_selection`.
"""

import itertools
from collections.abc import Callable

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.quality.contact_models import contact_blocks
from drake_pregrasp.quality.force_closure import FRICTION, moved_least_norm_margin
from drake_pregrasp.quality.singular_values import extreme_singular_values

Score = Callable[[IntArray], FloatArray]
"""Maps held candidates, shape (k,), to the score with each candidate beside them, shape (N,)."""

_GAIN = 1e-12  # Of the score, relative: what is less is rounding, and could go round and round.


def eigenvalue_score(p_CoMQ: FloatArray) -> Score:
    """Returns Q_MSV², by numpy's decomposition of each 6 x 6 matrix.

    Args:
        p_CoMQ: Lever arms of the candidates, shape (N, 3), in metres.
    """
    grams = grasp_grams(p_CoMQ)

    def score(held: IntArray) -> FloatArray:
        values: FloatArray = np.linalg.eigvalsh(grams + np.sum(grams[held], axis=0))[:, 0]
        return values

    return score


def closed_form_score(p_CoMQ: FloatArray) -> Score:
    """Returns Q_MSV², by the planner's closed form.

    Args:
        p_CoMQ: As for `eigenvalue_score`.
    """
    B = grasp_grams(p_CoMQ)[:, 3:, 3:] - np.eye(3)

    def score(held: IntArray) -> FloatArray:
        t, moments = p_CoMQ + np.sum(p_CoMQ[held], axis=0), B + np.sum(B[held], axis=0)
        return extreme_singular_values(t, moments, len(held) + 1)[0] ** 2

    return score


def margin_score(p_CoMQ: FloatArray, nhat_OQ: FloatArray) -> Score:
    """Returns the bound of the min-weight margin of hard fingers.

    Args:
        p_CoMQ: As for `eigenvalue_score`.
        nhat_OQ: Outward unit normals there, shape (N, 3).
    """

    def score(held: IntArray) -> FloatArray:
        last = np.append(held, 0)  # Any candidate stands where the moved contact will.
        return moved_least_norm_margin(
            p_CoMQ[last],
            nhat_OQ[last],
            FRICTION,
            moved=np.full(len(p_CoMQ), len(held)),
            p_CoMQ=p_CoMQ,
            nhat_Q=nhat_OQ,
        )

    return score


def greedy(score: Score, first: int, contacts: int) -> IntArray:
    """Returns candidates, the first as given, each other where the score so far is best.

    Args:
        score: What to maximise.
        first: Index of the first candidate.
        contacts: How many to choose, n.

    Returns:
        Indices, shape (n,).
    """
    chosen = np.array([first])
    while len(chosen) < contacts:
        chosen = np.append(chosen, np.argmax(score(chosen)))
    return chosen


def exchanged(score: Score, chosen: IntArray) -> IntArray:
    """Returns candidates of which no one can go elsewhere to a better score.

    Args:
        score: What to maximise.
        chosen: Where to begin, shape (n,).
    """
    chosen, at_their_best = chosen.copy(), 0
    for i in itertools.cycle(range(len(chosen))):
        if at_their_best == len(chosen):
            break
        values = score(np.delete(chosen, i))
        best = int(np.argmax(values))
        gains = values[best] - values[chosen[i]] > _GAIN * abs(values[best])
        if gains:
            chosen[i] = best
        at_their_best = 1 if gains else at_their_best + 1
    return chosen


def grasp_grams(p_CoMC: FloatArray) -> FloatArray:
    """Returns G_i G_iᵀ of the complete model, shape (k, 6, 6), of lever arms (k, 3) in metres."""
    G = contact_blocks(p_CoMC, None, "complete")
    grams: FloatArray = G @ G.transpose(0, 2, 1)
    return grams
