"""Which finger goes to which contact."""

import numpy as np
from scipy.optimize import linear_sum_assignment

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.planning.arrays import FloatArray, IntArray


def assign_fingers(fingertips: FloatArray, contacts: FloatArray) -> IntArray:
    """Returns for each finger the contact that it goes to, so that all together travel least.

    Straight ways of least total length never cross in a plane: uncrossing two would shorten them.

    Args:
        fingertips: Where the fingertips are, shape (n, 3), in metres.
        contacts: Where they are to go, in the same frame, shape (n, 3).

    Raises:
        InvalidArgumentError: If there is not one contact for each fingertip.
    """
    if fingertips.shape != contacts.shape:
        raise InvalidArgumentError(
            f"{len(fingertips)} fingertips can't be assigned to {len(contacts)} contacts"
        )
    travel = np.linalg.norm(fingertips[:, None] - contacts, axis=2)
    _, assigned = linear_sum_assignment(travel)
    order: IntArray = np.array(assigned, dtype=np.int64)
    return order
