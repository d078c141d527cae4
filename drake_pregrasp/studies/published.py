"""What the paper prints: Tables II and III, as (Q_MSV, Q_GII, Q_VEW)."""

from typing import NamedTuple


class Published(NamedTuple):
    """One row of a table; None where nothing is printed."""

    static: tuple[float | None, float | None, float | None]
    dynamic: tuple[float | None, float | None, float | None]


SCENARIOS = {
    "a": "a_base",
    "b": "b_slower",
    "c": "c_faster",
    "d": "d_smaller",
    "e": "e_bigger",
    "f": "f_damage",
    "g": "g_poor_start",
    "h": "h_msv",
    "i": "i_gii",
    "j": "j_vew",
}
"""The cases of Table I and III, by the names of their scenarios."""

_STATIC = (2.2089, 0.9749, 125.4176)

TABLE_2 = {
    "a": Published(_STATIC, (2.2307, 0.9941, 125.4403)),
    "b": Published(_STATIC, (2.2152, 0.9804, 125.4160)),
    "c": Published(_STATIC, (2.2357, 0.9981, 125.4970)),
    "d": Published((2.2161, 0.9818, 125.2092), (2.2356, 0.9989, 125.2405)),
    "e": Published((2.1817, 0.9489, 126.2972), (2.1846, 0.9514, 126.2973)),
    "f": Published((1.6913, 0.9494, 26.8783), (1.7129, 0.9770, 27.0855)),
    "g": Published((1.9508, 0.9512, None), (2.2159, 0.9812, 125.3789)),
}
"""Table II; f is after the damage, and the static set of g is its poor start."""

TABLE_3 = {
    "a": TABLE_2["a"],
    "h": Published(_STATIC, (2.2359, 0.9974, 125.7573)),
    "i": Published(_STATIC, (2.2340, 0.9965, 125.8007)),
    "j": Published(_STATIC, (2.2260, 0.9890, 125.7573)),
}
"""Table III."""

REMARKS = {
    "f": "The published static Q_VEW of three contacts, 26.8783, is below its bound 3³ = 27:"
    " no contacts have it.",
    "h": "Q_VEW 125.7573 is printed for h and for j: possibly a slip.",
}
"""Entries of the tables that can't be, or are doubtful."""
