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

ACTIVE_CONTACTS = {"f": (3, 3), "g": (4, 5)}
"""How many contacts are measured, in the static and in the dynamic set, where it isn't five."""


def remarks(case: str) -> list[str]:
    """Returns what is to be said of a case's published entries: impossible or doubtful ones.

    G Gᵀ of n contacts has a determinant of at least n⁶, so Q_VEW >= n³ whatever the contacts.
    """
    rows = [table[case] for table in (TABLE_2, TABLE_3) if case in table]
    found = []
    counts = ACTIVE_CONTACTS.get(case, (5, 5))
    for name, n, values in zip(("static", "best"), counts, rows[0], strict=True):
        q_vew = values[2]
        if q_vew is not None and q_vew < n**3:
            found.append(
                f"The published {name} Q_VEW {q_vew} is impossible: {n} contacts have at least"
                f" {n}³ = {n**3}."
            )
    twins = [other for other, row in TABLE_3.items() if row.dynamic[2] == rows[0].dynamic[2]]
    if case in twins and len(twins) > 1:
        found.append(
            f"Q_VEW {rows[0].dynamic[2]} is printed for {' and '.join(twins)}: possibly a slip."
        )
    return found
