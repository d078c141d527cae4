"""Regions and goals of some contacts, as a tick makes them, and what drives and holds goals."""

from dataclasses import replace

import numpy as np
import trimesh

from drake_pregrasp import box_surface
from drake_pregrasp.contacts.centroids import (
    gaussian_log_weights,
    position_tracking,
    select_contacts,
)
from drake_pregrasp.contacts.goal_limits import ContactLimits
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.geometry.mesh_surface import mesh_surface
from drake_pregrasp.geometry.shapes import ball_shape
from drake_pregrasp.geometry.surface import ForbiddenPoints
from drake_pregrasp.regions.constraints import RegionConstraints
from drake_pregrasp.regions.safe_regions import NO_REGION, SafeRegions, compute_safe_regions

BALL = mesh_surface(ball_shape(0.04), spacing=0.006)
CUBE = box_surface([0.1, 0.1, 0.1], spacing=0.01)


def regions_of(surface, p_OC, weights=None, **constraints):
    weights = np.zeros(len(p_OC)) if weights is None else np.array(weights)
    limits = RegionConstraints(len(p_OC), **constraints)
    return compute_safe_regions(surface.p_OQ, p_OC, weights, surface.forbidden, limits)


def selection_of(surface, p_OC, weights=None, **constraints):
    regions = regions_of(surface, p_OC, weights, **constraints)
    return SelectionInput(surface, p_OC, regions, 0.04**2 * np.eye(3))


def joined(a, b):
    """The forbidden points of two sets."""
    parts = ((a.points, b.points), (a.radii, b.radii), (a.normals, b.normals))
    return ForbiddenPoints(*(np.concatenate(pair) for pair in parts))


def nearest_candidate(surface, place):
    return int(np.argmin(np.linalg.norm(surface.p_OQ - place, axis=1)))


def given_regions(surface, *members, **constraints):
    """Regions of which the candidates are given, one set of indices a contact."""
    labels = np.full(len(surface.p_OQ), NO_REGION)
    for contact, candidates in enumerate(members):
        labels[candidates] = contact
    regions = SafeRegions.unlimited(labels, len(members))
    return replace(regions, constraints=RegionConstraints(len(members), **constraints))


def without_region(selection, contact):
    """The same input, but the region of one contact is empty."""
    labels = selection.regions.labels
    labels = np.where(labels == contact, NO_REGION, labels)
    return replace(selection, regions=replace(selection.regions, labels=labels))


def spread_contacts(surface, n, distance, seed=0, first=()):
    """Random candidates that are apart, after some that are given."""
    chosen = list(first)
    for p in np.random.default_rng(seed).permutation(surface.p_OQ):
        if all(np.linalg.norm(p - other) > distance for other in chosen):
            chosen.append(p)
    assert len(chosen) >= n
    return np.array(chosen[:n])


class Wandering:
    """A strategy that is drawn to another place each time."""

    def __init__(self, seed, size=0.06, spread=0.01):
        self.rng, self.size, self.spread = np.random.default_rng(seed), size, spread

    def __call__(self, chosen, i):
        mean = self.rng.uniform(-self.size, self.size, 3)
        q = chosen.surface.p_OQ[chosen.regions.members(i)]
        return gaussian_log_weights(q, mean, self.spread**2 * np.eye(3))


def wander(surface, p_OC, limits, ticks, seed=0, **constraints):
    """Yields the selection, contacts before and goals of each tick."""
    strategy = Wandering(seed)
    for _ in range(ticks):
        chosen = selection_of(surface, p_OC, **constraints)
        goals = select_contacts(chosen, strategy, limits=limits)
        yield chosen, p_OC, goals
        p_OC = goals.p_OC


def goals_towards(places, p_OC, tip_radius=1e-3, surface=CUBE, **limits):
    """Goals where each region is the candidate nearest to a place, or empty if that is None."""
    members = [[] if place is None else nearest_candidate(surface, place) for place in places]
    regions = given_regions(surface, *members, tip_radii=np.full(len(p_OC), tip_radius))
    chosen = SelectionInput(surface, p_OC, regions, np.eye(3))
    return select_contacts(chosen, position_tracking, limits=ContactLimits(**limits)).p_OC


def lengths(vectors):
    return np.linalg.norm(vectors, axis=1)


def always_worse():
    """A measure of which each value is below those before it, so that no step is accepted."""
    values = iter(range(0, -1000, -1))
    return lambda surface, p_OC, nhat: np.array([next(values)])


def tracking_goals(surface, p_OC, limits=None, **constraints):
    return select_contacts(
        selection_of(surface, p_OC, **constraints), position_tracking, limits=limits
    )


def overlaps(surface, goals, tips):
    centres = goals.p_OC + tips[:, None] * surface.project(goals.p_OC)[1]
    away = np.linalg.norm(centres[:, None] - centres, axis=2)
    both = np.outer(goals.active, goals.active) & ~np.eye(len(tips), dtype=bool)
    return np.any(both & (away < tips[:, None] + tips - 1e-8))


def on_face(*yz):
    """Contacts on the cube's face +x."""
    return np.array([[0.05, y, z] for y, z in yz])


def changed_surface(surface, R):
    """The same surface in another frame, turned or mirrored by an orthogonal matrix R."""
    order = slice(None, None, -1 if np.linalg.det(R) < 0 else 1)
    mesh = trimesh.Trimesh(surface.mesh.vertices @ R.T, surface.mesh.faces[:, order], process=False)
    Z = surface.forbidden
    forbidden = ForbiddenPoints(Z.points @ R.T, Z.radii, Z.normals @ R.T)
    return replace(
        surface,
        p_OQ=surface.p_OQ @ R.T,
        nhat_OQ=surface.nhat_OQ @ R.T,
        forbidden=forbidden,
        p_OCoM=R @ surface.p_OCoM,
        mesh=mesh,
        patches=np.ascontiguousarray((surface.patches @ R.T)[:, order]),
    )
