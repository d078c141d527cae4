"""Measurement of an object's pose by contacts: fingertips that touch it, and the table below.

A camera with a wrong place shows the object displaced by a slowly changing offset. The filter
estimates it beside the pose (`pose_filter`). Contacts in W do not share the offset, so that they
measure the pose itself: the centre of a fingertip is a radius away from the surface, as a point of
`surface_alignment`, and the flat side on which an object stands, or else its lowest point, has the
height 0. Directions without contact keep their uncertainty.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.estimation.pose_belief import PoseBelief, PoseFilterNoise
from drake_pregrasp.estimation.pose_filter import (
    coordinates,
    correct,
    merged,
    predicted_mean,
    process_noise,
    transitions,
)
from drake_pregrasp.estimation.surface_alignment import SurfacePoints
from drake_pregrasp.geometry.mesh_solid import MeshSolid
from drake_pregrasp.geometry.resting import TIPPING, FlatSide

_PASSES = 2  # Linearizations of the distances.
_GATE = 9.0  # Squared Mahalanobis distance up to which something touches: three deviations.
_VAGUE = 9e-4  # Variance of a distance, in m², besides the offset's, with which all is likely.
_LARGEST_TURN = 0.2  # Standard deviation of a turn up to which distances are linear, in radians.
_NEAR = 0.004  # Distance within the margin of the grid, in metres.
_UP = np.array([0.0, 0.0, 1.0])
_COS_STANDING = np.cos(TIPPING)  # Cosine of the largest tilt of a side that stands on the table.
_TOUCH_TIME = 0.05  # Seconds in which the error of a contact stays the same.
_PUSHED = 1 / 16  # Variance of a touched object's motion in this time, over that of a touch.


@dataclass(frozen=True, eq=False)
class Contacts:
    """Contacts of an object at one time.

    Attributes:
        solid: The object in O.
        p_OCoM: Centre of mass in O, shape (3,), in metres.
        touches: Fingertips; a bound counts where it is violated.
        rests: Whether the object is on the plane z = 0 of W.
        std: Standard deviation of its height there, in metres.
        pushed: Variance of the motion along the normal of each fingertip since the last contacts,
            in m². It keeps an error that lasts from being averaged out.
        sides: Flat sides on which it may stand. If none is level within `TIPPING`, its lowest point
            is on the plane.
    """

    solid: MeshSolid
    p_OCoM: FloatArray
    touches: SurfacePoints
    rests: bool
    std: float
    pushed: float = 0.0
    sides: Sequence[FlatSide] = ()

    def residuals(
        self, R_WO: FloatArray, p_WCoM: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
        """Returns residuals, shape (m,), Jacobians, standard deviations, and which are touches.

        An error (theta, p) of orientation and centre of mass changes the residual of a fingertip by
        [(n x a)ᵀ, -nᵀ], with the outward normal n and the vector a from the centre of mass. The
        same holds for points on the table; n points down there.

        Args:
            R_WO: Orientation, shape (3, 3).
            p_WCoM: Centre of mass in W, shape (3,), in metres.
        """
        touches = self.touches
        a = touches.p_WQ - p_WCoM
        p_OT = a @ R_WO + self.p_OCoM
        distances, gradients = self.solid.surface.at(p_OT)
        near = ~touches.is_bound | (distances < touches.radius + _NEAR)
        distances, gradients = self._refined(p_OT[near], distances[near], gradients[near])
        a, e = a[near], distances - touches.radius[near]
        n, std = gradients @ R_WO.T, touches.std[near]
        counts = ~(touches.is_bound[near] & (e > 0))
        a, e, n, std = a[counts], e[counts], n[counts], std[counts]
        is_touch = ~touches.is_bound[near][counts]
        if self.rests:
            below = (self._below(R_WO) - self.p_OCoM) @ R_WO.T
            count = len(below)  # Together they tell the height as well as one point does.
            a, n = np.vstack([a, below]), np.vstack([n, np.tile(-_UP, (count, 1))])
            e = np.append(e, p_WCoM[2] + below[:, 2])
            std = np.append(std, np.full(count, self.std * count**0.5))
            is_touch = np.append(is_touch, np.zeros(count, dtype=bool))
        return e, np.hstack([np.cross(n, a), -n]), std, is_touch

    def _below(self, R_WO: FloatArray) -> FloatArray:
        """Returns the points in O that are on the table, shape (m, 3), in metres."""
        down = [side.nhat @ R_WO[2] for side in self.sides]
        if down and min(down) < -_COS_STANDING:
            return self.sides[int(np.argmin(down))].p_OV
        corners = self.solid.corners
        return corners[[np.argmin(corners @ R_WO[2])]]

    def _refined(
        self, p_OT: FloatArray, distances: FloatArray, gradients: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Returns signed distances and unit gradients at fingertips, shape (m, 3).

        Gradients are coarse outside the grid, where a large fingertip has its centre, so they are
        evaluated on the way to the surface. There the distance is shorter by this way.
        """
        if not len(p_OT):
            return distances, gradients
        nearer = p_OT - np.maximum(0.0, distances - _NEAR)[:, None] * gradients
        distances, gradients = self.solid.surface.at(nearer)
        return distances + np.einsum("ki,ki->k", p_OT - nearer, gradients), gradients


