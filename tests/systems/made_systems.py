"""Systems with small settings, and a driver for a system on its own."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BusValue

from drake_pregrasp import (
    ArmPosture,
    BoxSolid,
    CarrierPosture,
    CentroidSelector,
    EstimatorConfig,
    FingertipGoalShaper,
    GraspConfig,
    GraspSequencer,
    HandModel,
    JointReference,
    LimitsConfig,
    Obstacles,
    PlannerConfig,
    PoseEstimator,
    SafeRegionPartitioner,
    load_hand,
)
from drake_pregrasp.config.hand_description import Fingertip
from drake_pregrasp.regions.safe_regions import SafeRegions

HAND_FILE = "package://drake_pregrasp/five_finger_hand.yaml"
HAND = HandModel(load_hand(HAND_FILE))
FRAMES = HAND.kinematics.tip_frames
N, NQ, RADIUS = 5, 19, 0.009
PERIOD, CONTROL_PERIOD = 0.05, 0.02
AROUND = 2 * np.pi * np.arange(N) / N
RING = np.stack([np.cos(AROUND), np.sin(AROUND), 0 * AROUND], axis=1)
SETTINGS = GraspConfig().make_settings()
X_WO = RigidTransform(RollPitchYaw(0.2, -0.4, 1.0), [0.5, -0.3, 0.2])


def planner_config(limits=None, **changes):
    """A configuration that adapts contacts from the start, and has no clearance."""
    changes = {"period": PERIOD, "static_duration": 0.0, **changes}
    return PlannerConfig(limits=LimitsConfig(**{"clearance": 0.0, **(limits or {})}), **changes)


def make_selector(surface, p_OC, limits=None, fingertip_frames=None, **changes):
    config = planner_config(limits, **changes)
    return CentroidSelector(config, surface=surface, p_OC=p_OC, fingertip_frames=fingertip_frames)


def make_partitioner(surface, num_contacts=N, limits=None, **changes):
    config = planner_config(limits, **changes)
    return SafeRegionPartitioner(config, surface=surface, num_contacts=num_contacts)


def make_estimator(p_OCoM=None, **changes):
    return PoseEstimator(EstimatorConfig(**changes), period=PERIOD, p_OCoM=p_OCoM)


def make_shaper(*, fixed=(), p_GT=1.2 * 0.079 * RING, target_period=PERIOD, lead=0.0, **changes):
    return FingertipGoalShaper(
        GraspConfig(**changes),
        tip_frames=FRAMES,
        tip_radius=RADIUS,
        object_solid=BoxSolid(np.zeros(3), np.eye(3), np.full(3, 0.1)),
        object_top=0.05,
        fixed=fixed,
        p_GT=p_GT,
        finger_azimuths=AROUND,
        target_period=target_period,
        lead=lead,
    )


def make_sequencer():
    tips = [Fingertip(radius=RADIUS)] * N
    return GraspSequencer(GraspConfig(), fingertips=tips, mass=0.4, p_OCoM=np.zeros(3))


def make_reference(initial=None):
    initial = np.full(NQ, 0.1) if initial is None else initial
    return JointReference(HAND.kinematics, period=CONTROL_PERIOD, initial=initial)


def make_carrier(home=None, **changes):
    arguments = {"gain": 5.0, "period": CONTROL_PERIOD, "carrier": [0, 1, 2, 3], **changes}
    home = HAND.home(np.zeros(3), 0.0) if home is None else home
    return CarrierPosture(tip_frames=FRAMES, finger_azimuths=AROUND, home=home, **arguments)


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
    return ArmPosture(**arguments)


def bus(points, normals=None, names=FRAMES):
    """A bus of poses at points, with their z axes against the normals if there are any."""
    value = BusValue()
    for index, (name, point) in enumerate(zip(names, points, strict=False)):
        R = RotationMatrix()
        if normals is not None:
            R = RotationMatrix.MakeFromOneVector(-np.array(normals[index], dtype=float), 2)
        value.Set(name, AbstractValue.Make(RigidTransform(R, point)))
    return value


def points_of(value, names=FRAMES):
    found = [value.Find(name) for name in names]
    return np.array([X.translation() for X in found if X is not None])


def plain(value):
    """A port's value as an array."""
    if isinstance(value, RigidTransform):
        return value.GetAsMatrix34()
    if isinstance(value, SpatialVelocity):
        return value.get_coeffs().copy()
    if isinstance(value, SafeRegions):
        return value.labels.copy()
    if isinstance(value, BusValue):
        found = [value.Find(name) for name in (*FRAMES, "palm")]
        return np.array([X.GetAsMatrix34() for X in found if X is not None])
    return np.array(value)


def partition(surface, p_OC, inputs=None, X=X_WO, **settings):
    """The safe regions of contacts at p_OC on an object at X."""
    own = {k: settings.pop(k) for k in ("wall_test", "normal_length") if k in settings}
    driven = Driven(make_partitioner(surface, len(p_OC), settings, **own))
    driven.fix(X_WO_estimated=X, p_WC=(X @ p_OC.T).T.ravel())
    driven.fix(**(inputs or {}))
    return driven.eval("safe_regions")


class Driven:
    """A system on its own whose inputs are set, and whose clock goes from tick to tick."""

    def __init__(self, system, period=CONTROL_PERIOD, **inputs):
        self.system, self.period = system, period
        self.simulator = Simulator(system)
        self.context = self.simulator.get_mutable_context()
        self.fix(**inputs)

    def fix(self, **inputs):
        for port, value in inputs.items():
            if isinstance(value, BusValue | Obstacles):
                value = AbstractValue.Make(value)
            self.system.GetInputPort(port).FixValue(self.context, value)

    def advance(self, seconds):
        self.simulator.AdvanceTo(self.context.get_time() + seconds)

    def tick(self, count=1):
        self.advance(count * self.period)

    def eval(self, port):
        return self.system.GetOutputPort(port).Eval(self.context)

    def array(self, port):
        return plain(self.eval(port)).copy()

    def numbers(self):
        """All outputs as one vector."""
        ports = [
            self.system.get_output_port(i).get_name() for i in range(self.system.num_output_ports())
        ]
        return np.concatenate([self.array(port).ravel() for port in ports])
