"""Surfaces with few candidates (numpy): all are asked at once, since trees would cost more."""

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.kernels.blocks import Blocks
from drake_pregrasp.kernels.hand_measures import extremes, volumes
from drake_pregrasp.kernels.partition import MIXED, NOBODY, Partition
from drake_pregrasp.kernels.region_planes import forbidden_planes
from drake_pregrasp.kernels.sorting import BLOCK
from drake_pregrasp.kernels.weighting import FLAT, HandSums, Weighting, volume_numbers


def partition_of_few(
    blocks: Blocks, r: FloatArray, h: FloatArray, z: FloatArray, radii: FloatArray, slack: float
) -> Partition:
    """Divides candidates into cells, and takes out of each what is beyond its forbidden planes.

    Of those only the ones matter that cut the box around a cell.

    Args:
        blocks: Of the surface.
        r: Contacts relative to the centre of mass, shape (n, 3), in metres.
        h: Their weights, shape (n,), in m²; -inf for the lost.
        z: Forbidden points, as the contacts, shape (m, 3), in metres.
        radii: Theirs, shape (m,), in metres.
        slack: Added to half the edges of boxes, in metres: more than rounding could move a plane.
    """
    N = blocks.num_candidates
    labels = np.full(blocks.count * BLOCK, NOBODY, dtype=np.int16)
    sizes = np.zeros(len(r), dtype=np.int64)
    owners = np.full(blocks.count, MIXED, dtype=np.int64)
    kept = np.flatnonzero(np.isfinite(h))
    if len(kept):
        powers = np.einsum("ij,ij->i", r[kept], r[kept]) - h[kept]
        cells = np.argmin(powers / 2 - blocks.points[:, :N].T @ r[kept].T, axis=1)
        counts = np.bincount(cells, minlength=len(kept))
        ends = np.cumsum(counts)
        places = np.argsort(cells.astype(np.int16), kind="stable")
        q = blocks.points.take(places, axis=1)
        filled = np.flatnonzero(counts)
        starts = (ends - counts)[filled]
        low, high = np.minimum.reduceat(q, starts, axis=1), np.maximum.reduceat(q, starts, axis=1)
        normals, bounds = forbidden_planes(r[kept[filled]], z, radii)
        farthest = np.einsum("ijk,ki->ij", normals, (low + high) / 2)
        farthest += np.einsum("ijk,ki->ij", np.abs(normals), (high - low) / 2 + slack)
        cut = farthest > bounds
        for k, (start, contact) in enumerate(zip(starts, kept[filled], strict=True)):
            own = slice(start, start + counts[filled[k]])
            beyond = normals[k, cut[k]] @ q[:, own] > bounds[k, cut[k], None]
            inside = ~beyond.any(axis=0)
            labels[places[own]] = np.where(inside, contact, NOBODY)
            sizes[contact] = np.count_nonzero(inside)
    return Partition(owners, labels.reshape(blocks.count, BLOCK), sizes, blocks)


def centroids_of_few(
    partition: Partition, movers: IntArray, weighting: Weighting, sums: HandSums
) -> FloatArray:
    """Returns what `TickKernel.centroids` does, relative to the centre of mass.

    Args:
        partition: As there, and so the next two.
        movers: Contacts.
        weighting: Of the candidates.
        sums: Of the hand.
    """
    labels = partition.labels.ravel()
    by_contact = np.argsort(labels, kind="stable")
    edges = labels.take(by_contact).searchsorted(np.stack([movers, movers + 1]))
    counts = edges[1] - edges[0]
    if np.array_equal(edges[0, 1:], edges[1, :-1]):  # As a rule all contacts with a region move.
        places, starts = by_contact[edges[0, 0] : edges[1, -1]], edges[0] - edges[0, 0]
    else:
        places = np.concatenate([by_contact[start:end] for start, end in edges.T])
        starts = np.cumsum(counts) - counts
    q, areas = partition.blocks.points.take(places, axis=1), partition.blocks.areas.take(places)
    if weighting.kind == "position":
        white = weighting.whitener() @ q
        exponents = -0.5 * np.einsum("ik,ik->k", white, white)
        b = np.exp(exponents - np.maximum.reduceat(exponents, starts).repeat(counts))
    else:
        b = _hand_measure(weighting.kind, q, movers, starts, counts, sums)
    rounding = np.zeros(len(starts))
    if weighting.stretch and weighting.is_of_the_hand:
        least = np.minimum.reduceat(b, starts)
        b -= least.repeat(counts)
        rounding = FLAT * least * np.add.reduceat(areas, starts)
    b *= areas
    totals = np.add.reduceat(b, starts)
    if np.any(totals <= rounding):
        b = np.where((totals > rounding).repeat(counts), b, areas)
        totals = np.add.reduceat(b, starts)
    centroids: FloatArray = (np.add.reduceat(q * b, starts, axis=1) / totals).T
    return centroids


def _hand_measure(
    kind: str,
    q: FloatArray,
    movers: IntArray,
    starts: IntArray,
    counts: IntArray,
    sums: HandSums,
) -> FloatArray:
    """Returns b of Eq. 5, 6 or 7 at the points of the contacts' regions, one after another."""
    if kind == "vew":
        pieces = zip(volume_numbers(sums)[movers], np.split(q, starts[1:], axis=1), strict=True)
        return np.concatenate([volumes(numbers, sums.n, points) for numbers, points in pieces])
    t, B = sums.t[movers].T.repeat(counts, axis=1), np.moveaxis(sums.B[movers], 0, -1)
    sigma_min, sigma_max = extremes(t, B.repeat(counts, axis=-1), sums.n, q, largest=kind == "gii")
    return sigma_min / sigma_max
