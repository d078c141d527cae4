"""The live view, as someone uses it who opens its page in a browser."""

import io
import queue
import threading
import time
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest
from browser import BROWSER, PATIENCE, Browser
from PIL import Image
from pydrake.math import RollPitchYaw

from drake_pregrasp import load_resolved, load_scenario
from drake_pregrasp.live.live_controls import LiveControls
from drake_pregrasp.live.live_page import served_page
from drake_pregrasp.live.live_run import LiveRun
from drake_pregrasp.simulation.recording import start_meshcat

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None, reason="needs Chromium (Debian: chromium)"),
]


class Page:
    """A live run in a browser, with a mouse that presses its controls."""

    def __init__(self, name: str, text: str, folder: Path) -> None:
        opened: queue.Queue[str] = queue.Queue()

        def serve() -> None:  # Meshcat must be used by the thread that has made it.
            meshcat = start_meshcat(live=True)
            self.run = LiveRun(load_resolved(name, text=text), name=name, meshcat=meshcat)
            self.controls = LiveControls(self.run, meshcat, out=folder / "saved")
            with served_page(meshcat, self.controls) as address:
                opened.put(address)
                self.controls.serve()

        self.thread = threading.Thread(target=serve)
        self.thread.start()
        self.browser = Browser(folder / "profile", opened.get(timeout=PATIENCE))
        self.browser.until("window.viewer && 'stop' in viewer.gui_controllers")

    def close(self) -> None:
        self.controls.is_stopped = True
        self.thread.join()
        self.browser.close()

    def mouse(self, kind: str, x: float, y: float, *, ctrl: bool = False) -> None:
        """Presses, moves or releases the mouse with its left button."""
        options = {"button": "left", "clickCount": 1, "modifiers": 2 * ctrl}
        self.browser.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, **options)

    def seen(self) -> np.ndarray:
        """Returns where the object is in the picture: x and y from -1 to 1."""
        place = """new Promise(resolve => requestAnimationFrame(() => {
            const object = viewer.scene_tree.find(["drake", "pregrasp", "object"]).object;
            viewer.controls.update();
            viewer.camera.updateMatrixWorld();
            const place = object.getWorldPosition(viewer.camera.position.clone());
            resolve(place.project(viewer.camera).toArray());
        }))"""
        return np.array(self.browser.value(place))[:2]

    def click(self, name: str, share: float = 0.5) -> None:
        """Clicks on a button, or at a share of a slider's width."""
        self.browser.until(f'"{name}" in viewer.gui_controllers')  # Not while it is being saved.
        place = f"""(() => {{
            const row = viewer.gui_controllers["{name}"].domElement.closest("li");
            row.scrollIntoView();
            const box = (row.querySelector(".slider") ?? row).getBoundingClientRect();
            return [box.x + {share} * box.width, box.y + box.height / 2];
        }})()"""
        x, y = self.browser.value(place)
        for kind in ("mousePressed", "mouseReleased"):
            self.mouse(kind, x, y)

    def slide(self, name: str, share: float) -> float:
        """Moves a slider, and returns the value that it then shows."""
        self.click(name, share)
        return float(self.browser.value(f'viewer.gui_controllers["{name}"].getValue()'))

    def told(self, text: str) -> None:
        """Waits until the page shows a text."""
        shown = 'document.getElementById("timeline").innerText.replace(/\\s+/g, " ")'
        self.browser.until(f'{shown}.includes("{text}")')

    def pass_time(self, duration: float) -> None:
        """Waits until the run has simulated for a time."""
        end = self.run.time + duration
        self.reaches(lambda: self.run.time >= end)

    def place(self) -> np.ndarray:
        """Returns the true position of the object."""
        return self.run.last.X_WO.translation()

    def moment(self) -> tuple[float, float, float]:
        """Returns a time, and the object's x and yaw at that time."""
        last = self.run.last
        yaw = RollPitchYaw(last.X_WO.rotation()).yaw_angle()
        return last.time, last.X_WO.translation()[0], yaw

    def reaches(self, condition) -> None:
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end
            time.sleep(0.05)


@pytest.fixture
def opened(tmp_path):
    pages = []

    def open_page(name, text="{}"):
        pages.append(Page(name, text, tmp_path))
        return pages[-1]

    yield open_page
    for page in pages:
        page.close()


@pytest.fixture
def page(opened):
    return opened("a_base", "{planner: {static_duration: 0.2}}")


