"""Many tests seen as one family."""

from collections.abc import Sequence


def holm(p_values: Sequence[float]) -> list[float]:
    """Returns p corrected by Holm's step-down (Scandinavian Journal of Statistics 6, 1979).

    The smallest is multiplied by how many there are, the next by one less, and so on; none gets
    less than a smaller one does, and none more than 1. If differences are said to be shown where
    the corrected p is below some bound, then the probability that any of them is there by chance
    is below that bound, however the tests depend on each other.

    Args:
        p_values: Of all tests of the family.
    """
    corrected = [1.0] * len(p_values)
    largest = 0.0
    for done, index in enumerate(sorted(range(len(p_values)), key=p_values.__getitem__)):
        largest = max(largest, min(1.0, (len(p_values) - done) * p_values[index]))
        corrected[index] = largest
    return corrected
