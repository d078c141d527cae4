"""The command `drake-pregrasp run`."""

import argparse
import contextlib
import math
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from drake_pregrasp.errors import InvalidArgumentError, ScenarioError
from drake_pregrasp.grasping.held_criterion import LARGEST_DEG, LARGEST_MM, PARTS
from drake_pregrasp.live.live_page import serve_live_run
from drake_pregrasp.quality.grasp_quality import QUALITY_MEASURES
from drake_pregrasp.simulation.output import INTERRUPTED_STATUS, check_new, handling
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.simulation.run import RunResult, run, write_graphviz
from drake_pregrasp.simulation.scenario_file import load_resolved, only_name
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.systems.grasp_quality_monitor import GraspQualityView
from drake_pregrasp.systems.loggers import TickRecord

OUT = "runs"
"""Default folder of run folders."""

_NOISE = 1e-4  # Share of a measure by which noise may change it.
_DOUBTFUL = 0.5  # Share of tracked ticks below which a run says so.


@contextlib.contextmanager
def stop_on_signals() -> Iterator[Callable[[], bool]]:
    """Turns the first SIGINT or SIGTERM into a request to stop; the second ends the process."""
    requested = False

    def request(number: int, frame: object) -> None:
        nonlocal requested
        requested = True
        signal.signal(number, signal.SIG_DFL)

    with handling(request, signal.SIGINT, signal.SIGTERM):
        yield lambda: requested


@contextlib.contextmanager
def run_bar(resolved: ResolvedScenario) -> Iterator[Callable[[TickRecord], None]]:
    """Prints at the first tick which kernels compute, and shows a progress bar on a terminal."""
    scenario, console = resolved.scenario, Console(stderr=True)
    columns = (
        TextColumn("{task.completed:5.1f} s of {task.total:g} s"),
        BarColumn(),
        TextColumn("{task.fields[factor]:5.1f} x real time   Q_GII {task.fields[q_gii]:.4f}"),
        TimeRemainingColumn(),
    )
    bar = Progress(*columns, console=console, disable=not console.is_terminal)
    task = bar.add_task("", total=scenario.simulation_duration, factor=0.0, q_gii=0.0)
    start = math.nan

    def on_tick(record: TickRecord) -> None:
        nonlocal start
        if math.isnan(start):
            with contextlib.suppress(OSError):  # Printing the results fails, too, and is reported.
                print(f"kernels     {resolved.kernels.name}", flush=True)
            bar.start()
            start = time.perf_counter()
        factor = record.time / (time.perf_counter() - start)
        q_gii = GraspQualityView(record.grasp_quality).q_gii
        bar.update(task, completed=record.time, factor=factor, q_gii=q_gii)

    try:
        yield on_tick
        if scenario.simulation_duration - bar.tasks[task].completed < scenario.planner.period:
            bar.update(task, completed=scenario.simulation_duration)
    finally:
        bar.stop()


def print_result(result: RunResult, *, recorded: bool) -> None:
    """Prints a run's measures, speed and problems, and the place of its files.

    Args:
        result: Result of the run.
        recorded: Whether there is a recording.
    """
    summary = result.summary
    factor, tick_ms = summary["real_time_factor"], summary["tick_time_p50_ms"]
    if result.replaced:
        print("replaced    the earlier run in this folder")
    for line in _measures_in_words(summary):
        print(line)
    print(f"speed       {factor:.1f} x real time, planning tick {tick_ms:.2f} ms (median)")
    if "grasp" in summary:
        print(f"grasp       {grasp_in_words(summary['grasp'])}")
    if late := summary["deadline_overruns"]:
        print(f"late        {late} of {summary['ticks']} ticks took longer than planner.period")
    for contact, reason in summary["inactive_contacts"].items():
        print(f"inactive    contact {contact} has no goal at the end: {reason}")
    if not result.completed:
        log, end = result.folder / "log.csv", summary["simulated_seconds"]
        print(f"interrupted at {end:g} s: the log up to that tick is in {log}")
    if recorded:
        print(f"recording in {result.folder / 'recording.html'}: open it in a browser")
    else:
        print(f"results in {result.folder}")


