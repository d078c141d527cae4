"""Configuration of the planner, of its pose estimator and of the measures of its contacts."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.limits_config import LimitsConfig
from drake_pregrasp.config.sensor_config import ORIENTATION_NOISE, POSITION_NOISE
from drake_pregrasp.contacts.strategies import BLEND, READINGS, STRATEGIES
from drake_pregrasp.estimation.pose_belief import PoseFilterNoise
from drake_pregrasp.estimation.pose_track import TrackerSettings
from drake_pregrasp.geometry.rotations import rotation_group
from drake_pregrasp.quality.force_closure import (
    FRICTION,
    TORSIONAL_FRICTION,
    torsional_friction_of,
)
from drake_pregrasp.quality.grasp_quality import CONTACT_MODELS
from drake_pregrasp.regions.coordinates import GIVEN, QUANTITIES
from drake_pregrasp.regions.finger_measures import FINGER_MEASURES
from drake_pregrasp.regions.walls import WALL_TESTS

AUTO = "auto"
"""Value of `MeasuresConfig.contact_model` for that of the hand's fingertips."""

LARGEST_SCALE = 1e4
"""Largest number of metres per unit of a further coordinate."""

MOST_LATE = 1000
"""Largest number of used measurements that may be newer than an out-of-sequence one."""

INITIAL_VELOCITY = 3.0
"""Standard deviation of the velocity before the first measurement, in m/s."""

INITIAL_ANGULAR_VELOCITY = 15.0
"""Standard deviation of the angular velocity before the first measurement, in rad/s."""

_STD = {"above": 0, "at_most": 10}
_RATE = {"above": 0, "at_most": 1000}
_TIME = {"at_least": 0, "at_most": 1e6}
_WEIGHT = {"at_least": 0, "at_most": 1e6}


@dataclass
class EstimatorConfig:
    """Assumptions of the pose estimator. Standard deviations are per axis."""

    # Standard deviation of a measured position, in metres.
    position_std: float = field(default=0.0005, metadata=_STD | POSITION_NOISE)

    # Standard deviation of a measured orientation, as a rotation vector, in radians.
    orientation_std: float = field(default=0.0035, metadata=_STD | ORIENTATION_NOISE)

    # Square root of the spectral density of the object's random acceleration while it keeps its
    # velocity, in m/s^2/sqrt(Hz).
    acceleration: float = field(default=0.001, metadata=_RATE)

    # Square root of the spectral density of its random angular acceleration, in rad/s^2/sqrt(Hz).
    angular_acceleration: float = field(default=0.01, metadata=_RATE)

    # The same two densities while it changes its motion, such as on a circle or in free flight.
    manoeuvre_acceleration: float = field(default=1.5, metadata=_RATE)
    manoeuvre_angular_acceleration: float = field(default=5.0, metadata=_RATE)

    # Mean number of changes of the motion per second; 0 if it never changes.
    manoeuvre_rate: float = field(default=0.5, metadata={"at_least": 0, "at_most": 1000})

    # Mean acceleration along -z of W, in m/s^2: 0 for an object that is carried, 9.81 for one in
    # free flight.
    gravity: float = field(default=0.0, metadata={"at_least": 0, "at_most": 1000})

    # Seconds by which the estimate, and with it the goals, are predicted ahead. Measures still use
    # the object's present pose; position errors compare poses of the same time.
    lookahead: float = field(
        default=0.0,
        metadata={"at_least": 0, "at_most": 10, "typical": (0.0, 0.5), "unit": "ms"},
    )

    # Rotations of O that leave the object unchanged, as rotation vectors in radians, such as
    # [[0, 0, 3.14159265]] for half a turn about z. What follows from them by repetition and
    # combination counts, too. A measured orientation is replaced by the nearest equivalent one.
    symmetry: list[list[float]] = field(
        default_factory=list,
        metadata={"elements": {"length": 3, "at_least": -math.pi, "at_most": math.pi}},
    )

    # Mahalanobis distance of a measured pose from the predictions of all models beyond which it is
    # an outlier; 0 accepts all measurements.
    gate: float = field(default=5.0, metadata=_WEIGHT)

    # Largest number of used measurements that are newer than an out-of-sequence one; an older one
    # is refused.
    late_measurements: int = field(default=20, metadata={"at_least": 1, "at_most": MOST_LATE})

    # For points of the surface: standard deviation of a point's distance from it, in metres. The
    # standard deviations of a pose above then are errors that all points of a picture share.
    point_std: float = field(default=0.002, metadata=_STD | POSITION_NOISE)

    # Least number of points that must fit, so that they measure the pose.
    fewest_points: int = field(default=20, metadata={"at_least": 1, "at_most": 20_000})

    # Standard deviation of the displacement with which cameras show the object, because their
    # places are not well known, per axis, in metres. Above 0, contacts with the object correct it.
    bias_std: float = field(
        default=0.0,
        metadata={"at_least": 0, "at_most": 1, "typical": (0.0, 0.02), "unit": "mm"},
    )

    # Seconds in which the correlation of the displacement falls to 1/e.
    bias_time: float = field(default=30.0, metadata={"above": 0, "at_most": 1e6})

    # Whether fingertips measure the pose: those that touch are on the surface, others outside.
    touch: bool = True

    # Standard deviation of the distance of something that touches from the surface, in metres; with
    # a period below 0.05 s, that of its mean over this time.
    touch_std: float = field(default=0.001, metadata=_STD | POSITION_NOISE)

    # Whether an object that no hand holds rests on the plane z = 0 of W, with a flat side if one is
    # level within 8 degrees.
    rests_on_table: bool = False

    # Seconds by which a measurement is overdue when the status becomes coasting: goals then follow
    # the prediction.
    coast_after: float = field(default=0.1, metadata=_TIME)

    # Seconds by which a confirmation by measurements or touches is overdue when the object is lost:
    # goals then stay. At least coast_after.
    lost_after: float = field(default=1.0, metadata=_TIME)


