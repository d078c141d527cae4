"""Loads and writes scenarios in Drake's format: YAML with named entries and overrides."""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pydrake.common.yaml import yaml_dump_typed

from drake_pregrasp.config.yaml_text import parse_entries, parse_yaml, read_text
from drake_pregrasp.errors import ScenarioError, nearest, printable
from drake_pregrasp.resources import make_paths_absolute, resource_folder
from drake_pregrasp.simulation.hand_file import HandSource, read_hand
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario, resolve_scenario
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.schema_check import add_tags, check_mapping, load_checked

SCENARIO_TEXT = "scenario text"
"""Name of the text that overrides a scenario, for error messages."""


def shipped_scenarios() -> dict[str, tuple[Path, str]]:
    """Returns the file and description of each shipped scenario, with the paper's first."""
    ordered = sorted(_shipped_files(), key=lambda file: (file.stem != "paper", file.stem))
    return {
        name: (file, str(entry.get("description", "")))
        for file in ordered
        for name, entry in read_mapping(file).items()
    }


def _shipped_files() -> Iterator[Path]:
    return resource_folder("scenarios").glob("*.yaml")


def find_scenario(name: str) -> Path:
    """Returns the file of the shipped scenario with a name.

    Raises:
        ScenarioError: If the name is unknown; the message suggests the nearest name, lists all
            names, or says how to give a file.
    """
    entry = re.compile(rf"^{re.escape(name)}:", re.MULTILINE)
    for file in _shipped_files():  # It would take long to parse all of them.
        if entry.search(read_text(file)) and name in read_mapping(file):
            return file
    if Path(name).suffix in (".yaml", ".yml"):
        hint = f"for a file, use --scenario_file {name}"
    else:
        hint = nearest(name, shipped_scenarios())
    raise ScenarioError("", name, f"no such scenario; {hint}")


def load_scenario(
    name: str | None = None,
    *,
    file: str | Path | None = None,
    text: str | None = None,
    folders: Sequence[str | Path] = (),
) -> Scenario:
    """Loads the data of a scenario, with its keys, types and ranges checked.

    Relative paths start at the file's folder, and those in `text` at the working directory. The
    returned scenario has absolute paths.

    Args:
        name: Name of an entry of `file`, or of a shipped scenario if no file is given.
        file: YAML file of scenarios. If it has a single entry, `name` can be left out.
        text: YAML that overrides single keys, for example `{planner: {period: 0.1}}`. The entry's
            description is left out then, because it may be false.
        folders: Folders that may hold files which the scenario names, at any depth, besides the
            file's own folder and, for files that `text` names, the working directory.

    Raises:
        ScenarioError: If the scenario is invalid; the message names file, key and value.
    """
    return _load(name, file, text, folders).scenario


class LoadedScenario(NamedTuple):
    """A scenario's data, and its hand as it was read for the check.

    Attributes:
        scenario: The data.
        hand: Description of the hand, and its model; None without a hand.
    """

    scenario: Scenario
    hand: HandSource | None


def _load(
    name: str | None, file: str | Path | None, text: str | None, folders: Sequence[str | Path]
) -> LoadedScenario:
    if file is None and name is None:
        raise ScenarioError("", "", "a scenario needs a name or a file")
    file = Path(find_scenario(str(name)) if file is None else file)
    entries = read_mapping(file)
    name = name or only_name(file)
    if name not in entries:
        raise ScenarioError(str(file), name, f"no such entry; {nearest(name, entries)}")
    scenario = load_checked(str(file), name, entries[name], Scenario())
    source, folder = str(file), file.parent
    allowed = [folder, *map(Path, folders)]
    try:
        if text is not None:
            make_paths_absolute(scenario, folder, allowed=allowed, source=source)
            overrides = _checked_entries(SCENARIO_TEXT, parse_entries(SCENARIO_TEXT, text))
            scenario.description = ""  # It may be false now, in titles of pictures too.
            scenario = load_checked(SCENARIO_TEXT, "", overrides, scenario)
            source, folder = f"{file} with {SCENARIO_TEXT}", Path.cwd()
            allowed.append(folder)
        return _checked(scenario, source, folder, allowed)
    except ScenarioError as error:
        if error.source != printable(source):
            raise
        raise ScenarioError(source, f"{name}.{error.key}", error.problem) from error


def only_name(file: str | Path) -> str:
    """Returns the name of the only entry in a file.

    Raises:
        ScenarioError: If the file has several entries or no entry.
    """
    names = list(read_mapping(Path(file)))
    if len(names) != 1:
        listed = ", ".join(names) or "none; names that begin with '_' are not entries"
        problem = f"choose one scenario by its name; there are: {listed}"
        raise ScenarioError(str(file), "", problem)
    return names[0]


