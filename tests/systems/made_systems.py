"""Systems with small settings, and values for their inputs."""

import numpy as np
from driven import Driven, port_names
from five_finger_hand import AROUND, FRAMES, HAND, bus
from five_finger_hand import RAYS as RING
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from selections import regions_of

import drake_pregrasp as dp
from drake_pregrasp.config.hand_description import Fingertip
from drake_pregrasp.config.planner_config import MeasuresConfig
from drake_pregrasp.config.sensor_config import SensorConfig
from drake_pregrasp.grasping.grasp_state import NOT_BLOCKED
from drake_pregrasp.regions.finger_measures import FingerMeasures
from drake_pregrasp.systems.sources import HandPose

N, NQ, RADIUS = 5, 19, 0.009
PERIOD, CONTROL_PERIOD = 0.05, 0.02
SETTINGS = dp.GraspConfig().make_settings()
NO_POSES = (
    RigidTransform([1e300, 0.0, np.nan]),
    RigidTransform(RotationMatrix.MakeUnchecked(np.full((3, 3), np.nan)), np.zeros(3)),
    RigidTransform(RotationMatrix.MakeUnchecked(1.1 * np.eye(3)), np.zeros(3)),
)
X_WO = RigidTransform(RollPitchYaw(0.2, -0.4, 1.0), [0.5, -0.3, 0.2])


def planner_config(limits=None, **changes):
    """A configuration that adapts contacts from the start, and has no clearance."""
    changes = {"period": PERIOD, "static_duration": 0.0, **changes}
    return dp.PlannerConfig(
        limits=dp.LimitsConfig(**{"clearance": 0.0, **(limits or {})}), **changes
    )


def make_selector(surface, p_OC, limits=None, fingertip_frames=None, **changes):
    config = planner_config(limits, **changes)
    return dp.CentroidSelector(
        config, surface=surface, p_OC=p_OC, fingertip_frames=fingertip_frames
    )


def make_partitioner(surface, num_contacts=N, limits=None, finger_measures=None, **changes):
    config, own = planner_config(limits, **changes), {"finger_measures": finger_measures}
    return dp.SafeRegionPartitioner(config, surface=surface, num_contacts=num_contacts, **own)


def sloping_measures(size=0.2):
    """Fingers whose joint range grows along x of the palm from 0 to 1/2."""
    table = np.zeros((N, 2, 2, 2, 3 + 4))
    table[:, 1, ..., -1] = 0.5
    low, step = np.full((N, 3), -size), np.full((N, 3), 2 * size)
    return FingerMeasures(low, step, table, efforts=np.ones((N, 1)))


def make_estimator(period=PERIOD, p_OCoM=None, **changes):
    return dp.PoseEstimator(dp.EstimatorConfig(**changes), period=period, p_OCoM=p_OCoM)


def make_shaper(*, fixed=(), p_GT=1.2 * 0.079 * RING, target_period=PERIOD, lead=0.0, **changes):
    return dp.FingertipGoalShaper(
        dp.GraspConfig(**changes),
        tip_frames=FRAMES,
        tip_radius=RADIUS,
        object_solid=dp.BoxSolid(np.zeros(3), np.eye(3), np.full(3, 0.1)),
        fixed=fixed,
        p_GT=p_GT,
        finger_azimuths=AROUND,
        target_period=target_period,
        lead=lead,
    )


def make_sequencer(config=None, object_solid=None, **changes):
    tips = [Fingertip(radius=RADIUS)] * N
    ball, efforts = dp.BallSolid(np.zeros(3), 0.05), np.full(NQ, 9.0)
    return dp.GraspSequencer(
        config or dp.GraspConfig(),
        fingertips=tips,
        mass=0.4,
        p_OCoM=np.zeros(3),
        object_solid=object_solid or ball,
        efforts=efforts,
        **changes,
    )


def make_reference(initial=None):
    initial = np.full(NQ, 0.1) if initial is None else initial
    return dp.JointReference(HAND.kinematics, period=CONTROL_PERIOD, initial=initial)


def make_carrier(home=None, **changes):
    arguments = {"gain": 5.0, "period": CONTROL_PERIOD, "carrier": [0, 1, 2, 3], **changes}
    home = HAND.home(np.zeros(3), 0.0) if home is None else home
    return dp.CarrierPosture(tip_frames=FRAMES, finger_azimuths=AROUND, home=home, **arguments)


def make_arm(**changes):
    arguments = {
        "tip_frames": FRAMES,
        "palm_frame": "palm",
        "finger_azimuths": AROUND,
        "X_GP": RigidTransform([0.0, 0.0, 0.1]),
        "home": np.zeros(NQ),
        "p_WG": np.zeros(3),
        "yaw": 0.0,
        "lead": 0.03,
        "period": CONTROL_PERIOD,
        **changes,
    }
    return dp.ArmPosture(**arguments)


def partition(surface, p_OC, inputs=None, X=X_WO, **settings):
    """The safe regions of contacts at p_OC on an object at X."""
    planner = ("wall_test", "normal_length", "coordinates", "finger_measures")
    own = {name: settings.pop(name) for name in planner if name in settings}
    driven = Driven(make_partitioner(surface, len(p_OC), settings, **own))
    driven.fix(X_WO_estimated=X, p_WC=(X @ p_OC.T).T.ravel())
    driven.fix(**(inputs or {}))
    return driven.eval("safe_regions")


# Systems of an object at X_G, with two values for each port: a sound one, and another.

