"""How much noise a sensor has shown, by the innovations of its measurements.

Both are running means; an innovation νᵀ S⁻¹ ν over its degrees of freedom is 1 on average if the
filter's assumptions hold.
"""

from drake_pregrasp.planning.arrays import FloatArray

_MEMORY = 0.05  # Share of the newest innovation in the means.
_LARGEST = 9.0  # What a single one can count for: it may be an outlier.


def noisiness_after(before: float, innovation_squared: FloatArray) -> float:
    """Returns the mean of innovations that count for 1 at most: near 0 for a sensor without noise.

    Args:
        before: The mean so far.
        innovation_squared: Of position and orientation, shape (2,), each of 3 degrees of freedom.
    """
    return _mean(before, innovation_squared, 1.0)


def excess_after(before: float, innovation_squared: FloatArray) -> float:
    """Returns the mean of innovations: above 1 for a sensor that is noisier than assumed.

    Args:
        before: The mean so far.
        innovation_squared: As above, by the assumed noise.
    """
    return _mean(before, innovation_squared, _LARGEST)


def _mean(before: float, innovation_squared: FloatArray, largest: float) -> float:
    newest = float(innovation_squared.sum()) / (3 * len(innovation_squared))
    return (1 - _MEMORY) * before + _MEMORY * min(newest, largest)
