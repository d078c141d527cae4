"""Estimate of the sensor's noise from the measurements alone, whatever the object's motion is.

Fourth differences of poses remove a motion with a constant jerk, and leave the noise.
"""

from dataclasses import dataclass, replace

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.estimation.pose_belief import PoseMeasurement
from drake_pregrasp.geometry.rotations import rotation_vector

POSES = 5
"""Number of poses in a fourth difference."""

_SQUARES = 15  # Fourth differences in the median.
_LEAST = 5  # The same at least.
_MEDIAN = 0.789  # Median of a chi-square number with 3 degrees of freedom over 3.
_TOLERATED = 2.5  # Variance over the assumed one that may be chance, or the motion's.
_MOST = 25.0  # Largest variance over the assumed one that is believed.
_CLOSEST = 1e-6  # Times that differ by less, in seconds, do not tell a difference.
_ONES, _EACH = np.ones(2), np.eye(POSES)
_NO_POSES = np.full((POSES, 7), np.nan)


@dataclass(frozen=True, eq=False)
class NoiseEstimate:
    """Newest poses that were measured in time, and the fourth differences of such poses.

    Attributes:
        poses: Time, orientation relative to the newest one as a sum of rotation vectors, and
            position of each pose, oldest first, shape (5, 7); NaN if missing.
        squares: Mean square of the coordinates of each fourth difference, over its expectation with
            the assumed noise, of orientation and position, oldest first, shape (15, 2); NaN if
            missing.
    """

    poses: FloatArray
    squares: FloatArray

    @staticmethod
    def empty() -> "NoiseEstimate":
        """Returns the estimate before the first measurement."""
        return NoiseEstimate(_NO_POSES, np.full((_SQUARES, 2), np.nan))

    @property
    def ratios(self) -> FloatArray:
        """Variances of measured orientation and position over the assumed ones, shape (2,).

        As medians they bear outliers and sudden changes of the motion. They are 0 while too few
        measurements are known.
        """
        known = self.squares[~np.isnan(self.squares[:, 0])]
        if len(known) < _LEAST:
            return np.zeros(2)
        return np.asarray(np.sort(known, axis=0)[len(known) // 2] / _MEDIAN)

    @property
    def factors(self) -> FloatArray:
        """Factors on the assumed variances: 1 unless the ratio is clearly larger, shape (2,)."""
        ratios = self.ratios
        if ratios.max() <= _TOLERATED:
            return _ONES
        return np.where(ratios > _TOLERATED, np.minimum(ratios, _MOST), 1.0)

    def replayed(
        self, measurements: list[PoseMeasurement], variances: FloatArray
    ) -> "NoiseEstimate":
        """Returns the estimate after an out-of-sequence measurement.

        Args:
            measurements: The measurements in memory with the new one, oldest first.
            variances: Assumed variances of a measured orientation and position.
        """
        noise, newest = replace(self, poses=_NO_POSES), measurements[-POSES:]
        for before, measurement in zip([newest[0], *newest], newest, strict=False):
            noise = noise.updated(before, measurement, variances)
        return noise

    def updated(
        self, before: PoseMeasurement, measurement: PoseMeasurement, variances: FloatArray
    ) -> "NoiseEstimate":
        """Returns the estimate after a measurement.

        The differences are divided ones, so that the measurements need not be equally spaced. They
        start anew after a measurement of a part of the pose.

        Args:
            before: The measurement before.
            measurement: The new measurement.
            variances: Assumed variances of a measured orientation and position.
        """
        if not measurement.is_whole:
            return replace(self, poses=_NO_POSES)
        poses = np.empty_like(self.poses)
        poses[:-1], poses[-1, 0], poses[-1, 4:] = self.poses[1:], measurement.time, measurement.p_WO
        poses[:-1, 1:4] -= rotation_vector(measurement.R_WO @ before.R_WO.T)
        poses[-1, 1:4] = 0.0
        times = poses[:, 0]
        if not np.minimum.reduce(times[1:] - times[:-1]) > _CLOSEST:  # Also if a pose is missing.
            return NoiseEstimate(poses, self.squares)
        weights = 1 / np.multiply.reduce(times[:, None] - times + _EACH, axis=1)
        parts = (weights @ poses[:, 1:]).reshape(2, 3)
        # Directions that are measured in part have larger variances than the assumed ones.
        assumed = np.repeat(variances, 3)
        ratios = (np.linalg.inv(measurement.directions) ** 2 @ assumed / assumed).reshape(2, 3)
        expected = (weights @ weights) * np.add.reduce(ratios, axis=1) * variances
        square = np.add.reduce(parts * parts, axis=1) / expected
        return NoiseEstimate(poses, np.concatenate([self.squares[1:], square[None]]))
