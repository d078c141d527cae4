"""Systems with small settings, and values for their inputs."""

import numpy as np
from driven import Driven, port_names
from five_finger_hand import AROUND, FRAMES, HAND, bus
from five_finger_hand import RAYS as RING
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialVelocity
from pydrake.perception import PointCloud
from selections import regions_of

import drake_pregrasp as dp
from drake_pregrasp.config.hand_description import Fingertip
from drake_pregrasp.config.planner_config import MeasuresConfig
from drake_pregrasp.config.sensor_config import Camera, SensorConfig
from drake_pregrasp.contacts.assignment import FREE_TURN
from drake_pregrasp.diagrams.palm_meeting import meeting_settings
from drake_pregrasp.fast import default_kernels
from drake_pregrasp.geometry.mesh_solid import MeshSolid
from drake_pregrasp.grasping.grasp_state import NO_LIMIT, NOT_BLOCKED
from drake_pregrasp.grasping.hand_commands import GraspCommand
from drake_pregrasp.grasping.hand_goals import HandGoals
from drake_pregrasp.regions.finger_measures import FingerMeasures
from drake_pregrasp.systems.interception_planner import InterceptionPlanner
from drake_pregrasp.systems.sources import HandFramePose

N, NQ, RADIUS = 5, 19, 0.009
PERIOD, CONTROL_PERIOD, TIME_STEP = 0.05, 0.02, 0.0025
SETTINGS = dp.GraspConfig().make_settings()
X_WO = RigidTransform(RollPitchYaw(0.2, -0.4, 1.0), [0.5, -0.3, 0.2])
CUBE = dp.BoxSolid(np.zeros(3), np.eye(3), np.full(3, 0.1))
Q = HAND.home(np.array([0.1, -0.05, 0.05]), 0.4) + 0.05 * np.sin(np.arange(NQ))
FORCES = np.random.default_rng(1).normal(size=(N, 3))


def joint_torques(forces):
    """J^T f of the hand at Q."""
    return np.einsum("nij,ni->j", HAND.kinematics.pose(Q).J_WT, forces)


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


def make_estimator(period=PERIOD, p_OCoM=None, object_solid=None, tip_radii=None, **changes):
    seen = {"object_solid": object_solid, "tip_radii": tip_radii}
    return dp.PoseEstimator(dp.EstimatorConfig(**changes), period=period, p_OCoM=p_OCoM, **seen)


def make_shaper(
    palm=None, *, fixed=(), p_GT=1.2 * 0.079 * RING, target_period=PERIOD, lead=0.0, **changes
):
    palm = palm or {}
    return dp.HandGoalShaper(
        dp.GraspConfig(**changes),
        tip_frames=FRAMES,
        tip_radius=RADIUS,
        object_solid=CUBE,
        fixed=fixed,
        p_GT=p_GT,
        finger_azimuths=AROUND,
        withdrawn_radii=np.full(N, np.mean(np.linalg.norm(p_GT[:, :2], axis=1))),
        target_period=target_period,
        lead=lead,
        **palm,
    )


def make_sequencer(config=None, object_solid=None, p_OCoM=(0.0, 0.0, 0.0), **changes):
    values = {"fingertips": [Fingertip(radius=RADIUS)] * N}
    ball, efforts = dp.BallSolid(np.zeros(3), 0.05), np.full(NQ, 9.0)
    return dp.GraspSequencer(
        config or dp.GraspConfig(),
        mass=0.4,
        p_OCoM=np.array(p_OCoM),
        object_solid=object_solid or ball,
        efforts=efforts,
        **values | changes,
    )


def make_interception(p_WL=(0.3, -0.2, 0.25), R_AW=None, R_WO=None, **changes):
    ball, upright, place = dp.BallSolid(np.zeros(3), 0.05), np.eye(3), np.array(p_WL)
    q, config = HAND.home(place, 0.0), dp.GraspConfig(**changes)
    return InterceptionPlanner(
        meeting_settings(config, HAND, q, ball, 0.4, np.zeros(3), upright, 0.0, 1e-6),
        R_AW=upright if R_AW is None else R_AW,
        R_WO=R_WO,
        p_OCoM=np.zeros(3),
        p_WL=place,
        commitment=SETTINGS.closing_duration,
        predicts=config.meeting.predicts,
        period=CONTROL_PERIOD,
        kernels=default_kernels().hand(),
    )