def filter_noise(config: EstimatorConfig) -> PoseFilterNoise:
    """Returns the noise that the pose filter assumes."""
    return PoseFilterNoise(
        position=config.position_std,
        orientation=config.orientation_std,
        acceleration=config.acceleration,
        angular_acceleration=config.angular_acceleration,
        initial_velocity=INITIAL_VELOCITY,
        initial_angular_velocity=INITIAL_ANGULAR_VELOCITY,
        gravity=config.gravity,
        manoeuvre_acceleration=config.manoeuvre_acceleration,
        manoeuvre_angular_acceleration=config.manoeuvre_angular_acceleration,
        manoeuvre_rate=config.manoeuvre_rate,
        bias=config.bias_std,
        bias_time=config.bias_time,
    )


def tracker_settings(config: EstimatorConfig, p_OCoM: FloatArray | None = None) -> TrackerSettings:
    """Returns the settings with which the tracker checks and uses measurements.

    Args:
        config: Assumptions of the estimator.
        p_OCoM: Centre of mass in O, shape (3,), in metres; the origin of O by default.

    Raises:
        InvalidArgumentError: If `symmetry` has too many rotations.
    """
    symmetry = rotation_group(np.reshape(config.symmetry, (-1, 3)))
    return TrackerSettings(filter_noise(config), config.gate, symmetry, p_OCoM)


@dataclass
class BlendConfig:
    """Relative weights of the strategies in a blend."""

    # Weight of the strategy of that name.
    position: float = field(default=0.0, metadata=_WEIGHT)
    msv: float = field(default=0.0, metadata=_WEIGHT)
    gii: float = field(default=0.0, metadata=_WEIGHT)
    vew: float = field(default=0.0, metadata=_WEIGHT)
    margin: float = field(default=0.0, metadata=_WEIGHT)
    independence: float = field(default=0.0, metadata=_WEIGHT)
    singularity_distance: float = field(default=0.0, metadata=_WEIGHT)
    manipulability: float = field(default=0.0, metadata=_WEIGHT)
    uniformity: float = field(default=0.0, metadata=_WEIGHT)
    joint_range: float = field(default=0.0, metadata=_WEIGHT)
    finger_force: float = field(default=0.0, metadata=_WEIGHT)


@dataclass
class CoordinateConfig:
    """A further coordinate of regions, such as a force: what fingers offer and places demand."""

    # Name of the quantity in the summary, unique. Empty: that of `candidates`.
    name: str = ""

    # Metres that count as much as one unit of the quantity.
    scale: float = field(
        default=1.0, metadata={"required": True, "above": 0, "at_most": LARGEST_SCALE}
    )

    # Quantity at the candidates: one that follows from the surface, or that of the port
    # candidate_coordinates.
    candidates: str = field(default=GIVEN, metadata={"one_of": (GIVEN, *QUANTITIES)})

    # Quantity of each contact's finger. Empty: the one at the contact's place on the surface.
    fingers: list[float] = field(default_factory=list, metadata={"at_least": -1e6, "at_most": 1e6})

    @property
    def label(self) -> str:
        """Name of the coordinate in the summary."""
        return self.name or self.candidates


