"""Measures of G Gᵀ of any contact model for many places of a contact, in vector instructions.

G Gᵀ is the matrix of the other contacts, which is the same for all places, plus that of the place.
Its eigenvalues come from cyclic Jacobi rotations. Elements of the matrix stand for a group of
places each, so that loops run over places.
"""

import math

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import MEASURES, RANK_TOLERANCE
from drake_pregrasp.fast.compiling import GROUP, compiled
from drake_pregrasp.fast.members import Members
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.grasp_quality import contact_blocks

_SWEEPS = 12  # Largest number of sweeps; six are usual, and each of the last squares the error.
_SETTLED = 1e-30  # Share of the squared trace up to which squares off the diagonal are rounding.
_MSV, _GII, _VEW = range(len(MEASURES))


@compiled()
def rotate(M, p, q, size, cosines, sines):  # type: ignore[no-untyped-def]
    """Rotates the axes p < q of `size` matrices so that their elements (q, p) become zero."""
    for k in range(size):
        a, half = M[q, p, k], (M[q, q, k] - M[p, p, k]) / 2.0
        root = math.sqrt(half * half + a * a)
        below = half + (root if half >= 0.0 else -root)
        t = a / (below if below != 0.0 else 1.0)
        M[p, p, k] -= t * a
        M[q, q, k] += t * a
        M[q, p, k] = 0.0
        cosines[k] = 1.0 / math.sqrt(1.0 + t * t)
        sines[k] = t * cosines[k]
    for row in range(6):
        if row in (p, q):
            continue
        x, y = M[max(row, p), min(row, p)], M[max(row, q), min(row, q)]
        for k in range(size):
            u, v = x[k], y[k]
            x[k] = cosines[k] * u - sines[k] * v
            y[k] = sines[k] * u + cosines[k] * v


@compiled()
def write_group(kind, M, size, cosines, sines, b):  # type: ignore[no-untyped-def]
    """Writes a measure of `size` matrices, which it overwrites, shape (6, 6, `GROUP`)."""
    for _ in range(_SWEEPS):
        for p in range(5):
            for q in range(p + 1, 6):
                rotate(M, p, q, size, cosines, sines)
        unsettled = 0
        for k in range(size):
            off, trace = 0.0, 0.0
            for p in range(6):
                trace += M[p, p, k]
                for q in range(p + 1, 6):
                    off += M[q, p, k] * M[q, p, k]
            unsettled += off > _SETTLED * trace * trace
        if unsettled == 0:
            break
    for k in range(size):
        least, most, product = np.inf, 0.0, 1.0
        for p in range(6):
            square = M[p, p, k]
            least, most, product = min(least, square), max(most, square), product * square
        if least <= RANK_TOLERANCE * most:
            b[k] = 0.0
        elif kind == _VEW:
            b[k] = math.sqrt(product)
        else:
            b[k] = math.sqrt(least / most if kind == _GII else least)


@compiled("void(i8, i8[::1], b1[::1], i8[::1], i8[::1], f8[:,::1], f8[:,::1], f8[::1])")
def write_measures(kind, contacts, active, ends, candidates, grams_C, grams_Q, b):  # type: ignore[no-untyped-def]
    """Writes a measure of contacts at each candidate of their regions.

    Args:
        kind: Index of the measure in `MEASURES`.
        contacts: Indices of the contacts that move, shape (k,).
        active: Mask of the contacts that take part in the grasp, shape (n,).
        ends: As the next one, part of `Members`.
        candidates: Indices of the candidates.
        grams_C: Lower triangle of G_i G_iᵀ of each contact, shape (n, 21).
        grams_Q: The same of a contact at each candidate, shape (N, 21).
        b: Result, shape (M,).
    """
    M, cosines, sines = np.empty((6, 6, GROUP)), np.empty(GROUP), np.empty(GROUP)
    others = np.empty(21)
    for region in range(len(contacts)):
        others[:] = 0.0
        for other in range(len(active)):
            if active[other] and other != contacts[region]:
                for element in range(21):
                    others[element] += grams_C[other, element]
        for start in range(ends[region], ends[region + 1], GROUP):
            size, element = min(GROUP, ends[region + 1] - start), 0
            for row in range(6):
                for column in range(row + 1):
                    for k in range(size):
                        own = grams_Q[candidates[start + k], element]
                        M[row, column, k] = others[element] + own
                    element += 1
            write_group(kind, M, size, cosines, sines, b[start:])


class MeasureWeights:
    """Weights of a measure of the grasp matrix: `WriteWeights`.

    Args:
        surface: The object's surface.
        name: Name of the measure in `MEASURES`.
        contact_model: Contact model of the grasp matrix.
        unit: Length by which the matrix divides lever arms, in metres.
    """

    def __init__(self, surface: ObjectSurface, name: str, contact_model: str, unit: float) -> None:
        self._surface, self._model, self._unit = surface, contact_model, unit
        self._kind = list(MEASURES).index(name)
        self._grams_Q = self._grams(surface.p_OQ, surface.nhat_OQ)

    def __call__(self, selection: SelectionInput, members: Members, b: FloatArray) -> None:
        """See `WriteWeights`."""
        grams_C = self._grams(selection.p_OC, selection.surface.project(selection.p_OC)[1])
        contacts, active, _, ends, candidates, _, _ = members
        write_measures(self._kind, contacts, active, ends, candidates, grams_C, self._grams_Q, b)

    def _grams(self, p_OC: FloatArray, nhat: FloatArray) -> FloatArray:
        """Returns the lower triangles of G_i G_iᵀ of n contacts, shape (n, 21)."""
        A = contact_blocks((p_OC - self._surface.p_OCoM) / self._unit, nhat, self._model)
        return np.ascontiguousarray((A @ A.swapaxes(1, 2))[:, *np.tril_indices(6)])
