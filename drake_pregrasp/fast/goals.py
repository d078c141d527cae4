"""Goals of contacts: weighted centroids of safe regions, projected onto the regions' patches."""

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import MEASURES, finger_measure
from drake_pregrasp.fast.projection import CompiledSurface
from drake_pregrasp.fast.weights import KINDS, weighted_goals
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.force_closure import FRICTION, balance_blocks
from drake_pregrasp.quality.grasp_quality import characteristic_length
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
        friction: Coulomb's coefficient, for the margin.
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
        self._reading, self._contact_model, self._friction = reading, contact_model, float(friction)
        q = surface.p_OQ - surface.p_OCoM
        self._given: list[GivenWeights] = []
        kinds = []
        for name in shares:
            if name == "margin":
                self._arm = surface.longest_lever_arm
                P_Q = balance_blocks(q, surface.nhat_OQ, "hard_finger", self._arm)
                self._P_Q = np.ascontiguousarray(P_Q.reshape(21, -1).T)
                self._given.append(self._margins)
            elif name in FINGER_MEASURES:
                self._given.append(partial(_finger_measures, name))
            elif name in MEASURES and contact_model != "complete":
                from drake_pregrasp.fast.spectra import grams  # Compiled only if it is needed.

                self._grams_Q = grams(q / self._unit, surface.nhat_OQ, contact_model)
                self._given.append(partial(self._measures, list(MEASURES).index(name)))
            else:
                kinds.append(KINDS.index((name, "hand" if name == "position" else reading)))
                continue
            kinds.append(len(KINDS) + len(self._given) - 1)
        strategies = np.array(kinds), np.array(list(shares.values()), dtype=float)
        self._settings = (*strategies, stretch, float(power), best_point)
        self._q = np.array(q, dtype=float, order="C")
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
            np.array(r, dtype=float, order="C"),
            np.array(selection.covariance_O, dtype=float, order="C"),
            self._q,
            self._unit,
            self._areas,
            given,
        )
        goals += self._surface.p_OCoM
        if self._best_point:
            return goals
        return self._surface.project_into_regions(goals, contacts, labels)[0]

    def _margins(
        self, selection: SelectionInput, contacts: IntArray, labels: IntArray, active: BoolArray
    ) -> FloatArray:
        from drake_pregrasp.fast.margins import hand_margins  # Compiled only if it is needed.

        r, nhat = selection.p_OC - selection.surface.p_OCoM, selection.project(selection.p_OC)[1]
        P_C = balance_blocks(r, nhat, "hard_finger", self._arm)
        P_C = np.ascontiguousarray(P_C.transpose(2, 0, 1))[..., None]
        margins: FloatArray = hand_margins(contacts, labels, active, P_C, self._P_Q, self._friction)
        return margins

    def _measures(
        self,
        kind: int,
        selection: SelectionInput,
        contacts: IntArray,
        labels: IntArray,
        active: BoolArray,
    ) -> FloatArray:
        from drake_pregrasp.fast.spectra import grams, measures_of_grams

        r, nhat = selection.p_OC - selection.surface.p_OCoM, selection.project(selection.p_OC)[1]
        grams_C = grams(r / self._unit, nhat, self._contact_model)
        counts = active & (self._reading == "hand")
        measures: FloatArray = measures_of_grams(
            kind, contacts, labels, counts, grams_C, self._grams_Q
        )
        return measures


def _finger_measures(
    name: str, selection: SelectionInput, contacts: IntArray, labels: IntArray, _: BoolArray
) -> FloatArray:
    measures = np.zeros(len(labels))
    for i in contacts.tolist():
        measures[selection.regions.members(i)] = finger_measure(selection, i, name=name)
    return measures
