"""Measurement of a pose by the points that cameras see."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.estimation.pose_belief import (
    NO_MEASUREMENT,
    PoseBelief,
    PoseFilterNoise,
    PoseMeasurement,
)
from drake_pregrasp.estimation.pose_filter import predicted_mean
from drake_pregrasp.estimation.registration import AS_WELL, register_pose
from drake_pregrasp.estimation.surface_alignment import (
    Alignment,
    SurfacePoints,
    align_pose,
    measured_part,
)
from drake_pregrasp.geometry.mesh_solid import MeshSolid

_REGISTERED = 0.5  # Least share of points that fit a first pose.


@dataclass(frozen=True, eq=False)
class SeenObject:
    """An object whose pose points measure, and what is assumed about them.

    Attributes:
        solid: The object in O.
        noise: Noise and motion that the filter assumes: of a pose, errors that all points share.
        p_OCoM: Centre of mass in O, shape (3,), in metres.
        point_std: Standard deviation of a point's distance from the surface, in metres.
        fewest: Least number of points that must fit.
        rests_on_table: Whether the object rests on the plane z = 0 of W at first.
        align: Implementation of `align_pose`.
    """

    solid: MeshSolid
    noise: PoseFilterNoise
    p_OCoM: FloatArray
    point_std: float
    fewest: int
    rests_on_table: bool
    align: Callable[..., Alignment] = align_pose

    def measured(
        self, p_WQ: FloatArray, time: float, belief: PoseBelief | None, *, is_followed: bool = True
    ) -> PoseMeasurement:
        """Returns the part of a pose that points measure; it is NaN if too few fit.

        Args:
            p_WQ: The points in W, shape (N, 3), in metres.
            time: Their time, in seconds.
            belief: Belief of one model from before that time; None if there is none.
            is_followed: Whether the belief is followed. Otherwise the pose is registered anew, and
                the prediction counts only if it fits as well.
        """
        least = float(self.fewest)
        std = np.sqrt(np.repeat(self.noise.variances, 3))
        nothing = replace(NO_MEASUREMENT, time=time, p_WO=np.full(3, np.nan))
        if len(p_WQ) < least:
            return nothing
        found = None if belief is None else self._followed(p_WQ, time, belief, std)
        if found is None or not is_followed:
            least = max(least, _REGISTERED * len(p_WQ))
            registered = register_pose(
                self.solid.surface,
                self.solid.corners,
                p_WQ,
                std,
                point_std=self.point_std,
                table=self.rests_on_table,
                offset_std=self.noise.bias,
                align=self.align,
            )
            if found is None or not found.fits > registered.fits - AS_WELL * len(p_WQ):
                found = registered
        if not (found.fits >= least and np.isfinite(found.p_WO).all()):
            return nothing
        return measured_part(time, found, std)

    def _followed(
        self, p_WQ: FloatArray, time: float, belief: PoseBelief, std: FloatArray
    ) -> Alignment:
        """Returns the alignment that starts from the prediction of a belief."""
        dt = max(0.0, time - belief.time)
        R_WO, p_WCoM, _ = predicted_mean(belief, dt, self.noise.gravity)
        p_WO = p_WCoM - R_WO @ self.p_OCoM
        if belief.b_W.size:
            p_WO = p_WO + belief.b_W[0]
        points = SurfacePoints.seen(p_WQ, self.point_std)
        return self.align(self.solid.surface, points, R_WO, p_WO, std)