def make_kinematics(scene=None, base=HAND.base, initial=None, **changes):
    scene = scene or HAND.make_scene(CUBE, [])
    initial = HAND.home(X_G.translation(), 0.0) if initial is None else initial
    arguments = {
        "base": base,
        "home": HAND.fingers_home,
        "initial": initial,
        "yaw_range": FREE_TURN,
        "acceleration": 5.0,
        "period": CONTROL_PERIOD,
    }
    return dp.DifferentialKinematics(scene, **(arguments | changes))


def grasp_command(X_WO=None, X_WG=None, V_WO=None, V_WG=None, **changes):
    """A command while the hand tracks an object at rest; G is at O unless it is given."""
    X_WO = RigidTransform() if X_WO is None else X_WO
    X_WG = X_WO if X_WG is None else X_WG
    still, holding = SpatialVelocity.Zero(), np.zeros(N, dtype=bool)
    fields = {
        "R_WO": X_WO.rotation().matrix(),
        "p_WO": X_WO.translation(),
        "V_WO": (V_WO or still).get_coeffs().reshape(2, 3),
        "R_WG": X_WG.rotation().matrix(),
        "p_WG": X_WG.translation(),
        "V_WG": (V_WG or still).get_coeffs().reshape(2, 3),
        "is_tracked": True,
        "holds_contacts": False,
        "standoffs": np.full(N, dp.GraspConfig().standoff),
        "fingers_hold": holding,
        "f_T_W": np.zeros((N, 3)),
        "nhat_W": np.tile([1.0, 0.0, 0.0], (N, 1)),
        "force_limits": np.full((N, 2), NO_LIMIT),
    }
    frame = "G" if np.any(changes.get("fingers_hold", holding)) else "O"
    fields |= {f"{kind}_WE": fields[f"{kind}_W{frame}"] for kind in "RpV"}
    return GraspCommand(**(fields | changes))


def hand_goals(p_WT, v_WT=None, p_WL=None, v_WL=None, yaw=0.0, yaw_rate=0.0, **others):
    """Goals of the fingertips, and of a palm over a point, by default the origin."""
    v_WT = np.zeros((N, 3)) if v_WT is None else v_WT
    p_WL, v_WL = (np.zeros(3) if value is None else np.array(value) for value in (p_WL, v_WL))
    return HandGoals(np.array(p_WT), v_WT, p_WL, v_WL, yaw, yaw_rate, **others)


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
P_OC = dp.resolve(dp.load_scenario("a_base")).start.p_OC
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
    "sensor of a camera": lambda: dp.NoisyPoseSensor(Camera(0.1, 0.1, FAULTS), period=0.1),
    "estimator": make_estimator,
    "estimator of points": lambda: make_estimator(
        object_solid=MeshSolid.of(SURFACE.mesh), tip_radii=np.full(N, 0.028), bias_std=0.01
    ),
    "partitioner": lambda: make_partitioner(
        SURFACE,
        limits=LIMITS,
        coordinates=[dp.CoordinateConfig(scale=1.0)],
        finger_measures=sloping_measures(),
    ),
    "selector": lambda: make_selector(SURFACE, P_OC),
    "hand pose": lambda: HandFramePose(X_G),
    "fingertip sensor": lambda: dp.FingertipSensor(HAND.kinematics, TIME_STEP),
    "kinematics": make_kinematics,
    "shaper": lambda: make_shaper(lead=0.03, target_period=CONTROL_PERIOD),
    "sequencer": make_sequencer,
    "interception": make_interception,
    "monitor": lambda: dp.GraspQualityMonitor(MEASURES, surface=SURFACE, num_contacts=N),
}


def in_world(p_GQ):
    return (X_G @ p_GQ.T).T


def cloud(points):
    """Points in W as a `PointCloud`."""
    result = PointCloud(len(points))
    result.mutable_xyzs()[:] = np.asarray(points).T
    return result


