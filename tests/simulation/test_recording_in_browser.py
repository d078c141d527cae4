"""The recording, as someone sees it who opens it in a browser."""

import subprocess
from pathlib import Path

import numpy as np
import pytest
from browser import BROWSER, FLAGS, Browser
from matplotlib.image import imread
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.systems.analysis import Simulator

from drake_pregrasp import load_scenario, make_diagram

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None, reason="needs Chromium (Debian: chromium)"),
]

HIDE = 'document.getElementById("timeline")?.remove();'
TIME = "--virtual-time-budget=5000"


def picture(recording: Path, time: float, folder: Path) -> np.ndarray:
    """Returns the scene at a moment, shape (height, width, 3), between 0 and 1."""
    seek = f"viewer.animator.pause(); viewer.animator.seek({time}); {HIDE}"
    page = folder / f"at_{time}.html"
    script = f"<script>setTimeout(() => {{ {seek} }}, 500);</script></body>"
    page.write_text(recording.read_text(encoding="utf-8").replace("</body>", script))
    png = folder / f"at_{time}.png"
    profile = f"--user-data-dir={folder / f'profile_{time}'}"
    command = [BROWSER, *FLAGS, TIME, profile, f"--screenshot={png}", page.as_uri()]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    return imread(png)[:, :, :3]


def colored(image: np.ndarray) -> np.ndarray:
    """Mask of saturated pixels: the regions and goals; everything else in the scene is greyish."""
    return image.max(axis=2) - image.min(axis=2) > 0.15


@pytest.fixture(scope="module")
def pictures(recorded_run, tmp_path_factory):
    folder = tmp_path_factory.mktemp("pictures")
    recording = recorded_run.folder / "recording.html"
    return {time: picture(recording, time, folder) for time in (1.0, 3.0, 7.5)}


def test_regions_are_seen(pictures):
    for image in pictures.values():
        assert 0.01 < np.mean(colored(image)) < 0.3


def test_regions_keep_their_colors_while_contacts_are_held(pictures):
    early, late = colored(pictures[1.0]), colored(pictures[3.0])
    assert np.sum(early != late) < 0.3 * np.sum(early)  # The object turns by 2 degrees.
    assert np.sum(late) == pytest.approx(np.sum(early), rel=0.1)


def test_regions_grow_when_contacts_adapt(pictures, base_log):
    """The log says that regions cover more of the surface then; so must the picture."""
    covered = sum(base_log[f"region{i}_size"] for i in range(5))
    assert covered[-1] > 1.3 * covered[0]
    assert np.sum(colored(pictures[7.5])) > 1.1 * np.sum(colored(pictures[3.0]))
    assert np.mean(np.any(np.abs(pictures[7.5] - pictures[3.0]) > 0.1, axis=2)) > 0.01


def test_a_live_view_shows_what_a_recording_shows(recorded_run, pictures, tmp_path):
    """The whole scene, in the same colours, in a viewer of one's own."""
    scenario = load_scenario("a_base", text="{simulation_duration: 8.0}")
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    Simulator(make_diagram(scenario, meshcat=meshcat)).AdvanceTo(1.0)
    page = tmp_path / "live.html"
    page.write_text(meshcat.StaticHtml())
    live = picture(page, 1.0, tmp_path)
    assert np.mean(np.any(np.abs(live - pictures[1.0]) > 0.03, axis=2)) < 0.01


def test_a_recording_tells_what_happens_when_it_happens(recorded_run, base_log, tmp_path):
    browser = Browser(tmp_path, (recorded_run.folder / "recording.html").as_uri())
    try:
        browser.until("window.viewer && viewer.animator.duration > 7")
        for time, is_told in ((3.0, False), (4.2, True), (7.5, False)):
            browser.value(f"viewer.animator.pause(); viewer.animator.seek({time})")
            browser.until(
                f'document.getElementById("timeline-clock").textContent === "{time:.2f} s"'
            )
            caption = browser.value('document.getElementById("timeline-caption").textContent')
            assert caption == ("contacts adapt" if is_told else "")
            row = np.flatnonzero(np.isclose(base_log["time"], time))[0]
            rows = browser.value('document.getElementById("timeline-rows").innerText')
            assert f"{base_log['q_gii'][row]:.4f}" in rows
            assert rows.count("finger") == rows.count("active") == 5
        browser.value('document.querySelector("#timeline-events button").click()')
        browser.until("viewer.animator.playing && viewer.animator.mixer.timeScale < 1")
    finally:
        browser.close()


def test_goals_behind_the_object_are_seen_through_it(recorded_run, tmp_path):
    browser = Browser(tmp_path, (recorded_run.folder / "recording.html").as_uri())
    try:
        browser.until("window.viewer && viewer.animator.duration > 7")
        for i in range(5):
            path = f'["drake", "pregrasp", "goals", "{i}", "through", "<object>"]'
            assert (
                browser.value(f"viewer.scene_tree.find({path}).object.material.depthTest") is False
            )
    finally:
        browser.close()
