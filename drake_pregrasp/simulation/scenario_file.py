"""Scenarios from YAML files in Drake's manner: named entries, overriding texts, `_` anchors."""

from collections.abc import Sequence
from pathlib import Path

from pydrake.common.yaml import yaml_dump_typed

from drake_pregrasp.bounded_file import read_bounded_text
from drake_pregrasp.errors import InvalidArgumentError, ScenarioError, printable
from drake_pregrasp.resources import resource_folder
from drake_pregrasp.simulation.hand_file import check_hand_files
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_check import validate
from drake_pregrasp.simulation.scenario_paths import make_paths_absolute
from drake_pregrasp.simulation.schema_check import check_mapping
from drake_pregrasp.simulation.yaml_text import MAX_BYTES, load_typed, parse_yaml

SCENARIO_TEXT = "scenario text"
"""What error messages call the text that overrides a scenario."""


def shipped_scenarios() -> dict[str, tuple[Path, str]]:
    """Returns, for each shipped scenario's name, its file and description, the paper's first."""
    shipped = {}
    files = resource_folder("scenarios").glob("*.yaml")
    for file in sorted(files, key=lambda file: (file.stem != "paper", file.stem)):
        for name, entry in _entries(file).items():
            shipped[name] = (file, str(entry.get("description", "")))
    return shipped


def find_scenario(name: str) -> Path:
    """Returns the file that holds the shipped scenario of that name.

    Raises:
        ScenarioError: If there is none; the message lists the names there are.
    """
    shipped = shipped_scenarios()
    if name not in shipped:
        raise ScenarioError("", name, f"no such scenario; there are: {', '.join(shipped)}")
    return shipped[name][0]


def load_scenario(
    name: str | None = None,
    *,
    file: str | Path | None = None,
    text: str | None = None,
    folders: Sequence[str | Path] = (),
) -> Scenario:
    """Loads a scenario.

    Args:
        name: Its name: an entry of `file`, or of the shipped files if no file is given.
        file: A YAML file. With one entry only, `name` can be left out.
        text: YAML that overrides single keys, for example `{planner: {period: 0.1}}`.
        folders: Where files that it names may be, beside its file's own folder and, for those
            that `text` names, the working directory; or anywhere below.

    Relative paths start at the file's folder, those in `text` at the working directory; they come
    back absolute.

    Raises:
        ScenarioError: If anything is wrong with it; the message names file, key and value.
    """
    if file is None:
        if name is None:
            raise ScenarioError("", "", "a scenario needs a name or a file")
        file = find_scenario(name)
    file = Path(file)
    entries = _entries(file)
    name = name or only_name(file)
    if name not in entries:
        raise ScenarioError(str(file), name, f"no such entry; there are: {', '.join(entries)}")
    check_mapping(str(file), name, entries[name], Scenario)
    scenario: Scenario = load_typed(Scenario, entries[name], Scenario())
    source = str(file)
    allowed = [file.parent, *map(Path, folders)]
    try:
        make_paths_absolute(scenario, file.parent, allowed=allowed, source=source)
        if text is not None:
            overrides = _parse(SCENARIO_TEXT, text)
            check_mapping(SCENARIO_TEXT, "", overrides, Scenario)
            scenario = load_typed(Scenario, overrides, scenario)
            source = f"{file} with {SCENARIO_TEXT}"
            allowed.append(Path.cwd())
            make_paths_absolute(scenario, Path.cwd(), allowed=allowed, source=source)
        check_hand_files(scenario.grasp.hand, allowed, source)
        validate(scenario, source)
    except ScenarioError as error:
        if error.source != printable(source):
            raise
        raise ScenarioError(source, f"{name}.{error.key}", error.problem) from error
    return scenario


def only_name(file: str | Path) -> str:
    """Returns the name of a file's only entry.

    Raises:
        ScenarioError: If there are several, or none.
    """
    entries = _entries(Path(file))
    if len(entries) != 1:
        raise ScenarioError(
            str(file), "", f"choose one scenario by its name; there are: {', '.join(entries)}"
        )
    return next(iter(entries))


def check_scenario(scenario: Scenario) -> None:
    """Checks a scenario that was made or changed in Python as thoroughly as one from a file.

    Its relative paths, which start at the working directory, are made absolute.

    Raises:
        ScenarioError: If it can't be simulated.
    """
    make_paths_absolute(scenario, Path.cwd())
    entry = _parse("scenario", dump_scenario("scenario", scenario))["scenario"]
    check_mapping("scenario", "", entry, Scenario)
    validate(scenario)


def dump_scenario(name: str, scenario: Scenario) -> str:
    """Returns a scenario as YAML with every key; loading it gives the same scenario."""
    text: str = yaml_dump_typed(scenario, child_name=name)
    # Newer Drakes no longer know this key; at its default it says nothing.
    return text.replace("    publish_every_time_step: false\n", "")


def _entries(file: Path) -> dict[str, dict[str, object]]:
    try:
        text = read_bounded_text(file, MAX_BYTES)
    except InvalidArgumentError as error:
        raise ScenarioError("", "", str(error)) from error
    return _parse(str(file), text)


def _parse(source: str, text: str) -> dict[str, dict[str, object]]:
    data = parse_yaml(source, text)
    if not isinstance(data, dict):
        raise ScenarioError(source, "", "must be a mapping from names to values")
    for key in data:
        if not isinstance(key, str):
            raise ScenarioError(source, str(key), "is no name; quote it if it is meant as one")
    return {key: value for key, value in data.items() if not key.startswith("_")}