def test_sliders_change_what_they_name(page):
    """The object moves as the sliders say; the other settings reach the planner and the sensor."""
    run, degree = page.run, np.pi / 180
    speed = 1e-3 * page.slide("linear velocity [mm/s]", 0.7)
    rate = degree * page.slide("angular velocity [deg/s]", 0.8)
    assert speed > 0.02
    assert rate > 0.3
    page.reaches(lambda: run.scenario.motion.velocities()[-1][1:] == pytest.approx([speed, rate]))
    page.pass_time(0.4)
    (t0, x0, yaw0), _, (t1, x1, yaw1) = page.moment(), page.pass_time(0.5), page.moment()
    assert (x1 - x0) / (t1 - t0) == pytest.approx(speed, rel=0.02)
    assert (yaw1 - yaw0) / (t1 - t0) == pytest.approx(rate, rel=0.02)
    for name, share, fields, unit in (
        ("position std [mm]", 0.2, "sensor.position_std planner.estimator.position_std", 1e-3),
        (
            "orientation std [deg]",
            0.1,
            "sensor.orientation_std planner.estimator.orientation_std",
            degree,
        ),
        ("position spread [mm]", 0.2, "planner.position_spread", 1e-3),
        ("lookahead [ms]", 0.3, "planner.estimator.lookahead", 1e-3),
    ):
        value = unit * page.slide(name, share)
        for field in fields.split():
            read = attrgetter(field)
            assert read(load_scenario("a_base")) != pytest.approx(value)
            page.reaches(lambda read=read, value=value: read(run.scenario) == pytest.approx(value))
    period = 1e-3 * page.slide("period [ms]", 0.03)
    assert period < 0.03
    page.reaches(lambda: run.scenario.planner.period == pytest.approx(period))
    page.click("pause / resume")
    page.told("paused")
    before = run.time
    page.click("step")
    page.reaches(lambda: run.time > before)
    assert run.time - before == pytest.approx(period)


def test_buttons_do_what_they_say(page, tmp_path):
    run = page.run
    page.click("next strategy")
    page.told("strategy msv")
    assert run.scenario.planner.strategy == "msv"
    page.click("finger 2: lose / give back")
    page.told("finger 2 out of use")
    assert run.timeline.states["2"] == "out of use"
    page.click("finger 2: lose / give back")
    page.told("finger 2 active")
    page.click("object: hide / show")
    page.told("lost from sight")
    page.click("object: hide / show")
    page.told("tracked")
    x = page.place()
    page.click("object: nudge")
    page.reaches(lambda: np.linalg.norm(page.place() - x) > 0.005)  # The conveyor takes 5 s.
    page.click("pause / resume")
    page.told("paused")
    time = run.time
    (tmp_path / "saved").touch()
    page.click("save the recording")
    page.told("is a file, not a folder")
    (tmp_path / "saved").unlink()
    page.click("save the recording")
    page.told("saved in")
    recording = tmp_path / "saved" / "a_base-live-1" / "recording.html"
    assert run.time == time
    assert "finger 2 has a goal again" in recording.read_text(encoding="utf-8")
    again = load_scenario(file=recording.with_name("scenario.yaml"))
    assert again.planner.strategy == "msv"
    assert again.simulation_duration == time
    page.click("pause / resume")
    page.click("reset")
    page.reaches(lambda: run.time < time)
    page.click("stop")
    page.thread.join(timeout=PATIENCE)
    assert not page.thread.is_alive()


def test_a_hand_closes_when_it_is_told_to(opened):
    # The belt stays within the carrier's travel.
    slow = "motion: {linear_velocity: 0.001, angular_velocity: 0.0}"
    page = opened(
        "grasp_five_finger", f"{{grasp: {{close_at: 1000}}, {slow}, simulation_duration: 2000}}"
    )
    page.told("follows the object")
    page.click("hand: close")
    page.told("hand holds")  # Phases before it may be over before a slow browser has shown them.


def test_the_camera_goes_with_the_object_and_the_mouse_turns_it(page):
    direction = "viewer.camera.position.clone().sub(viewer.controls.target).toArray()"
    assert page.slide("linear velocity [mm/s]", 0.99) > 90
    page.pass_time(1.0)
    x, first = page.place()[0], page.browser.value(direction)
    np.testing.assert_allclose(page.seen(), 0, atol=0.1)
    page.mouse("mousePressed", 450, 400)
    page.mouse("mouseMoved", 500, 400)
    page.mouse("mouseReleased", 500, 400)
    page.pass_time(1.0)
    turned = page.browser.value(direction)
    assert np.linalg.norm(np.subtract(turned, first)) > 0.01
    page.pass_time(4.0)
    assert page.place()[0] - x > 0.5  # Five times its size.
    np.testing.assert_allclose(page.browser.value(direction), turned, atol=1e-6)
    np.testing.assert_allclose(page.seen(), 0, atol=0.1)
    page.browser.ask("Page.reload")
    page.browser.until("window.viewer?.controls?.target.x > 0.5")
    np.testing.assert_allclose(page.seen(), 0, atol=0.1)


