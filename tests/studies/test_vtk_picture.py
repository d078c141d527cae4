"""Pictures by Drake's VTK renderer: background, colours and lights."""

import numpy as np
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    RenderCameraCore,
    Rgba,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.systems.sensors import CameraInfo

from drake_pregrasp.studies.vtk_picture import WHITE, Light, coloured, lit_renderer, take_picture

CAMERA = ColorRenderCamera(
    RenderCameraCore("vtk", CameraInfo(21, 21, 0.5), ClippingRange(0.01, 10.0), RigidTransform())
)
FORWARD = [0.0, 0.0, 1.0]
MIDDLE, CORNER = (10, 10), (0, 0)


def picture(light, background=WHITE):
    """A red ball a metre before the camera."""
    scene = SceneGraph()
    scene.AddRenderer("vtk", lit_renderer([light], background))
    ball = coloured(RigidTransform([0, 0, 1]), Sphere(0.1), Rgba(0.8, 0.1, 0.1), "ball")
    scene.RegisterAnchoredGeometry(scene.RegisterSource("test"), ball)
    query = scene.get_query_output_port().Eval(scene.CreateDefaultContext())
    return take_picture(query, CAMERA, RigidTransform())


def test_around_what_is_drawn_there_is_the_background():
    np.testing.assert_array_equal(picture(Light(FORWARD, 1.0))[CORNER], 255)
    blue = picture(Light(FORWARD, 1.0), (0.0, 0.0, 1.0))[CORNER]
    np.testing.assert_array_equal(blue, [0, 0, 255])


def test_shapes_have_their_colour_and_more_light_makes_them_brighter():
    dim, bright = (picture(Light(FORWARD, share))[MIDDLE].astype(int) for share in (0.4, 0.9))
    assert dim[0] > max(dim[1:])
    assert bright[0] > dim[0]


def test_a_light_shines_in_its_own_direction_and_frame():
    ahead, back = (picture(Light([0, 0, z], 1.0, "world"))[MIDDLE] for z in (1.0, -1.0))
    assert int(ahead[0]) > int(back[0])