def ring(radius):
    """Points of the fingers at a radius from the origin of G, in W."""
    return in_world(radius * RING)


def wall(x):
    """A wall at x in G."""
    return dp.Obstacles((dp.HalfSpace(X_G @ np.array([x, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0])),))


FRAME_NAMES = ("X_WO", "X_WO_estimated", "X_WO_measured", "X_WG", "X_WH", "X_WU")
CONTACTS = np.concatenate([0.05 * RING, RING], axis=None)
VALUES = {
    **dict.fromkeys(FRAME_NAMES, (X_G, X_G @ TURNED)),
    "V_WO_estimated": (SLOW, FAST),
    "V_WO_held": (SLOW, FAST),
    "point_cloud": (cloud(in_world(SURFACE.p_OQ)), cloud((X_G @ TURNED @ SURFACE.p_OQ.T).T)),
    "command": (grasp_command(X_G), grasp_command(X_G @ TURNED, V_WG=FAST)),
    "noise": (np.zeros(6), np.ones(6)),
    "visible_share": ([1.0], [0.0]),
    "measurement_time": ([0.0], [-np.inf]),
    "p_WO_covariance": (1e-6 * np.eye(3).ravel(), 1e-2 * np.eye(3).ravel()),
    "tracking_status": ([dp.TrackingStatus.TRACKING], [dp.TrackingStatus.LOST]),
    "camera_offset": (np.zeros(12), np.append([0.004, -0.003], np.zeros(10))),
    "blocked_finger": ([NOT_BLOCKED], [1.0]),
    "contact_weights": (np.zeros(N), np.array([0, 0, 0, 0, 1e-2])),
    "finger_coordinates": (0.05 * np.arange(N), np.zeros(N)),
    "candidate_coordinates": (SURFACE.p_OQ[:, 2], SURFACE.p_OQ[:, 0]),
    "obstacles": (wall(0.12), wall(0.06)),
    "safe_regions": (regions_of(SURFACE, P_OC), regions_of(SURFACE, OTHER)),
    "p_WC": (in_world(P_OC).ravel(), in_world(OTHER).ravel()),
    "contact_status": (np.ones(N), np.array([1.0, 1, 1, 1, 0])),
    "hold_contacts": ([0.0], [1.0]),
    "late_fingers": (np.zeros(N), np.array([0.0, 1, 0, 0, 0])),
    "fingertip_targets": (bus(ring(0.05), RING), bus(ring(0.06), RING)),
    "goals": (
        hand_goals(ring(0.08), p_WL=X_G.translation()),
        hand_goals(ring(0.09), p_WL=X_G.translation()),
    ),
    "close": ([0.0], [1.0]),
    "approach": ([1.5, 0.3, -0.2, 0.25, 0, 0, 0], [np.inf, 0.4, -0.2, 0.25, 0.1, 0, 0]),
    "grasp_report": (np.zeros(4), [1.0, 0, 0, 0]),
    "contacts": (np.append(CONTACTS, np.ones(N)), np.append(-CONTACTS, np.ones(N))),
    "p_WT": (ring(0.05 + RADIUS + 0.02).ravel(), (ring(0.05) + 0.01).ravel()),
    "f_T_W": (np.full(3 * N, 2.0), np.zeros(3 * N)),
    "touching": (np.ones(N), np.zeros(N)),
    "J_WT": (np.zeros(3 * N * NQ), np.ones(3 * N * NQ)),
    "hand_state": (np.zeros(2 * NQ), np.full(2 * NQ, 0.1)),
    "net_actuation": (np.ones(NQ), np.full(NQ, 2.0)),
}


UNCONNECTED = {
    "estimator": {"point_cloud", "p_WT", "touching"},
    "estimator of points": {"X_WO_measured"},
    "planner": {"point_cloud", "p_WT", "touching"},
}
"""Ports in whose place another one is connected."""


def driven(name):
    """A system with a sound value at each of its ports."""
    system = MAKERS[name]()
    inputs = [port for port in port_names(system)[0] if port not in UNCONNECTED.get(name, ())]
    return Driven(system, **{port: VALUES[port][0] for port in inputs})
