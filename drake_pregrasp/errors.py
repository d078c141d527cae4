"""Errors that this package raises on purpose; any other exception is a defect."""

import contextlib
import difflib
import traceback
from collections.abc import Iterable, Iterator, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Self

LONGEST_MESSAGE = 4000
"""Most characters of an error message about a scenario."""

LONGEST_KEY = 200
"""Most characters of the key in such a message."""

_LEFT_OUT = " ... "


class PregraspError(Exception):
    """Base of all errors raised on purpose by `drake_pregrasp`."""


class InvalidArgumentError(PregraspError, ValueError):
    """An argument of a function, a class or a port is invalid."""


class ProblemsError(InvalidArgumentError):
    """Several arguments are invalid.

    Args:
        problems: The problem of each of them, in one line.

    Attributes:
        problems: The same.
    """

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("; ".join(problems))
        self.problems = list(problems)


class ProblemCollector:
    """Collects the problems of independent parts, and raises them all at the end of its block."""

    def __init__(self) -> None:
        self._problems: list[str] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        if kind is None and self._problems:
            raise ProblemsError(self._problems)

    @contextlib.contextmanager
    def part(self) -> Iterator[None]:
        """Keeps an `InvalidArgumentError` of a part for the end."""
        try:
            yield
        except InvalidArgumentError as error:
            self._problems += problems_of(error)


def problems_of(error: PregraspError) -> list[str]:
    """Returns the problems that an error tells of, one or several."""
    return error.problems if isinstance(error, ProblemsError) else [str(error)]


class MissingPackageError(InvalidArgumentError):
    """A Python package of an extra of this package is not installed."""


class OutOfReachError(InvalidArgumentError):
    """An arm cannot hold its palm at a pose.

    Args:
        problem: Description of the problem.
        miss: Least distance from the pose, in metres.
    """

    def __init__(self, problem: str, miss: float) -> None:
        super().__init__(problem)
        self.miss = miss


class NoSurfaceError(InvalidArgumentError):
    """No part of an object's surface is allowed for contacts."""


class Lack(StrEnum):
    """Property that a grasp needs and that is missing.

    Attributes:
        ARM: The palm cannot be held where fingers could grasp.
        REACH: Too few fingers reach the allowed surface.
        OPENING: Fingers reach the object, but not two opposite sides of it at once.
        ROOM: Fingertips in reach have no room beside each other, obstacles and the object.
        FRICTION: Contacts have no force closure, or do not hold the weight.
        TORQUE: The torques of the fingers' joints cannot lift the weight.
    """

    ARM = "arm reach"
    REACH = "reach"
    OPENING = "opening"
    ROOM = "room"
    FRICTION = "friction"
    TORQUE = "torque"


class NoGraspError(InvalidArgumentError):
    """A hand has no start contacts on an object.

    Args:
        lack: What is missing.
        detail: What there is instead.
        miss: Least distance of the palm from where it should be, in metres, if that is missing.
    """

    def __init__(self, lack: Lack, detail: str, miss: float = 0.0) -> None:
        super().__init__(f"no grasp for lack of {lack}: {detail}")
        self.lack, self.miss = lack, miss


class ScenarioError(PregraspError):
    """A scenario is invalid.

    The message is one line of printable characters, for any content of a file.

    Args:
        source: File that holds the scenario, or the name of a text.
        key: Dotted path of the invalid key, for example `planner.period`.
        problem: Invalid value and its requirements, in one line.
    """

    def __init__(self, source: str, key: str, problem: str) -> None:
        self.source = printable(source)
        self.key = printable(key, LONGEST_KEY)
        self.problem = printable(problem)
        super().__init__(": ".join(filter(None, (self.source, self.key, self.problem))))

    def __reduce__(self) -> tuple[type["ScenarioError"], tuple[str, str, str]]:
        """Supports pickling: by default, an exception is recreated from its message alone."""
        return type(self), (self.source, self.key, self.problem)


class OutputError(PregraspError):
    """A run folder cannot be written, or its files cannot be read back."""


class ContactError(PregraspError):
    """Verification found a contact goal off the object's allowed surface, which is a defect."""


def printable(text: str, longest: int = LONGEST_MESSAGE) -> str:
    """Returns a text as one line of printable characters.

    Characters that move a cursor, break a line or change the direction of writing are escaped.

    Args:
        text: Text of unknown origin.
        longest: Most characters to keep; the middle of a longer text is left out.
    """
    if len(text) > longest:
        half = (longest - len(_LEFT_OUT)) // 2
        text = text[:half] + _LEFT_OUT + text[-half:]
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def first_line(error: BaseException) -> str:
    """Returns the first line of an error's message, or the name of its type if it is empty."""
    lines = (line.strip() for line in str(error).splitlines())
    return next(filter(None, lines), type(error).__name__)


def nearest(name: str, names: Iterable[str], label: str = "there are") -> str:
    """Returns the second half of an error message about an unknown name.

    Args:
        name: Unknown name.
        names: Valid names.
        label: Words before the list of all names, which is used if none resembles `name`.
    """
    names = list(names)
    if close := difflib.get_close_matches(name, names, n=1):
        return f"did you mean {close[0]}?"
    return f"{label}: {', '.join(names)}"


def one_line(error: BaseException) -> str:
    """Returns an error in one line: its message, and the type and place of a defect."""
    if isinstance(error, PregraspError) and (message := " ".join(str(error).split())):
        return message
    place = ""
    if frames := traceback.extract_tb(error.__traceback__):
        place = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})"
    return " ".join(f"{type(error).__name__}: {error}".split()) + place


Problems = Iterator[tuple[str, str]]
"""Pairs of a key and the problem of its value. Later pairs may follow from the first one."""


def raise_first(problems: Problems) -> None:
    """Raises a `ScenarioError` without a source for the first of some problems, if any."""
    for key, problem in problems:
        raise ScenarioError("", key, problem)


@contextlib.contextmanager
def errors_at(key: str, prefix: str = "") -> Iterator[None]:
    """Turns an error in the `with` block into the problem of a key."""
    try:
        yield
    except PregraspError as error:
        raise ScenarioError("", key, f"{prefix}{error}") from error
