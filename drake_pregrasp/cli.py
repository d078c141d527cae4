"""The command `drake-pregrasp`."""

import argparse
import contextlib
import logging
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from drake_pregrasp.errors import PregraspError, ScenarioError, printable
from drake_pregrasp.simulation.run import RunResult, run, write_graphviz
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_check import validate
from drake_pregrasp.simulation.scenario_file import (
    load_scenario,
    only_name,
    shipped_scenarios,
)
from drake_pregrasp.simulation.schema_check import check_mapping
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.simulation.smooth_file import load_estimator, smooth_file
from drake_pregrasp.simulation.summary import MEASURES
from drake_pregrasp.studies.bench.bench import bench
from drake_pregrasp.studies.faults.study import study_faults
from drake_pregrasp.studies.gallery import make_gallery
from drake_pregrasp.studies.grasp_pictures import picture_grasps
from drake_pregrasp.studies.lookahead import study_lookahead
from drake_pregrasp.studies.published import SCENARIOS
from drake_pregrasp.studies.reproduce import reproduce
from drake_pregrasp.studies.shapes import study_shapes
from drake_pregrasp.studies.static_versus_dynamic import command as static_versus_dynamic
from drake_pregrasp.studies.step_bar import step_bar
from drake_pregrasp.studies.sweep import command as sweep
from drake_pregrasp.systems.grasp_quality_monitor import GraspQualityView
from drake_pregrasp.systems.tick_logger import TickRecord
from drake_pregrasp.version import __version__

BAD_INPUT = 2
INTERRUPTED = 130
BROKEN_PIPE = 141

