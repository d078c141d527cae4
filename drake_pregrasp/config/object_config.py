"""The object and how it moves: the keys `object` and `motion` of a scenario."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pydrake.math import RollPitchYaw
from pydrake.multibody.tree import UniformGravityFieldElement

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.estimation.recorded_poses import RecordedPoses
from drake_pregrasp.geometry import shapes
from drake_pregrasp.geometry.random_objects import OBJECTS_URL, random_object
from drake_pregrasp.geometry.resting import settled_rotation, stable_rotation
from drake_pregrasp.geometry.solids import BoxSolid
from drake_pregrasp.interfaces.pose_files import read_poses
from drake_pregrasp.resources import resolve_path

GRAVITY: float = UniformGravityFieldElement.kDefaultStrength
"""Acceleration of gravity along -z of W in Drake's plants, in m/s²."""


def rpy_matrix(rpy: list[float]) -> FloatArray:
    """Returns the rotation matrix of roll, pitch and yaw in radians, shape (3, 3)."""
    R: FloatArray = RollPitchYaw(rpy).ToRotationMatrix().matrix()
    return R


def zeros() -> list[float]:
    """Returns three zeros: a default for points, directions and angles."""
    return [0.0, 0.0, 0.0]


POINT = {"length": 3, "at_least": -10, "at_most": 10}
"""Rules of a place, a direction or an orientation near the object or the hand."""


@dataclass
class BoxFields:
    """A box in a frame F, which the classes of this schema name."""

    # Edge lengths, in metres.
    size: list[float] = field(
        default_factory=zeros, metadata={"required": True, "length": 3, "above": 0, "at_most": 10}
    )

    # Centre in F, in metres.
    center: list[float] = field(default_factory=zeros, metadata=POINT)

    # Orientation in F, as roll, pitch and yaw, in radians.
    rpy: list[float] = field(default_factory=zeros, metadata=POINT)

    def make_solid(self) -> BoxSolid:
        """Returns the box, in F."""
        return BoxSolid(np.array(self.center), rpy_matrix(self.rpy), np.array(self.size))


_LENGTH = {"at_least": 0.001, "at_most": 1}
_MASS = {"above": 0, "at_most": 1000}

PLACED, SETTLED, STABLE = "placed", "settled", "stable"
"""Values of `Orientation.rest`."""


@dataclass(kw_only=True)
class Orientation:
    """Orientation of a shape about the origin of O, whose axes are those of W at the start."""

    # Roll, pitch and yaw of the shape in O, in radians.
    rpy: list[float] = field(default_factory=zeros, metadata=POINT)

    # Whether the shape is turned further, so that it rests on a table: not if `placed`; until it
    # rests if `settled`; to its most probable resting pose after a drop if `stable` (extra
    # `meshes`).
    rest: str = field(default=PLACED, metadata={"one_of": (PLACED, SETTLED, STABLE)})

    def turned(self, shape: shapes.Shape) -> shapes.Shape:
        """Returns a shape with this orientation in O."""
        shape = shape.turned(rpy_matrix(self.rpy))
        if self.rest == PLACED:
            return shape
        rotation = stable_rotation if self.rest == STABLE else settled_rotation
        return shape.turned(rotation(shape.mesh))


@dataclass
class Box(Orientation):
    """A homogeneous box whose frame O is at its centre."""

    # Edge lengths along the box's own x, y and z, in metres.
    size: list[float] = field(
        default_factory=lambda: [0.1, 0.1, 0.1],
        metadata={"length": 3, "at_least": 0.005, "at_most": 0.25},
    )

    # Mass, in kg.
    mass: float = field(default=0.4, metadata=_MASS)

    def make_shape(self) -> shapes.Shape:
        """Returns the shape in O."""
        return self.turned(shapes.box_shape(self.size))

    @property
    def is_aligned(self) -> bool:
        """Whether the edges of the box are along the axes of O."""
        return self.rest == PLACED and not any(self.rpy)


