"""Differential inverse kinematics of a whole hand that keeps its links clear."""

from collections.abc import Mapping

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.solvers import ClarabelSolver, MathematicalProgram
from pydrake.systems.framework import Context, LeafSystem, ValueProducer

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.grasping.fingertip_paths import Pace
from drake_pregrasp.grasping.grasp_state import NOT_HINDERED
from drake_pregrasp.regions.constraints import Obstacles
from drake_pregrasp.regions.obstacles import ANYWHERE, place_obstacles
from drake_pregrasp.systems.fingertip_sensor import scoped_frame
from drake_pregrasp.systems.hand_scene import FASTEST_APPROACH, HandScene
from drake_pregrasp.systems.palm_posture import pose_error
from drake_pregrasp.systems.ports import (
    BUS,
    OBSTACLES,
    POSE,
    VELOCITY,
    LastPose,
    declare_cache,
    declare_output,
    eval_obstacles,
    validated_poses,
    validated_velocity,
)

_TRACKING_WEIGHT = 1e4  # Weight of goals against posture.
_DAMPING = 1e-3  # Singular value of a Jacobian, in metres, below which its direction is given up.
_LIMIT_RATE = 10.0  # Largest ratio of a joint's speed to its distance from a limit, in 1/s.
_USED = 0.75  # Share of the limit of acceleration that is commanded: drives and clearances add.
_TOLERANCE = 1e-9  # Violation of a constraint that is rounding, in m/s or rad/s.


