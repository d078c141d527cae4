"""How much noise a sensor has shown, by the innovations of its measurements.

Both are running means, and 1 on average if the filter's assumptions hold.
"""

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.pose_filter import Innovation

_MEMORY = 0.05  # Share of the newest innovation in the means.
_LARGEST = 9.0  # What a single one can count for: it may be an outlier.


def noisiness_after(before: float, new: Innovation, last: FloatArray) -> float:
    """Returns how much noise there is, at most 1: near 0 for a sensor without noise.

    Noise makes an innovation differ from the one before it, by 2 S in the mean of the square; what
    the object does, and the filter doesn't expect, makes innovations that are like each other.

    Args:
        before: The mean so far.
        new: The newest innovation.
        last: The one before it, `nu`, shape (2, 3).
    """
    changes = ((new.nu - last) ** 2).tolist()
    variances = new.S.diagonal(axis1=1, axis2=2).tolist()
    shares = [
        sum(change) / (2 * sum(variance))
        for change, variance in zip(changes, variances, strict=True)
    ]
    return _mean(before, min(1.0, sum(shares) / len(shares)))


def excess_after(before: float, innovation_squared: FloatArray) -> float:
    """Returns how much larger innovations are than assumed, as a variance.

    Args:
        before: The mean so far.
        innovation_squared: νᵀ S⁻¹ ν of position and orientation, by the assumed noise, shape (2,).
    """
    newest = sum(innovation_squared.tolist()) / (3 * len(innovation_squared))
    return _mean(before, min(newest, _LARGEST))


def _mean(before: float, newest: float) -> float:
    return (1 - _MEMORY) * before + _MEMORY * newest
