"""The pages name code, commands and keys that exist."""

import ast
import dataclasses
import functools
import importlib
import pkgutil
import re
import shlex
import typing

import pydrake.all
import pytest
import yaml
from pages import DOCS, ROOT

from drake_pregrasp import load_scenario, shipped_scenarios
from drake_pregrasp.simulation.run_log import grasp_columns, log_columns
from drake_pregrasp.studies.study_file import load_study

pytest.importorskip("numba")  # Some of the names are of compiled functions.

PACKAGE = ROOT / "drake_pregrasp"
PAGES = [
    *DOCS.glob("*.md"),
    *DOCS.glob("results/*.md"),
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
]
ELSEWHERE = {
    "--expire_sec",
    "NUMBA_CACHE_DIR",
    "OPENBLAS_NUM_THREADS",
    "ROS_PACKAGE_PATH",
    "System.Clone",
    "ToAutoDiffXd",
    "cartesian_axis_masks",
    "desired_cartesian_poses",
    "drake_pregrasp.Measures",
    "foxglove.FrameTransform",
    "foxglove.FrameTransforms",
    "foxglove.PointCloud",
    "foxglove.PoseInFrame",
    "foxglove.SceneUpdate",
    "hardware_sim",
    "lcm_buses",
    "live.py",
    "model_drivers",
    "my_goals.py",
}
"""Names of other programs, of files that a page tells the reader to write, columns and arrays."""
DATA = r"(csv|dot|html|json|jsonl|mcap|md|npz|obj|png|svg|urdf|xml|yaml)"
COMMANDS = (DOCS / "reference" / "commands.md").read_text(encoding="utf-8")


def names_on(page):
    """Returns the texts in single backticks outside blocks of code."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    return set(re.findall(r"`([^`\n]+)`", text))


@functools.cache
def modules():
    """Returns the modules of the package by their names."""
    found = pkgutil.walk_packages([str(PACKAGE)], "drake_pregrasp.")
    names = [info.name for info in found if not info.name.endswith("__main__")]
    return {name: importlib.import_module(name) for name in names}


@functools.cache
def classes():
    """Returns the classes of the package by their names."""
    return {
        name: value
        for module in modules().values()
        for name, value in vars(module).items()
        if isinstance(value, type) and value.__module__.startswith("drake_pregrasp")
    }


@functools.cache
def words():
    """Returns all identifiers and one-word strings of the package, its data and Drake."""
    found = {*dir(pydrake.all), *log_columns(2), *grasp_columns(2)}
    for path in PACKAGE.rglob("*.py"):
        found.add(path.stem)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            for field in ("id", "attr", "arg", "name", "value"):
                text = getattr(node, field, None)
                found |= {text} if isinstance(text, str) else set()
    for folder in (PACKAGE, ROOT / "scenarios", ROOT / "models"):
        for path in folder.rglob("*.yaml"):
            found.add(path.stem)
            found |= {
                token.value
                for token in yaml.scan(path.read_text(encoding="utf-8"))
                if isinstance(token, yaml.ScalarToken)
            }
    return found


def follows(hint, names):
    """Returns whether a chain of fields starts at a type hint, through lists and unions."""
    if not names:
        return True
    if str(getattr(hint, "__module__", "")).startswith("pydrake"):
        return hasattr(hint, names[0])
    if not dataclasses.is_dataclass(hint):
        return any(follows(part, names) for part in typing.get_args(hint))
    hints = typing.get_type_hints(hint)
    return names[0] in hints and follows(hints[names[0]], names[1:])


def is_dotted_name(text):
    """Returns whether a text is a key, an attribute of a class, or something in a module."""
    first, *rest = text.split(".")
    if any(follows(schema, [first, *rest]) for schema in classes().values()):
        return True
    if first in classes():
        return hasattr(classes()[first], rest[0]) or follows(classes()[first], rest)
    for place in (f"drake_pregrasp.{text}", text):
        try:
            pkgutil.resolve_name(place)
        except (ImportError, AttributeError):
            continue
        return True
    return False


def exists(text):
    """Returns whether a text names something that exists, or is no name of code at all."""
    name = re.split(r"[(:=]", text)[0].removeprefix("!")
    if name in ELSEWHERE:
        return True
    if re.fullmatch(r"[\w/-]+\.py", name):
        return any((folder / name).exists() for folder in (ROOT, PACKAGE, DOCS))
    if re.fullmatch(r"--\w+", name):
        return name in COMMANDS
    if re.fullmatch(r"\w*[A-Z_]\w*", name):
        return name in words()
    is_file = re.search(rf"\.{DATA}$", name)
    if re.fullmatch(r"[A-Za-z]\w+(\.[A-Za-z_]\w+)+", name) and not is_file:
        return is_dotted_name(name)
    return True


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_names_on_a_page_exist(page):
    assert sorted(name for name in names_on(page) if not exists(name)) == []


@pytest.mark.parametrize(
    "name", ["FingertipGoalShaper", "planner.limit.reach", "quality.no_file.function"]
)
def test_a_name_that_does_not_exist_is_found(name):
    assert not exists(name)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_commands_on_a_page_exist(page):
    text = page.read_text(encoding="utf-8")
    for command in re.findall(r"drake-pregrasp ([a-z][a-z-]*)", text):
        assert re.search(rf"^## `drake-pregrasp {command}[` ]", COMMANDS, flags=re.MULTILINE)


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_studies_on_a_page_load_with_their_options(page):
    text = page.read_text(encoding="utf-8")
    for line in re.findall(r"^    \S*drake-pregrasp study (\w+ .*|\w+)$", text, flags=re.M):
        name, *options = shlex.split(line)
        given = dict(zip(options[::2], options[1::2], strict=True))
        choice = {key: given.get(f"--{key}", "") for key in ("conditions", "methods")}
        choice = {key: keys.split(",") for key, keys in choice.items() if keys}
        load_study(name, text=given.get("--study_text", "{}"), **choice)


@pytest.mark.parametrize("heading", ["One tick", "The hand"])
def test_the_functions_of_a_tick_exist(heading):
    text = (DOCS / "architecture.md").read_text(encoding="utf-8")
    (tick,) = re.findall(rf"^## {heading}\n.*?^```\n(.*?)^```", text, flags=re.M | re.S)
    for line in tick.splitlines():
        names = re.match(r" *(\w+(?:\.\w+)?(?:, \w+)*)(?:  |$)", line)
        file = re.search(r"\w+/\w+\.py", line)
        known = (PACKAGE / file[0]).read_text(encoding="utf-8") if file else words()
        for name in re.findall(r"\w+", names[1]) if names else []:
            assert name in known, line


def scenario_texts():
    """Returns the page, the scenario and the YAML of each command that changes a scenario."""
    return [
        (page.name, scenario, text)
        for page in PAGES
        for scenario, text in re.findall(
            r"drake-pregrasp \w+ (\w+) --scenario_text '([^']*)'", page.read_text(encoding="utf-8")
        )
        if not re.search(r"file: \w+\.yaml", text)  # To be written first.
    ]


@pytest.mark.parametrize(("page", "scenario", "text"), scenario_texts())
def test_the_keys_on_a_page_exist(page, scenario, text):
    if scenario in shipped_scenarios():
        load_scenario(scenario, text=text)