def conditioned(
    belief: PoseBelief, contacts: Contacts, R_WO: FloatArray, p_WCoM: FloatArray
) -> PoseBelief:
    """Returns a belief of one model with its covariance given contacts; the means stay.

    A contact counts if it is within three of its own standard deviations from the pose.

    Args:
        belief: Belief without them, at their time.
        contacts: The contacts.
        R_WO: Orientation, shape (3, 3).
        p_WCoM: Centre of mass in W, shape (3,), in metres.
    """
    e, J, std, _ = contacts.residuals(R_WO, p_WCoM)
    fits = e**2 <= _GATE * std**2
    if not fits.any():
        return belief
    H = np.zeros((1, int(fits.sum()), belief.P.shape[-1]))
    H[0, :, :6] = J[fits]
    return correct(belief, np.zeros(H.shape[:2]), H, np.diag(std[fits] ** 2)).belief


def touch_noise(std: float, period: float) -> tuple[float, float]:
    """Returns the standard deviation of a contact at each tick, and the variance of pushes.

    More ticks in the same time tell no more. After many ticks, the standard deviation along the
    normal stays about half of the one that is given.

    Args:
        std: Standard deviation of a contact, in metres.
        period: Seconds between ticks.
    """
    at_tick = std * max(1.0, _TOUCH_TIME / period) ** 0.5
    return at_tick, std**2 * _PUSHED * period / _TOUCH_TIME


def felt(
    belief: PoseBelief,
    dt: float,
    contacts: Contacts,
    noise: PoseFilterNoise,
    merge: Callable[[PoseBelief], PoseBelief] = merged,
) -> tuple[PoseBelief, bool]:
    """Returns a belief after contacts at a later time, and whether a fingertip confirms it.

    A fingertip confirms the belief if it touches the surface where that is expected.

    A touch may push the object, so that its position becomes less certain along the normal before
    it is measured. Residual and Jacobian are those at the pose predicted for that time; what the
    motion may change until then adds to the noise. A contact is left out if it is more than three
    standard deviations from the prediction, or if the prediction is too vague to tell. A turn that
    no measurement has shown, such as that of a can about its axis, is left as it is: distances are
    not linear in it.

    Args:
        belief: Belief before, at its time.
        dt: Time from that of the belief to that of the contacts, in seconds.
        contacts: The contacts.
        noise: Noise and motion that the filter assumes.
        merge: Implementation of `merged`.
    """
    belief = _pushed(belief, dt, contacts, noise, merge)
    prior, after, confirms = merge(belief), belief, False
    Q = process_noise(noise, dt)[:, :6, :6]
    turns, axes = np.linalg.eigh(prior.P[0, :3, :3])
    known = axes * (turns < _LARGEST_TURN**2) @ axes.T
    for _ in range(_PASSES):
        mean = merge(after)
        R_WO, p_WCoM, _ = predicted_mean(mean, dt, noise.gravity)
        e, J, std, is_touch = contacts.residuals(R_WO, p_WCoM)
        J[:, :3] = J[:, :3] @ known
        H = J @ transitions(mean, dt, noise)[0, :6]
        R = J @ Q @ J.T + np.diag(std**2)
        R_at, x = mean.R_WO[0], coordinates(mean, mean.R_WO[0])
        expected = e + (coordinates(prior, R_at) - x)[0] @ H.T
        S = H @ prior.P[0] @ H.T + np.tensordot(belief.weights, R, 1)
        variances = S.diagonal()
        is_known = variances <= _VAGUE + noise.bias**2
        likely = np.flatnonzero(is_known & (expected**2 <= _GATE * variances))
        if not len(likely):
            return belief, False
        confirms = bool(is_touch[likely].any())
        H, R = H[likely], R[:, likely[:, None], likely]
        residual = -e[likely] - (coordinates(belief, R_at) - x) @ H.T
        after = correct(belief, residual, np.tile(H, (len(R), 1, 1)), R).belief
    return after, confirms


def _pushed(
    belief: PoseBelief,
    dt: float,
    contacts: Contacts,
    noise: PoseFilterNoise,
    merge: Callable[[PoseBelief], PoseBelief],
) -> PoseBelief:
    """Returns a belief with more variance along the normals of fingertips; arguments of `felt`."""
    R_WO, p_WCoM, _ = predicted_mean(merge(belief), dt, noise.gravity)
    _, J, *_ = replace(contacts, rests=False).residuals(R_WO, p_WCoM)
    P = belief.P.copy()
    P[:, 3:6, 3:6] += contacts.pushed * J[:, 3:].T @ J[:, 3:]
    return replace(belief, P=P)
