"""With all constraints and strategies at random, the compiled tick equals the reference."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from selections import joined
from thin_cup import CUP

from drake_pregrasp import BoxSolid, ForbiddenPoints, box_surface, mesh_surface
from drake_pregrasp.config.planner_config import PlannerConfig
from drake_pregrasp.contacts.centroids import select_contacts
from drake_pregrasp.contacts.contact_pairs import Pair
from drake_pregrasp.contacts.goal_limits import ContactLimits
from drake_pregrasp.contacts.reassignment import (
    ReassignmentRule,
    reassigned_goals,
    surface_symmetries,
)
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import STRATEGIES, make_blend
from drake_pregrasp.geometry.mesh_surface import AxisArea
from drake_pregrasp.geometry.sampling import lifted
from drake_pregrasp.geometry.shapes import ball_shape
from drake_pregrasp.geometry.solids import BallSolid, HalfSpace
from drake_pregrasp.quality.grasp_quality import CONTACT_MODELS
from drake_pregrasp.regions.constraints import Obstacles, RegionConstraints
from drake_pregrasp.regions.finger_measures import FINGER_MEASURES, FingerMeasures
from drake_pregrasp.regions.finger_reach import FingerReach
from drake_pregrasp.regions.safe_regions import compute_safe_regions
from drake_pregrasp.regions.walls import SurfaceGraph, normals_agree

pytest.importorskip("numba", reason="numba is not installed (the extra [fast])")

from drake_pregrasp.fast import compiled_kernels

KERNELS = compiled_kernels.COMPILED

LENGTH = 0.05  # Of the normals as further coordinates, in metres.
SURFACES = [
    box_surface([0.1, 0.1, 0.1], spacing=0.008),
    box_surface([0.2, 0.05, 0.06], spacing=0.004),  # Blocks larger than the smallest ones.
    mesh_surface(ball_shape(0.04), spacing=0.006),
    mesh_surface(CUP, spacing=0.008),
    box_surface([0.1, 0.1, 0.1], spacing=0.05),  # Fewer candidates than a block holds.
]
GRAPHS = [SurfaceGraph(surface) for surface in SURFACES]
COMPILED = [KERNELS.surface(surface) for surface in SURFACES]
SYMMETRIES = [surface_symmetries(surface)[:12] for surface in SURFACES]
LIFTED = [lifted(surface.p_OQ, surface.nhat_OQ, LENGTH) for surface in SURFACES]
LABELS = [
    {3: KERNELS.labels(surface.p_OQ, surface.nhat_OQ), 6: KERNELS.labels(points, surface.nhat_OQ)}
    for surface, points in zip(SURFACES, LIFTED, strict=True)
]


def random_solid(rng):
    center = rng.normal(0, 0.06, 3)
    kind = rng.integers(3)
    if kind == 0:
        return BallSolid(center, rng.uniform(0, 0.04))
    if kind == 1:
        return BoxSolid(center, Rotation.random(rng=rng).as_matrix(), rng.uniform(0, 0.08, 3))
    normal = rng.normal(size=3)
    return HalfSpace(-rng.uniform(0, 0.06) * normal / np.linalg.norm(normal), normal)


def random_reach(rng, center):
    if rng.random() < 0.3:
        return None
    solid = None if rng.random() < 0.5 else random_solid(rng).moved(np.eye(3), center)
    direction = None if rng.random() < 0.4 else rng.normal(size=3)
    if direction is None:
        return FingerReach(solid)
    angles = np.minimum(rng.uniform(0.5, 4, 3), [np.pi, np.pi, np.pi / 2]).tolist()
    return FingerReach(solid, direction, *angles, rng.normal(0, 0.01, 3))


def random_measures(rng, n, *, k=3, nodes=4):
    """Random lattices, with places where the finger is nowhere."""
    table = rng.uniform(0, 1, (n, nodes, nodes, nodes, 3 * k + 4))
    table[rng.random(table.shape[:4]) < 0.02] = np.nan
    return FingerMeasures(
        low=rng.uniform(-0.2, -0.05, (n, 3)),
        step=rng.uniform(0.05, 0.1, (n, 3)),
        table=table,
        efforts=rng.uniform(0.5, 1, (n, k)),
        least=rng.choice([0, 0.25], 5) * (rng.random() < 0.8),
        R_OU=Rotation.random(rng=rng).as_matrix(),
        p_OU=rng.normal(0, 0.01, 3),
    )


def random_constraints(rng, which, p_OC, forbidden, has):
    surface, n = SURFACES[which], len(p_OC)
    nhat_OC = surface.project(p_OC)[1]
    solids = tuple(random_solid(rng) for _ in range(rng.integers(1, 4))) if "solids" in has else ()
    count = rng.integers(1, 60) if "points" in has else 0
    places = 0.09 * rng.normal(size=(count, 3))
    points = ForbiddenPoints(places, np.abs(rng.normal(0, 0.004, count)))
    obstacles = Obstacles(solids, points, rng.normal(0, 0.05, (len(solids), 3)))
    later = []
    if "horizon" in has:
        R, p = Rotation.from_rotvec(rng.normal(0, 0.1, 3)).as_matrix(), rng.normal(0, 0.01, 3)
        later = [obstacles.after(t).moved(R, p) for t in (0.1, 0.2)]
    same_side = active_forbidden_points = None
    if "walls" in has:
        same_side = normals_agree(nhat_OC, surface.nhat_OQ)
        active_forbidden_points = normals_agree(nhat_OC, forbidden.normals)
        if rng.random() < 0.2:
            same_side &= GRAPHS[which].near_over_the_surface(p_OC, nhat_OC)
    faces = ("-x", "+x", "-y", "+y", "-z", "+z")
    return RegionConstraints(
        n,
        obstacles=obstacles,
        later=later,
        clearance=rng.uniform(0, 0.005),
        tip_radii=rng.uniform(0, 0.012, n) if "tips" in has else np.empty(0),
        tip_gap=rng.uniform(0, 0.004) if "tips" in has else 0.0,
        standoff=rng.uniform(0, 0.04) if "tips" in has else 0.0,
        nhat_OQ=surface.nhat_OQ,
        nhat_OC=nhat_OC,
        reach=[random_reach(rng, p) for p in p_OC] if "reach" in has else (),
        finger_measures=random_measures(rng, n) if "finger_measures" in has else None,
        reach_pose=(np.eye(3), np.zeros(3)) if "reassign" in has else None,
        closed=[
            [AxisArea(f) for f in rng.choice(faces, rng.integers(3), replace=False)]
            for _ in range(n)
        ]
        if "closed" in has
        else (),
        same_side=same_side,
        active_forbidden_points=active_forbidden_points,
    )


PARTS = ("tips", "solids", "points", "horizon", "walls", "reach", "closed", "normals", "limits")
PARTS += ("forbidden", "coincident", "coordinates", "reassign", "finger_measures")


# Settings of the examples that were found.
FOUND = {"spread": 0.03, "strategy": "msv", "power": 2.0, "stretch": True}
FOUND |= {"best_point": False, "in_turns": False, "contact_model": "complete", "length": 0.0}


@settings(max_examples=200)
@given(
    which=st.integers(0, len(SURFACES) - 1),
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 12),
    lost=st.integers(0, 2),
    has=st.sets(st.sampled_from(PARTS)),
    spread=st.sampled_from([3e-4, 0.03, 30.0]),
    strategy=st.sampled_from([*STRATEGIES, "blend"]),
    reading=st.sampled_from(["hand", "contact"]),
    contact_model=st.sampled_from(CONTACT_MODELS),
    length=st.sampled_from([0.0, 0.1]),
    power=st.sampled_from([1.0, 2.0, 3.0]),
    stretch=st.booleans(),
    best_point=st.booleans(),
    in_turns=st.booleans(),
)
@example(  # A centroid in a plane of symmetry of the cube: rounding must not choose its side.
    which=0,
    seed=8,
    n=8,
    lost=0,
    has={"solids", "horizon", "points", "tips", "normals"},
    reading="contact",
    **FOUND,
)
@example(  # A goal that two obstacle points bar, one of them later.
    which=3,
    seed=947390,
    n=5,
    lost=0,
    has=set(PARTS) - {"forbidden", "coincident", "coordinates", "finger_measures"},
    reading="hand",
    **FOUND,
)
@example(  # Complete contacts with lever arms that are long in the unit of length.
    which=3, seed=3, n=4, lost=0, has=set(), reading="contact", **FOUND | {"length": 1e-3}
)
def test_a_tick_is_that_of_the_reference(
    which,
    seed,
    n,
    lost,
    has,
    spread,
    strategy,
    reading,
    contact_model,
    length,
    power,
    stretch,
    best_point,
    in_turns,
):
    rng, surface = np.random.default_rng(seed), SURFACES[which]
    if strategy in (*FINGER_MEASURES, "blend"):
        has = has | {"finger_measures"}
    q = surface.p_OQ[rng.choice(len(surface.p_OQ), n)]
    p_OC, nhat_OC = surface.project(q + 1e-3 * rng.normal(size=(n, 3)))
    h = 1e-4 * rng.normal(size=n)
    if "coincident" in has:
        p_OC[n // 2 :], nhat_OC[n // 2 :], h[n // 2 :] = p_OC[0], nhat_OC[0], h[0]
    h[rng.permutation(n)[:lost]] = -np.inf
    forbidden = surface.forbidden
    if "forbidden" in has:
        m = rng.choice([1, 40, 300])
        z = rng.choice(surface.p_OQ, m) + 1e-3 * rng.normal(size=(m, 3))
        z[: m // 20] = p_OC[0]  # Some at a contact itself.
        forbidden = joined(forbidden, ForbiddenPoints(z, np.abs(rng.normal(0, 0.004, m))))
    constraints = random_constraints(rng, which, p_OC, forbidden, has)
    points, c = surface.p_OQ, p_OC
    if "normals" in has:
        points, c = LIFTED[which], lifted(p_OC, nhat_OC, LENGTH)
    label = LABELS[which][c.shape[1]]
    if "coordinates" in has:
        k = rng.integers(1, 3)
        points = np.hstack([points, 0.03 * rng.normal(size=(len(points), k))])
        c = np.hstack([c, 0.03 * rng.normal(size=(n, k))])
        c[n // 2 :] = c[0] if "coincident" in has else c[n // 2 :]
        label = KERNELS.labels(points, surface.nhat_OQ)
    expected, found = (
        compute_safe_regions(points, c, h, forbidden, constraints, label=own)
        for own in (None, label)
    )
    for part in ("labels", "lost", "limits", "causes"):
        np.testing.assert_array_equal(getattr(found, part), getattr(expected, part))

    weights = {strategy: 1.0}
    if strategy == "blend":
        weights = dict(zip(STRATEGIES, rng.choice([0.0, 1.0, 3.0], len(STRATEGIES)), strict=True))
        weights["gii"] += 0.5
    options = {"reading": reading, "contact_model": contact_model, "length": length}
    options |= {"power": power, "stretch": stretch, "friction": PlannerConfig.friction}
    limits = ContactLimits()
    if "limits" in has:
        pairs = (Pair(0, 1, 0.03),) if n > 1 and rng.random() < 0.5 else ()
        limits = ContactLimits(0.01, 0.001 * (rng.random() < 0.3), pairs, bool(rng.random() < 0.5))
    A = rng.normal(size=(3, 3))
    covariance = spread**2 * (np.eye(3) + A @ A.T)
    reference = SelectionInput(surface, p_OC, expected, covariance)
    compiled = SelectionInput(COMPILED[which], p_OC, expected, covariance, KERNELS.limits_at)
    choose = KERNELS.goals(surface, weights, **options, best_point=best_point)
    goals, others = (
        select_contacts(
            selection,
            make_blend(weights, **options),
            best_point=best_point,
            in_turns=in_turns,
            limits=limits,
            choose=own,
        )
        for selection, own in ((reference, None), (compiled, choose))
    )
    if {"reassign", "reach"} <= has:
        rule = ReassignmentRule(beyond=1e-3, gain=0.05)
        goals = reassigned_goals(reference, goals, rule, SYMMETRIES[which])
        others = reassigned_goals(compiled, others, rule, SYMMETRIES[which])
    np.testing.assert_allclose(
        others.p_OC, goals.p_OC, rtol=0, atol=1e-9 * np.ptp(surface.p_OQ, axis=0).max()
    )
    np.testing.assert_array_equal(others.status, goals.status)
    np.testing.assert_array_equal(others.causes, goals.causes)