@dataclass
class Cylinder(Orientation):
    """A homogeneous cylinder along z, whose frame O is at its centre."""

    # Radius, in metres.
    radius: float = field(default=0.033, metadata=_LENGTH)

    # Length, in metres.
    length: float = field(default=0.12, metadata=_LENGTH)

    # Mass, in kg.
    mass: float = field(default=0.35, metadata=_MASS)

    def make_shape(self) -> shapes.Shape:
        """Returns the shape in O."""
        return self.turned(shapes.cylinder_shape(self.radius, self.length))


@dataclass
class Ball:
    """A homogeneous ball whose frame O is at its centre."""

    # Radius, in metres.
    radius: float = field(default=0.04, metadata=_LENGTH)

    # Mass, in kg.
    mass: float = field(default=0.15, metadata=_MASS)

    def make_shape(self) -> shapes.Shape:
        """Returns the shape in O."""
        return shapes.ball_shape(self.radius)


@dataclass
class Revolved(Orientation):
    """A homogeneous body of revolution about z, such as a bottle or a cup."""

    # Points (r, z) of the outline in metres, r >= 0, with z increasing along the outside, from the
    # axis back to the axis. An outline that does not end there is closed into a ring.
    profile: list[list[float]] = field(
        default_factory=list,
        metadata={
            "required": True,
            "min_length": 3,
            "max_length": 256,
            "elements": {"length": 2, "at_least": -1, "at_most": 1},
        },
    )

    # Mass, in kg.
    mass: float = field(default=0.3, metadata=_MASS)

    def make_shape(self) -> shapes.Shape:
        """Returns the shape in O."""
        return self.turned(shapes.revolved_shape(self.profile))


@dataclass
class Mesh(Orientation):
    """A homogeneous body with the surface of a mesh file, whose origin is that of O."""

    # OBJ, STL, PLY, OFF or glTF file with a watertight mesh, relative to the folder of the
    # scenario's file; package://drake_pregrasp/... for a shipped mesh; or objects://random/000.obj
    # to 999.obj for a random object of the extra `objects`.
    file: str = field(default="", metadata={"required": True, "path": True})

    # Length of one unit of the file, in metres. The unit of a random object is the metre.
    scale: float = field(default=1.0, metadata={"above": 0, "at_most": 1000})

    # Mass, in kg.
    mass: float = field(default=0.3, metadata=_MASS)

    def make_shape(self) -> shapes.Shape:
        """Returns the shape in O."""
        if self.file.startswith(OBJECTS_URL):
            return self.turned(random_object(self.file, self.scale))
        path = resolve_path(self.file, Path.cwd())
        return self.turned(shapes.load_shape(path, scale=self.scale))


ObjectConfig = Box | Cylinder | Ball | Revolved | Mesh


_LARGEST_SPEED = {"at_least": -10, "at_most": 10}
_LARGEST_TURN = {"at_least": -100, "at_most": 100}


@dataclass
class Conveyor:
    """A table that slides and turns, and moves the object by friction."""

    # Speed along x of W, in m/s.
    linear_velocity: float = field(
        default=0.001, metadata={**_LARGEST_SPEED, "typical": (-0.1, 0.1), "unit": "mm/s"}
    )

    # Turning rate about z of W, in rad/s.
    angular_velocity: float = field(
        default=0.0174,
        metadata={**_LARGEST_TURN, "typical": (-np.pi / 3, np.pi / 3), "unit": "deg/s"},
    )

    # Velocities over time, instead of the two above: rows [time, linear, angular] in s, m/s and
    # rad/s, with times that increase from 0. They are interpolated linearly; the last ones stay.
    profile: list[list[float]] = field(
        default_factory=list,
        metadata={
            "elements": {"length": 3, "at_least": -100, "at_most": 1e6},
            "max_length": 10_000,
        },
    )

    # Initial x and y of the object's centre of mass in W, in metres. The turntable starts at x, and
    # y must be on it.
    position: list[float] = field(
        default_factory=lambda: [0.0, 0.0],
        metadata={"length": 2, "at_least": -10, "at_most": 10},
    )

    # Angle of O about z of W at the start, in radians.
    yaw: float = field(default=0.0, metadata={"at_least": -10, "at_most": 10})

    def velocities(self) -> list[list[float]]:
        """Returns the profile; a constant velocity is a profile of one row."""
        return self.profile or [[0.0, self.linear_velocity, self.angular_velocity]]