class DifferentialKinematics(LeafSystem):
    """Computes joint velocities that move fingertips to goals and keep all links clear.

    .. pydrake_system::

        name: DifferentialKinematics
        input_ports:
        - position
        - velocity
        - nominal_posture
        - desired_cartesian_poses
        - v_WT
        - X_WG
        - V_WG
        - X_WO_estimated
        - V_WO_estimated
        - fingers_hold
        - obstacles
        output_ports:
        - commanded_velocity
        - hindered_finger

    Port `position` accepts a vector of nq: the reference positions of the joints at the Context's
    time.

    Port `velocity` accepts a vector of nq: the velocities of the reference in the last period.

    Port `nominal_posture` accepts a vector of nq: the positions that joints approach in the null
    space of the goals.

    Port `desired_cartesian_poses` accepts a `BusValue`: poses in W to reach in one period, by the
    scoped names of frames. Frames without a valid pose are free.

    Port `v_WT` accepts a vector of 3n: velocities of the fingertips' goals in W, in m/s, as
    `FingertipGoalShaper` emits it. Goals of other frames move with G.

    Ports `X_WO_estimated` and `V_WO_estimated` accept the estimated pose and velocity of the object
    in W: a `RigidTransform` and a `SpatialVelocity`. `X_WG` and `V_WG` accept those of the frame G
    of `GraspSequencer`, which replace them while fingers hold the object.

    Port `fingers_hold` accepts a vector of n. A finger holds the object, or closes on it, while its
    value is above 0 or NaN.

    Port `obstacles` (optional) accepts `Obstacles` in W. Only their solids count, and not those
    with numbers that are not finite.

    Port `commanded_velocity` emits a vector of nq: the velocities of the joints. It minimizes the
    errors of goals J v - V first and of the posture second, within the limits of speed and
    acceleration of the joints, and such that links keep their clearances (`HandScene`). If no
    velocity satisfies this, the joints stop with their largest deceleration.

    Port `hindered_finger` emits a vector of 1: the index of the finger that stops the hand, `BASE`,
    or `NOT_HINDERED`.

    Args:
        scene: The hand and what it must be clear of.
        masks: Names of the frames that have goals, with 1 for each of their rotations and
            translations along x, y and z that counts, else 0, shape (6,).
        posture_gain: Gain with which joints follow the nominal posture, in 1/s.
        acceleration: Largest acceleration of frames on the way to goals, in m/s².
        period: Seconds between ticks.
    """

    def __init__(
        self,
        scene: HandScene,
        *,
        masks: Mapping[str, FloatArray],
        posture_gain: float,
        acceleration: float,
        period: float,
    ) -> None:
        super().__init__()
        self._hand = hand = scene.hand
        nq, n = hand.num_positions, len(hand.tip_frames)
        self._scene = scene
        self._gain, self._period, self._solver = posture_gain, period, ClarabelSolver()
        self._pace = Pace(FASTEST_APPROACH, _USED * acceleration, period)
        self._change = hand.acceleration_limit * period
        self._frames = {name: scoped_frame(hand.plant, name) for name in masks}
        self._masks = {name: np.asarray(mask) > 0 for name, mask in masks.items()}
        self._q = self.DeclareVectorInputPort("position", nq)
        self._v = self.DeclareVectorInputPort("velocity", nq)
        self._posture = self.DeclareVectorInputPort("nominal_posture", nq)
        self._goals = self.DeclareAbstractInputPort("desired_cartesian_poses", BUS)
        self._v_WT = self.DeclareVectorInputPort("v_WT", 3 * n)
        self._X_WG = self.DeclareAbstractInputPort("X_WG", POSE)
        self._V_WG = self.DeclareAbstractInputPort("V_WG", VELOCITY)
        self._X_WO = self.DeclareAbstractInputPort("X_WO_estimated", POSE)
        self._V_WO = self.DeclareAbstractInputPort("V_WO_estimated", VELOCITY)
        self._hold = self.DeclareVectorInputPort("fingers_hold", n)
        self._obstacles = self.DeclareAbstractInputPort("obstacles", OBSTACLES)
        self._pose = LastPose(self, self._X_WO)
        placing = {p.ticket() for p in (self._q, self._X_WG, self._hold, self._obstacles)}
        self._placed = self.DeclareCacheEntry(
            "the hand and what is around it",
            ValueProducer(
                lambda: AbstractValue.Make(scene.diagram.CreateDefaultContext()), self._calc_placed
            ),
            placing | {self._pose.source.ticket()},
        )
        inputs = (self._v, self._posture, self._goals, self._v_WT, self._V_WG, self._V_WO)
        self._step = declare_cache(
            self, "velocities", (np.zeros(nq), NOT_HINDERED), self._calc_step, self._placed, *inputs
        )
        declare_output(self, "commanded_velocity", nq, lambda c: self._step.Eval(c)[0], self._step)
        declare_output(self, "hindered_finger", 1, lambda c: self._step.Eval(c)[1], self._step)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._pose.store)

    def _holding(self, context: Context) -> BoolArray:
        holding: BoolArray = ~(np.asarray(self._hold.Eval(context)) <= 0)
        return holding

    def _calc_placed(self, context: Context, output: AbstractValue) -> None:
        is_held = np.any(self._holding(context))
        X_WO = self._X_WG.Eval(context) if is_held else self._pose.eval(context)
        given = Obstacles(eval_obstacles(self, self._obstacles, context).solids)
        placed = place_obstacles(given, np.eye(3), np.zeros(3)).solids
        known = [solid for solid in placed if solid is not ANYWHERE]
        self._scene.place(output.get_mutable_value(), self._q.Eval(context), X_WO, known)

    def _calc_step(self, context: Context) -> tuple[FloatArray, int]:
        placed, holding = self._placed.Eval(context), self._holding(context)
        V_WO = validated_velocity((self._V_WG if np.any(holding) else self._V_WO).Eval(context))
        q, v_last = self._q.Eval(context), self._v.Eval(context)
        least, most = self._bounds(q, v_last)
        J, V = self._goal_rates(context, placed, v_last)
        U, s, Vt = np.linalg.svd(J)
        rank = int(np.sum(s > _DAMPING))
        span, free = Vt[:rank], Vt[rank:]
        v = span.T @ (U[:, :rank].T @ V / s[:rank])
        v += free.T @ (free @ (self._gain * (self._posture.Eval(context) - q)))
        clear = self._scene.clearances(placed, V_WO, holding)
        lacking = clear.least - clear.rows @ v
        within = np.all(v >= least - _TOLERANCE) and np.all(v <= most + _TOLERANCE)
        if within and np.max(lacking, initial=0.0) <= _TOLERANCE:
            return v, NOT_HINDERED
        program = MathematicalProgram()
        x = program.NewContinuousVariables(len(v))
        # Both costs are zero at the v from above, which is the minimum without constraints.
        H = _TRACKING_WEIGHT * J.T @ J + free.T @ free + _DAMPING**2 * np.eye(len(v))
        program.AddQuadraticCost(2 * H, -2 * H @ v, x, is_convex=True)
        program.AddBoundingBoxConstraint(least, most, x)
        if len(clear.least):
            unbounded = np.full(len(clear.least), np.inf)
            program.AddLinearConstraint(clear.rows, clear.least, unbounded, x)
        result = self._solver.Solve(program)
        if result.is_success():
            return np.clip(result.GetSolution(x), least, most), NOT_HINDERED
        stopped = np.clip(0.0, v_last - self._change, v_last + self._change)
        worst = np.argmax(clear.least - clear.rows @ stopped)
        return stopped, int(clear.fingers[worst])

    def _bounds(self, q: FloatArray, v_last: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Returns the smallest and largest velocities that respect the joints' limits."""
        hand = self._hand
        most = np.minimum(hand.rate_limit, _LIMIT_RATE * np.maximum(hand.upper - q, 0.0))
        least = -np.minimum(hand.rate_limit, _LIMIT_RATE * np.maximum(q - hand.lower, 0.0))
        slowest, fastest = v_last - self._change, v_last + self._change
        return np.clip(least, slowest, fastest), np.clip(most, slowest, fastest)

    def _goal_rates(
        self, context: Context, placed: Context, v_last: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Returns J and V: with J v = V, frames go to their goals within limits."""
        X_WG, V_WG = self._X_WG.Eval(context), validated_velocity(self._V_WG.Eval(context))
        plant = self._hand.plant
        plant_context, world = plant.GetMyContextFromRoot(placed), plant.world_frame()
        port = f"desired_cartesian_poses of {self.get_name()}"
        goals = validated_poses(self._goals.Eval(context), list(self._frames), port)
        v_WT = np.reshape(self._v_WT.Eval(context), (-1, 3))
        v_goals = dict(zip(self._hand.tip_frames, v_WT, strict=True))
        J, V = [np.empty((0, self._hand.num_positions))], [np.empty(0)]
        for (name, frame), X_WD in zip(self._frames.items(), goals, strict=True):
            if X_WD is None:
                continue
            mask, X_WF = self._masks[name], frame.CalcPoseInWorld(plant_context)
            J_F = plant.CalcJacobianSpatialVelocity(
                plant_context, JacobianWrtVariable.kV, frame, np.zeros(3), world, world
            )
            V_F = pose_error(X_WF, X_WD) / self._period
            if (v_goal := v_goals.get(name)) is None:
                v_goal = V_WG.Shift(X_WF.translation() - X_WG.translation()).translational()
            wanted, last = (v - v_goal for v in (V_F[3:], J_F[3:] @ v_last))
            V_F[3:] = v_goal + self._pace.toward(wanted[None], last[None])[0]
            J.append(J_F[mask])
            V.append(V_F[mask])
        return np.concatenate(J), np.concatenate(V)