def scenario_data(scenario: Scenario) -> dict[str, Any]:
    """Returns a scenario as plain data with every key, the inverse of `scenario_from_data`.

    A mapping of a union's type has its tag under the key `_tag`, even if it is the union's first
    type.
    """
    data: dict[str, Any] = parse_yaml("scenario", dump_scenario("scenario", scenario))["scenario"]
    add_tags(data, scenario)
    return data


def scenario_from_data(
    data: Mapping[str, Any], *, source: str, folder: Path, folders: Sequence[str | Path] = ()
) -> LoadedScenario:
    """Returns the scenario described by plain data, with its hand.

    Args:
        data: Entry of a scenario file, as `parse_yaml` returns it; missing keys have defaults.
        source: Name of the data's origin, for error messages.
        folder: Folder at which relative paths start.
        folders: Folders that may hold files which the scenario names, at any depth, besides
            `folder`.

    Raises:
        ScenarioError: If the scenario is invalid; the message names source, key and value.
    """
    scenario = load_checked(source, "", data, Scenario())
    return _checked(scenario, source, folder, [folder, *map(Path, folders)])


def _checked(scenario: Scenario, source: str, folder: Path, allowed: list[Path]) -> LoadedScenario:
    make_paths_absolute(scenario, folder, allowed=allowed, source=source)
    if not scenario.has_hand:
        return LoadedScenario(scenario, None)
    try:
        return LoadedScenario(scenario, read_hand(scenario.hand_file, allowed))
    except ScenarioError as error:
        raise ScenarioError(source, "hand.file", str(error)) from error


def resolve(scenario: Scenario | ResolvedScenario) -> ResolvedScenario:
    """Returns a scenario with everything that it needs to be simulated.

    A scenario that was made in Python is checked like one from a file: relative paths start at the
    working directory, and are made absolute. A resolved scenario is returned as it is.

    Raises:
        ScenarioError: If the scenario cannot be simulated.
    """
    if isinstance(scenario, ResolvedScenario):
        return scenario
    make_paths_absolute(scenario, Path.cwd())
    check_mapping("scenario", "", scenario_data(scenario), Scenario)
    return resolve_scenario(scenario)


def load_resolved(
    name: str | None = None,
    *,
    file: str | Path | None = None,
    text: str | None = None,
    folders: Sequence[str | Path] = (),
    simulation_duration: float | None = None,
) -> ResolvedScenario:
    """Loads a scenario and resolves it; see `load_scenario` and `resolve`.

    Args:
        name: Name of an entry of `file`, or of a shipped scenario.
        file: YAML file of scenarios.
        text: YAML that overrides single keys.
        folders: Folders that may hold files which the scenario names.
        simulation_duration: Value of that key in seconds; None for that of the scenario.

    Raises:
        ScenarioError: If the scenario is invalid or cannot be simulated; the message names file,
            key and value.
    """
    if file is None and name is not None:
        file = find_scenario(name)
    scenario, hand = _load(name, file, text, folders)
    assert file is not None
    file = Path(file)
    source = str(file) if text is None else f"{file} with {SCENARIO_TEXT}"
    if simulation_duration is not None:
        option = "--simulation_duration"
        check_mapping(option, "", {"simulation_duration": simulation_duration}, Scenario)
        scenario.simulation_duration = simulation_duration
        return resolve_scenario(scenario, f"{name or only_name(file)} with {option}", hand=hand)
    try:
        return resolve_scenario(scenario, source, hand=hand)
    except ScenarioError as error:
        key = f"{name or only_name(file)}.{error.key}"
        raise ScenarioError(source, key, error.problem) from error.__cause__


def dump_scenario(name: str, scenario: Scenario) -> str:
    """Returns a scenario as YAML with every key; loading it gives the same scenario."""
    text: str = yaml_dump_typed(scenario, child_name=name)
    # Newer versions of Drake do not have this key.
    return text.replace("    publish_every_time_step: false\n", "")


def read_mapping(file: Path) -> dict[str, Any]:
    """Returns the entries of a YAML file, without private entries, whose names begin with `_`.

    Raises:
        ScenarioError: If the file cannot be read, or is not a mapping from names.
    """
    return _checked_entries(str(file), parse_entries(str(file), read_text(file)))


def _checked_entries(source: str, data: Any) -> dict[str, Any]:
    if not isinstance(data, dict):
        raise ScenarioError(source, "", "must be a mapping from names to values")
    for key in data:
        if not isinstance(key, str):
            raise ScenarioError(source, str(key), "is not a name; quote it if it is one")
    return data
