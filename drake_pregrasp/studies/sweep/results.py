"""The rows of a sweep by columns, for its report."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.studies.sweep.grid_axis import Label, label_text
from drake_pregrasp.studies.sweep.plan import SweepPlan
from drake_pregrasp.studies.sweep.rows_file import SweepRow

MOST_GROUPS = 8
"""Random numbers of more values than that are put together by quarters of the runs."""

_QUARTERS = 4


class Group(NamedTuple):
    """Runs that have something in common.

    Attributes:
        label: What it is, in words.
        value: What it is.
        places: Which rows.
    """

    label: str
    value: Label
    places: IntArray


@dataclass(frozen=True)
class Spread:
    """How a measure is spread over runs; nan where none has a number.

    Attributes:
        median: Half of the runs have less.
        low: The least of all.
        high: The most of all.
        first_quartile: A quarter of the runs has less.
        third_quartile: A quarter of the runs has more.
    """

    median: float
    low: float
    high: float
    first_quartile: float
    third_quartile: float


class SweepResults:
    """What a report is computed from.

    Args:
        plan: All runs.
        measures: Names of the numbers in a row.
        rows: Of the runs that there are.

    Attributes:
        axes: Names of what is swept.
        values: Of each measure, shape (rows,).
    """

    def __init__(self, plan: SweepPlan, measures: Sequence[str], rows: Sequence[SweepRow]) -> None:
        self.axes = [axis.name for axis in plan.axes]
        table = np.array([row.values for row in rows]).reshape(len(rows), len(measures))
        self.values: dict[str, FloatArray] = dict(zip(measures, table.T, strict=True))
        said = [dict(zip(plan.columns, plan.run(row.index).labels, strict=True)) for row in rows]
        self._labels = {name: [labels[name] for labels in said] for name in self.axes}
        self._order = {axis.name: axis.labels for axis in plan.grid}

    def is_continuous(self, axis: str) -> bool:
        """Whether an axis has random numbers, and so many that they can't be told apart."""
        labels = self._labels[axis]
        return axis not in self._order and _are_numbers(labels) and len(set(labels)) > MOST_GROUPS

    def is_numeric(self, axis: str) -> bool:
        """Whether all values of an axis are numbers."""
        return _are_numbers(self._labels[axis])

    def numbers(self, axis: str) -> FloatArray:
        """Returns the values of a numeric axis, shape (rows,)."""
        return np.array(self._labels[axis], dtype=float)

    def groups(self, axis: str) -> list[Group]:
        """Returns the runs by the values of an axis, in the order of the study, or of numbers."""
        if self.is_continuous(axis):
            return self._quarters(axis)
        labels = self._labels[axis]
        there = list(dict.fromkeys(labels))
        order = [label for label in self._order.get(axis, there) if label in there]
        if self.is_numeric(axis):
            order = sorted(order, key=float)
        texts = np.array([label_text(label) for label in labels], dtype=object)
        return [
            Group(_short(label), label, np.flatnonzero(texts == label_text(label)))
            for label in order
        ]

    def spread(self, measure: str, places: IntArray) -> Spread:
        """Returns how a measure is spread over some rows."""
        values = self.values[measure][places]
        values = values[np.isfinite(values)]
        if not len(values):
            return Spread(*[math.nan] * 5)
        low, first, median, third, high = np.quantile(values, np.linspace(0, 1, 5)).tolist()
        return Spread(median, low, high, first, third)

    def _quarters(self, axis: str) -> list[Group]:
        numbers = self.numbers(axis)
        parts = np.array_split(np.argsort(numbers, kind="stable"), _QUARTERS)
        return [
            Group(
                f"{numbers[part[0]]:.4g} to {numbers[part[-1]]:.4g}",
                float(np.median(numbers[part])),
                part,
            )
            for part in parts
            if len(part)
        ]


def _short(label: Label) -> str:
    return f"{label:.4g}" if isinstance(label, float) else label_text(label)


def _are_numbers(labels: Sequence[Label]) -> bool:
    return all(isinstance(v, int | float) and not isinstance(v, bool) for v in labels)
