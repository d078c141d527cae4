"""Goals of contacts: weighted centroids of safe regions, projected onto the regions' patches."""

from collections.abc import Mapping

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.fast.projection import CompiledSurface
from drake_pregrasp.fast.weights import KINDS, weighted_goals
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.force_closure import FRICTION, balance_blocks


class CompiledGoals:
    """Goals of contacts on one surface: a `GoalFunction`.

    Args:
        surface: The object's surface.
        weights: Share of each strategy in the weights, by name.
        reading: Reading of the grasp matrix; this and the next three are as for `make_strategy`.
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
        stretch: bool = True,
        power: float = 1.0,
        friction: float = FRICTION,
        best_point: bool = False,
    ) -> None:
        self._surface = surface = CompiledSurface.of(surface)
        shares = {name: share for name, share in weights.items() if share > 0}
        readings = {"position": "hand", "margin": "hand"}
        kinds = [KINDS.index((name, readings.get(name, reading))) for name in shares]
        strategies = np.array(kinds), np.array(list(shares.values()), dtype=float)
        self._settings = (*strategies, stretch, float(power), best_point)
        self._friction, self._p_OCoM = float(friction), surface.p_OCoM
        self._q = np.array(surface.p_OQ - surface.p_OCoM, dtype=float, order="C")
        self._areas = np.array(surface.areas, dtype=float)
        self._best_point, self._P_Q = best_point, None
        if "margin" in shares:
            import drake_pregrasp.fast.margins  # noqa: F401  It is compiled now, not in a tick.

            self._arm = surface.longest_lever_arm
            P_Q = balance_blocks(self._q, surface.nhat_OQ, "hard_finger", self._arm)
            self._P_Q = np.ascontiguousarray(P_Q.reshape(21, -1).T)

    def __call__(self, selection: SelectionInput, contacts: IntArray) -> FloatArray:
        """Returns the goals, shape (k, 3), in O, in metres, as `region_goals` does.

        Args:
            selection: Surface, contacts, regions and estimate of this tick.
            contacts: Indices of k contacts whose regions are not empty, shape (k,).
        """
        contacts = np.array(contacts, dtype=np.int64)
        labels = np.array(selection.regions.labels, dtype=np.int64)
        r = np.array(selection.p_OC - self._p_OCoM, dtype=float, order="C")
        active, margins = np.array(selection.active, dtype=bool), np.empty(len(labels))
        if self._P_Q is not None:
            from drake_pregrasp.fast.margins import hand_margins  # Compiled only if it is needed.

            nhat = selection.project(selection.p_OC)[1]
            P_C = balance_blocks(r, nhat, "hard_finger", self._arm)
            P_C = np.ascontiguousarray(P_C.transpose(2, 0, 1))[..., None]
            margins = hand_margins(contacts, labels, active, P_C, self._P_Q, self._friction)
        goals: FloatArray = weighted_goals(
            self._settings,
            contacts,
            labels,
            active,
            r,
            np.array(selection.covariance_O, dtype=float, order="C"),
            self._q,
            self._areas,
            margins,
        )
        goals += self._p_OCoM
        if self._best_point:
            return goals
        return self._surface.project_into_regions(goals, contacts, labels)[0]
