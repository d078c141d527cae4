"""Tables II and III, published and ours, from the logs of runs."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drake_pregrasp.simulation.phases import remaining_static_quality
from drake_pregrasp.simulation.summary import MEASURES
from drake_pregrasp.studies.case_runs import CaseLog
from drake_pregrasp.studies.published import TABLE_2, TABLE_3, Published, remarks

Row = dict[str, Any]


def make_tables(logs: Mapping[str, Sequence[CaseLog]]) -> dict[str, dict[str, Row]]:
    """Returns `table2` and `table3`, a row for each case that was run.

    As in the paper, a run's value is its maximum over its last phase. `ours` is the median of
    the runs with different seeds, `ours_min` and `ours_max` are the ends of their range.
    `static_ours` is about the contacts that are held: the mean over that phase, and for f, where
    the two sets are compared after the damage, the measures of what is left of them.

    Args:
        logs: For each case, its runs with different seeds.
    """
    return {
        name: {case: _row(case, table[case], logs[case]) for case in table if case in logs}
        for name, table in (("table2", TABLE_2), ("table3", TABLE_3))
    }


def best_values(log: CaseLog) -> list[float]:
    """Returns the maxima of the three measures over the last phase."""
    return [float(np.max(log.columns[name][log.last_phase])) for name in MEASURES]


def settled_values(log: CaseLog) -> list[float]:
    """Returns the means of the three measures once the contacts have settled."""
    return [float(np.mean(log.columns[name][log.settled])) for name in MEASURES]


def static_values(log: CaseLog) -> list[float]:
    """Returns the three measures of the contacts that are held."""
    if log.scenario.damage:
        quality = remaining_static_quality(log.scenario, log.scenario.make_surface())
        return [getattr(quality, name) for name in MEASURES]
    return [float(np.mean(log.columns[name][log.static])) for name in MEASURES]


def _row(case: str, published: Published, logs: Sequence[CaseLog]) -> Row:
    best = np.array([best_values(log) for log in logs])
    settled = np.array([settled_values(log) for log in logs])
    static = np.array([static_values(log) for log in logs])
    return {
        "published": list(published.dynamic),
        "ours": np.median(best, axis=0).tolist(),
        "ours_min": np.min(best, axis=0).tolist(),
        "ours_max": np.max(best, axis=0).tolist(),
        "ours_settled": np.median(settled, axis=0).tolist(),
        "static_published": list(published.static),
        "static_ours": np.median(static, axis=0).tolist(),
        "seeds": [log.seed for log in logs],
        "remarks": remarks(case),
    }
