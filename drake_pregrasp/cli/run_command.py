"""The command `drake-pregrasp run`."""

import argparse
from pathlib import Path
from typing import Any

from drake_pregrasp.cli.run_progress import run_bar, stop_on_signals
from drake_pregrasp.cli.run_words import print_result
from drake_pregrasp.errors import ScenarioError
from drake_pregrasp.simulation.run import run, write_graphviz
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_check import validate
from drake_pregrasp.simulation.scenario_file import load_scenario, only_name
from drake_pregrasp.simulation.schema_check import check_mapping
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.studies.interruptible import INTERRUPTED_STATUS


def add_command(commands: "argparse._SubParsersAction[Any]") -> None:
    """Adds the command to those of `drake-pregrasp`."""
    parser = commands.add_parser("run", help="simulate a scenario and write its run folder")
    parser.set_defaults(command=_run)
    parser.add_argument("scenario", nargs="?", help="name of a shipped scenario")
    parser.add_argument("--scenario_file", metavar="FILE", help="YAML file to load it from instead")
    parser.add_argument(
        "--scenario_name", metavar="NAME", help="its entry in that file; may be left out of one"
    )
    parser.add_argument(
        "--scenario_text",
        metavar="YAML",
        help="overrides single keys, for example '{planner: {period: 0.1}}'",
    )
    parser.add_argument(
        "--allow",
        action="append",
        default=[],
        metavar="FOLDER",
        help="where files that the scenario names may be, beside its own folder; repeatable",
    )
    parser.add_argument(
        "--simulation_duration", metavar="SECONDS", type=float, help="overrides that key"
    )
    parser.add_argument(
        "--out",
        default="runs",
        metavar="FOLDER",
        help="where run folders go; %(default)s if not set",
    )
    parser.add_argument("--no-recording", action="store_true", help="leave out recording.html")
    parser.add_argument(
        "--graphviz", metavar="FILE", help="write the diagram to this file and don't simulate"
    )


def _run(options: argparse.Namespace) -> int:
    name, scenario = _load(options)
    if options.graphviz is not None:
        diagram = make_diagram(scenario, scenario.make_surface())
        write_graphviz(diagram, Path(options.graphviz))
        return 0
    with stop_on_signals() as should_stop, run_bar(scenario) as on_tick:
        result = run(
            scenario,
            name=name,
            out=options.out,
            recording=not options.no_recording,
            on_tick=on_tick,
            should_stop=should_stop,
        )
    print_result(result, recorded=not options.no_recording)
    return 0 if result.completed else INTERRUPTED_STATUS


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