SURFACE = dp.box_surface([0.1, 0.1, 0.1], spacing=0.01)
P_OC = dp.load_scenario("a_base").initial_p_OC(SURFACE)
OTHER = P_OC * [1, -1, 1]
X_G = RigidTransform([0.3, -0.2, 0.1])
TURNED = RigidTransform(RollPitchYaw(0.1, -0.2, 0.3), [0.02, 0.03, 0.01])
SLOW = SpatialVelocity(w=[0, 0.01, 0], v=[0.01, 0, 0])
FAST = SpatialVelocity(w=[0, 0, 0.5], v=[0.1, 0, 0])
LIMITS = {
    "reach": [dp.BallReach(center=[0, 0, 0], radius=0.06)] * N,
    "tip_radii": [RADIUS] * N,
    "horizon": 1.0,
    "joint_range": 0.22,
}
FAULTS = dp.MeasurementFaults(dropout_rate=1e-9)
MEASURES = MeasuresConfig(contact_model="hard_finger")
MAKERS = {
    "sensor": lambda: dp.NoisyPoseSensor(SensorConfig(0.1, 0.1)),
    "sensor with memory": lambda: dp.NoisyPoseSensor(SensorConfig(0.1, 0.1, FAULTS), period=0.1),
    "estimator": make_estimator,
    "partitioner": lambda: make_partitioner(
        SURFACE,
        limits=LIMITS,
        coordinates=[dp.CoordinateConfig(scale=1.0)],
        finger_measures=sloping_measures(),
    ),
    "selector": lambda: make_selector(SURFACE, P_OC),
    "hand pose": lambda: HandPose(X_G),
    "fingertip sensor": lambda: dp.FingertipSensor(HAND.kinematics),
    "reference": make_reference,
    "carrier": lambda: make_carrier(np.zeros(NQ)),
    "arm": lambda: make_arm(p_WG=X_G.translation()),
    "shaper": lambda: make_shaper(lead=0.03, target_period=CONTROL_PERIOD),
    "sequencer": make_sequencer,
    "monitor": lambda: dp.GraspQualityMonitor(MEASURES, surface=SURFACE, num_contacts=N),
}


def in_world(p_GQ):
    return (X_G @ p_GQ.T).T


def ring(radius):
    """Points of the fingers at a radius from the origin of G, in W."""
    return in_world(radius * RING)


def wall(x):
    """A wall at x in G."""
    return dp.Obstacles((dp.HalfSpace(X_G @ np.array([x, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0])),))


FRAME_NAMES = ("X_WO", "X_WO_estimated", "X_WO_measured", "X_WG", "X_WH", "X_WU")
CONTACT_FRAMES = np.concatenate([0.05 * RING, RING]).ravel()
VALUES = {
    **dict.fromkeys(FRAME_NAMES, (X_G, X_G @ TURNED)),
    "V_WO_estimated": (SLOW, FAST),
    "V_WG": (SLOW, FAST),
    "V_WO_held": (np.append(1, SLOW.get_coeffs()), np.append(1, FAST.get_coeffs())),
    "noise": (np.zeros(6), np.ones(6)),
    "measurement_time": ([0.0], [-np.inf]),
    "p_WO_covariance": (1e-6 * np.eye(3).ravel(), 1e-2 * np.eye(3).ravel()),
    "tracking_status": ([dp.TrackingStatus.TRACKING], [dp.TrackingStatus.LOST]),
    "blocked_finger": ([NOT_BLOCKED], [1.0]),
    "contact_weights": (np.zeros(N), np.array([0, 0, 0, 0, 1e-2])),
    "finger_coordinates": (0.05 * np.arange(N), np.zeros(N)),
    "candidate_coordinates": (SURFACE.p_OQ[:, 2], SURFACE.p_OQ[:, 0]),
    "obstacles": (wall(0.12), wall(0.06)),
    "safe_regions": (regions_of(SURFACE, P_OC), regions_of(SURFACE, OTHER)),
    "p_WC": (in_world(P_OC).ravel(), in_world(OTHER).ravel()),
    "contact_status": (np.ones(N), np.array([1.0, 1, 1, 1, 0])),
    "hold_contacts": ([0.0], [1.0]),
    "fingertip_targets": (bus(ring(0.05), RING), bus(ring(0.06), RING)),
    "tip_goals": (bus(ring(0.08), RING), bus(in_world(P_OC), RING)),
    "standoffs": (np.full(N, 0.02), np.zeros(N)),
    "fingers_hold": (np.zeros(N), np.ones(N)),
    "close": ([0.0], [1.0]),
    "contact_frames": (CONTACT_FRAMES, -CONTACT_FRAMES),
    "p_WT": (ring(0.05 + RADIUS + 0.02).ravel(), (ring(0.05) + 0.01).ravel()),
    "f_T_W": (np.zeros(3 * N), np.ones(3 * N)),
    "force_limits": (np.full(N, 0.5), np.full(N, 0.1)),
    "J_WT": (np.zeros(3 * N * NQ), np.ones(3 * N * NQ)),
    "hand_state": (np.zeros(2 * NQ), np.full(2 * NQ, 0.1)),
    "net_actuation": (np.ones(NQ), np.full(NQ, 2.0)),
    "commanded_velocity": (np.full(NQ, 0.1), np.zeros(NQ)),
}


def driven(name):
    """A system with a sound value at each of its ports."""
    system = MAKERS[name]()
    inputs, _ = port_names(system)
    return Driven(system, **{port: VALUES[port][0] for port in inputs})
