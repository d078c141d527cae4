"""The object's pose, twist and uncertainty from noisy pose measurements."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    LeafSystem,
    ValueProducer,
)

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.pose_filter import (
    PoseBelief,
    PoseFilterNoise,
    first_belief,
    predict,
    update,
)
from drake_pregrasp.systems.tick import tick_is_due


class PoseEstimator(LeafSystem):
    """Estimates pose and twist of the object O in the world W.

    .. pydrake_system::

        name: PoseEstimator
        input_ports:
        - X_WO_measured
        output_ports:
        - X_WO_estimated
        - V_WO_estimated
        - p_WO_covariance

    Port `X_WO_measured` accepts a `RigidTransform`; it is sampled once each period.

    Port `X_WO_estimated` emits a `RigidTransform`.

    Port `V_WO_estimated` emits a `SpatialVelocity`: of O's frame in W, expressed in W.

    Port `p_WO_covariance` emits a vector of 9: the covariance Sigma of the position estimate, which
    is made at the object's centre of mass, expressed in W, row-major, in m² (Eq. 3).

    A Kalman filter follows the centre of mass, an error-state filter the orientation. There is no
    lag: at a tick the outputs are the posterior of that tick's measurement, whether they are
    evaluated before the discrete update stores it or after (the stored belief carries its time, so
    that no measurement counts twice). Between ticks they are predictions.

    Args:
        period: Seconds between measurements, greater than zero.
        noise: What the filter assumes.
        p_OCoM: The object's centre of mass in O, shape (3,), in metres.
        lookahead: Seconds by which the outputs are predicted ahead of the time, at least zero.

    Raises:
        InvalidArgumentError: If `period` or `lookahead` is out of its range.
    """

    def __init__(
        self,
        *,
        period: float,
        noise: PoseFilterNoise,
        p_OCoM: FloatArray | None = None,
        lookahead: float = 0.0,
    ) -> None:
        super().__init__()
        if not period > 0:
            raise InvalidArgumentError(f"period must be greater than 0 s, not {period}")
        if not lookahead >= 0:
            raise InvalidArgumentError(f"lookahead must be at least 0 s, not {lookahead}")
        self._period = period
        self._noise = noise
        self._p_OCoM = np.zeros(3) if p_OCoM is None else np.array(p_OCoM, dtype=float)
        self._lever_arm = self._p_OCoM if np.any(self._p_OCoM) else None
        self._lookahead = lookahead

        self._state_index = self.DeclareDiscreteState(PoseBelief.empty().to_vector())
        self._X_WO_measured = self.DeclareAbstractInputPort(
            "X_WO_measured", AbstractValue.Make(RigidTransform())
        )
        sources = {
            self.time_ticket(),
            self.discrete_state_ticket(self._state_index),
            self._X_WO_measured.ticket(),
        }
        self._belief = self.DeclareCacheEntry(
            "belief at the Context's time",
            ValueProducer(lambda: AbstractValue.Make(PoseBelief.empty()), self._calc_belief),
            sources,
        )
        self.DeclareAbstractOutputPort(
            "X_WO_estimated",
            lambda: AbstractValue.Make(RigidTransform()),
            self._calc_pose,
            {self._belief.ticket()},
        )
        self.DeclareAbstractOutputPort(
            "V_WO_estimated",
            lambda: AbstractValue.Make(SpatialVelocity()),
            self._calc_velocity,
            {self._belief.ticket()},
        )
        self.DeclareVectorOutputPort(
            "p_WO_covariance", 9, self._calc_covariance, {self._belief.ticket()}
        )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._store_belief)

    def _calc_belief(self, context: Context, output: AbstractValue) -> None:
        time = context.get_time()
        belief = PoseBelief.from_vector(context.get_discrete_state(self._state_index).value())
        if tick_is_due(time, belief.time, self._period):
            X_WO: RigidTransform = self._X_WO_measured.Eval(context)
            p_WCoM = X_WO @ self._p_OCoM
            R_WO: FloatArray = X_WO.rotation().matrix()
            if belief.is_empty or belief.time > time:  # The latter if the Context was set back.
                belief = first_belief(time, p_WCoM, R_WO, self._noise, self._lever_arm)
            else:
                prior = predict(belief, time - belief.time, self._noise)
                belief = update(prior, p_WCoM, R_WO, self._noise, self._lever_arm)
        else:
            belief = predict(belief, max(0.0, time - belief.time), self._noise)
        output.set_value(belief)

    def _store_belief(self, context: Context, discrete_state: DiscreteValues) -> None:
        belief: PoseBelief = self._belief.Eval(context)
        discrete_state.set_value(self._state_index, belief.to_vector())

    def _looked_ahead(self, context: Context) -> PoseBelief:
        belief: PoseBelief = self._belief.Eval(context)
        return predict(belief, self._lookahead, self._noise) if self._lookahead else belief

    def _calc_pose(self, context: Context, output: AbstractValue) -> None:
        belief = self._looked_ahead(context)
        R_WO = RotationMatrix.ProjectToRotationMatrix(belief.R_WO)
        output.set_value(RigidTransform(R_WO, belief.p_WCoM - R_WO @ self._p_OCoM))

    def _calc_velocity(self, context: Context, output: AbstractValue) -> None:
        belief = self._looked_ahead(context)
        p_CoMO_W = -(belief.R_WO @ self._p_OCoM)
        v_WO = belief.v_WCoM + np.cross(belief.w_WO, p_CoMO_W)
        output.set_value(SpatialVelocity(w=belief.w_WO, v=v_WO))

    def _calc_covariance(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._looked_ahead(context).p_WCoM_covariance.ravel())
