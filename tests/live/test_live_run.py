"""A live run continues from its present state, and ends when it is told to."""

import json
import signal
import subprocess
import sys
import urllib.request

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from drake_pregrasp import InvalidArgumentError, ScenarioError, load_scenario, make_diagram
from drake_pregrasp.config.validation import scalar_problem
from drake_pregrasp.live.live_controls import LiveControls, make_sliders, value_at
from drake_pregrasp.live.live_run import LiveRun
from drake_pregrasp.simulation.recording import start_meshcat
from drake_pregrasp.simulation.scenario_file import load_resolved, resolve
from drake_pregrasp.studies.gallery.film import film_scenario

STEP = "plant_config: {time_step: 0.005}"
NAMES = ["a_base", pytest.param("grasp_five_finger", marks=pytest.mark.slow)]


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_change_of_nothing_changes_nothing(name):
    """Goals and the object are those of a simulation without a change, to the last bit."""
    scenario = load_scenario(name, text="{planner: {static_duration: 0.1}}")
    run = LiveRun(resolve(scenario), name=name, meshcat=start_meshcat(live=True))
    for tick in range(16):
        if tick in (4, 9):
            run.change(lambda scenario: None)
        run.advance()
    records = []
    diagram = make_diagram(scenario, sink=records.append)
    Simulator(diagram).AdvanceTo(run.time)
    plain = records[-1]
    assert run.last.time == plain.time > 0.5
    np.testing.assert_array_equal(run.last.p_WC, plain.p_WC)
    np.testing.assert_array_equal(run.last.X_WO.GetAsMatrix4(), plain.X_WO.GetAsMatrix4())


@pytest.mark.slow
def test_a_new_start_has_the_changed_settings_another_seed_and_all_fingers():
    run = LiveRun(load_resolved("a_base"), name="a_base", meshcat=start_meshcat(live=True))
    run.advance()
    run.set_velocity(linear=0.03)
    run.switch_finger(1)
    run.next_strategy()
    run.advance()
    run.reset()
    scenario = run.scenario
    assert (run.time, scenario.random_seed, scenario.damage) == (0.0, 1, [])
    assert scenario.planner.strategy == "msv"
    assert scenario.motion.velocities()[-1][1] == 0.03
    run.switch_sight()
    run.reset()
    assert not run.is_hidden
    assert run.scenario.sensor.faults.nan_probability == 0
    assert run.scenario.depth_sensor.ceiling == load_scenario("a_base").depth_sensor.ceiling


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a_base", "grasp_five_finger"])
def test_sliders_at_their_ends_make_valid_scenarios(name, tmp_path):
    meshcat = start_meshcat(live=True)
    run = LiveRun(load_resolved(name), name=name, meshcat=meshcat)
    controls = LiveControls(run, meshcat, out=tmp_path)
    for value in (-1e6, 1e6):
        for slider in meshcat.GetSliderNames():
            meshcat.SetSliderValue(slider, value)  # As near to it as its range permits.
        for _ in meshcat.GetSliderNames():
            controls.apply()
            resolve(run.scenario)
    assert run.scenario.planner.period == pytest.approx(0.2)


@pytest.mark.parametrize("name", ["a_base", "toss", "see_and_feel"])
def test_a_slider_keeps_within_the_declared_range_whatever_a_page_sends(name):
    scenario = load_scenario(name)

    class Run:
        def __init__(self):
            self.scenario, self.velocity = scenario, {}
            self.change = lambda edit: edit(scenario)
            self.set_velocity = self.velocity.update

    for slider in make_sliders(scenario):
        run = Run()
        for sent in (-1e308, 0.0, 1e308, float("nan"), float("inf"), -float("inf")):
            slider.apply(run, sent)
            for path, rules in slider.fields.items():
                key = path.split("_")[0].split(".")[-1]
                value = run.velocity[key] if run.velocity else value_at(scenario, path)
                value = np.linalg.norm(value) if isinstance(value, list) else value
                low, high = rules["typical"]
                assert scalar_problem(value, float, rules) is None, (path, sent)
                assert low - 1e-9 <= value <= high + 1e-9
        assert value == pytest.approx(high), "a value that is not finite was not ignored"


