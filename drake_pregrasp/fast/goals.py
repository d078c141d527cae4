"""Goals of contacts: weighted centroids of safe regions, projected onto the regions' patches."""

from collections.abc import Mapping
from functools import partial

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import MEASURES, singular_values
from drake_pregrasp.fast.predicates import numbers_of, write_finger_measures
from drake_pregrasp.fast.projection import CompiledSurface
from drake_pregrasp.fast.weights import (
    Members,
    WriteWeights,
    centroids,
    members_of,
    write_position_weights,
)
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.force_closure import FRICTION
from drake_pregrasp.quality.grasp_quality import characteristic_length
from drake_pregrasp.regions.constraints import RADIUS
from drake_pregrasp.regions.finger_measures import FINGER_MEASURES
from drake_pregrasp.regions.safe_regions import SafeRegions


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
        reading: str = "hand",
        contact_model: str = "complete",
        length: float = 0.0,
        stretch: bool = True,
        power: float = 1.0,
        friction: float = FRICTION,
        best_point: bool = False,
    ) -> None:
        self._surface = surface = CompiledSurface.of(surface)
        shares = {name: share for name, share in weights.items() if share > 0}
        self._unit = characteristic_length(length, contact_model, surface.longest_lever_arm)
        p_CoMQ = np.array(surface.p_OQ - surface.p_OCoM, dtype=float, order="C")
        self._q, self._areas = p_CoMQ / self._unit, np.array(surface.areas, dtype=float)
        model = {"reading": reading, "contact_model": contact_model, "friction": float(friction)}
        self._strategies = [self._strategy(name, **model) for name in shares]
        is_measure = np.array([name != "position" for name in shares])
        powers = np.where(is_measure, float(power), 1.0)
        self._settings = (
            np.array(list(shares.values()), dtype=float),
            is_measure & stretch,
            powers,
            best_point,
        )
        self._best_point = best_point

    def _strategy(
        self, name: str, *, reading: str, contact_model: str, friction: float
    ) -> WriteWeights:
        """Returns the weights of a strategy; only what it needs is compiled."""
        surface = self._surface
        if name == "position":
            return self._write_position_weights
        if name in FINGER_MEASURES:
            places = np.array(surface.p_OQ, order="C"), np.array(surface.nhat_OQ, order="C")
            return partial(_write_finger_measures, FINGER_MEASURES.index(name), places)
        if name not in MEASURES:
            from drake_pregrasp.fast.margins import MarginWeights

            return MarginWeights(surface, friction, slips=name == "independence")
        if reading == "contact":  # The other contacts do not count: it is the same in all ticks.
            regions = SafeRegions.unlimited(np.zeros(len(surface.p_OQ), dtype=np.int64), 1)
            alone = SelectionInput(surface, surface.p_OQ[:1], regions, np.eye(3))
            model = {"reading": reading, "contact_model": contact_model, "length": self._unit}
            b = MEASURES[name](singular_values(alone, 0, **model))
            return lambda _, members, out: np.take(b, members.candidates, out=out)
        if contact_model != "complete":
            from drake_pregrasp.fast.spectra import MeasureWeights

            return MeasureWeights(surface, name, contact_model, self._unit)
        from drake_pregrasp.fast.closed_forms import CompleteMeasure

        return CompleteMeasure(name)

    def _write_position_weights(
        self, selection: SelectionInput, members: Members, b: FloatArray
    ) -> None:
        covariance = np.array(selection.covariance_O, dtype=float, order="C")
        write_position_weights(covariance, self._unit, members.ends, members.q, b)

    def __call__(self, selection: SelectionInput, contacts: IntArray) -> FloatArray:
        """Returns the goals, shape (k, 3), in O, in metres, as `region_goals` does.

        Args:
            selection: Surface, contacts, regions and estimate of this tick.
            contacts: Indices of k contacts whose regions are not empty, shape (k,).
        """
        contacts = np.array(contacts, dtype=np.int64)
        labels = np.array(selection.regions.labels, dtype=np.int64)
        active = np.array(selection.active, dtype=bool)
        r = np.array(selection.p_OC - self._surface.p_OCoM, dtype=float, order="C") / self._unit
        places = np.empty(len(active) + 1, dtype=np.int64)
        own = members_of(contacts, places, labels, self._q, self._areas)
        members = Members(contacts, active, r, *own)
        b = np.empty((1 + len(self._strategies), len(members.areas)))
        for write, row in zip(self._strategies, b, strict=False):
            write(selection, members, row)
        goals: FloatArray = centroids(
            *self._settings, members.ends, members.q, members.areas, b[:-1], b[-1]
        )
        goals = goals * self._unit + self._surface.p_OCoM
        if self._best_point:
            return goals
        return self._surface.project_into_regions(goals, contacts, labels)[0]


def _write_finger_measures(
    measure: int,
    places: tuple[FloatArray, FloatArray],
    selection: SelectionInput,
    members: Members,
    b: FloatArray,
) -> None:
    predicates = selection.regions.predicates
    hand, radii = numbers_of(predicates.known_finger_measures), predicates.contacts[:, RADIUS]
    own = members.contacts, members.ends, members.candidates
    write_finger_measures(hand, measure, np.array(radii), *own, *places, b)
