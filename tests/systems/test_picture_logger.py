"""Pictures of depth cameras, as pages show them."""

import io

import numpy as np
import pytest
from driven import Driven
from PIL import Image
from pydrake.common.value import AbstractValue
from pydrake.systems.sensors import ImageDepth32F

from drake_pregrasp import CameraConfig
from drake_pregrasp.visualization.picture_logger import PictureLogger

NEAR = CameraConfig(position=[0.5, 0.0, 0.0], target=[0.0, 0.0, 0.0])
FAR = CameraConfig(position=[2.0, 0.0, 0.0], target=[0.0, 0.0, 0.0])


def pictures(depths, cameras=(NEAR,)):
    """Returns what is passed on for a picture with some depths."""
    found = []
    logger = PictureLogger(cameras, period=0.1, sink=lambda *told: found.append(told))
    image = ImageDepth32F(len(depths), 2)
    image.mutable_data[:, :, 0] = depths
    inputs = {f"depth_image_{k}": AbstractValue.Make(image) for k in range(len(cameras))}
    driven = Driven(logger, **inputs)
    driven.at(0.3)
    driven.publish()
    return [(t, camera, np.array(Image.open(io.BytesIO(png)))) for t, camera, png in found]


def test_what_is_nearer_is_brighter_and_nothing_is_black():
    ((time, camera, grey),) = pictures([0.1, 0.3, 0.4, 0.5, 0.6, 0.7, 3.0, np.inf])
    assert (time, camera) == (pytest.approx(0.3), 0)
    assert grey.shape == (2, 8)
    np.testing.assert_array_equal(grey[0], [255, 255, 191, 128, 64, 0, 0, 0])
    np.testing.assert_array_equal(grey[1], grey[0])


def test_each_camera_has_the_depths_around_its_target():
    near, far = pictures([0.5, 2.0], (NEAR, FAR))
    assert near[2][0].tolist() == [128, 0]
    assert far[2][0].tolist() == [255, 128]
    assert (near[1], far[1]) == (0, 1)


def test_pictures_come_at_the_period():
    times = []
    logger = PictureLogger([NEAR], period=0.1, sink=lambda time, *_: times.append(time))
    image = ImageDepth32F(2, 2)
    driven = Driven(logger, depth_image_0=AbstractValue.Make(image))
    driven.advance(0.35)
    np.testing.assert_allclose(times, [0.0, 0.1, 0.2, 0.3])