@pytest.mark.slow
@pytest.mark.parametrize("far", [0.0, 100.0])
def test_a_dragged_object_follows_until_it_is_let_go_also_through_a_change(far):
    """A point that is not on the object pulls a corner of its bounding box."""
    scenario = load_resolved("a_base", text=f"{{{STEP}}}")
    run = LiveRun(scenario, name="a_base", meshcat=start_meshcat(live=True))
    run.set_velocity(linear=0.0, angular=0.0)
    begin = run.last.X_WO.translation()
    corner, away = begin + np.array([0.05, 0.05, -0.05]), far * np.array([1.0, 1.0, -1.0])
    target = np.array([0.15, 0.0, 0.0])

    def advance(ticks):
        for _ in range(ticks):
            run.advance()
        return run.last.X_WO.translation()

    run.drag(corner + away, corner + target)
    first = advance(10)
    assert first[0] - begin[0] > 0.02
    run.change(lambda scenario: None)
    run.drag(corner, corner - 1.6 * target)
    second = advance(20)
    assert second[0] < begin[0] - 0.02
    run.let_go()
    released = advance(4)
    assert advance(4) == pytest.approx(released, abs=1e-4)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a_base", "{}"),
        ("pose_stream", f"{{{STEP}}}"),
        pytest.param("a_base", f"{{{STEP}, engine: mujoco}}", marks=pytest.mark.slow),
    ],
)
def test_an_object_in_long_steps_or_that_drake_does_not_simulate_is_not_dragged(name, text):
    run = LiveRun(load_resolved(name, text=text), name=name, meshcat=start_meshcat(live=True))
    assert not run.can_drag
    run.advance()


@pytest.mark.slow
def test_an_object_is_thrown_again_with_another_speed_in_the_same_direction(tmp_path):
    meshcat = start_meshcat(live=True)
    scenario = load_resolved("toss")
    run = LiveRun(scenario, name="toss", meshcat=meshcat)
    controls = LiveControls(run, meshcat, out=tmp_path)
    first = np.array(scenario.scenario.motion.velocity)
    meshcat.SetSliderValue("velocity [m/s]", 1.5)
    controls.apply()
    run.advance()
    controls._buttons["object: throw"]()
    assert run.time == 0
    run.advance()
    expected = 1.5 * first / np.linalg.norm(first)
    np.testing.assert_allclose(run.scenario.motion.velocity, expected)
    moved = run.last.X_WO.translation() - scenario.X_WO.translation()
    np.testing.assert_allclose(moved[:2], expected[:2] * run.last.time, atol=1e-3)


@pytest.mark.slow
def test_a_slider_moves_what_a_camera_shows_and_a_hidden_object_has_no_points(tmp_path):
    meshcat, text = start_meshcat(live=True), "{hand: {file: ''}, ring_contacts: 3}"
    scenario = load_resolved("see_and_feel", text=text)
    run = LiveRun(scenario, name="see_and_feel", meshcat=meshcat)
    controls = LiveControls(run, meshcat, out=tmp_path)
    for bias in (5.0, 15.0):
        meshcat.SetSliderValue("bias [mm]", bias)
        controls.apply()
        for _ in range(8):
            run.advance()
        shown = run.last.X_WO_estimated.translation() - run.last.X_WO.translation()
        share = np.linalg.norm([6, -6, 0]) / np.linalg.norm([6, -6, 5])  # The table corrects z.
        assert 1e3 * np.linalg.norm(shown) == pytest.approx(share * bias, abs=1.5)
    run.switch_sight()
    for _ in range(8):
        run.advance()
    assert run.last.time_since_measurement > 0.3


@pytest.mark.slow
def test_each_recording_is_saved_in_a_folder_of_its_own(tmp_path):
    run = LiveRun(load_resolved("a_base"), name="a_base", meshcat=start_meshcat(live=True))
    (tmp_path / "a_base-live-2").symlink_to(tmp_path / "elsewhere")
    run.advance()
    saved = [run.save(tmp_path).parent.name for _ in range(2)]
    assert saved == ["a_base-live-1", "a_base-live-3"]
    assert not (tmp_path / "elsewhere").exists()


