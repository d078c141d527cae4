"""The commands `drake-pregrasp export` and `drake-pregrasp replay`."""

import argparse
import json
from pathlib import Path
from typing import Any

from drake_pregrasp.cli.run_command import (
    OUT,
    add_allow_option,
    add_overwrite_option,
    add_scenario_options,
    grasp_in_words,
    load_chosen,
    refuse_options,
    stop_on_signals,
)
from drake_pregrasp.config.yaml_text import MAX_BYTES
from drake_pregrasp.diagrams.object_plant import ENGINES, MUJOCO
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.resources import read_bounded_text
from drake_pregrasp.simulation.grasp_export import export_grasp, read_postures
from drake_pregrasp.simulation.output import INTERRUPTED_STATUS
from drake_pregrasp.simulation.posture_test import posture_test
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.simulation.run import EXPORT_FILE, RunResult, run, valid_name
from drake_pregrasp.simulation.scenario_file import load_resolved, load_scenario

_SCENARIO = "scenario.yaml"


def add_commands(commands: "argparse._SubParsersAction[Any]") -> None:
    """Adds the commands to those of `drake-pregrasp`."""
    export = commands.add_parser("export", help="write the motion and the postures of a grasp")
    export.set_defaults(command=_export)
    add_scenario_options(export, or_run=True)
    add_overwrite_option(export)
    replay = commands.add_parser("replay", help="repeat a run with MuJoCo, or test its postures")
    replay.set_defaults(command=_replay)
    add = replay.add_argument
    add("run", metavar="RUN", type=Path, help="run folder")
    add("--engine", choices=ENGINES, default=MUJOCO, help="what simulates it (%(default)s)")
    add("--postures", action="store_true", help="test the exported postures by DexGraspBench")
    add_allow_option(replay)
    add("--out", default=OUT, metavar="FOLDER", help="folder of run folders (%(default)s)")
    add_overwrite_option(replay)


def _export(options: argparse.Namespace) -> int:
    folder = Path(options.scenario or "")
    if options.scenario and (folder / _SCENARIO).is_file():
        without = "scenario_file", "scenario_text", "simulation_duration", "overwrite", "out"
        refuse_options(options, "on a run folder", *without)
        resolved = load_resolved(file=folder / _SCENARIO, folders=options.allow)
    else:
        name, resolved = load_chosen(options)
        if resolved.hand is None:
            raise InvalidArgumentError(f"{name}: has no hand, so there is no grasp to export")
        done = _run(options, resolved, name)
        if not done.completed:
            return INTERRUPTED_STATUS
        folder = done.folder
    export_grasp(resolved, folder / EXPORT_FILE)
    print(f"motion and postures in {folder / EXPORT_FILE}")
    return 0


def _replay(options: argparse.Namespace) -> int:
    folder: Path = options.run
    if not (folder / _SCENARIO).is_file():
        raise InvalidArgumentError(f"{folder}: is no run folder: it has no {_SCENARIO}")
    if options.postures:
        refuse_options(options, "on the test of postures", "overwrite", "out")
        if options.engine != MUJOCO:
            raise InvalidArgumentError(f"--postures: tested by {MUJOCO}, not by {options.engine}")
    text = f"{{engine: {options.engine}}}"
    resolved = load_resolved(file=folder / _SCENARIO, text=text, folders=options.allow)
    if resolved.hand is None:
        raise InvalidArgumentError(f"{folder}: has no hand, so there is no grasp to repeat")
    if options.postures:
        return _test_postures(options, resolved)
    before = load_scenario(file=folder / _SCENARIO, folders=options.allow).engine
    if before == options.engine:
        other = next(engine for engine in ENGINES if engine != before)
        raise InvalidArgumentError(f"--engine: {before} made {folder}; give {other}")
    first, was_held = _outcome(folder)
    done = _run(options, resolved, valid_name(f"{folder.resolve().name}-{options.engine}"))
    if not done.completed:
        return INTERRUPTED_STATUS
    second, is_held = _outcome(done.folder)
    print(f"{before:12}{first}")
    print(f"{options.engine:12}{second}")
    if None in (was_held, is_held):
        print("verdicts    none: a run ended before its hand held the object or gave up")
    else:
        print(f"verdicts    {'agree' if was_held == is_held else 'differ'}")
    print(f"results in {done.folder}")
    return 0


def _run(options: argparse.Namespace, resolved: ResolvedScenario, name: str) -> RunResult:
    """Runs a scenario without a recording, until its end or a signal."""
    with stop_on_signals() as should_stop:
        return run(
            resolved,
            name=name,
            out=options.out,
            recording=False,
            overwrite=options.overwrite,
            should_stop=should_stop,
        )


def _outcome(folder: Path) -> tuple[str, bool | None]:
    """Returns the results of a grasp in words, and whether the object was held.

    Of a run without a shake, it is whether the hand holds it at the end; None if the run ended
    before the hand did or gave up.
    """
    file = folder / "summary.json"
    try:
        grasp: dict[str, Any] = json.loads(read_bounded_text(file, MAX_BYTES))["grasp"]
        words, held = grasp_in_words(grasp), grasp.get("held")
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise InvalidArgumentError(f"{file}: is no summary of a run with a hand") from error
    if held is None:
        is_over = grasp["phase"] == "hold" or grasp["gave_up"] is not None
        return words, grasp["phase"] == "hold" if is_over else None
    return words, bool(held)


def _test_postures(options: argparse.Namespace, resolved: ResolvedScenario) -> int:
    file = options.run / EXPORT_FILE
    if not file.is_file():
        command = f"drake-pregrasp export {options.run}"
        raise InvalidArgumentError(f"{file}: there is no such file; `{command}` writes it")
    results = posture_test(resolved, read_postures(file))
    for result in results:
        x, y, z = (round(share) for share in result.direction)
        verdict = "held" if result.held else "lost"
        moved = f"moved {1e3 * result.moved:.2f} mm and turned {result.turned:.2f}°"
        print(f"force along ({x:2},{y:2},{z:2})  {verdict}: {moved}")
    held = all(result.held for result in results)
    print(f"postures    {'hold' if held else 'do not hold'} the object in all six directions")
    return 0
