"""The errors this package raises on purpose; everything else is a defect."""

LONGEST_MESSAGE = 4000
"""Characters of what an error says of a scenario."""

LONGEST_KEY = 200
"""Characters of the key in it."""

_LEFT_OUT = " ... "


class PregraspError(Exception):
    """Base of all errors raised on purpose by `drake_pregrasp`."""


class InvalidArgumentError(PregraspError, ValueError):
    """An argument of a function, a class or a port is unusable."""


class NoGroundError(InvalidArgumentError):
    """No ground of an object is left for contacts."""


class ScenarioError(PregraspError):
    """A scenario can't be used.

    What it says is one line of printable characters, whatever a file holds.

    Args:
        source: The file, or the name of the text, that holds the scenario.
        key: Dotted path of the key at fault, for example `planner.period`.
        problem: What is there and what would be right, in one line.
    """

    def __init__(self, source: str, key: str, problem: str) -> None:
        self.source = printable(source)
        self.key = printable(key, LONGEST_KEY)
        self.problem = printable(problem)
        super().__init__(": ".join(filter(None, (self.source, self.key, self.problem))))

    def __reduce__(self) -> tuple[type["ScenarioError"], tuple[str, str, str]]:
        """Lets it cross to another process, which an error's own way does with one argument."""
        return type(self), (self.source, self.key, self.problem)


class OutputError(PregraspError):
    """A run folder can't be written, or what was written there can't be read back."""


class ContactError(PregraspError):
    """A contact goal is not on the object's allowed surface: a defect, found by verification."""


def printable(text: str, longest: int = LONGEST_MESSAGE) -> str:
    """Returns a text as one line that a terminal only prints.

    Characters that move a cursor, break a line or turn the way of writing become escapes.

    Args:
        text: Of unknown origin.
        longest: How many characters of it are kept; the middle is left out.
    """
    if len(text) > longest:
        half = (longest - len(_LEFT_OUT)) // 2
        text = text[:half] + _LEFT_OUT + text[-half:]
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def first_line(error: BaseException) -> str:
    """Returns the first line of what an error says, or its kind if it says nothing."""
    lines = (line.strip() for line in str(error).splitlines())
    return next(filter(None, lines), type(error).__name__)
