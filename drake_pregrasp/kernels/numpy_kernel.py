"""The kernel in numpy: nothing to compile."""

from collections.abc import Callable, Iterable

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.kernels.blocks import FAN
from drake_pregrasp.kernels.few_candidates import (
    centroids_of_few,
    partition_of_few,
)
from drake_pregrasp.kernels.hand_measures import extremes, volumes
from drake_pregrasp.kernels.partition import MIXED, NOBODY, Partition
from drake_pregrasp.kernels.region_planes import region_planes
from drake_pregrasp.kernels.sorting import BLOCK
from drake_pregrasp.kernels.tick_kernel import TickKernel
from drake_pregrasp.kernels.weighting import FLAT, HandSums, Weighting, volume_numbers

SLACK = 1e-13
"""Share of its terms by which a plane must clear a box to decide it: rounding is far below it."""

Weigh = Callable[[FloatArray], FloatArray]


class NumpyKernel(TickKernel):
    """Asks the tree level by level, and the points of undecided blocks with the planes in them.

    Attributes:
        few: Candidates up to which asking all of them costs less than the tree's steps.
        chunk: Points weighed at a time, so that their arrays stay in the cache.
    """

    few = 1 << 13
    chunk = 1 << 13

    def _partition(
        self, r: FloatArray, h: FloatArray, z: FloatArray, radii: FloatArray
    ) -> Partition:
        count = self.blocks.count
        if self.blocks.num_candidates <= self.few:
            return partition_of_few(self.blocks, r, h, z, radii, SLACK * self._longest_arm)
        owners = np.full(count, NOBODY, dtype=np.int64)
        labels = np.full((count, BLOCK), NOBODY, dtype=np.int16)
        for contact in np.flatnonzero(np.isfinite(h)).tolist():
            normals, bounds = region_planes(contact, r, h, z, radii)
            whole, mixed, cuts = self._ask_boxes(normals, bounds)
            owners[whole] = contact
            owners[mixed] = MIXED
            members = self._ask_points(normals, bounds, mixed, cuts)
            labels[mixed] = np.where(members, contact, labels[mixed])
        self._settle_padding(owners, labels)
        sizes = BLOCK * np.bincount(owners[owners >= 0], minlength=len(r))
        mixed_labels = labels[owners == MIXED].ravel()
        sizes += np.bincount(mixed_labels[mixed_labels >= 0], minlength=len(r))
        return Partition(owners, labels, sizes, self.blocks)

    def _ask_boxes(
        self, normals: FloatArray, bounds: FloatArray
    ) -> tuple[IntArray, IntArray, tuple[IntArray, IntArray]]:
        """Returns blocks wholly inside all planes, undecided ones, and which planes cut those.

        The cuts are pairs of the place among the undecided blocks and the plane's, sorted.
        """
        blocks = self.blocks
        sizes = np.diff(blocks.starts)
        planes = np.arange(len(bounds))
        nodes = np.arange(sizes[0])
        slack = SLACK * (np.abs(bounds) + np.sum(np.abs(normals), axis=1) * self._longest_arm)
        inner, outer = bounds - slack, bounds + slack
        whole = []
        for level in range(len(sizes)):
            first = blocks.starts[level]
            middle = normals[planes] @ blocks.centers[first + nodes].T
            reach = np.abs(normals[planes]) @ blocks.halves[first + nodes].T
            meets = np.all(middle - reach <= outer[planes, None], axis=0)
            cuts = (middle + reach > inner[planes, None]) & meets
            undecided = np.any(cuts, axis=0)
            width = FAN ** (len(sizes) - 1 - level)
            decided = nodes[meets & ~undecided]
            whole.append((decided[:, None] * width + np.arange(width)).ravel())
            nodes, cuts = nodes[undecided], cuts[:, undecided]
            if level < len(sizes) - 1:
                planes = planes[np.any(cuts, axis=1)]
                nodes = (nodes[:, None] * FAN + np.arange(FAN)).ravel()
                nodes = nodes[nodes < sizes[level + 1]]
        inside = np.concatenate(whole)
        block, plane = np.nonzero(cuts.T)
        return inside[inside < blocks.count], nodes, (block, planes[plane])

    def _ask_points(
        self,
        normals: FloatArray,
        bounds: FloatArray,
        mixed: IntArray,
        cuts: tuple[IntArray, IntArray],
    ) -> BoolArray:
        """Returns which points of undecided blocks are inside all planes, shape (k, BLOCK)."""
        if len(mixed) == 0:
            return np.empty((0, BLOCK), dtype=bool)
        block, plane = cuts
        x, y, z = self.blocks.points.reshape(3, -1, BLOCK)[:, mixed]
        n = normals[plane]
        value = n[:, :1] * x[block]
        value += n[:, 1:2] * y[block]
        value += n[:, 2:] * z[block]
        beyond = value > bounds[plane, None]
        starts = np.searchsorted(block, np.arange(len(mixed)))
        outside: BoolArray = np.logical_or.reduceat(beyond, starts, axis=0)
        return ~outside

    def _settle_padding(self, owners: IntArray, labels: np.ndarray) -> None:
        filled = self.blocks.num_candidates - (len(owners) - 1) * BLOCK
        if filled < BLOCK:
            if owners[-1] != MIXED:
                labels[-1] = owners[-1]
                owners[-1] = MIXED
            labels[-1, filled:] = NOBODY

    def _centroids(
        self, partition: Partition, r: FloatArray, movers: IntArray, weighting: Weighting
    ) -> FloatArray:
        sums = HandSums.none(len(r))
        if weighting.is_of_the_hand:
            sums = HandSums.over(r, partition.sizes > 0)
        if self.blocks.num_candidates <= self.few:
            return centroids_of_few(partition, movers, weighting, sums)
        numbers = volume_numbers(sums) if weighting.kind == "vew" else np.empty((len(r), 0))
        mixed = np.flatnonzero(partition.owners == MIXED)
        mixed_labels = partition.labels[mixed].ravel()
        places = (mixed[:, None] * BLOCK + np.arange(BLOCK)).ravel()
        whitener = weighting.whitener()
        centroids = np.empty((len(movers), 3))
        for row, contact in enumerate(movers.tolist()):
            whole = np.flatnonzero(partition.owners == contact)
            some = places[mixed_labels == contact]
            if weighting.kind == "position":
                pieces = self._pieces(whole, some)
                centroids[row] = _gaussian_centroid(pieces, whitener)
                continue
            t, B = sums.t[contact, :, None], sums.B[contact, :, :, None]
            weigh = _measure(weighting.kind, numbers[contact], t, B, sums.n)
            pieces = self._pieces(whole, some)
            weighed = ((q, areas, weigh(q)) for q, areas in pieces)
            centroids[row] = _measure_centroid(weighed, stretch=weighting.stretch)
        return centroids

    def _weights(
        self,
        partition: Partition,
        r: FloatArray,
        contact: int,
        weighting: Weighting,
        q: FloatArray,
    ) -> FloatArray:
        if not weighting.is_of_the_hand:
            return np.exp(_gaussian_exponents(weighting.whitener(), q))
        sums = HandSums.over(r, partition.sizes > 0)
        numbers = volume_numbers(sums)[contact]
        t, B = sums.t[contact, :, None], sums.B[contact, :, :, None]
        return _measure(weighting.kind, numbers, t, B, sums.n)(q)

    def _pieces(self, whole: IntArray, some: IntArray) -> list[tuple[FloatArray, FloatArray]]:
        """Returns points (3, k) and areas (k,) of whole blocks and of places, in chunks."""
        points, areas = self.blocks.points, self.blocks.areas
        by_block = points.reshape(3, -1, BLOCK), areas.reshape(-1, BLOCK)
        at_a_time = self.chunk // BLOCK
        pieces = []
        for first in range(0, len(whole), at_a_time):
            chosen = whole[first : first + at_a_time]
            pieces.append((by_block[0][:, chosen].reshape(3, -1), by_block[1][chosen].ravel()))
        for first in range(0, len(some), self.chunk):
            chosen = some[first : first + self.chunk]
            pieces.append((points[:, chosen], areas[chosen]))
        if len(pieces) == 2 and pieces[0][0].shape[1] + pieces[1][0].shape[1] <= self.chunk:
            (q, a), (p, b) = pieces
            return [(np.concatenate([q, p], axis=1), np.concatenate([a, b]))]
        return pieces


