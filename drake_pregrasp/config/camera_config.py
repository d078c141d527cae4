"""Configuration of simulated depth cameras."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.object_config import POINT, zeros

_ASIDE = 1e-3  # Least horizontal distance of a camera from its target, in metres.


@dataclass
class CameraConfig:
    """A depth camera that stands still and looks at a point."""

    # Position of the camera in W, in metres.
    position: list[float] = field(default_factory=lambda: [0.45, -0.45, 0.45], metadata=POINT)

    # Point in W in the middle of its picture, in metres; not straight above or below the camera.
    target: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.05], metadata=POINT)

    # Error of its calibrated place: displacement in W of what it sees, in metres.
    bias: list[float] = field(
        default_factory=zeros, metadata=POINT | {"typical": (0.001, 0.02), "unit": "mm"}
    )

    # Standard deviation of a further displacement that drifts, along each axis of W, in metres.
    drift_std: float = field(default=0.0, metadata={"at_least": 0, "at_most": 1})

    # Time constant of the drift, a Gauss-Markov process, in seconds.
    drift_time: float = field(default=30.0, metadata={"at_least": 0.01, "at_most": 1e6})

    # Width of its picture, in pixels.
    width: int = field(default=320, metadata={"at_least": 16, "at_most": 1280})

    # Height of its picture, in pixels.
    height: int = field(default=240, metadata={"at_least": 16, "at_most": 1280})

    # Vertical field of view, in radians.
    field_of_view: float = field(
        default=0.8, metadata={"at_least": 0.05, "at_most": math.radians(120)}
    )

    @property
    def corner_angle(self) -> float:
        """Angle between the middle and a corner of the picture, in radians."""
        half_height = math.tan(self.field_of_view / 2)
        return math.atan(half_height * math.hypot(1, self.width / self.height))

    def angles_to(self, p_WB: FloatArray, radius: float) -> FloatArray:
        """Returns angles from the middle of the picture to balls, shape (k,), in radians.

        They are negative for balls that cover the middle.

        Args:
            p_WB: Centres of the balls in W, shape (k, 3), in metres.
            radius: Their radius, in metres.
        """
        ahead, rays = np.subtract(self.target, self.position), p_WB - self.position
        across, away = (np.linalg.norm(v, axis=1) for v in (np.cross(rays, ahead), rays))
        centers = np.arctan2(across, rays @ ahead)
        angles: FloatArray = centers - np.arcsin(radius / np.maximum(away, radius))
        return angles


@dataclass
class DepthSensorConfig:
    """Depth cameras that take pictures at the same time, and the points of the object in them."""

    # The cameras. With one at least, they take the place of the pose sensor.
    cameras: list[CameraConfig] = field(default_factory=list, metadata={"max_length": 8})

    # Seconds between pictures.
    period: float = field(default=0.05, metadata={"at_least": 0.005, "at_most": 10})

    # Seconds from a picture to the arrival of its points.
    latency: float = field(default=0.03, metadata={"at_least": 0.001, "at_most": 1})

    # Largest number of points of a picture.
    points: int = field(default=500, metadata={"at_least": 1, "at_most": 5000})

    # Standard deviation of the white noise of a point along the ray from the camera, in metres.
    noise: float = field(default=0.001, metadata={"at_least": 0, "at_most": 1})

    # Points nearer than this to a link of the hand, at the measured joint positions, are left out,
    # in metres.
    link_margin: float = field(default=0.006, metadata={"at_least": 0, "at_most": 1})

    # Points below this height over the table are left out, in metres.
    table_margin: float = field(default=0.004, metadata={"at_least": -10, "at_most": 1})

    # Points above this height over the table are left out, in metres.
    ceiling: float = field(default=0.3, metadata={"at_least": -10, "at_most": 10})

    # Scale of the mesh with which the object is seen and felt, over the true one.
    mesh_scale: float = field(default=1.0, metadata={"at_least": 0.5, "at_most": 2})


def camera_problems(config: DepthSensorConfig) -> Iterator[tuple[str, str]]:
    """Yields the key and the problem, in one line, of each camera that looks nowhere.

    Args:
        config: Cameras with each field in its range.
    """
    for index, camera in enumerate(config.cameras):
        if math.dist(camera.position[:2], camera.target[:2]) < _ASIDE:
            problem = f"{camera.target} is straight above or below position {camera.position}"
            yield f"cameras[{index}].target", f"{problem}; move it aside by 1 mm at least"


def sight_problems(
    config: DepthSensorConfig, p_WO: FloatArray, radius: float
) -> Iterator[tuple[str, str]]:
    """Yields the key and the problem, in one line, of each camera that never sees the object.

    Args:
        config: Cameras that look somewhere.
        p_WO: Expected path of the middle of the object in W, shape (k, 3), in metres.
        radius: Radius of a ball around the object, in metres.
    """
    start = [round(x, 3) for x in p_WO[0].tolist()]
    for index, camera in enumerate(config.cameras):
        off, most = np.degrees([np.min(camera.angles_to(p_WO, radius)), camera.corner_angle])
        if off > most:
            yield (
                f"cameras[{index}].target",
                f"{camera.target}: from {camera.position}, the object stays {off:.3g}° off the"
                f" middle of the picture, which ends at {most:.3g}°; the object starts at {start}",
            )
