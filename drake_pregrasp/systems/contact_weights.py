"""The fingers' weights h_i over time, and the loss of fingers."""

from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.planning.arrays import FloatArray


class ContactWeights(LeafSystem):
    """Emits the weights h_i of Eq. 1, and from stated times on -inf for fingers that are lost.

    .. pydrake_system::

        name: ContactWeights
        output_ports:
        - contact_weights

    Port `contact_weights` emits a vector of n, in m²; -inf says that the finger is lost.

    Args:
        weights: h_i, shape (n,), in m².
        losses: Pairs of a time in seconds and the indices of the contacts that are lost from it on.

    Raises:
        InvalidArgumentError: If a contact isn't there.
    """

    def __init__(
        self, weights: FloatArray, losses: Sequence[tuple[float, Sequence[int]]] = ()
    ) -> None:
        super().__init__()
        self._weights = np.array(weights, dtype=float)
        self._losses = [(time, list(contacts)) for time, contacts in losses]
        for _, contacts in self._losses:
            for contact in contacts:
                if not 0 <= contact < len(self._weights):
                    raise InvalidArgumentError(
                        f"there is no contact {contact}; there are 0 to {len(self._weights) - 1}"
                    )
        self.DeclareVectorOutputPort(
            "contact_weights", len(self._weights), self._calc_weights, {self.time_ticket()}
        )

    def _calc_weights(self, context: Context, output: BasicVector) -> None:
        weights = self._weights.copy()
        for time, contacts in self._losses:
            if context.get_time() >= time - 1e-9:  # A tick's time may be rounded to just before.
                weights[contacts] = -np.inf
        output.SetFromVector(weights)