def _measure(kind: str, numbers: FloatArray, t: FloatArray, B: FloatArray, n: int) -> Weigh:
    def weigh(q: FloatArray) -> FloatArray:
        if kind == "vew":
            return volumes(numbers, n, q)
        sigma_min, sigma_max = extremes(t, B, n, q, largest=kind == "gii")
        return sigma_min / sigma_max

    return weigh


def _gaussian_exponents(whitener: FloatArray, q: FloatArray) -> FloatArray:
    white = whitener @ q
    exponents: FloatArray = -0.5 * np.einsum("ik,ik->k", white, white)
    return exponents


def _gaussian_centroid(
    pieces: list[tuple[FloatArray, FloatArray]], whitener: FloatArray
) -> FloatArray:
    highest, total, moment = -np.inf, 0.0, np.zeros(3)
    for q, areas in pieces:
        exponents = _gaussian_exponents(whitener, q)
        top = float(np.max(exponents))
        if top > highest:
            shrink = np.exp(highest - top)
            highest, total, moment = top, total * shrink, moment * shrink
        weights = np.exp(exponents - highest) * areas
        total += float(np.sum(weights))
        moment += q @ weights
    centroid: FloatArray = moment / total
    return centroid


def _measure_centroid(
    pieces: Iterable[tuple[FloatArray, FloatArray, FloatArray]], *, stretch: bool
) -> FloatArray:
    reference, least = np.nan, np.inf
    area, first_moment, total, moment = 0.0, np.zeros(3), 0.0, np.zeros(3)
    for q, areas, b in pieces:
        if np.isnan(reference):
            reference = float(b[0])
        least = min(least, float(np.min(b)))
        weights = (b - reference) * areas
        area += float(np.sum(areas))
        first_moment += q @ areas
        total += float(np.sum(weights))
        moment += q @ weights
    back = reference - (least if stretch else 0.0)
    rounding = FLAT * (total + reference * area) if stretch else 0.0
    total, moment = total + back * area, moment + back * first_moment
    centroid: FloatArray = moment / total if total > rounding else first_moment / area
    return centroid