def _measures_in_words(summary: Mapping[str, Any]) -> Iterator[str]:
    """Yields the measures before and after adapting, and the reasons to doubt them."""
    phases = summary.get("after_damage", summary)
    if phases["max"]["q_msv"] is None:
        phases = summary
    elif phases is not summary:
        yield "damage      fingers are lost: static and best are those of the ones left at the end"
    static, best = phases["static"], phases["max"]
    for key, words in (("left", "left the table"), ("lost", "was lost for good")):
        if (at := summary[f"object_{key}_at"]) is not None:
            yield f"object      {words} at {at:g} s: static and best are from before"
    share = summary["tracking"]["share"]["tracking"]
    if share is not None and share < _DOUBTFUL:
        once = share * summary["ticks"] < 2  # A first measurement counts until it is contradicted.
        words = "was never tracked" if once else f"was tracked at {100 * share:.0f} % of the ticks"
        yield f"tracking    the object {words}: measures are of goals on an estimate in doubt"
    for title, values in (("static", static), ("best after", best)):
        if values["q_msv"] is not None:
            shown = "   ".join(f"{m.upper()} {values[m]:.4f}" for m in QUALITY_MEASURES)
            yield f"{title:12}{shown}"
    for name in QUALITY_MEASURES:
        if None not in (static[name], best[name]) and best[name] < (1 - _NOISE) * static[name]:
            yield f"worse       best {name.upper()} is {static[name] - best[name]:.2g} below static"


def grasp_in_words(grasp: Mapping[str, Any]) -> str:
    """Returns the results of a grasp, from `summary.json`, as a sentence."""
    words = [f"at the end: {grasp['phase']}"]
    x, y, up = grasp.get("palm_from", (0, 0, 1))
    if up < 0.5:
        words.append(f"palm from the side, at {math.degrees(math.atan2(y, x)):.0f}° about z")
    if (met_at := grasp.get("met_at")) is not None:
        words.append(f"met the object at {met_at:.2f} s")
    if grasp.get("cannot_meet") is not None:
        words.append(f"cannot meet the object because {grasp['cannot_meet']}")
    if grasp["gave_up"] is not None:
        words.append(f"gave up because {grasp['gave_up']}")
    if (held := grasp.get("held")) is not None:
        verdict = "the object was held" if held else "the object was not held"
        words.append(" ".join([verdict, *_far_parts(grasp)]))
    for key, text in (
        ("tracking_error_mean_mm", "fingertips {:.3f} mm off their goals (mean until closing)"),
        ("moved_closing_mm", "object up to {:.2f} mm off its place in closing"),
        ("moved_squeeze_mm", "{:.2f} mm in the squeeze"),
        ("lift_height_mm", "lifted {:.1f} mm"),
        ("moved_hold_mm", "{:.2f} mm off its place in the hold"),
        ("slips_after_s", "would slip by 5 mm after {:.0f} s"),
    ):
        if grasp[key] is not None:
            words.append(text.format(grasp[key]))
    if (force := max(grasp.get("link_forces", {"": 0.0}).values())) > 0:
        words.append(f"links pressed with up to {force:.1f} N")
    return ", ".join(words)


def _far_parts(grasp: Mapping[str, Any]) -> Iterator[str]:
    """Yields in words by how much, and in which parts of the grasp, an object was too far off."""
    for part in PARTS:
        mm, angle = (grasp.get(key) or 0.0 for key in (f"moved_{part}_mm", f"turned_{part}_deg"))
        if mm > LARGEST_MM or angle > LARGEST_DEG:
            yield f"({part}: {mm:.1f} mm and {angle:.1f}° off its place)"


def add_command(commands: "argparse._SubParsersAction[Any]") -> None:
    """Adds the command to those of `drake-pregrasp`."""
    parser = commands.add_parser("run", help="simulate a scenario and write its run folder")
    parser.set_defaults(command=_run)
    add_scenario_options(parser)
    add = parser.add_argument
    add_overwrite_option(parser)
    add("--no-recording", action="store_true", help="do not make recording.html")
    add("--mcap", action="store_true", help="also write run.mcap for Foxglove (extra interfaces)")
    add("--graphviz", metavar="FILE", help="write the diagram to this file, without a simulation")
    live = commands.add_parser("live", help="watch and change a run in a browser")
    live.set_defaults(command=_live)
    add_scenario_options(live)
    film = commands.add_parser("film", help="make an animated picture of a scenario")
    film.set_defaults(command=_film)
    add_scenario_options(film)


