"""Goals of contacts: weighted centroids of safe regions, projected onto the regions' patches."""

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import MEASURES
from drake_pregrasp.fast.predicates import numbers_of, weights_by_measure
from drake_pregrasp.fast.projection import CompiledSurface
from drake_pregrasp.fast.weights import KINDS, weighted_goals
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.force_closure import FRICTION
from drake_pregrasp.quality.grasp_quality import characteristic_length
from drake_pregrasp.regions.constraints import RADIUS
from drake_pregrasp.regions.finger_measures import FINGER_MEASURES

GivenWeights = Callable[[SelectionInput, IntArray, IntArray, BoolArray], FloatArray]
"""Maps a selection's input, the contacts that move, labels and active contacts, in the types of the
compiled functions, to the weights of a strategy at the candidates, shape (N,)."""


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
        self._given: list[GivenWeights] = []
        kinds = []
        for name in shares:
            given: GivenWeights
            if name in FINGER_MEASURES:
                places = np.array(surface.p_OQ, order="C"), np.array(surface.nhat_OQ, order="C")
                given = partial(_finger_measures, FINGER_MEASURES.index(name), places)
            elif name in MEASURES and contact_model != "complete":  # Compiled only if needed.
                from drake_pregrasp.fast.spectra import MeasureWeights

                given = MeasureWeights(surface, name, reading, contact_model, self._unit)
            elif name in ("margin", "independence"):
                from drake_pregrasp.fast.margins import MarginWeights

                given = MarginWeights(surface, float(friction), slips=name == "independence")
            else:
                kinds.append(KINDS.index((name, "hand" if name == "position" else reading)))
                continue
            kinds.append(len(KINDS) + len(self._given))
            self._given.append(given)
        strategies = np.array(kinds), np.array(list(shares.values()), dtype=float)
        self._settings = (*strategies, stretch, float(power), best_point)
        self._q = np.array(surface.p_OQ - surface.p_OCoM, dtype=float, order="C")
        self._areas = np.array(surface.areas, dtype=float)
        self._best_point = best_point

    def __call__(self, selection: SelectionInput, contacts: IntArray) -> FloatArray:
        """Returns the goals, shape (k, 3), in O, in metres, as `region_goals` does.

        Args:
            selection: Surface, contacts, regions and estimate of this tick.
            contacts: Indices of k contacts whose regions are not empty, shape (k,).
        """
        contacts = np.array(contacts, dtype=np.int64)
        labels = np.array(selection.regions.labels, dtype=np.int64)
        active = np.array(selection.active, dtype=bool)
        given = np.empty((len(self._given), len(labels)))
        for row, weights in enumerate(self._given):
            given[row] = weights(selection, contacts, labels, active)
        r = selection.p_OC - self._surface.p_OCoM
        goals: FloatArray = weighted_goals(
            self._settings,
            contacts,
            labels,
            active,
            np.array(r, dtype=float, order="C") / self._unit,
            np.array(selection.covariance_O, dtype=float, order="C") / (self._unit * self._unit),
            self._q,
            self._unit,
            self._areas,
            given,
        )
        goals += self._surface.p_OCoM
        if self._best_point:
            return goals
        return self._surface.project_into_regions(goals, contacts, labels)[0]


def _finger_measures(
    measure: int,
    places: tuple[FloatArray, FloatArray],
    selection: SelectionInput,
    contacts: IntArray,
    labels: IntArray,
    active: BoolArray,
) -> FloatArray:
    predicates = selection.regions.predicates
    hand, radii = numbers_of(predicates.known_finger_measures), predicates.contacts[:, RADIUS]
    labels = np.where(np.isin(labels, contacts), labels, -1)  # Others do not move now.
    weights: FloatArray = weights_by_measure(hand, measure, np.array(radii), labels, *places)
    return weights
