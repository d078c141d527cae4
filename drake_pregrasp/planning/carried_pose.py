"""How a hand goes on with an object that it has just taken off a moving table."""

import numpy as np

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.rotation_vectors import rotation_matrix


def stopping_pose(
    R: FloatArray, p: FloatArray, w: FloatArray, v: FloatArray, elapsed: float, stop: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Returns pose and twist of a frame that comes to rest with constant deceleration.

    Args:
        R: Its orientation in W at the start, shape (3, 3).
        p: Its origin in W at the start, shape (3,), in metres.
        w: Its angular velocity in W at the start, in rad/s.
        v: Its velocity in W at the start, in m/s.
        elapsed: Seconds since then, at least 0.
        stop: Seconds in which it comes to rest, above 0.

    Returns:
        R, p, w and v after the elapsed time.
    """
    t = min(elapsed, stop)
    way, share = t - t**2 / (2 * stop), 1 - t / stop
    turned: FloatArray = rotation_matrix(np.asarray(w) * way) @ R
    return turned, p + v * way, w * share, v * share