@dataclass
class PlannerConfig:
    """Configuration of the planner of contact goals."""

    # Seconds between planning ticks.
    period: float = field(
        default=0.05,
        metadata={"at_least": 1e-4, "at_most": 10, "typical": (0.01, 0.2), "unit": "ms"},
    )

    # Seconds for which the initial contacts are held on the object before they adapt.
    static_duration: float = field(default=4.0, metadata=_TIME)

    # Distance of the fingertip targets from the surface while the object is not tracked, in metres.
    lost_standoff: float = field(default=0.02, metadata={"at_least": 0, "at_most": 10})

    # Weights of a contact's goal in its safe region: position tracking, a measure of the grasp
    # matrix, the force-closure margin, how far the contact may slip without a loss of force
    # closure, a measure of the hand's finger there (see `limits`), or a blend of them.
    strategy: str = field(default="position", metadata={"one_of": (*STRATEGIES, BLEND)})

    # Weights for the strategy blend; at least one must be above 0.
    blend: BlendConfig = field(default_factory=BlendConfig)

    # For measures: the grasp matrix of the candidate alone, or of the hand with the candidate.
    reading: str = field(default="hand", metadata={"one_of": READINGS})

    # For measures: contact model of the grasp matrix. If its rank is below six, msv, gii and vew
    # are 0, and all candidates count equally.
    contact_model: str = field(default="complete", metadata={"one_of": CONTACT_MODELS})

    # For measures: unit of lever arms, in metres. 0: the longest lever arm on the object; for the
    # complete model one metre, as in the paper.
    length: float = field(default=0.0, metadata={"at_least": 0, "at_most": 1000})

    # For measures: whether weights are stretched over each region, b_n - min b.
    stretch: bool = True

    # For measures: exponent of the weights. The larger it is, the closer the centroid is to the
    # best point.
    power: float = field(default=1.0, metadata={"above": 0, "at_most": 100})

    # For margin and independence: Coulomb's coefficient between fingertip and object.
    friction: float = field(default=FRICTION, metadata={"at_least": 0, "at_most": 10})

    # Whether contacts move one after another, each with the new goals of those before it, and not
    # all at once. Measures then settle, at the cost of computing the weights once per contact.
    in_turns: bool = False

    # Whether a contact moves to the candidate with the largest weight, not to the centroid.
    best_point: bool = False

    # Standard deviation added to the filter's covariance in the Gaussian weights, in metres. The
    # filter's own, 0.2 mm in the base case, would select the candidate closest to the centre.
    position_spread: float = field(
        default=0.04,
        metadata={"at_least": 1e-6, "at_most": 1000, "typical": (0.001, 0.1), "unit": "mm"},
    )

    # Test that keeps a region from extending through a thin wall: none, the angle between outward
    # normals, or the distance over the surface.
    wall_test: str = field(default="none", metadata={"one_of": WALL_TESTS})

    # If above zero, regions are evaluated in six coordinates: points, and outward normals times
    # this length in metres. Regions then prefer surface that faces the same way as their contact.
    normal_length: float = field(default=0.0, metadata={"at_least": 0, "at_most": 10})

    # Further coordinates of safe regions.
    coordinates: list[CoordinateConfig] = field(default_factory=list, metadata={"max_length": 8})

    limits: LimitsConfig = field(default_factory=LimitsConfig)

    # Whether to check every active goal against the mesh, and to stop with an error if a goal is
    # off the allowed surface. This is slow: it is meant for finding defects.
    verify_contacts: bool = False

    estimator: EstimatorConfig = field(default_factory=EstimatorConfig)

    @property
    def needs_finger_measures(self) -> bool:
        """Whether a weight or a limit needs to know what the fingers can do."""
        weights = vars(self.blend) if self.strategy == BLEND else {self.strategy: 1.0}
        weighted = any(weights.get(name, 0) > 0 for name in FINGER_MEASURES)
        return weighted or any(self.limits.least_measures())


@dataclass
class MeasuresConfig:
    """Assumptions about contacts in the logged measures and in the margins of the summary."""

    # Contact model of the grasp matrix; auto: soft_finger for a hand with soft fingertips, else
    # complete. Margins need a friction cone: with the complete model, whose contacts can also pull,
    # they are those of the hard finger.
    contact_model: str = field(default=AUTO, metadata={"one_of": (AUTO, *CONTACT_MODELS)})

    # Coulomb's coefficient.
    friction: float = field(default=FRICTION, metadata={"at_least": 0, "at_most": 10})

    # For soft fingers: largest moment about the normal per newton of normal force, in metres. 0:
    # that of half the hand's smallest `patch_radius`, or of a patch of radius 10 mm without one.
    torsional_friction: float = field(default=0.0, metadata={"at_least": 0, "at_most": 10})

    # Unit of lever arms, in metres. 0: the longest lever arm on the object; for the measures of the
    # complete model one metre, as in the paper.
    length: float = field(default=0.0, metadata={"at_least": 0, "at_most": 1000})

    def resolved(self, patch_radii: Sequence[float] | FloatArray = ()) -> "MeasuresConfig":
        """Returns the assumptions with the contact model of a hand's fingertips, where it is auto.

        Args:
            patch_radii: Radii of the patches of fingertips in metres, 0 for hard ones.
        """
        soft = np.array([radius for radius in patch_radii if radius > 0])
        model, torsional = self.contact_model, self.torsional_friction
        if model == AUTO:
            model = "soft_finger" if len(soft) else "complete"
        if not torsional:
            own = torsional_friction_of(self.friction, soft)
            torsional = float(np.min(own)) if len(soft) else TORSIONAL_FRICTION
        return replace(self, contact_model=model, torsional_friction=torsional)
