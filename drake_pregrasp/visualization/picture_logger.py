"""Pictures of depth cameras, for pages that show a run."""

from collections.abc import Callable, Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, EventStatus, LeafSystem
from pydrake.systems.sensors import ImageDepth32F, ImageFileFormat, ImageGrey8U, ImageIo

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.camera_config import CameraConfig

PictureSink = Callable[[float, int, bytes], None]
"""Function that is called with the time in seconds, the index of a camera, and its picture."""


class PictureLogger(LeafSystem):
    """Passes on the pictures of depth cameras as PNG files in grey.

    .. pydrake_system::

        name: PictureLogger
        input_ports:
        - depth_image_0

    Port `depth_image_0` accepts an `ImageDepth32F`; further cameras have `depth_image_1` and so on.
    What is near is bright: the greys are those of depths from 0.6 to 1.4 times the distance between
    the camera and its target.

    Args:
        cameras: The cameras.
        period: Seconds between pictures, greater than zero.
        sink: Function that is called with each picture.
    """

    def __init__(
        self, cameras: Sequence[CameraConfig], *, period: float, sink: PictureSink
    ) -> None:
        super().__init__()
        self._sink = sink
        self._distances = [np.subtract(c.target, c.position) for c in cameras]
        model = AbstractValue.Make(ImageDepth32F())
        self._images = [
            self.DeclareAbstractInputPort(f"depth_image_{index}", model)
            for index in range(len(cameras))
        ]
        self.DeclarePeriodicPublishEvent(period, 0.0, self._log)
        self.DeclareForcedPublishEvent(self._log)

    def _log(self, context: Context) -> EventStatus:
        for index, (port, way) in enumerate(zip(self._images, self._distances, strict=True)):
            picture = _png(port.Eval(context).data[:, :, 0], float(np.linalg.norm(way)))
            self._sink(context.get_time(), index, picture)
        return EventStatus.Succeeded()


def _png(depths: FloatArray, distance: float) -> bytes:
    """Returns a picture of depths in metres around a distance."""
    height, width = depths.shape
    image = ImageGrey8U(width, height)
    share = (depths / distance - 0.6) / 0.8  # 0 for what is near; infinite where nothing is seen.
    image.mutable_data[:, :, 0] = np.rint(255 * (1 - np.clip(share, 0.0, 1.0)))
    return bytes(ImageIo().Save(image, ImageFileFormat.kPng))
