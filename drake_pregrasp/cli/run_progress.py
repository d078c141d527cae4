"""What a command that simulates shows meanwhile, and how it is stopped."""

import contextlib
import signal
import time
from collections.abc import Callable, Iterator

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.systems.grasp_quality_monitor import GraspQualityView
from drake_pregrasp.systems.tick_logger import TickRecord


@contextlib.contextmanager
def stop_on_signals() -> Iterator[Callable[[], bool]]:
    """Turns the first SIGINT or SIGTERM into a request to stop; a second one ends the process."""
    requested = False

    def request(number: int, frame: object) -> None:
        nonlocal requested
        requested = True
        signal.signal(number, signal.SIG_DFL)

    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, request) for number in numbers]
    try:
        yield lambda: requested
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


@contextlib.contextmanager
def run_bar(scenario: Scenario) -> Iterator[Callable[[TickRecord], None] | None]:
    """Shows a bar on a terminal, and nothing when the output goes elsewhere."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield None
        return
    columns = (
        TextColumn("{task.completed:5.1f} s of {task.total:g} s"),
        BarColumn(),
        TextColumn("{task.fields[factor]:5.1f} x real time   Q_GII {task.fields[q_gii]:.4f}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as bar:
        task = bar.add_task("", total=scenario.simulation_duration, factor=0.0, q_gii=0.0)
        start = time.perf_counter()

        def on_tick(record: TickRecord) -> None:
            bar.update(
                task,
                completed=record.time,
                factor=record.time / (time.perf_counter() - start),
                q_gii=GraspQualityView(record.grasp_quality).q_gii,
            )

        yield on_tick
        bar.update(task, completed=scenario.simulation_duration)