_STUDIES = {
    "faults": (study_faults, "how the planner stands up to faulty measurements"),
    "gallery": (make_gallery, "pictures of the shipped scenarios, with their measures"),
    "grasps": (picture_grasps, "pictures of the shipped hands"),
    "lookahead": (study_lookahead, "what goals for a later pose gain on fast objects"),
    "shapes": (study_shapes, "whether contacts stay where they may be, on ten shapes"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit status: 2 for bad input, 130 if interrupted."""
    logging.getLogger("drake").setLevel(logging.WARNING)
    options = _parser().parse_args(arguments)
    try:
        status: int = options.command(options)
        sys.stdout.flush()
    except KeyboardInterrupt:
        print("drake-pregrasp: interrupted", file=sys.stderr)
        return INTERRUPTED
    except PregraspError as error:
        print(f"drake-pregrasp: {printable(str(error))}", file=sys.stderr)
        return BAD_INPUT
    except SystemExit as error:  # So a failed demand of Drake's reaches Python.
        print(f"drake-pregrasp: {printable(str(error))}", file=sys.stderr)
        return BAD_INPUT
    except BrokenPipeError:  # Whoever reads the output, as `head`, has enough of it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    return status


def _parser() -> argparse.ArgumentParser:
    parser = _OneLineParser(
        prog="drake-pregrasp",
        description="Dynamic pre-grasp planning for multi-finger hands that track a moving object.",
    )
    parser.add_argument("--version", action="version", version=f"drake-pregrasp {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    listing = commands.add_parser("list", help="list the shipped scenarios")
    listing.set_defaults(command=_list)

    runner = commands.add_parser("run", help="simulate a scenario and write its run folder")
    runner.set_defaults(command=_run)
    runner.add_argument("scenario", nargs="?", help="name of a shipped scenario")
    runner.add_argument("--scenario_file", metavar="FILE", help="YAML file to load it from instead")
    runner.add_argument(
        "--scenario_name", metavar="NAME", help="its entry in that file; may be left out of one"
    )
    runner.add_argument(
        "--scenario_text",
        metavar="YAML",
        help="overrides single keys, for example '{planner: {period: 0.1}}'",
    )
    runner.add_argument(
        "--allow",
        action="append",
        default=[],
        metavar="FOLDER",
        help="where files that the scenario names may be, beside its own folder; repeatable",
    )
    runner.add_argument(
        "--simulation_duration", metavar="SECONDS", type=float, help="overrides that key"
    )
    runner.add_argument(
        "--out",
        default="runs",
        metavar="FOLDER",
        help="where run folders go; %(default)s if not set",
    )
    runner.add_argument("--no-recording", action="store_true", help="leave out recording.html")
    runner.add_argument(
        "--graphviz", metavar="FILE", help="write the diagram to this file and don't simulate"
    )

    reproducer = commands.add_parser("reproduce", help="reproduce the paper's tables and figures")
    reproducer.set_defaults(command=_reproduce)
    reproducer.add_argument(
        "--out", default="reproduction", metavar="FOLDER", help="where the report goes"
    )
    reproducer.add_argument(
        "--cases",
        default=",".join(SCENARIOS),
        metavar="a,b,...",
        help="which; %(default)s if not set",
    )

    student = commands.add_parser("study", help="measure what a feature gains")
    studies = student.add_subparsers(required=True, metavar="NAME", dest="study")
    for name, (_, text) in _STUDIES.items():
        study = studies.add_parser(name, help=text)
        study.set_defaults(command=_study)
        study.add_argument(
            "--out", default=f"study_{name}", metavar="FOLDER", help="where the report goes"
        )
    static_versus_dynamic.add_command(studies)
    sweep.add_command(commands)

    bencher = commands.add_parser("bench", help="measure how long planning takes")
    bencher.set_defaults(command=_bench)
    bencher.add_argument(
        "--out",
        default="bench",
        metavar="FOLDER",
        help="where the report goes; %(default)s if not set",
    )
    bencher.add_argument("--quick", action="store_true", help="leave out what takes long")

    smoother = commands.add_parser(
        "smooth", help="smooth a recorded pose stream, and add its velocities"
    )
    smoother.set_defaults(command=_smooth)
    smoother.add_argument("input", metavar="IN.csv", help="columns time,x,y,z,qw,qx,qy,qz")
    smoother.add_argument("output", metavar="OUT.csv", help="the same and vx,vy,vz,wx,wy,wz")
    smoother.add_argument(
        "--estimator",
        default="{}",
        metavar="YAML",
        help="keys of planner.estimator, for example '{position_std: 0.002, acceleration: 1.0}'",
    )
    return parser


def _list(options: argparse.Namespace) -> int:
    shipped = shipped_scenarios()
    width = max(len(name) for name in shipped)
    for name, (_, description) in shipped.items():
        print(f"{name:{width}}  {description}".rstrip())
    return 0


def _run(options: argparse.Namespace) -> int:
    name, scenario = _load(options)
    if options.graphviz is not None:
        diagram = make_diagram(scenario, scenario.make_surface())
        write_graphviz(diagram, Path(options.graphviz))
        return 0
    with _stop_on_signals() as should_stop, _progress(scenario) as on_tick:
        result = run(
            scenario,
            name=name,
            out=options.out,
            recording=not options.no_recording,
            on_tick=on_tick,
            should_stop=should_stop,
        )
    _report(result, options)
    return 0 if result.completed else INTERRUPTED


def _reproduce(options: argparse.Namespace) -> int:
    cases = [case.strip() for case in options.cases.split(",")]
    start = time.perf_counter()
    with step_bar() as on_progress:
        report = reproduce(options.out, cases, on_progress=on_progress)
    print(f"reproduced in {(time.perf_counter() - start) / 60:.1f} minutes")
    print(f"report in {report}: open it in a browser")
    return 0


def _study(options: argparse.Namespace) -> int:
    study, _ = _STUDIES[options.study]
    with step_bar() as on_progress:
        report = study(options.out, on_progress=on_progress)
    print(f"report in {report}")
    return 0


def _bench(options: argparse.Namespace) -> int:
    with step_bar() as on_progress:
        report = bench(options.out, quick=options.quick, on_progress=on_progress)
    print(f"report in {report}")
    return 0


def _smooth(options: argparse.Namespace) -> int:
    config = load_estimator(options.estimator)
    rows = smooth_file(Path(options.input), Path(options.output), config)
    print(f"{rows} poses smoothed into {options.output}")
    return 0


def _load(options: argparse.Namespace) -> tuple[str, Scenario]:
    file: str | None = options.scenario_file
    name: str | None = options.scenario_name
    if options.scenario is not None:
        if file is not None or name is not None:
            raise ScenarioError(
                "", options.scenario, "give either a shipped scenario's name or --scenario_file"
            )
        name = options.scenario
    if name is None:
        if file is None:
            raise ScenarioError("", "run", "needs a shipped scenario's name, or --scenario_file")
        name = only_name(file)
    scenario = load_scenario(name, file=file, text=options.scenario_text, folders=options.allow)
    if options.simulation_duration is not None:
        scenario.simulation_duration = options.simulation_duration
        source = "--simulation_duration"
        check_mapping(source, "", {"simulation_duration": scenario.simulation_duration}, Scenario)
        validate(scenario, f"{name} with {source}")
    return name, scenario


@contextlib.contextmanager
def _stop_on_signals() -> Iterator[Callable[[], bool]]:
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
def _progress(scenario: Scenario) -> Iterator[Callable[[TickRecord], None] | None]:
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


def _report(result: RunResult, options: argparse.Namespace) -> None:
    summary = result.summary
    for title, phase in (("static", "static"), ("best after", "max")):
        values = summary[phase]
        if values["q_msv"] is not None:
            shown = "   ".join(f"{m.upper()} {values[m]:.4f}" for m in MEASURES)
            print(f"{title:12}{shown}")
    print(
        f"speed       {summary['real_time_factor']:.1f} x real time,"
        f" planning tick {summary['tick_time_p50_ms']:.2f} ms (median)"
    )
    if "grasp" in summary:
        print(f"grasp       {_grasp_in_words(summary['grasp'])}")
    if summary["deadline_overruns"]:
        print(
            f"late        {summary['deadline_overruns']} of {summary['ticks']} ticks took longer"
            " than planner.period"
        )
    for contact, reason in summary["inactive_contacts"].items():
        print(f"at the end contact {contact} has no place, and doesn't count: {reason}")
    if not result.completed:
        print(
            f"interrupted at {summary['simulated_seconds']:g} s:"
            f" the log up to that tick is in {result.folder / 'log.csv'}"
        )
    if options.no_recording:
        print(f"results in {result.folder}")
    else:
        print(f"recording in {result.folder / 'recording.html'}: open it in a browser")


def _grasp_in_words(grasp: Mapping[str, Any]) -> str:
    words = [f"at the end: {grasp['phase']}"]
    if grasp["gave_up"] is not None:
        words.append(f"gave up because {grasp['gave_up']}")
    for key, text in (
        ("tracking_error_mean_mm", "fingertips {:.3f} mm off their goals"),
        ("closing_motion_mm", "object moved {:.3f} mm in closing"),
        ("lift_height_mm", "lifted {:.1f} mm"),
        ("slip_lift_mm", "slip {:.2f} mm in the lift"),
        ("slip_hold_mm", "{:.2f} mm in the hold"),
    ):
        if grasp[key] is not None:
            words.append(text.format(grasp[key]))
    return ", ".join(words)


class _OneLineParser(argparse.ArgumentParser):
    """Says what is wrong in one line, without the usage before it."""

    def error(self, message: str) -> NoReturn:
        print(f"{self.prog}: {message}", file=sys.stderr)
        sys.exit(BAD_INPUT)
