"""The errors this package raises on purpose; everything else is a defect."""


class PregraspError(Exception):
    """Base of all errors raised on purpose by `drake_pregrasp`."""


class InvalidArgumentError(PregraspError, ValueError):
    """An argument of a function, a class or a port is unusable."""


class NoGroundError(InvalidArgumentError):
    """No ground of an object is left for contacts."""


class ScenarioError(PregraspError):
    """A scenario can't be used.

    Args:
        source: The file, or the name of the text, that holds the scenario.
        key: Dotted path of the key at fault, for example `planner.period`.
        problem: What is there and what would be right, in one line.
    """

    def __init__(self, source: str, key: str, problem: str) -> None:
        self.source = source
        self.key = key
        self.problem = problem
        super().__init__(": ".join(part for part in (source, key, problem) if part))


class OutputError(PregraspError):
    """A run folder can't be written, or what was written there can't be read back."""


class ContactError(PregraspError):
    """A contact goal is not on the object's allowed surface: a defect, found by verification."""


def first_line(error: BaseException) -> str:
    """Returns the first line of what an error says, or its kind if it says nothing."""
    lines = (line.strip() for line in str(error).splitlines())
    return next(filter(None, lines), type(error).__name__)
