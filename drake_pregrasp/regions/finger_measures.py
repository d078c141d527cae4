"""Hand-centric measures of contacts: manipulability, joint range and force of their fingers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.quality.grasp_quality import posture_measures

FINGER_MEASURES = (
    "singularity_distance",
    "manipulability",
    "uniformity",
    "joint_range",
    "finger_force",
)
"""Names of the measures, in the order of `FingerMeasures.at`."""

_FORCELESS = 1 - len(FINGER_MEASURES)  # First column of the table after those of the Jacobian.

LEAST_ARM = 1e-3
"""Least lever arm of a force about a joint, in metres, so that all forces are finite."""

ARRIVED = 1e-3
"""Largest distance of a fingertip from a place that it reaches, in metres."""

_NODES = 16  # Number of nodes along each axis of a lattice.
_SAMPLES = 3000  # Places of a fingertip; 90 % are nearer to the next than half of 12 mm.
_NEAR = 8  # Number of samples near a node, of which the one closest to home is taken.
_STEPS = 12  # Number of steps from there to the node.
_LAST = 4  # Number of the last steps, which no longer lead toward home.
_DAMPING = 0.01  # Damping of these steps, in metres per radian.
_LEAST_SIZE = 1e-3  # Least size of a lattice, in metres.
_HOMEWARD = 0.3  # Share of the distance to home per step, in the null space of the fingertip.


@dataclass(frozen=True, eq=False)
class FingerChain:
    """Serial finger on a palm that rests in a frame U, as a product of exponentials.

    Attributes:
        screws: Screws of the joints at home, in U, from the palm to the tip, shape (k, 6): rotation
            and, at the origin of U, translation per unit rate.
        tip: Centre of the fingertip at home in U, shape (3,), in metres.
        home: Home positions of the joints, shape (k,), in radians or metres.
        lower: Lower limits of the joints, shape (k,).
        upper: Upper limits of the joints, shape (k,).
        efforts: Largest torques or forces of the joints, shape (k,), in N m or N.
    """

    screws: FloatArray
    tip: FloatArray
    home: FloatArray
    lower: FloatArray
    upper: FloatArray
    efforts: FloatArray

    def tips(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Returns centres of the fingertip in U, shape (m, 3), and Jacobians, shape (m, 3, k).

        Args:
            q: Positions of the joints, shape (m, k).
        """
        *before, (R_UB, p_UB) = self.displacements(q)
        p_UT = R_UB @ self.tip + p_UB
        R_UJ, p_UJ = (np.stack(parts, axis=1) for parts in zip(*before, strict=True))
        w, v = (R_UJ @ part[:, :, None] for part in np.split(self.screws, 2, axis=1))
        J = v[..., 0] + np.cross(w[..., 0], p_UT[:, None] - p_UJ)
        return p_UT, J.swapaxes(1, 2)

    def displacements(self, q: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
        """Returns how links have moved from home: R and p with p_U = R p_U(home) + p for each.

        A joint moves what it carries by exp([S] (q - q_home)), whose rotation R is about the point
        w x v of its axis.

        Args:
            q: Positions of the joints, shape (m, k).

        Returns:
            Rotations, shape (m, 3, 3), and translations, shape (m, 3), in metres: of the palm, then
            of the link behind each joint.
        """
        w, v = np.split(self.screws, 2, axis=1)
        moved, center = (q - self.home)[:, :, None], np.cross(w, v)
        slide = np.where(np.any(w, axis=1, keepdims=True), np.sum(w * v, axis=1)[:, None] * w, v)
        turns = Rotation.from_rotvec((moved * w).reshape(-1, 3)).as_matrix()
        turns = turns.reshape(*q.shape, 3, 3)
        shifts = center - (turns @ center[:, :, None])[..., 0] + moved * slide
        R_UB, p_UB = np.tile(np.eye(3), (len(q), 1, 1)), np.zeros((len(q), 3))
        found = [(R_UB, p_UB)]
        for R, shift in zip(turns.swapaxes(0, 1), shifts.swapaxes(0, 1), strict=True):
            p_UB = p_UB + (R_UB @ shift[:, :, None])[:, :, 0]
            R_UB = R_UB @ R
            found.append((R_UB, p_UB))
        return found

    def along(self, p_UT: FloatArray) -> FloatArray:
        """Returns the parts of places along the directions in which the joints move the tip.

        Args:
            p_UT: Places in U, shape (m, 3), in metres.

        Returns:
            The places whose distance from the tip at home has these parts, shape (m, 3); with three
            joints or more, the places themselves.
        """
        if len(self.home) >= p_UT.shape[1]:
            return p_UT
        J = self.tips(self.home[None])[1][0]
        return np.asarray(self.tip + (p_UT - self.tip) @ (J @ np.linalg.pinv(J)))

    @cached_property
    def samples(self) -> FloatArray:
        """Evenly spread positions of the joints, shape (m, k)."""
        # Imported only here, because scipy.stats takes a quarter of a second.
        from scipy.stats.qmc import Halton

        share = Halton(len(self.home), seed=0).random(_SAMPLES)
        q: FloatArray = self.lower + share * (self.upper - self.lower)
        return q

    @cached_property
    def workspace(self) -> cKDTree:
        """Places of the fingertip in U at `samples`."""
        return cKDTree(self.tips(self.samples)[0])

    def postures(self, p_UT: FloatArray) -> FloatArray:
        """Returns positions of the joints, near home, that bring the fingertip closest to places.

        Args:
            p_UT: Places in U, shape (m, 3), in metres.
        """
        _, near = self.workspace.query(p_UT, k=_NEAR)
        away = np.linalg.norm(self.samples[near] - self.home, axis=2)
        q: FloatArray = self.samples[near[np.arange(len(near)), np.argmin(away, axis=1)]]
        damping, free = _DAMPING**2 * np.eye(3), np.ones(q.shape, dtype=bool)
        for step in range(_STEPS):
            p, J = self.tips(q)
            J = J * free[:, None]
            inverse = J.swapaxes(1, 2) @ np.linalg.inv(J @ J.swapaxes(1, 2) + damping)
            homeward = _HOMEWARD * (self.home - q) * free * (step < _STEPS - _LAST)
            error = p_UT - p - (J @ homeward[:, :, None])[:, :, 0]
            goal = q + homeward + (inverse @ error[:, :, None])[:, :, 0]
            q = np.clip(goal, self.lower, self.upper)
            free = q == goal  # What a limit stops leaves the next step to the other joints.
        return q


@dataclass(frozen=True, eq=False)
class FingerLinks:
    """Links of a finger without its fingertip, as balls inside.

    Attributes:
        chain: The finger.
        balls: Number of joints that carry each link, and its balls with the joints at home: centres
            in U and radii, shape (b, 4), in metres.
    """

    chain: FingerChain
    balls: Sequence[tuple[int, FloatArray]]

    def gaps(self, p_UT: FloatArray, distance: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """Returns the least gap of the links to an object, shape (k,), in metres; negative inside.

        The finger is in the posture closest to home, as that of a hand whose joints are drawn home
        while its tips follow their goals. Where this does not get there, the gap is -inf.

        Args:
            p_UT: Places of the fingertip in U, shape (k, 3), in metres.
            distance: Function from points in U, shape (p, 3), to their signed distances from the
                object, shape (p,), in metres.
        """
        q = self.chain.postures(p_UT)
        off = np.linalg.norm(self.chain.tips(q)[0] - p_UT, axis=1)
        moved, gaps = self.chain.displacements(q), np.where(off <= ARRIVED, np.inf, -np.inf)
        for joints, balls in self.balls:
            R_UB, p_UB = moved[joints]
            p_US = balls[:, :3] @ R_UB.swapaxes(1, 2) + p_UB[:, None]
            away = distance(p_US.reshape(-1, 3)).reshape(p_US.shape[:-1]) - balls[:, 3]
            gaps = np.minimum(gaps, np.min(away, axis=1))
        return gaps


@dataclass(frozen=True, eq=False)
class FingerMeasures:
    """Measures of n fingers at places of their tips, as lattices in the palm's frame U.

    Attributes:
        low: Corner of each finger's lattice in U, shape (n, 3), in metres.
        step: Distances between its nodes, shape (n, 3), in metres.
        table: At each node, the columns of the Jacobian in U and all measures but the force, shape
            (n, N, N, N, 3k + 4); NaN where the finger cannot bring its tip near the
            node. Fingers with fewer than k joints have columns of zeros.
        efforts: Largest torques or forces of the joints, shape (n, k), in N m or N.
        least: Least value of each of the `FINGER_MEASURES`, shape (5,); 0 for no limit.
        R_OU: Orientation of U in the frame O of the places, shape (3, 3).
        p_OU: Position of U in O, shape (3,), in metres.
    """

    low: FloatArray
    step: FloatArray
    table: FloatArray
    efforts: FloatArray
    least: FloatArray = field(default_factory=lambda: np.zeros(len(FINGER_MEASURES)))
    R_OU: FloatArray = field(default_factory=lambda: np.eye(3))
    p_OU: FloatArray = field(default_factory=lambda: np.zeros(3))

    @staticmethod
    def around(radius: float, fingers: Sequence[FingerChain]) -> "FingerMeasures":
        """Returns the measures of a hand's fingers around the origin of U, without limits.

        The posture at a node is the one closest to home, as that of a hand whose joints are drawn
        home while its tips follow their goals.

        Args:
            radius: Largest distance of fingertips from the origin of U, in metres.
            fingers: The fingers.
        """
        most = max(len(finger.home) for finger in fingers)
        parts = [_lattice(finger, radius, most) for finger in fingers]
        return FingerMeasures(*map(np.array, zip(*parts, strict=True)))

    @property
    def is_limiting(self) -> bool:
        """Whether any finger is kept from places by a least value."""
        return bool(np.any(self.least > 0))

    def at(self, fingers: IntArray, p_OT: FloatArray, normals: FloatArray) -> FloatArray:
        """Returns the `FINGER_MEASURES` at places, shape (m, 5); NaN outside the lattice.

        - Distance to a singularity, in metres, manipulability, in m³, and uniformity, from 0 to 1,
          of the fingertip's Jacobian J; see `posture_measures`.
        - Joint range: least distance of a joint to its limits over their distance, from 0 to 1/2.
        - Force: the largest force f along the inward normal n that every joint's torque permits,
          min_j tau_j / |J_jᵀ n|, because the torques of f n are Jᵀ n f.

        All but the force are interpolated linearly between the nodes. For the shipped hands the
        first three are off by up to 20 % of the finger's largest value, 95 % of the places by at
        most 8 %. Errors are largest near stretched postures and limits of joints.

        Args:
            fingers: Index of the finger at each place, shape (m,).
            p_OT: Centres of the fingertips in O, shape (m, 3), in metres.
            normals: Normals of the surface in O, shape (m, 3).
        """
        place = ((p_OT - self.p_OU) @ self.R_OU - self.low[fingers]) / self.step[fingers]
        last = self.table.shape[1] - 1
        corner = np.clip(np.nan_to_num(place), 0, last - 1).astype(int)
        share = np.where((place >= 0) & (place <= last), place - corner, np.nan)
        row = np.zeros((len(place), self.table.shape[-1]))
        for offset in product((0, 1), repeat=3):
            weight = np.prod(np.where(offset, share, 1 - share), axis=1)
            row += weight[:, None] * self.table[fingers, *(corner + offset).T]
        columns = row[:, :_FORCELESS].reshape(len(row), self.efforts.shape[1], 3)
        arms = np.abs(np.einsum("mji,mi->mj", columns, normals @ self.R_OU))
        forces = np.min(self.efforts[fingers] / np.maximum(arms, LEAST_ARM), axis=1)
        return np.column_stack([row[:, _FORCELESS:], forces])

    def permits(self, measures: FloatArray) -> BoolArray:
        """Returns the mask of places where no measure is below its least value, shape (m,).

        Args:
            measures: Measures from `at`, shape (m, 5).
        """
        is_permitted: BoolArray = np.all((measures >= self.least) | (self.least <= 0), axis=1)
        return is_permitted


def _lattice(finger: FingerChain, radius: float, most: int) -> tuple[FloatArray, ...]:
    """Returns the rows of a finger in the first four attributes of `FingerMeasures`."""
    tips, absent = finger.workspace.data, (0, most - len(finger.home))
    low = np.maximum(np.min(tips, axis=0), -radius)
    high = np.maximum(np.minimum(np.max(tips, axis=0), radius), low + _LEAST_SIZE)
    step = (high - low) / (_NODES - 1)
    nodes = low + step * np.indices(3 * [_NODES]).reshape(3, -1).T
    q = finger.postures(nodes)
    p_UT, J = finger.tips(q)
    columns = np.pad(J.swapaxes(1, 2), ((0, 0), absent, (0, 0))).reshape(len(q), -1)
    ranges = np.minimum(q - finger.lower, finger.upper - q) / (finger.upper - finger.lower)
    rows = np.column_stack([columns, posture_measures(J), np.min(ranges, axis=1)])
    rows[np.linalg.norm(p_UT - nodes, axis=1) > np.linalg.norm(step)] = np.nan
    efforts = np.pad(finger.efforts, absent, constant_values=np.inf)
    return low, step, rows.reshape(*3 * [_NODES], -1), efforts