@pytest.fixture
def resting(opened):
    """A page with a hand over an object that rests."""
    still = "motion: {linear_velocity: 0, angular_velocity: 0}, planner: {static_duration: 0.2}"
    page = opened("grasp_five_finger", f"{{{still}, grasp: {{close_at: 1000}}}}")
    page.pass_time(2.0)
    if not page.browser.value('typeof mouseDrag !== "undefined"'):
        pytest.skip("needs the page of Drake 1.57 or later")
    page.told("drag the object")
    return page


def place_in_picture(page):
    """Returns where the lower half of the object is in the picture, in pixels."""
    width, height = page.browser.value("[innerWidth, innerHeight]")
    x, y = page.seen()
    return (x + 1) / 2 * width, (1 - y) / 2 * height + 40  # Pulled higher, a cube tips.


def test_the_mouse_drags_the_object_and_the_hand_follows(resting):
    """The hand takes it where it was let go, and the camera waits as long as it is dragged."""
    run, (x, y) = resting.run, place_in_picture(resting)
    begin, camera = resting.place(), "viewer.controls.target.toArray()"
    seen = resting.browser.value(camera)
    resting.mouse("mousePressed", x, y, ctrl=True)
    target = "mouseDrag.targetWorld.toArray()"
    first = resting.browser.value(target)
    for step in range(1, 31):
        resting.mouse("mouseMoved", x + 5 * step, y, ctrl=True)
        resting.pass_time(0.05)
    resting.pass_time(1.0)
    moved = np.subtract(resting.browser.value(target), first)
    way = resting.place() - begin
    assert np.linalg.norm(way) > 0.03
    np.testing.assert_allclose(resting.browser.value(camera), seen, atol=1e-6)
    assert way @ [moved[0], -moved[2], moved[1]] > 0  # Axes of the viewer and those of Drake.
    resting.mouse("mouseReleased", x + 150, y, ctrl=True)
    resting.pass_time(1.0)
    released = resting.place()
    assert np.linalg.norm(released - begin - way) < 0.01
    resting.pass_time(1.0)
    np.testing.assert_allclose(resting.place(), released, atol=1e-3)
    np.testing.assert_allclose(run.last.X_WO_estimated.translation(), released, atol=2e-3)
    goals = run.last.p_WC.reshape(-1, 3)
    assert np.all(np.abs((run.last.X_WO.inverse() @ goals.T).T) < 0.055)  # Of a cube of 0.1 m.
    resting.click("hand: close")
    resting.told("hand holds")
    assert resting.place()[2] > 0.1
    for _ in range(40):  # A busy machine draws few pictures, with which the camera moves.
        shift = np.subtract(resting.browser.value(camera), seen)
        if is_there := np.allclose(shift[[0, 2]], [way[0], -way[1]], atol=0.01):
            break
        resting.pass_time(0.1)
    assert is_there, (shift, way)
    assert resting.controls.refused == 0


def test_only_the_object_is_dragged_and_only_with_ctrl(resting):
    x, y = place_in_picture(resting)
    begin = resting.place()
    for ctrl, press in ((False, (x, y)), (True, (x, y + 140))):
        resting.mouse("mousePressed", *press, ctrl=ctrl)
        assert not resting.browser.value("mouseDrag.isActive()")
        resting.mouse("mouseMoved", x + 150, press[1], ctrl=ctrl)
        resting.pass_time(0.5)
        resting.mouse("mouseReleased", x + 150, press[1], ctrl=ctrl)
    np.testing.assert_allclose(resting.place(), begin, atol=1e-3)


def test_the_page_shows_the_whole_scene(page, tmp_path):
    """The table, the object, and regions on it, soon after the page is opened."""
    page.pass_time(4.0)
    image = np.array(Image.open(io.BytesIO(page.browser.picture())).convert("RGB"), dtype=float)
    spread = image.max(axis=2) - image.min(axis=2)
    scene = np.s_[150:, 360:650]  # Between the timeline and the controls.
    assert np.mean(spread[scene] > 40) > 0.05  # Regions.
    assert np.mean(image[scene].mean(axis=2) < 215) > 0.3  # Object and table.
