"""Goals of contacts: weighted centroids of safe regions, projected onto the regions' patches.

Candidates of a region are copied next to each other, one region after another. Each strategy writes
its weights at these places; `centroids` stretches, blends and applies them.
"""

from collections.abc import Mapping
from functools import partial

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.contacts.centroids import TIE
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import FLAT, HAND_MEASURES, MEASURES, singular_values
from drake_pregrasp.fast.compiling import compiled
from drake_pregrasp.fast.members import Members, WriteWeights, members_of
from drake_pregrasp.fast.predicates import numbers_of, write_finger_measures
from drake_pregrasp.fast.projection import CompiledSurface
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.grasp_quality import characteristic_length
from drake_pregrasp.regions.constraints import RADIUS
from drake_pregrasp.regions.finger_measures import FINGER_MEASURES
from drake_pregrasp.regions.safe_regions import SafeRegions


@compiled("void(f8[:,::1], f8, i8[::1], f8[:,::1], f8[::1])")
def write_position(covariance, unit, ends, q, b):  # type: ignore[no-untyped-def]
    """Writes the logarithms of the weights: -qᵀ P q / 2 less its largest value in the region.

    P is the precision, the inverse of the covariance.

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
            b[k] -= most


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


class CompiledGoals:
    """Goals of contacts on one surface: a `GoalFunction`.

    Args:
        surface: The object's surface.
        weights: Share of each strategy in the weights, by name.
        reading: Reading of the grasp matrix; the arguments but the last are as for `make_strategy`.
        contact_model: Contact model of the grasp matrix.
        length: Unit of the lever arms, in metres; 0 for the default.
        stretch: Whether weights are stretched over each region.
        power: Exponent of the weights.
        friction: Coulomb's coefficient, for `margin` and `independence`.
        best_point: Whether goals are the candidates with the largest weights.
    """

    def __init__(
        self,
        surface: ObjectSurface,
        weights: Mapping[str, float],
        *,
        reading: str,
        contact_model: str,
        length: float,
        stretch: bool,
        power: float,
        friction: float,
        best_point: bool,
    ) -> None:
        self._surface = surface = CompiledSurface.of(surface)
        shares = {name: share for name, share in weights.items() if share > 0}
        self._unit = characteristic_length(length, contact_model, surface.longest_lever_arm)
        p_CoMQ = surface.p_OQ - surface.p_OCoM
        self._values: FloatArray = np.array([*p_CoMQ.T / self._unit, surface.areas], dtype=float)
        model = reading, contact_model, float(friction)
        self._strategies = [self._strategy(name, *model) for name in shares]
        is_measure = np.array([name != "position" for name in shares])
        stretches, powers = is_measure & stretch, np.where(is_measure, float(power), 1.0)
        parts = np.array(list(shares.values()), dtype=float)
        self._settings = parts, stretches, powers, best_point

    def _strategy(self, name: str, reading: str, model: str, friction: float) -> WriteWeights:
        """Returns the weights of a strategy; only what it needs is compiled."""
        surface = self._surface
        if name == "position":
            return self._write_position
        if name in FINGER_MEASURES:
            places = np.array(surface.p_OQ, order="C"), np.array(surface.nhat_OQ, order="C")
            return partial(_write_finger_measures, FINGER_MEASURES.index(name), places)
        if name in HAND_MEASURES:
            # Imported only here, because what is not needed is not compiled.
            from drake_pregrasp.fast.margins import MarginWeights

            return MarginWeights(surface, friction, slips=name == "independence")
        if reading == "contact":  # The other contacts do not count: it is the same in all ticks.
            regions = SafeRegions.unlimited(np.zeros(len(surface.p_OQ), dtype=np.int64), 1)
            alone = SelectionInput(surface, surface.p_OQ[:1], regions, np.eye(3))
            sigma = singular_values(
                alone, 0, reading=reading, contact_model=model, length=self._unit
            )
            b = MEASURES[name](sigma)
            return lambda _, members, out: np.take(b, members.candidates, out=out)
        if model != "complete":
            from drake_pregrasp.fast.spectra import MeasureWeights

            return MeasureWeights(surface, name, model, self._unit)
        from drake_pregrasp.fast.closed_forms import CompleteMeasure

        return CompleteMeasure(name)

    def _write_position(self, selection: SelectionInput, members: Members, b: FloatArray) -> None:
        covariance = np.array(selection.covariance_O, dtype=float, order="C")
        write_position(covariance, self._unit, members.ends, members.q, b)
        np.exp(b, out=b)  # On some processors in vector instructions, in numba on none.

    def __call__(self, selection: SelectionInput, contacts: IntArray) -> FloatArray:
        """Returns the goals, shape (k, 3), in O, in metres, as `region_goals` does.

        Args:
            selection: Surface, contacts, regions and estimate of this tick.
            contacts: Indices of k contacts whose regions are not empty, shape (k,).
        """
        contacts = np.array(contacts, dtype=np.int64)
        labels = np.ascontiguousarray(selection.regions.labels, dtype=np.int64)
        active = np.array(selection.active, dtype=bool)
        r = np.array(selection.p_OC - self._surface.p_OCoM, dtype=float, order="C") / self._unit
        places = np.full(len(active) + 1, -1, dtype=np.int64)
        places[contacts] = np.arange(len(contacts))
        ends, candidates, values = members_of(len(contacts), places, labels, self._values)
        members = Members(contacts, active, r, ends, candidates, values[:3], values[3])
        b = np.empty((1 + len(self._strategies), len(candidates)))
        for write, row in zip(self._strategies, b, strict=False):
            write(selection, members, row)
        goals: FloatArray = centroids(*self._settings, ends, values[:3], values[3], b[:-1], b[-1])
        goals = goals * self._unit + self._surface.p_OCoM
        if self._settings[-1]:  # They are candidates, up to rounding.
            return goals
        return self._surface.project_into_regions(goals, contacts, labels)[0]


def _write_finger_measures(
    measure: int,
    places: tuple[FloatArray, FloatArray],
    selection: SelectionInput,
    members: Members,
    b: FloatArray,
) -> None:
    predicates = selection.regions.constraints.predicates
    hand, radii = numbers_of(predicates.known_finger_measures), predicates.contacts[:, RADIUS]
    own = members.contacts, members.ends, members.candidates
    write_finger_measures(hand, measure, np.array(radii), *own, *places, b)
