"""The bound of `moved_least_norm_margin` for many places of a contact, in vector instructions.

For each place, M y = e with the 7 x 7 matrix M = sum P_i P_iᵀ is solved by M = L D Lᵀ, as the
reference does. The matrix of the other contacts is the same for all places. Elements of M stand for
a group of places each, so that loops run over places.
"""

import math

import numpy as np
from scipy.spatial.distance import cdist

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.fast.compiling import GROUP, compiled
from drake_pregrasp.fast.members import Members
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.force_closure import LEAST_MARGIN
from drake_pregrasp.quality.grasp_quality import longest_arm
from drake_pregrasp.quality.margin_bounds import GRAM_RANK_TOLERANCE
from drake_pregrasp.regions.independent_regions import slip_radii


@compiled()
def lower_to_cone(P, y, size, components, least):  # type: ignore[no-untyped-def]
    """Lowers `least` to g_0 - |g_t| of a contact's force g = Pᵀ y, for `size` places.

    P has shape (7, 3, size), or (7, 3, 1) for the same contact at all places.
    """
    components[:] = 0.0
    for a in range(7):
        for column in range(3):
            if P.shape[2] == 1:
                p = P[a, column, 0]
                for k in range(size):
                    components[column, k] += p * y[a, k]
            else:
                for k in range(size):
                    components[column, k] += P[a, column, k] * y[a, k]
    for k in range(size):
        t, o = components[1, k], components[2, k]
        least[k] = min(least[k], components[0, k] - math.sqrt(t * t + o * o))


@compiled()
def group_margins(gram, P_C, others, P, size, M, y, components, least, spans, b):  # type: ignore[no-untyped-def]
    """Writes the margin's bound of `size` places; a negative one b becomes b / (1 - b).

    Args:
        gram: Lower triangle of M of the other contacts, shape (7, 7).
        P_C: P of each contact, shape (n, 7, 3, 1).
        others: Indices of the other contacts, shape (n - 1,).
        P: P of the moved contact at each place, shape (7, 3, `GROUP`).
        size: Number of places.
        M: Memory, shape (7, 7, `GROUP`).
        y: Memory, shape (7, `GROUP`).
        components: Memory, shape (3, `GROUP`).
        least: Memory, shape (`GROUP`,).
        spans: Memory of the same shape, for the largest element.
        b: Result, shape (`size`,) or longer.
    """
    spans[:] = 0.0
    for k in range(size):
        b[k] = 1.0 if len(others) > 1 else 0.0  # Two fingers never span all wrenches.
    for i in range(7):
        for j in range(i + 1):
            same = gram[i, j]
            for k in range(size):
                tangential = P[i, 1, k] * P[j, 1, k] + P[i, 2, k] * P[j, 2, k]
                M[i, j, k] = same + P[i, 0, k] * P[j, 0, k] + tangential
        for k in range(size):
            spans[k] = max(spans[k], M[i, i, k])
    for k in range(size):
        spans[k] *= GRAM_RANK_TOLERANCE
    # Below the diagonal M keeps D L, above it L.
    for j in range(7):
        for k in range(size):
            b[k] = b[k] if M[j, j, k] > spans[k] else 0.0
            M[j, j, k] = 1.0 / (M[j, j, k] if b[k] > 0.0 else 1.0)
        for i in range(j + 1, 7):
            for k in range(size):
                M[j, i, k] = M[i, j, k] * M[j, j, k]
        for i in range(j + 1, 7):
            for column in range(j + 1, i + 1):
                for k in range(size):
                    M[i, column, k] -= M[j, i, k] * M[column, j, k]
    for j in range(6, -1, -1):
        for k in range(size):
            y[j, k] = M[6, 6, k] if j == 6 else 0.0
        for i in range(j + 1, 7):
            for k in range(size):
                y[j, k] -= M[j, i, k] * y[i, k]
    least[:] = np.inf
    lower_to_cone(P, y, size, components, least)
    for other in others:
        lower_to_cone(P_C[other], y, size, components, least)
    for k in range(size):
        bound = (len(others) + 1) * least[k]
        bound = bound if bound >= 0.0 else 1.0 / (1.0 - bound) - 1.0
        b[k] = bound if b[k] > 0.0 else -1.0


@compiled("void(i8[::1], b1[::1], i8[::1], i8[::1], f8[:,:,:,::1], f8[:,:,:,::1], f8[::1])")
def write_margins(contacts, active, ends, candidates, P_C, P_Q, b):  # type: ignore[no-untyped-def]
    """Writes `hand_margin` of the contacts at each candidate of their regions.

    Args:
        contacts: As the next three, part of `Members`.
        active: Mask of the active contacts.
        ends: Ends of the regions.
        candidates: Indices of the candidates.
        P_C: P of each contact, shape (n, 7, 3, 1).
        P_Q: P of a contact at each candidate, shape (N, 7, 3, 1).
        b: Result, shape (M,).
    """
    P, M, y = np.empty((7, 3, GROUP)), np.empty((7, 7, GROUP)), np.empty((7, GROUP))
    components, least, spans = np.empty((3, GROUP)), np.empty(GROUP), np.empty(GROUP)
    gram, others = np.empty((7, 7)), np.empty(len(active), np.int64)
    for region in range(len(contacts)):
        count = 0
        gram[:] = 0.0
        for other in range(len(active)):
            if active[other] and other != contacts[region]:
                p = P_C[other]
                for i in range(7):
                    for j in range(i + 1):
                        for column in range(3):
                            gram[i, j] += p[i, column, 0] * p[j, column, 0]
                others[count] = other
                count += 1
        for start in range(ends[region], ends[region + 1], GROUP):
            size = min(GROUP, ends[region + 1] - start)
            for k in range(size):
                j = candidates[start + k]
                for a in range(7):
                    for column in range(3):
                        P[a, column, k] = P_Q[j, a, column, 0]
            own = others[:count], P, size, M, y, components, least, spans, b[start:]
            group_margins(gram, P_C, *own)


