"""docs/equations.md names functions that exist, cite the paper, and run."""

import importlib
import inspect
import re
import sys
from pathlib import Path

import pytest
from pydrake.systems.analysis import Simulator

from drake_pregrasp import load_scenario, make_diagram
from drake_pregrasp.fast import SWITCH

PAGE = Path(__file__).parent.parent / "docs" / "equations.md"
EQUATIONS = [
    tuple(cell.strip().strip("`") for cell in line.strip("|").split("|"))
    for line in PAGE.read_text(encoding="utf-8").splitlines()
    if line.startswith("| Eq. ")
]
TICKED = sorted({row[3] for row in EQUATIONS} - {"tests"})


def function_named(name):
    module, function = name.rsplit(".", 1)
    return getattr(importlib.import_module(f"drake_pregrasp.{module}"), function)


@pytest.fixture(scope="module")
def called():
    """The functions that one adapting tick of each scenario calls, without compiled code."""
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(SWITCH, "0")
        for name in TICKED:
            scenario = load_scenario(name, text="{planner: {static_duration: 0.0}}")
            diagram = make_diagram(scenario, sink=lambda _: None)
            simulator = Simulator(diagram)
            codes = found[name] = set()
            sys.setprofile(lambda frame, event, _, to=codes: to.add(frame.f_code))
            simulator.AdvanceTo(2.5 * scenario.planner.period)
            sys.setprofile(None)
    return found


def test_the_text_names_functions_that_exist():
    named = re.findall(r"`([a-z]+\.[a-z_]+\.[a-z_]+)`", PAGE.read_text(encoding="utf-8"))
    assert {row[2] for row in EQUATIONS} < set(named)
    assert all(callable(function_named(name)) for name in named)


def test_every_equation_is_there():
    assert {row[0] for row in EQUATIONS} == {f"Eq. {number}" for number in range(1, 10)}


@pytest.mark.parametrize("row", EQUATIONS, ids=lambda row: f"{row[0]} {row[2]}")
def test_each_function_cites_the_paper(row):
    cited = re.findall(r"Eq\. (\d)(?:-(\d))?", inspect.getsource(function_named(row[2])))
    number = int(row[0].removeprefix("Eq. "))
    assert any(int(first) <= number <= int(last or first) for first, last in cited)


@pytest.mark.parametrize(
    "row", [row for row in EQUATIONS if row[3] != "tests"], ids=lambda row: f"{row[0]} {row[2]}"
)
def test_each_equation_runs_in_a_tick(row, called):
    assert function_named(row[2]).__code__ in called[row[3]]


def test_one_file_evaluates_each_equation():
    package = PAGE.parent.parent / "drake_pregrasp"
    for number in range(1, 10):
        citing = {
            str(path.relative_to(package).with_suffix("")).replace("/", ".")
            for path in package.rglob("*.py")
            if path.parent.name != "systems"  # Their docstrings are the manual of ports.
            for first, last in re.findall(r"Eq\. (\d)(?:-(\d))?", path.read_text(encoding="utf-8"))
            if int(first) <= number <= int(last or first)
        }
        named = {row[2].rsplit(".", 1)[0] for row in EQUATIONS if row[0] == f"Eq. {number}"}
        assert citing == named, f"Eq. {number}"
