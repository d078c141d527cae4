"""A planning tick and a control tick run through few files and functions."""

import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import pytest
from pydrake.systems.analysis import Simulator

import drake_pregrasp
from drake_pregrasp import load_scenario, make_diagram
from drake_pregrasp.fast import SWITCH

PACKAGE = str(Path(drake_pregrasp.__file__).parent)
# They sample or move the plant in each of its steps.
SENSOR = ("FingertipSensor._measure", "FingertipSensor._place", "HandKinematics.moves_freely")
PLANT = ("LinkContacts", "_contacts", "BodyPose", "ObjectShake", "Launch", *SENSOR)


def calls_of(function: Callable[[], object]) -> Counter[tuple[str, str]]:
    """How often a function calls each function of the package, by file and name."""
    calls: Counter[tuple[str, str]] = Counter()

    def note(frame: FrameType, event: str, argument: object) -> None:
        code = frame.f_code
        if event != "call" or not code.co_filename.startswith(PACKAGE):
            return
        # Comprehensions and lambdas are part of the functions around them. On Python 3.11, numba
        # reports calls of compiled functions too.
        if not code.co_name.startswith(("<", "write_")) and not code.co_qualname.startswith(PLANT):
            calls[code.co_filename[len(PACKAGE) + 1 :], code.co_qualname] += 1

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        function()
    finally:
        sys.setprofile(before)
    return calls


def check(calls: Counter[tuple[str, str]], *, files: int, functions: int, count: int) -> None:
    listed = "\n".join(f"{number} {file} {name}" for (file, name), number in sorted(calls.items()))
    limits = files, functions, count
    reached = len({file for file, _ in calls}), len(calls), calls.total()
    assert reached[1] > 20, "the tick was not seen"
    assert all(is_few <= most for is_few, most in zip(reached, limits, strict=True)), (
        f"{reached[0]} files, {reached[1]} functions, {reached[2]} calls\n{listed}"
    )


def test_a_planning_tick_of_the_base_case_is_small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(SWITCH, "0")
    scenario = load_scenario("a_base")
    diagram = make_diagram(scenario)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    monitor = diagram.GetSubsystemByName("grasp_quality_monitor")
    first = round(scenario.planner.static_duration / scenario.planner.period) + 2

    def tick(index: int) -> None:
        """Advances to the time of a tick, after the update of the tick before."""
        simulator.AdvanceTo(index * scenario.planner.period)
        monitor.GetOutputPort("grasp_quality").Eval(monitor.GetMyContextFromRoot(context))

    tick(first)
    check(calls_of(lambda: tick(first + 1)), files=21, functions=89, count=176)


@pytest.mark.slow
def test_a_control_tick_of_a_hand_is_small() -> None:
    """While the hand tracks, closes, squeezes and holds, between two ticks of the planner."""
    simulator = Simulator(make_diagram(load_scenario("grasp_five_finger")))
    # Only the squeeze plans forces, at each tick.
    for time, files, functions, count in (
        (2.011, 26, 90, 151),
        (4.511, 27, 109, 194),
        (5.211, 29, 113, 230),
        (7.011, 28, 98, 177),
    ):
        simulator.AdvanceTo(time)
        calls = calls_of(lambda end=time + 0.01: simulator.AdvanceTo(end))
        check(calls, files=files, functions=functions, count=count)
