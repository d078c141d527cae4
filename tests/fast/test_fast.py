"""The compiled implementation equals the reference."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from drake_pregrasp import (
    BoxSolid,
    ForbiddenPoints,
    InvalidArgumentError,
    box_surface,
    mesh_surface,
)
from drake_pregrasp.config.planner_config import PlannerConfig
from drake_pregrasp.contacts.centroids import select_contacts
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import make_strategy
from drake_pregrasp.estimation.pose_belief import PoseFilterNoise, PoseMeasurement, first_belief
from drake_pregrasp.estimation.pose_filter import filter_step, merged
from drake_pregrasp.estimation.surface_alignment import SurfacePoints, align_pose
from drake_pregrasp.fast import SWITCH, default_kernels
from drake_pregrasp.fast.kernels import REFERENCE
from drake_pregrasp.geometry.distance_grid import distance_grid
from drake_pregrasp.geometry.mesh_solid import MeshSolid
from drake_pregrasp.geometry.shapes import ball_shape
from drake_pregrasp.quality.force_closure import min_weight_margin
from drake_pregrasp.quality.grasp_quality import contact_blocks
from drake_pregrasp.regions.independent_regions import slip_radii_within
from drake_pregrasp.regions.safe_regions import SafeRegions, compute_safe_regions

pytest.importorskip("numba", reason="numba is not installed (the extra [fast])")

from drake_pregrasp.fast.compiled_kernels import COMPILED

EDGES = [(1, 1, 1), (1, 0.5, 0.5), (1, 1, 0.04), (1, 0.1, 0.1), (1, 0.3, 0.01)]
CUBE = box_surface([0.1, 0.1, 0.1], spacing=0.008)
FEW = box_surface([0.1, 0.1, 0.1], spacing=0.05)
LABELS = COMPILED.labels(CUBE.p_OQ, CUBE.nhat_OQ)
CENTRE = np.array([0.003, -0.002, 0.001])
GRID = distance_grid(CUBE.mesh)
KINDS = ("position", "msv", "gii", "vew")


def singular_values_of(p_CoMC):
    return np.linalg.svd(
        np.hstack(list(contact_blocks(p_CoMC, None, "complete"))), compute_uv=False
    )


def contacts(surface, n, rng):
    """Contacts off the grid, where no candidate is at a tie."""
    q = surface.p_OQ[rng.choice(len(surface.p_OQ), n)]
    return surface.project(q + 1e-3 * np.ptp(surface.p_OQ) * rng.normal(size=(n, 3)))[0]


def test_of_tied_candidates_the_first_contact_has_each():
    surface = box_surface([0.1, 0.1, 0.1], spacing=0.01)
    p_OC = np.array([[0.05, 0.03, 0.0], [0.05, -0.03, 0.0], [-0.05, 0.03, 0.0], [0.05, 0.03, 0]])
    regions = compute_safe_regions(
        surface.p_OQ,
        p_OC,
        np.zeros(4),
        ForbiddenPoints.none(),
        label=COMPILED.labels(surface.p_OQ, surface.nhat_OQ),
    )
    assert np.sum(regions.sizes()) == len(surface.p_OQ)
    assert regions.sizes()[3] == 0


@pytest.mark.parametrize(("N", "size"), [(1, 64), (64, 64), (65, 64), (577, 64), (40_000, 400)])
def test_blocks_hold_every_candidate_once(N, size):
    from drake_pregrasp.fast.blocks import block_size, compact_blocks

    blocks = compact_blocks(np.random.default_rng(N).normal(size=(N, 3)).round(1), block_size(N))
    np.testing.assert_array_equal(np.sort(np.concatenate(blocks)), np.arange(N))
    assert len(blocks) == -(-N // size)
    assert [len(block) for block in blocks[1:]] == (len(blocks) - 1) * [size]


def compiled_goals(surface, name, **changes):
    config = PlannerConfig(**changes)
    keys = "reading contact_model length stretch power friction best_point"
    options = {key: getattr(config, key) for key in keys.split()}
    return COMPILED.goals(surface, {name: 1.0}, **options)


def goals_of(surface, p_OC, h, name, *, stretch, covariance, in_turns=False):
    """Goals of the reference and of the compiled implementation."""
    regions = compute_safe_regions(surface.p_OQ, p_OC, h, surface.forbidden)
    selection = SelectionInput(surface, p_OC, regions, covariance)
    strategy = make_strategy(name, stretch=stretch)
    return [
        select_contacts(selection, strategy, in_turns=in_turns, choose=choose).p_OC
        for choose in (None, compiled_goals(surface, name, stretch=stretch))
    ]


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
@settings(max_examples=25)
@given(
    seed=st.integers(0, 10**6),
    n=st.integers(1, 12),
    size=st.sampled_from([0.05, 0.1, 1.0, 3.0]),
    edges=st.sampled_from(EDGES),
    stretch=st.booleans(),
    in_turns=st.booleans(),
)
def test_goals_are_those_of_the_reference(name, seed, n, size, edges, stretch, in_turns):
    if n == 1 and name == "vew":
        stretch = False  # The volume of one contact is constant but for rounding.
    rng = np.random.default_rng(seed)
    surface = box_surface(list(size * np.array(edges)), spacing=size / 12)
    surface = replace(surface, areas=surface.areas * rng.uniform(0.5, 2, len(surface.areas)))
    p_OC, h = contacts(surface, n, rng), np.where(rng.random(n) < 0.1, -np.inf, 0.0)
    A = rng.normal(size=(3, 3))
    covariance = (0.4 * size) ** 2 * (np.eye(3) + A @ A.T)
    options = {"stretch": stretch, "covariance": covariance, "in_turns": in_turns}
    expected, found = goals_of(surface, p_OC, h, name, **options)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * size)


@pytest.mark.parametrize("name", KINDS)
def test_double_singular_values_are_no_exception(name):
    """A regular cross of contacts: the sum of the arms is zero, and singular values pair."""
    surface = box_surface([0.1, 0.1, 0.1], spacing=0.02)
    p_OC = 0.05 * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    assert np.any(np.all(np.abs(surface.p_OQ - p_OC[0]) < 1e-12, axis=1))
    expected, found = goals_of(
        surface, p_OC, np.zeros(4), name, stretch=True, covariance=1e-3 * np.eye(3)
    )
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)


def test_where_the_closed_form_fails_a_decomposition_gives_the_isotropy():
    """A contact at the centre of mass: sigma_max does not depend on t, the sum of the arms."""
    from drake_pregrasp.fast import closed_forms
    from drake_pregrasp.fast.goals import Members

    places = np.array([[-1.0, 1, 0], [0.3, 0.2, 0.1], [0.5, 0.5, 0.0]])
    r = np.array([[0.0, 0, 0], [1, 1, 0], [-1, -1, 0], [1, -1, 0], [np.nan] * 3])
    active, ends = np.isfinite(r[:, 0]), np.array([0, len(places)])
    q, b = np.ascontiguousarray(places.T), np.empty(len(places))
    own = Members(np.array([0]), active, r, ends, ends, q, b)
    assert closed_forms.write_measures(closed_forms._GII, *own[:4], q, b)
    closed_forms.CompleteMeasure("gii")(None, own, b)
    for place, isotropy in zip(places, b, strict=True):
        sigma = singular_values_of(np.vstack([r[1:4], place]))
        assert isotropy == pytest.approx(sigma[-1] / sigma[0], abs=1e-12)


@pytest.mark.parametrize("name", ["msv", "gii", "vew"])
def test_of_weights_that_differ_by_rounding_only_areas_count(name):
    """One contact on a ball: all places are alike."""
    surface = mesh_surface(ball_shape(0.04), spacing=0.01)
    q = surface.p_OQ / np.linalg.norm(surface.p_OQ, axis=1)[:, None] * 0.04
    surface = replace(surface, p_OQ=q, p_OCoM=np.zeros(3))
    regions = SafeRegions.unlimited(np.where(q[:, 2] > 0.01, 0, -1), 1)
    selection = SelectionInput(surface, q[:1], regions, np.eye(3))
    member = regions.members(0)
    plain = surface.areas[member] @ q[member] / np.sum(surface.areas[member])
    expected = surface.project_into(plain[None], [member])[0]
    for choose in (None, compiled_goals(surface, name)):
        goals = select_contacts(selection, make_strategy(name), choose=choose).p_OC
        np.testing.assert_allclose(goals, expected, atol=1e-10)


def frozen(array):
    array = np.asfortranarray(array)
    array.setflags(write=False)
    return array


@pytest.mark.parametrize("kind", [np.array, frozen, lambda a: np.repeat(a, 2, axis=0)[::2]])
def test_no_tick_waits_for_the_compiler_whatever_arrays_it_meets(kind):
    from drake_pregrasp.fast import closed_forms, goals, labels, margins, predicates, projection

    surface, rng = CUBE, np.random.default_rng(0)
    p_OC = contacts(surface, 4, rng)
    plain = goals_of(surface, p_OC, np.zeros(4), "gii", stretch=True, covariance=np.eye(3))[1]
    regions = compute_safe_regions(
        surface.p_OQ, kind(p_OC), kind(np.zeros(4)), surface.forbidden, label=LABELS
    )
    regions = replace(regions, labels=kind(regions.labels.astype(np.int32)))
    selection = SelectionInput(surface, kind(p_OC), regions, kind(np.eye(3)))
    choose = compiled_goals(surface, "gii")
    np.testing.assert_array_equal(choose(selection, kind(np.arange(4))), plain)
    modules = closed_forms, goals, labels, margins, predicates, projection
    found = [f for module in modules for f in vars(module).values() if hasattr(f, "signatures")]
    entries = [f for f in found if "no_cpython_wrapper" not in f.targetoptions]
    assert len(entries) > len(modules)
    assert all(len(f.signatures) == 1 and not f._can_compile for f in entries)


def test_the_switch_chooses_the_reference(monkeypatch):
    monkeypatch.setenv(SWITCH, "0")
    assert default_kernels() is REFERENCE
    monkeypatch.setenv(SWITCH, "1")
    assert default_kernels() is COMPILED


def test_candidates_of_another_surface_are_refused():
    with pytest.raises(InvalidArgumentError, match="candidates were expected, not"):
        compute_safe_regions(
            FEW.p_OQ, np.zeros((1, 3)), np.zeros(1), ForbiddenPoints.none(), label=LABELS
        )


@pytest.mark.slow
@settings(max_examples=100)
@given(
    seed=st.integers(0, 2**32 - 1),
    rate=st.sampled_from([0.0, 1e-3, 1.0, 60.0]),
    gravity=st.sampled_from([0.0, 9.81]),
    has_com=st.booleans(),
    noise_factors=st.sampled_from([None, np.array([2.0, 3.0])]),
    manoeuvre_rate=st.sampled_from([0.0, 0.5]),
    measured=st.sampled_from([6, 4, 0]),
    bias=st.sampled_from([0.0, 0.01]),
)
def test_a_step_of_the_pose_filter_equals_the_reference(
    seed, rate, gravity, has_com, noise_factors, manoeuvre_rate, measured, bias
):
    rng = np.random.default_rng(seed)
    manoeuvres = 3.0, 9.0, manoeuvre_rate
    noise = PoseFilterNoise(1e-3, 0.01, 0.3, 2.0, 0.1, 1.0, gravity, *manoeuvres, bias, 0.5)
    p_OCoM = rng.normal(0, 0.05, 3) if has_com else None
    V = rng.normal(size=6) * np.repeat([rate, 1.0], 3)
    time, p_WO, R_WO, belief = 1.0, rng.normal(size=3), Rotation.random(rng=rng), None
    for _ in range(4):
        measurement = PoseMeasurement(time, p_WO, R_WO.as_matrix())
        if measured < 6 and belief is not None:
            Z = rng.normal(size=(6, 6)) * (np.arange(6) < measured)[:, None]
            measurement = replace(measurement, directions=Z)
        if belief is None:
            belief = first_belief(measurement, noise, p_OCoM)
        else:
            own = belief, measurement, noise, p_OCoM, noise_factors
            prior, new = filter_step(*own)
            fast_prior, fast_new = COMPILED.filter_step(*own)
            _are_equal(fast_prior, prior)
            _are_equal(fast_new.belief, new.belief)
            np.testing.assert_allclose(fast_new.squares, new.squares, rtol=1e-9, atol=1e-12)
            belief = new.belief
            _are_equal(COMPILED.merged(belief), merged(belief))
        dt = rng.uniform(0, 0.1)
        time, p_WO = time + dt, p_WO + dt * V[3:] + rng.normal(scale=2e-3, size=3)
        R_WO = Rotation.from_rotvec(dt * V[:3] + rng.normal(scale=0.02, size=3)) * R_WO


def _are_equal(fast, reference):
    for name, value in vars(reference).items():
        np.testing.assert_allclose(getattr(fast, name), value, rtol=1e-12, atol=1e-12)


@pytest.mark.slow
@settings(max_examples=100)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 6),
    edges=st.sampled_from(EDGES),
    radius=st.floats(0.001, 0.2),
    friction=st.floats(0.1, 1.0),
)
def test_slips_are_those_of_the_reference(seed, n, edges, radius, friction):
    surface = replace(box_surface(0.1 * np.array(edges), spacing=0.02), p_OCoM=CENTRE)
    p_OC, nhat = surface.project(contacts(surface, n, np.random.default_rng(seed)))
    fast, reference = (
        slip_radii(surface, frozen(p_OC), frozen(nhat), radius, friction)
        for slip_radii in (COMPILED.slip_radii(), slip_radii_within)
    )
    if not np.allclose(fast, reference, rtol=0, atol=1e-9):  # On a knife's edge, rounding decides.
        less = friction * (1 - 1e-6)
        nearby = slip_radii_within(surface, frozen(p_OC), frozen(nhat), radius, less)
        assume(np.allclose(nearby, reference, rtol=0, atol=1e-4))
    np.testing.assert_allclose(fast, reference, rtol=0, atol=1e-9)
    grasp = p_OC - surface.p_OCoM, nhat, friction
    fast = min_weight_margin(*grasp, solve=COMPILED.largest_minimum())
    assert fast == pytest.approx(min_weight_margin(*grasp), abs=1e-9)
    alone = {"model": "frictionless", "solve": COMPILED.largest_minimum()}
    assert min_weight_margin(*grasp, **alone) == pytest.approx(
        min_weight_margin(*grasp, model="frictionless"), abs=1e-9
    )


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), count=st.sampled_from([0, 1, 40]))
def test_a_pose_is_aligned_as_by_the_reference(seed, count):
    rng = np.random.default_rng(seed)
    p_WQ, std = rng.uniform(-0.06, 0.06, (count, 3)), np.repeat([0.0035, 0.0005], 3)
    is_bound = (rng.random(count) < 0.2) & (count > 1)  # One alone may end at its bound.
    points = SurfacePoints(
        p_WQ, rng.uniform(0, 0.01, count), rng.uniform(1e-3, 2e-3, count), is_bound
    )
    start = Rotation.random(rng=rng).as_matrix(), rng.normal(scale=0.005, size=3)
    fast, reference = (f(GRID, points, *start, std) for f in (COMPILED.align_pose(), align_pose))
    np.testing.assert_allclose(fast.p_WO, reference.p_WO, atol=1e-8)
    np.testing.assert_allclose(fast.R_WO, reference.R_WO, atol=1e-7)
    size = 1e-7 * max(1.0, np.abs(reference.information).max())
    np.testing.assert_allclose(fast.information, reference.information, atol=size)
    assert fast.fits == pytest.approx(reference.fits, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("mesh", [CUBE.mesh, trimesh.creation.annulus(0.02, 0.05, 0.06)])
def test_distances_of_a_mesh_are_those_of_the_reference(mesh):
    rng = np.random.default_rng(0)
    R, p = Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)
    solid = MeshSolid.of(mesh).moved(R, p)
    fast = COMPILED.hand().solid(solid)
    points = p + rng.uniform(-0.12, 0.12, (500, 3))  # Also beyond the grid.
    points[7, 1], points[8] = np.nan, np.nan
    for found, expected in zip(
        fast.distance_and_gradient(points), solid.distance_and_gradient(points), strict=True
    ):
        np.testing.assert_allclose(found, expected, atol=1e-12)
    assert np.isnan(fast.distance_and_gradient(points)[0][7:9]).all()
    box = BoxSolid(np.zeros(3), np.eye(3), np.ones(3))
    assert COMPILED.hand().solid(box) is box