def add_scenario_options(parser: argparse.ArgumentParser, *, or_run: bool = False) -> None:
    """Adds the options that `load_chosen` reads, and --out.

    Args:
        parser: Parser of the command.
        or_run: Whether the command also takes a run folder in place of a scenario.
    """
    add = parser.add_argument
    what = "name of a shipped scenario, or of an entry of --scenario_file"
    add("scenario", nargs="?", help=f"{what}; or a run folder" if or_run else what)
    add("--scenario_file", metavar="FILE", help="YAML file with scenarios")
    add(
        "--scenario_text",
        metavar="YAML",
        help="overrides single keys, for example '{planner: {period: 0.1}}'",
    )
    add_allow_option(parser)
    add("--simulation_duration", metavar="SECONDS", type=float, help="overrides that key")
    add("--out", default=OUT, metavar="FOLDER", help="folder of run folders (%(default)s)")


def add_allow_option(parser: argparse.ArgumentParser, source: str = "scenario") -> None:
    """Adds --allow.

    Args:
        parser: Parser of the command.
        source: What names the files.
    """
    parser.add_argument(
        "--allow",
        action="append",
        default=[],
        metavar="FOLDER",
        help=f"also allow files of this folder, which the {source} names; repeatable",
    )


def add_overwrite_option(parser: argparse.ArgumentParser) -> None:
    """Adds --overwrite."""
    text = "replace a run of another scenario"
    parser.add_argument("--overwrite", action="store_true", help=text)


def refuse_options(options: argparse.Namespace, where: str, *names: str) -> None:
    """Refuses options that are given, but have no effect.

    Args:
        options: Options of the command.
        where: What they have no effect on or with, for the message.
        names: Names of the options.
    """
    for name in names:
        value = getattr(options, name)
        if not (value is None or value is False or (name == "out" and value == OUT)):
            option = name.replace("no_", "no-")
            raise InvalidArgumentError(f"--{option}: has no effect {where}; leave it out")


def _live(options: argparse.Namespace) -> int:
    if not (options.scenario or options.scenario_file):
        options.scenario = "grasp_five_finger"
    name, scenario = load_chosen(options)

    def announce(address: str) -> None:
        print(f"kernels     {scenario.kernels.name}")
        print(f"open {address} in a browser; stop with Ctrl+C or in the page", flush=True)

    with stop_on_signals() as should_stop:
        serve_live_run(
            scenario, name=name, out=options.out, announce=announce, should_stop=should_stop
        )
    return 0


def _film(options: argparse.Namespace) -> int:
    # Imported here because the renderer takes a fifth of a second.
    from drake_pregrasp.studies.gallery.film import film_scenario

    name, scenario = load_chosen(options)
    print(f"film in {film_scenario(scenario, name, Path(options.out))}")
    return 0


def _run(options: argparse.Namespace) -> int:
    name, scenario = load_chosen(options)
    if options.graphviz is not None:
        without = "overwrite", "no_recording", "mcap", "out"
        refuse_options(options, "with --graphviz", *without)
        check_new(Path(options.graphviz))
        write_graphviz(make_diagram(scenario), Path(options.graphviz))
        return 0
    with stop_on_signals() as should_stop, run_bar(scenario) as on_tick:
        result = run(
            scenario,
            name=name,
            out=options.out,
            recording=not options.no_recording,
            mcap=options.mcap,
            overwrite=options.overwrite,
            on_tick=on_tick,
            should_stop=should_stop,
        )
    print_result(result, recorded=not options.no_recording)
    return 0 if result.completed else INTERRUPTED_STATUS


def load_chosen(options: argparse.Namespace) -> tuple[str, ResolvedScenario]:
    """Returns the name and the resolved scenario that the options choose."""
    file: str | None = options.scenario_file
    name: str | None = options.scenario
    if name is None:
        if file is None:
            raise ScenarioError("", "", "give a shipped scenario's name, or --scenario_file")
        name = only_name(file)
    return name, load_resolved(
        name,
        file=file,
        text=options.scenario_text,
        folders=options.allow,
        simulation_duration=options.simulation_duration,
    )
