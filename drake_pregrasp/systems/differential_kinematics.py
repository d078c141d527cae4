"""Differential inverse kinematics of a whole hand that keeps its links clear."""

import contextlib
from collections.abc import Mapping
from functools import partial

import numpy as np
from pydrake.solvers import ClarabelSolver, MathematicalProgram
from pydrake.systems.framework import Context, LeafSystem
from scipy.linalg import pinv
from scipy.linalg.lapack import dposv

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.grasping.fingertip_paths import Pace
from drake_pregrasp.grasping.grasp_state import BASE, NOT_BLOCKED
from drake_pregrasp.quality.grasp_quality import skew
from drake_pregrasp.regions.obstacles import ANYWHERE
from drake_pregrasp.systems import ports
from drake_pregrasp.systems.fingertip_sensor import moving_joints, scoped_frame
from drake_pregrasp.systems.hand_scene import FASTEST_APPROACH, HandScene
from drake_pregrasp.systems.palm_posture import pose_error

_TRACKING_WEIGHT = 1e4  # Weight of goals against posture.
_DAMPING = 1e-3  # Singular value of a Jacobian, in metres, below which its direction is given up.
_LIMIT_RATE = 10.0  # Largest ratio of a joint's speed to its distance from a limit, in 1/s.
_USED = 0.75  # Share of the limit of acceleration that is commanded: drives and clearances add.
_GUESSES = 5  # Guesses of the active set before the solver is asked.
_IN_W = np.eye(3), np.zeros(3)  # Rotation and position of W in itself.
_TOLERANCE = 1e-9  # Violation of a constraint that is rounding, in m/s or rad/s.


def _pseudoinverse(J: FloatArray) -> FloatArray:
    """Returns J⁺, in which directions of singular values up to `_DAMPING` are given up."""
    if len(J):
        _, inverse, failure = dposv(J @ J.T, np.eye(len(J)))  # Takes half as long as numpy's.
        # The norm of the inverse is at least the largest 1/s².
        if not failure and np.vdot(inverse, inverse) < _DAMPING**-4:
            return np.asarray(J.T @ inverse)
    return np.asarray(pinv(J, atol=_DAMPING, rtol=0))