@compiled("f8[:,::1](f8[:,:], f8[:,:], f8, f8)")
def contact_rows(r, nhat, friction, arm):  # type: ignore[no-untyped-def]
    """Returns P of hard fingers, shape (k, 21), as `balance_blocks`, with torques over an arm."""
    rows = np.zeros((len(r), 21))
    for k in range(len(r)):
        x, y, z = nhat[k, 0], nhat[k, 1], nhat[k, 2]
        # The first tangent is nhat x e / |nhat x e| with the axis e least along nhat.
        if abs(x) <= abs(y) and abs(x) <= abs(z):
            t = (0.0, z, -y)
        elif abs(y) <= abs(z):
            t = (-z, 0.0, x)
        else:
            t = (y, -x, 0.0)
        norm = math.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
        t = (t[0] / norm, t[1] / norm, t[2] / norm)
        o = (z * t[1] - y * t[2], x * t[2] - z * t[0], y * t[0] - x * t[1])
        for column, axis in enumerate(((-x, -y, -z), t, o)):
            scale = 1.0 if column == 0 else friction
            for row in range(3):
                i, j = (row + 1) % 3, (row + 2) % 3
                rows[k, 3 * row + column] = scale * axis[row]
                torque = r[k, i] * axis[j] - r[k, j] * axis[i]
                rows[k, 9 + 3 * row + column] = scale * torque / arm
        rows[k, 18] = 1.0
    return rows


def compiled_slip_radii(
    surface: ObjectSurface, p_OC: FloatArray, nhat_OC: FloatArray, radius: float, friction: float
) -> FloatArray:
    """Returns how far each of n contacts may slip, shape (n,), as `slip_radii_within`."""
    n, distances = len(p_OC), cdist(p_OC, surface.p_OQ)
    moved, near = np.nonzero(distances < radius)
    # The contacts themselves come first.
    r = np.concatenate([p_OC, surface.p_OQ[near]]) - surface.p_OCoM
    slips = np.append(np.zeros(n), distances[moved, near])
    moved = np.append(np.arange(n), moved)
    nhat = np.concatenate([nhat_OC, surface.nhat_OQ[near]])
    rows = contact_rows(r, nhat, float(friction), longest_arm(r)).reshape(-1, 7, 3, 1)
    order, bounds = np.argsort(moved, kind="stable"), np.empty(len(moved))
    contacts, ends = np.arange(n), np.searchsorted(moved[order], np.arange(n + 1))
    write_margins(contacts, np.ones(n, bool), ends, order, rows[:n], rows, bounds)
    radii, is_open = np.full(n, float(radius)), order[bounds <= LEAST_MARGIN]
    np.minimum.at(radii, moved[is_open], slips[is_open])
    return radii


class MarginWeights:
    """Weights of the strategies `margin` and `independence`: `WriteWeights`.

    Args:
        surface: The object's surface.
        friction: Coulomb's coefficient.
        slips: Whether the weights are `slip_radii`, and not the margin's bounds.
    """

    def __init__(self, surface: ObjectSurface, friction: float, *, slips: bool) -> None:
        self._surface, self._friction, self._slips = surface, friction, slips
        self._arm, q = surface.longest_lever_arm, surface.p_OQ - surface.p_OCoM
        self._P_Q = self._rows(q, np.array(surface.nhat_OQ))

    def _rows(self, r: FloatArray, nhat: FloatArray) -> FloatArray:
        rows: FloatArray = contact_rows(r, nhat, self._friction, self._arm).reshape(-1, 7, 3, 1)
        return rows

    def __call__(self, selection: SelectionInput, members: Members, b: FloatArray) -> None:
        """See `WriteWeights`."""
        r = selection.p_OC - self._surface.p_OCoM
        _, nhat = selection.surface.project(selection.p_OC)
        P_C = self._rows(r, nhat)
        contacts, active, _, ends, candidates, _, _ = members
        common, N = (P_C, self._P_Q), len(self._P_Q)
        if not self._slips:
            write_margins(contacts, active, ends, candidates, *common, b)
            return
        bounds, everywhere = np.empty(N), (np.array([0, N]), np.arange(N))
        for k, i in enumerate(contacts):
            write_margins(i[None], active, *everywhere, *common, bounds)
            own = slice(ends[k], ends[k + 1])
            b[own] = slip_radii(self._surface, bounds > LEAST_MARGIN, candidates[own])
