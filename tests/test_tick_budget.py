"""One planning tick of the base case runs through few files and functions."""

import sys
from pathlib import Path
from types import FrameType

import pytest
from pydrake.systems.analysis import Simulator

import drake_pregrasp
from drake_pregrasp import load_scenario, make_diagram
from drake_pregrasp.fast import SWITCH

PACKAGE = str(Path(drake_pregrasp.__file__).parent)
MOST_FILES, MOST_FUNCTIONS = 19, 64


def test_a_tick_of_the_base_case_is_small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(SWITCH, "0")
    scenario = load_scenario("a_base")
    diagram = make_diagram(scenario)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    monitor = diagram.GetSubsystemByName("grasp_quality_monitor")
    period = scenario.planner.period
    simulator.AdvanceTo(scenario.planner.static_duration + 2 * period)
    called: dict[str, set[str]] = {}

    def note(frame: FrameType, event: str, argument: object) -> None:
        if event == "call" and frame.f_code.co_filename.startswith(PACKAGE):
            file = frame.f_code.co_filename[len(PACKAGE) + 1 :]
            functions = called.setdefault(file, set())
            if not frame.f_code.co_name.startswith("<"):  # Comprehensions and lambdas.
                functions.add(frame.f_code.co_qualname)

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        simulator.AdvanceTo(context.get_time() + period)
        monitor.GetOutputPort("grasp_quality").Eval(monitor.GetMyContextFromRoot(context))
    finally:
        sys.setprofile(before)
    listed = "\n".join(f"{file}: {', '.join(sorted(called[file]))}" for file in sorted(called))
    count = sum(map(len, called.values()))
    assert count > 20, "the tick was not seen"
    assert (len(called) <= MOST_FILES, count <= MOST_FUNCTIONS) == (True, True), (
        f"{len(called)} files, {count} functions\n{listed}"
    )
