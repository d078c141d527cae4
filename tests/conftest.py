"""Fixtures that many tests share."""

import functools
import gc
import os
from collections.abc import Iterable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import settings
from selections import selection_of

from drake_pregrasp import (
    RunResult,
    Scenario,
    box_surface,
    load_scenario,
    resolve,
    run,
    shipped_scenarios,
)
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.resources import python_package, resource_folder
from drake_pregrasp.robots.robot_data import find_robot_data
from drake_pregrasp.studies.study_file import shipped_studies

# The same examples every time; machines differ too much for deadlines.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("quick", settings.get_profile("repeatable"), max_examples=40)


def pytest_configure(config: pytest.Config) -> None:
    settings.load_profile("quick" if config.getoption("markexpr") == "not slow" else "repeatable")
    # For the workers: threads of theirs would wait for processors that other workers use.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def pytest_collection_finish() -> None:
    gc.freeze()  # What is imported stays; a tenth of the time would go into looking at it.
    os.cpu_count = lambda: 1  # Studies start one process each: tests already run in parallel.


def slow(*values: object) -> Any:
    """Parameters with which a test is slow."""
    return pytest.param(*values, marks=pytest.mark.slow)


@pytest.fixture(scope="session")
def scenario() -> Scenario:
    return load_scenario("a_base")


@pytest.fixture(scope="session")
def surface() -> ObjectSurface:
    return box_surface([0.1, 0.1, 0.1], spacing=0.01)


@pytest.fixture(scope="session")
def p_OC(scenario: Scenario) -> np.ndarray:
    return resolve(scenario).start.p_OC


@pytest.fixture(scope="session")
def chosen(surface: ObjectSurface, p_OC: np.ndarray) -> SelectionInput:
    """The selection's input of the first tick of the base case, in plain Eq. 1-2."""
    return selection_of(surface, p_OC)


@pytest.fixture(scope="session")
def base_run(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """The base case, through the static phase and well into the adapting one."""
    return run_base_case(tmp_path_factory.mktemp("runs"), recording=False)


@pytest.fixture(scope="session")
def recorded_run(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """The same with a recording."""
    return run_base_case(tmp_path_factory.mktemp("recorded"), recording=True)


def run_base_case(out: Path, *, recording: bool) -> RunResult:
    scenario = load_scenario("a_base", text="{simulation_duration: 8.0}")
    return run(scenario, name="a_base", out=out, recording=recording)


@pytest.fixture(scope="session")
def base_log(base_run: RunResult) -> dict[str, np.ndarray]:
    return read_log(base_run.folder / "log.csv")


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def read_log(path: Path) -> dict[str, np.ndarray]:
    table = np.genfromtxt(path, delimiter=",", names=True)
    return {name: table[name] for name in table.dtype.names}


@functools.cache
def lacking_robots() -> str:
    """Says that the extra `robots` is not installed, or nothing."""
    try:
        find_robot_data()
    except InvalidArgumentError as error:
        return str(error)
    return ""


@pytest.fixture(scope="session")
def allegro_panda() -> Path:
    """The directives of an Allegro hand on a Panda arm, whose models are made if need be."""
    if lacking_robots():
        pytest.skip(lacking_robots())
    return resource_folder("models") / "allegro_panda.dmd.yaml"


SLOW_TO_LOAD = (*("finger_measures", "grasp_from_side", "grasp_shadow"),)
"""Scenarios whose start contacts take seconds to choose."""


def usable_scenarios() -> list[Any]:
    """The names of the shipped scenarios; those of hands that are not there are skipped."""
    with_panda = "grasp_allegro_panda", "see_with_allegro", "catch_with_panda"
    lacking = dict.fromkeys(with_panda, lacking_robots())
    lacking["grasp_shadow"] = lacking_shadow()
    return _usable(shipped_scenarios(), lacking)


def usable_studies() -> list[Any]:
    """The names of the shipped studies; those of robots that are not there are skipped."""
    lacking = dict.fromkeys(("random_boxes_allegro", "catching_with_panda"), lacking_robots())
    lacking["engines"] = lacking_robots() or lacking_shadow() or lacking_mujoco()
    return _usable(shipped_studies(), lacking | {"household": lacking_robots() or lacking_shadow()})


def lacking_mujoco() -> str:
    """Says that the extra `mujoco` is not installed, or nothing."""
    return "" if find_spec("mujoco") else "mujoco is not installed"


def lacking_shadow() -> str:
    """Returns the package that the Shadow hand lacks, in words; empty if it is installed."""
    return "" if python_package("gymnasium_robotics") else "gymnasium-robotics is not installed"


LACKING_HANDS = {
    **{f"allegro_{base}": lacking_robots() for base in ("hand", "panda", "ur5", "xarm7")},
    "five_finger_panda": lacking_robots(),
    "gripper_panda": lacking_robots(),
    "shadow_hand": lacking_shadow(),
    "shadow_panda": lacking_robots() or lacking_shadow(),
}
"""What shipped hands lack, in words, by their names."""


def usable_hands() -> list[Any]:
    """The names of the shipped hands; those that are not there are skipped."""
    files = resource_folder("models").glob("*.yaml")
    return _usable(sorted(f.stem for f in files if ".dmd" not in f.name), LACKING_HANDS)


def _usable(names: Iterable[str], lacking: Mapping[str, str]) -> list[Any]:
    marks: dict[str, list[Any]] = {name: [pytest.mark.slow] for name in SLOW_TO_LOAD}
    for name, lack in lacking.items():
        marks.setdefault(name, []).append(pytest.mark.skipif(bool(lack), reason=lack or "there"))
    return [pytest.param(name, marks=marks.get(name, ())) for name in names]