@dataclass
class Toss:
    """Free flight under gravity: a tossed or a falling object."""

    # Initial position of the object's centre of mass in W, in metres.
    position: list[float] = field(
        default_factory=lambda: [0.0, 0.0, 1.0],
        metadata={"length": 3, "at_least": -100, "at_most": 100},
    )

    # Initial orientation of O in W, as roll, pitch and yaw, in radians.
    rpy: list[float] = field(default_factory=zeros, metadata=POINT)

    # Initial velocity of the centre of mass in W, in m/s. A live run changes its magnitude.
    velocity: list[float] = field(
        default_factory=zeros,
        metadata={
            "length": 3,
            "at_least": -50,
            "at_most": 50,
            "typical": (0.1, 5.0),
            "unit": "m/s",
        },
    )

    # Initial angular velocity in W, in rad/s; it stays constant for equal moments of inertia.
    spin: list[float] = field(default_factory=zeros, metadata={"length": 3, **_LARGEST_TURN})

    # Whether there is a table with its top at z = 0.
    table: bool = False


@dataclass
class Push:
    """A spherical tip that pushes the object over a fixed table."""

    # Direction of the push, as the angle from x of W about z, in radians.
    direction: float = field(default=0.0, metadata={"at_least": -10, "at_most": 10})

    # Speed of the tip, in m/s.
    speed: float = field(default=0.05, metadata={"above": 0, "at_most": 2})

    # Distance that the tip moves, in metres.
    distance: float = field(default=0.25, metadata={"above": 0, "at_most": 1})

    # Time at which the tip starts, in seconds.
    start: float = field(default=0.5, metadata={"at_least": 0, "at_most": 1e6})

    # Initial distance of the tip's front behind the centre of mass, in metres; outside the object.
    start_distance: float = field(default=0.09, metadata={"above": 0, "at_most": 1})

    # Offset of the push to the left of the centre of mass, in metres; it turns the object.
    offset: float = field(default=0.0, metadata={"at_least": -0.5, "at_most": 0.5})

    # Height of the tip's centre over the table, in metres.
    height: float = field(default=0.03, metadata={"at_least": 0.012, "at_most": 0.5})

    def unit_vector(self) -> FloatArray:
        """Returns the unit vector of the tip's motion, in W, shape (3,)."""
        return np.array([np.cos(self.direction), np.sin(self.direction), 0.0])


@dataclass
class PoseStream:
    """Recorded poses of the object, from a camera or another program.

    With a hand, a person moves the object along them, and hands it over.
    """

    # CSV file with the header time,x,y,z,qw,qx,qy,qz: seconds, metres and a unit quaternion, the
    # pose of the object O in W; or an MCAP file, or the folder of a rosbag2 (extra `interfaces`). A
    # path is relative to the folder of the scenario's file; a path after package://drake_pregrasp/
    # is relative to the folder of the package's models.
    file: str = field(default="", metadata={"required": True, "path": True})

    # Topic of the poses in an MCAP file or a rosbag2; empty for the only one.
    topic: str = ""

    # Name of the object's frame O, if messages have transforms; empty for the only one.
    frame: str = ""

    def read(self) -> RecordedPoses:
        """Returns the poses in the file.

        Raises:
            InvalidArgumentError: If the file cannot be read, or holds no valid poses.
        """
        return read_poses(resolve_path(self.file, Path.cwd()), self.topic, self.frame)


MotionConfig = Conveyor | Toss | Push | PoseStream


def is_free_flight(motion: MotionConfig) -> bool:
    """Returns whether an object is tossed, and nothing but a hand ends its flight."""
    return isinstance(motion, Toss) and not motion.table
