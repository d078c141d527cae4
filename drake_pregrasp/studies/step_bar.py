"""The bar that shows how far a command is."""

import contextlib
from collections.abc import Callable, Iterator

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn


@contextlib.contextmanager
def step_bar(what: str = "step") -> Iterator[Callable[[int, int], None]]:
    """Shows steps done and to do on a terminal, and nothing when the output goes elsewhere.

    Args:
        what: What a step is called.
    """
    console = Console(stderr=True)
    columns = (
        TextColumn(f"{what} {{task.completed}} of {{task.total}}"),
        BarColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
