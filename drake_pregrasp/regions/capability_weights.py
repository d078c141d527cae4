"""Weights h_i of safe regions from the capability of the fingers."""

import numpy as np

from drake_pregrasp.arrays import FloatArray


def capability_weights(capability: FloatArray, length: float) -> FloatArray:
    """Returns weights h_i that divide the surface by the fingers' capability, shape (n,), in m².

        h_i = -L² (s_max - s_i) / (s_max + s_i),  s_max = max s_k

    The boundary of two regions is (|c_k - c_i|² + h_i - h_k) / (2 |c_k - c_i|) away from c_i. So it
    divides the line from the strongest finger to another one, at the distance L, in the proportion
    s_max : s_i of their capability. Equal fingers have equal weights, and a common factor of all
    capabilities changes nothing. As |h_i - h_k| < L², each contact stays in its own region while no
    two contacts are nearer to each other than L. With a larger L, weak fingers may be displaced.

    The capability s_i of a finger may be its largest force over that of a sound finger, the share
    of its energy that is left, (T_max - T) / (T_max - T_rest) for a motor of temperature T, one
    minus its wear, or a product of these.

    Args:
        capability: Capability s_i of each finger, shape (n,), limited to [0, 1]. A finger whose
            capability is zero, negative or NaN is lost: its weight is -inf.
        length: Length L, in metres: usually the smallest distance between two contacts.
    """
    s = np.clip(np.where(capability > 0, capability, 0.0), 0.0, 1.0)
    strongest = max(s.max(initial=0.0), np.finfo(float).tiny)
    h: FloatArray = -(length**2) * (strongest - s) / (strongest + s)
    return np.where(s > 0, h, -np.inf)