def constrained_velocity(
    H: FloatArray, v_free: FloatArray, A: FloatArray, b: FloatArray
) -> FloatArray | None:
    """Returns the v with A v >= b that minimizes (v - v_free)ᵀ H (v - v_free), or None without one.

    With the active constraints A v = b it is v_free + H⁻¹ Aᵀ λ. By the conditions of Karush, Kuhn
    and Tucker this is the optimum if all λ >= 0 and all constraints are kept. Otherwise the next
    guess of the active constraints drops those with λ < 0 and adds those that are violated (a
    primal-dual active-set method; Hintermüller, Ito and Kunisch, 2002). If some guesses fail, the
    solver is asked, which takes ten times as long.

    Args:
        H: Positive definite matrix, shape (nq, nq).
        v_free: Velocities without constraints, shape (nq,).
        A: Gradients of the constraints, shape (k, nq).
        b: Least values of the constraints, shape (k,).
    """
    lacking = b - A @ v_free
    if not np.isfinite(lacking).all():
        return None
    active = lacking > 0
    with contextlib.suppress(np.linalg.LinAlgError):  # Constraints that depend on each other.
        H_inverse = np.linalg.inv(H)
        for _ in range(_GUESSES):
            moves = H_inverse @ A[active].T
            multipliers = np.linalg.solve(A[active] @ moves, lacking[active])
            v: FloatArray = v_free + moves @ multipliers
            violated = ~(A @ v >= b - _TOLERANCE)
            if np.all(multipliers >= 0) and not violated.any():
                return v
            active[active] = multipliers >= 0
            active |= violated
    program = MathematicalProgram()
    # The cost of a small change is small, and so is the error by the solver's relative tolerance.
    dv = program.NewContinuousVariables(len(H))
    program.AddQuadraticCost(2 * H, np.zeros(len(H)), dv, is_convex=True)
    program.AddLinearConstraint(A, lacking, np.full(len(b), np.inf), dv)
    result = ClarabelSolver().Solve(program)
    return v_free + result.GetSolution(dv) if result.is_success() else None


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
        - blocked_finger

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

    Port `blocked_finger` emits a vector of 1: the index of the finger that stops the hand, `BASE`,
    or `NOT_BLOCKED`.

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
        self._gain, self._period, self._each = posture_gain, period, np.eye(nq)
        self._pace = Pace(FASTEST_APPROACH, _USED * acceleration, period)
        self._change = hand.acceleration_limit * period
        # Lower and upper limits of positions, and the range of either limit of velocities.
        self._ends = np.stack([hand.lower, hand.upper])
        self._rates = np.outer([-1.0, 0.0], hand.rate_limit), np.outer([0.0, 1.0], hand.rate_limit)
        self._tips = np.flatnonzero([name in masks for name in hand.tip_frames])
        tip_names = [hand.tip_frames[tip] for tip in self._tips]
        self._names = [*tip_names, *(name for name in masks if name not in tip_names)]
        is_goal = np.array([masks[name] for name in self._names]) > 0
        self._turns, self._shifts = np.split(is_goal, 2, axis=1)  # Rotations and translations.
        self._turning = np.flatnonzero(self._turns.any(axis=1))
        self._frames = [scoped_frame(hand.plant, name) for name in self._names]
        moves = [[moving_joints(hand.plant, frame)] for frame in self._frames]
        self._moves = np.array(moves, dtype=float)
        self._q = self.DeclareVectorInputPort("position", nq)
        self._v = self.DeclareVectorInputPort("velocity", nq)
        self._posture = self.DeclareVectorInputPort("nominal_posture", nq)
        self._goals = self.DeclareAbstractInputPort("desired_cartesian_poses", ports.BUS)
        self._v_WT = self.DeclareVectorInputPort("v_WT", 3 * n)
        self._X_WG = self.DeclareAbstractInputPort("X_WG", ports.POSE)
        self._V_WG = self.DeclareAbstractInputPort("V_WG", ports.VELOCITY)
        self._X_WO = self.DeclareAbstractInputPort("X_WO_estimated", ports.POSE)
        self._V_WO = self.DeclareAbstractInputPort("V_WO_estimated", ports.VELOCITY)
        self._hold = self.DeclareVectorInputPort("fingers_hold", n)
        self._obstacles = self.DeclareAbstractInputPort("obstacles", ports.OBSTACLES)
        self._pose = ports.LastPose(self, self._X_WO)
        placing = (self._q, self._X_WG, self._hold, self._obstacles, self._pose.source)
        words, calc = "the hand and what is around it", self._calc_placed
        self._placed = ports.declare_context(self, words, scene.diagram, calc, *placing)
        inputs = (self._v, self._posture, self._goals, self._v_WT, self._V_WG, self._V_WO)
        model, sources = (np.zeros(nq), NOT_BLOCKED), (self._placed, *inputs)
        self._step = step = ports.declare_cache(
            self, "velocities", model, self._calc_step, *sources
        )
        output = partial(ports.declare_output, self)
        output("commanded_velocity", nq, lambda context: step.Eval(context)[0], step)
        output("blocked_finger", 1, lambda context: step.Eval(context)[1], step)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._pose.store)

    def _holding(self, context: Context) -> BoolArray:
        return np.asarray(~(self._hold.Eval(context) <= 0))

    def _calc_placed(self, context: Context, placed: Context) -> None:
        is_held = self._holding(context).any()
        X_WO = self._X_WG.Eval(context) if is_held else self._pose.eval(context)
        solids = ports.eval_solids(self, self._obstacles, context, *_IN_W)
        known = [solid for solid in solids if solid is not ANYWHERE]
        self._scene.place(placed, self._q.Eval(context), X_WO, known)

    def _calc_step(self, context: Context) -> tuple[FloatArray, int]:
        placed, holding = self._placed.Eval(context), self._holding(context)
        V_WO = ports.validated_velocity((self._V_WG if holding.any() else self._V_WO).Eval(context))
        q, v_last = self._q.Eval(context), self._v.Eval(context)
        least, most = self._bounds(q, v_last)
        plant_context = self._hand.plant.GetMyContextFromRoot(placed)
        screws = self._hand.screws(plant_context)
        J, V = self._goal_rates(context, plant_context, screws, v_last)
        J_plus = _pseudoinverse(J)
        homeward = self._gain * (self._posture.Eval(context) - q)
        v = homeward + J_plus @ (V - J @ homeward)
        clear = self._scene.clearances(placed, screws, V_WO, holding)
        slack = np.concatenate([v - least, most - v, clear.rows @ v - clear.least])
        if np.minimum.reduce(slack) >= -_TOLERANCE:
            return v, NOT_BLOCKED
        # Both costs are zero at the v from above, which is the minimum without constraints.
        A = np.concatenate([self._each, -self._each, clear.rows])
        b = np.concatenate([least, -most, clear.least])
        free = self._each - J_plus @ J
        H = _TRACKING_WEIGHT * J.T @ J + free + _DAMPING**2 * self._each
        solution = constrained_velocity(H, v, A, b)
        if solution is not None:
            return np.clip(solution, least, most), NOT_BLOCKED
        stopped = np.clip(0.0, v_last - self._change, v_last + self._change)
        lacking = clear.least - clear.rows @ stopped
        blocking = int(clear.fingers[np.argmax(lacking)]) if len(lacking) else BASE
        return stopped, blocking

    def _bounds(self, q: FloatArray, v_last: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Returns the smallest and largest velocities that respect the joints' limits."""
        slowest, fastest = self._rates
        limits = np.minimum(np.maximum(_LIMIT_RATE * (self._ends - q), slowest), fastest)
        least, most = np.maximum(v_last - self._change, np.minimum(limits, v_last + self._change))
        return least, most

    def _goal_rates(
        self, context: Context, plant_context: Context, screws: FloatArray, v_last: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Returns J and V: with J v = V, frames go to their goals within limits."""
        port = f"desired_cartesian_poses of {self.get_name()}"
        X_WD = ports.validated_poses(self._goals.Eval(context), self._names, port)
        X_WF = [frame.CalcPoseInWorld(plant_context) for frame in self._frames]
        p_WF = np.array([X.translation() for X in X_WF])
        p_WD = np.array(
            [p if X is None else X.translation() for p, X in zip(p_WF, X_WD, strict=True)]
        )
        J = self._moves * (screws[3:] - skew(p_WF) @ screws[:3])
        v_goal = self._v_WT.Eval(context).reshape(-1, 3)[self._tips]
        if len(p_GF_W := p_WF[len(v_goal) :]):  # These move with G.
            w_WG, v_WG = ports.validated_velocity(self._V_WG.Eval(context))
            p_GF_W = p_GF_W - self._X_WG.Eval(context).translation()
            v_goal = np.concatenate([v_goal, v_WG + p_GF_W @ skew(w_WG).T])
        wanted = (p_WD - p_WF) / self._period - v_goal
        V = v_goal + self._pace.toward(wanted, J @ v_last - v_goal)
        shifts = self._shifts & np.array([[X is not None] for X in X_WD])
        J, V = J[shifts], V[shifts]
        for i in self._turning:
            if X_WD[i] is not None:
                turns, w = self._turns[i], pose_error(X_WF[i], X_WD[i])[:3] / self._period
                J = np.concatenate([J, (self._moves[i] * screws[:3])[turns]])
                V = np.concatenate([V, w[turns]])
        return J, V
