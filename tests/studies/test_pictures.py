"""Pictures by Drake's VTK renderer, and the pages that show them."""

from itertools import pairwise

import numpy as np
import pytest
from PIL import Image
from pydrake.geometry import Rgba, SceneGraph, Sphere
from pydrake.math import RigidTransform

from drake_pregrasp import load_resolved
from drake_pregrasp.studies.gallery import gallery, pictures
from drake_pregrasp.studies.gallery.film import film_scenario
from drake_pregrasp.studies.gallery.gallery import FRAME_TIME, film_grasp, make_gallery
from drake_pregrasp.studies.gallery.pictures import WHITE, Light
from drake_pregrasp.visualization.drawing import camera_pose

FORWARD = [0.0, 0.0, 1.0]
MIDDLE, CORNER = (10, 10), (0, 0)
BALL = Sphere(0.1)
AHEAD = RigidTransform()


def picture(light, background=WHITE, shape=BALL, p_WS=(0.0, 0.0, 1.0), X_WK=AHEAD):
    """Returns a picture of a red shape S, for a camera that looks along z a metre before it."""
    scene = SceneGraph()
    scene.AddRenderer("vtk", pictures.lit_renderer([light], background))
    red = pictures.coloured(RigidTransform(p_WS), shape, Rgba(0.8, 0.1, 0.1), "red")
    scene.RegisterAnchoredGeometry(scene.RegisterSource("test"), red)
    query = scene.get_query_output_port().Eval(scene.CreateDefaultContext())
    return pictures.take_picture(query, pictures.color_camera((21, 21), 0.5), X_WK)


def test_a_picture_has_its_background_colours_and_lights():
    """More light makes what is red brighter, and it comes from its own direction and frame."""
    np.testing.assert_array_equal(picture(Light(FORWARD, 1.0))[CORNER], 255)
    blue = picture(Light(FORWARD, 1.0), (0.0, 0.0, 1.0))[CORNER]
    np.testing.assert_array_equal(blue, [0, 0, 255])
    dim, bright = (picture(Light(FORWARD, share))[MIDDLE].astype(int) for share in (0.4, 0.9))
    assert bright[0] > dim[0] > max(dim[1:])
    ahead, back = (picture(Light([0, 0, z], 1.0, "world"))[MIDDLE] for z in (1.0, -1.0))
    assert int(ahead[0]) > int(back[0])


def test_a_camera_looks_at_its_target_and_keeps_upright():
    """10 cm higher is 5.6 pixels higher: a focal length of 41, times 9 cm aside over 66 cm off."""
    x, y, z = target = np.array([0.02, 0.01, 0.05])
    look = {"shape": Sphere(0.05), "X_WK": camera_pose(target, np.array([0.5, -0.4, 0.3]))}
    for height, above in ((0.0, 0.0), (0.1, 5.6)):
        image = picture(Light(FORWARD, 1.0), p_WS=[x, y, z + height], **look)
        row, column = np.mean(np.argwhere(image[..., 1] < 128), axis=0)
        assert (row, column) == pytest.approx((10 - above, 10), abs=0.8)


def test_a_mesh_is_drawn_where_its_triangles_are_lifted_to():
    """Lifted towards the camera by half the way, it looks twice as large."""
    corners = np.array([[-0.1, -0.1, 0], [0, 0.15, 0], [0.1, -0.1, 0]])
    images = [
        picture(Light(FORWARD, 1.0), shape=pictures.drawn_mesh(corners[None], lift=lift))
        for lift in (0.0, 0.5)
    ]
    areas = [np.sum(image[..., 1] < 128) for image in images]
    assert 3 < areas[1] / areas[0] < 5


@pytest.mark.slow
def test_a_hand_is_seen_at_four_moments_that_differ():
    resolved = load_resolved("grasp_five_finger", text="{simulation_duration: 8.0}")
    image = film_grasp(resolved).at_phases()
    assert image.dtype == np.uint8
    height, width, _ = image.shape
    assert width == 4 * height + 3 * 8
    moments = [image[:, k * (height + 8) :][:, :height].astype(float) for k in range(4)]
    for first, second in pairwise(moments):
        assert np.mean(np.any(np.abs(first - second) > 30, axis=2)) > 0.01
    for moment in moments:  # Something is there, and not everywhere.
        background = np.mean(np.all(np.abs(moment - moment[0, 0]) < 2, axis=2))
        assert 0.2 < background < 0.9


def colourful(image):
    """Returns the share of pixels with a strong colour."""
    return np.mean(np.ptp(image.astype(int), axis=2) > 60)


@pytest.mark.slow
def test_a_film_shows_regions_at_the_rate_of_its_frames():
    text = "{simulation_duration: 0.3, planner: {static_duration: 0.0}}"
    frames = film_grasp(load_resolved("grasp_five_finger", text=text)).frames
    assert len(frames) == 1 + round(0.3 / FRAME_TIME)
    assert all(frame.shape == frames[0].shape for frame in frames)
    assert colourful(frames[-1]) > 0.01  # Without regions and goals it is 0.003.


@pytest.mark.slow
def test_a_film_of_any_scenario_is_slow_at_its_event(tmp_path):
    """Contacts adapt after 2 s; the motion before and after it is shown in fewer pictures."""
    text = "{simulation_duration: 4.0, planner: {static_duration: 2.0}}"
    path = film_scenario(load_resolved("a_base", text=text), "a_base", tmp_path)
    with Image.open(path) as film:
        pictures_near_event = 0.8 / 0.025
        others = (4.0 - 0.8) / 0.4
        assert film.n_frames == pytest.approx(pictures_near_event + others, abs=3)
        film.seek(film.n_frames - 1)
        last = np.array(film.convert("RGB"))
    assert colourful(last[:, 250:]) > 0.02
    assert np.mean(last[:, :250].min(axis=2) < 100) > 0.01  # The timeline, in dark letters.


@pytest.mark.slow
def test_the_gallery_shows_a_picture_of_each_scenario(tmp_path, monkeypatch):
    shown = {name: own for name, own in gallery.shipped_scenarios().items() if name == "box"}
    monkeypatch.setattr(gallery, "shipped_scenarios", lambda: shown)
    text = make_gallery(tmp_path).read_text()
    assert (tmp_path / "box.png").stat().st_size > 10_000
    assert f"### `box`: {shown['box'][1]}\n\n![box](box.png)" in text