@pytest.mark.slow
def test_fingers_are_lost_after_the_end_and_a_saved_run_has_only_what_has_happened(tmp_path):
    """A conveyor goes on beyond the end of the scenario."""
    scenario = load_resolved("f_damage", text="{simulation_duration: 20.0}")
    assert scenario.scenario.damage
    run = LiveRun(scenario, name="f_damage", meshcat=start_meshcat(live=True))
    run.advance()
    file = run.save(tmp_path).with_name("scenario.yaml")
    assert not load_resolved(file=file).scenario.damage
    short = load_resolved("a_base", text="{simulation_duration: 0.2}")
    run = LiveRun(short, name="a_base", meshcat=start_meshcat(live=True))
    while run.time < 0.35:
        run.advance()
    run.switch_finger(2)
    assert [event.contacts for event in run.scenario.damage] == [[2]]


def test_names_do_not_lead_out_of_the_folder(tmp_path):
    resolved, meshcat = load_resolved("a_base"), start_meshcat(live=True)
    for name in ("../a_base", "a/b", "_a", ".a", ""):
        with pytest.raises(ScenarioError, match="a run's name must have only letters"):
            LiveRun(resolved, name=name, meshcat=meshcat)
        with pytest.raises(ScenarioError, match="a run's name must have only letters"):
            film_scenario(resolved, name, tmp_path / "films")
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_place_of_a_recording_is_told_to_the_terminal(tmp_path):
    meshcat, told = start_meshcat(live=True), []
    run = LiveRun(load_resolved("a_base"), name="a_base", meshcat=meshcat)
    controls = LiveControls(run, meshcat, out=tmp_path, tell=told.append)
    run.advance()
    controls._save()
    assert told == [f"saved in {tmp_path / 'a_base-live-1' / 'recording.html'}"]


@pytest.mark.slow
def test_a_hand_that_has_closed_says_that_it_keeps_its_fingers(tmp_path):
    scenario = load_resolved("grasp_five_finger", text="{planner: {static_duration: 0.1}}")
    run = LiveRun(scenario, name="grasp", meshcat=(meshcat := start_meshcat(live=True)))
    LiveControls(run, meshcat, out=tmp_path)
    assert meshcat.GetButtonClicks("finger 4 (finger_4_tip): lose / give back") == 0
    run.advance()
    for has_closed in (False, True):
        run.timeline.has_closed = has_closed
        run.switch_finger(0)
        texts = [text for _, text in run.timeline.data()["events"]]
        assert any("keeps finger 0 (finger_0_tip)" in text for text in texts) == has_closed


def test_a_run_goes_on_after_a_refused_change():
    scenario = load_scenario("fault_low_rate")
    run = LiveRun(resolve(scenario), name="low", meshcat=start_meshcat(live=True))
    period = run.scenario.planner.period
    run.change(lambda scenario: setattr(scenario.planner, "period", 10.0))
    assert "sample_period" in run.timeline.now()["events"][-1][1]
    assert run.scenario.planner.period == period
    run.advance()
    assert run.time == period


def test_refused_changes_of_velocity_and_sight_leave_nothing_for_a_new_start(monkeypatch):
    run = LiveRun(load_resolved("a_base"), name="a_base", meshcat=start_meshcat(live=True))
    run.set_velocity(linear=0.03)
    run.set_velocity(linear=1e9)
    refused = run.timeline.now()["events"][-1][1]
    assert refused.startswith("refused: ")
    assert "profile" in refused
    with monkeypatch.context() as context:
        context.setattr(run, "_simulate", _refuse)
        run.switch_sight()
    assert not run.is_hidden
    run.switch_sight()
    assert run.is_hidden
    assert run.scenario.sensor.faults.nan_probability == 1
    run.reset()
    assert run.scenario.motion.velocities()[-1][1] == 0.03


def _refuse():
    raise InvalidArgumentError("refused")


@pytest.mark.slow
def test_the_command_prints_a_local_address_and_serves_until_it_is_interrupted(tmp_path):
    command = [sys.executable, "-m", "drake_pregrasp", "live", "a_base"]
    with subprocess.Popen([*command, "--out", str(tmp_path)], stdout=subprocess.PIPE) as process:
        assert process.stdout.readline().startswith(b"kernels ")
        words = process.stdout.readline().decode().split()
        address = next(word for word in words if word.startswith("http://127.0.0.1:"))
        with urllib.request.urlopen(f"{address}timeline") as answer:
            timeline = json.load(answer)
        assert timeline["title"].startswith("a_base")
        with urllib.request.urlopen(address) as answer:
            assert b"followRun()" in answer.read()
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 0
    assert list(tmp_path.iterdir()) == []
