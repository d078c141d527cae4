"""Outcomes as lines of a CSV file, and back."""

import csv
import dataclasses
import io
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from drake_pregrasp.errors import OutputError
from drake_pregrasp.studies.static_versus_dynamic.outcome import Outcome
from drake_pregrasp.studies.whole_files import whole_lines

_FIELDS = {field.name: field.type for field in dataclasses.fields(Outcome)}
_TRUTH = {"yes": True, "no": False}
_READERS: dict[Any, Callable[[str], Any]] = {
    str: str,
    int: int,
    float: float,
    bool: _TRUTH.__getitem__,
}
# What numpy computes is no number of Python's own, and its `repr` is another one.
_WRITERS: dict[Any, Callable[[Any], str]] = {
    str: lambda value: " ".join(value.split()),  # A row is a line.
    int: lambda value: str(int(value)),
    float: lambda value: repr(float(value)),
    bool: lambda value: "yes" if value else "no",
}

HEADER = ",".join(_FIELDS) + "\n"
"""The first line."""


def to_lines(outcomes: Iterable[Outcome]) -> str:
    """Returns a line for each; floats with all their digits."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for outcome in outcomes:
        writer.writerow(_WRITERS[kind](getattr(outcome, name)) for name, kind in _FIELDS.items())
    return text.getvalue()


def from_text(text: str, path: Path) -> list[Outcome]:
    """Returns the outcomes of a file.

    What comes after the last end of a line is of a run that was killed while it wrote, and is
    left out.

    Args:
        text: All of the file.
        path: Its name, for errors.

    Raises:
        OutputError: If the header or a line isn't of this kind.
    """
    header, *lines = whole_lines(text).splitlines(keepends=True) or [HEADER]
    if header != HEADER:
        raise OutputError(f"{path}: its columns are not those of a study's outcomes")
    return [_outcome(line, path, number) for number, line in enumerate(lines, start=2)]


def _outcome(line: str, path: Path, number: int) -> Outcome:
    try:
        (cells,) = csv.reader([line], strict=True)
        return Outcome(
            **{
                name: _READERS[kind](cell)
                for (name, kind), cell in zip(_FIELDS.items(), cells, strict=True)
            }
        )
    except (ValueError, KeyError, csv.Error) as error:
        raise OutputError(f"{path}: line {number} is no outcome: {line.strip()!r}") from error
