"""Share of force-closed choices of points from the regions."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from selections import given_regions, nearest_candidate, regions_of

from drake_pregrasp import box_surface
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import hand_independence
from drake_pregrasp.quality.force_closure import min_weight_margin
from drake_pregrasp.quality.margin_bounds import least_norm_margin
from drake_pregrasp.regions.independent_regions import (
    force_closed_share,
    slip_radii,
    slip_radii_within,
)

SURFACE = box_surface([0.1, 0.1, 0.1], spacing=0.01)
regions_at, nearest = partial(given_regions, SURFACE), partial(nearest_candidate, SURFACE)


def share(regions, friction=0.7, *, seed=0, **options):
    generator = np.random.default_rng(seed)
    return force_closed_share(SURFACE, regions, friction, generator=generator, **options)


def test_single_points_of_a_force_closed_set_always_close():
    around = [nearest([0.05, 0, 0]), nearest([-0.05, 0, 0]), nearest([0, 0.05, 0])]
    assert share(regions_at(*around)) == 1
    assert share(regions_at(*around[:2])) == 0  # Free to turn about their line.
    assert share(regions_at(*around[:2]), model="soft_finger") == 1


def test_points_of_one_face_and_empty_regions_never_close():
    face = np.flatnonzero(SURFACE.nhat_OQ[:, 0] > 0.5)
    assert share(regions_at(*np.array_split(face, 4))) == 0
    assert share(regions_at([], [])) == 0


@pytest.mark.parametrize("friction", [0.7, 0.25])
def test_it_is_the_share_of_choices_with_a_margin(p_OC, friction):
    """Every choice once more, without the bound that decides most of them first."""
    regions = regions_of(SURFACE, p_OC)
    rng = np.random.default_rng(3)
    members = [regions.members(i) for i in range(5)]
    picks = np.stack([rng.choice(q, size=60, p=np.full(len(q), 1 / len(q))) for q in members])
    margins = [min_weight_margin(SURFACE.p_OQ[q], SURFACE.nhat_OQ[q], friction) for q in picks.T]
    closed = np.array(margins) > 1e-7
    assert 0 < np.mean(closed) < 1
    assert share(regions, friction, seed=3, samples=60) == np.mean(closed)


def test_what_the_bound_nearly_certifies_is_not_taken_for_closed():
    rng = np.random.default_rng(0)
    seen = 0
    while seen < 5:
        q = rng.choice(len(SURFACE.p_OQ), 3, replace=False)
        points = SURFACE.p_OQ[q], SURFACE.nhat_OQ[q], 0.7
        if -1 < least_norm_margin(*points) < 0 and min_weight_margin(*points) < 1e-9:
            assert share(regions_at(*q), samples=1) == 0
            seen += 1


@pytest.mark.slow
def test_more_friction_closes_no_fewer_and_the_seed_decides(p_OC):
    regions = regions_of(SURFACE, p_OC)
    shares = [share(regions, mu) for mu in (0.1, 0.3, 0.7, 1.2)]
    assert shares == sorted(shares)
    assert shares[0] < shares[-1]
    assert share(regions) == share(regions)


def test_candidates_count_by_their_areas():
    pair = [nearest([0.05, 0.02, 0]), nearest([0.05, -0.02, 0])]
    closing, spoiling = nearest([-0.05, 0, 0]), nearest([0.05, 0, 0.02])  # On the pair's face.
    areas = SURFACE.areas.copy()
    areas[spoiling] = 3 * areas[closing]
    weighed = replace(SURFACE, areas=areas)
    assert share(regions_at(*pair, closing)) == 1
    assert share(regions_at(*pair, spoiling)) == 0
    generator = np.random.default_rng(0)
    regions = regions_at(*pair, [closing, spoiling])
    found = force_closed_share(weighed, regions, 0.7, generator=generator, samples=400)
    assert found == pytest.approx(0.25, abs=0.08)


GRASPS = {
    "two a side": [
        [0.05, 0.01, 0],
        [-0.05, 0.02, 0.01],
        [-0.05, -0.02, -0.01],
        [0.05, -0.02, 0.01],
    ],
    "three": [[0.05, 0, 0], [-0.05, 0.025, 0], [-0.05, -0.025, 0]],
    "hardly closed": [
        [0.05, -0.005, 0.005],
        [-0.005, 0.05, 0.035],
        [-0.05, 0.015, 0.035],
        [-0.05, 0.035, -0.025],
    ],
    "open": [[0.05, 0, 0], [0, 0.05, 0], [0.02, 0.05, 0.01]],
}


@pytest.mark.parametrize("name", GRASPS)
def test_no_slip_within_the_radius_loses_force_closure(name):
    """All contacts but one stay; the weights of a strategy are the same radii."""
    p_OC, nhat = SURFACE.project(np.array(GRASPS[name]))
    radii = slip_radii_within(SURFACE, p_OC, nhat, 0.03, 0.7)
    expected = {"two a side": 0.03, "three": 0.026, "hardly closed": 0.01, "open": 0.0}[name]
    assert radii.min() == pytest.approx(expected, abs=1e-3)
    chosen = SelectionInput(SURFACE, p_OC, regions_of(SURFACE, p_OC), np.eye(3))
    for i, radius in enumerate(radii):
        slips = np.linalg.norm(SURFACE.p_OQ - p_OC[i], axis=1)
        for q in np.flatnonzero(slips < radius):
            p, n = p_OC.copy(), nhat.copy()
            p[i], n[i] = SURFACE.p_OQ[q], SURFACE.nhat_OQ[q]
            assert min_weight_margin(p - SURFACE.p_OCoM, n, 0.7) > 1e-7
        b = hand_independence(chosen, i, friction=0.7)
        for q, radius_there in list(zip(chosen.regions.members(i), b, strict=True))[::15]:
            p, n = p_OC.copy(), nhat.copy()
            p[i], n[i] = SURFACE.p_OQ[q], SURFACE.nhat_OQ[q]
            there = slip_radii_within(SURFACE, p, n, 0.03, 0.7)[i]
            assert there == pytest.approx(min(radius_there, 0.03))


def test_the_radius_of_a_candidate_is_to_the_nearest_one_without_force_closure():
    closed = np.linalg.norm(SURFACE.p_OQ - [0.05, 0, 0], axis=1) < 0.035
    places = np.arange(0, len(closed), 7)
    radii = slip_radii(SURFACE, closed, places)
    for q, radius in zip(places, radii, strict=True):
        away = np.linalg.norm(SURFACE.p_OQ - SURFACE.p_OQ[q], axis=1)
        assert radius == pytest.approx(away[~closed].min())
    longest = 2 * SURFACE.longest_lever_arm
    for mask, expected in ((True, longest), (False, 0)):  # All places count equally.
        radii = slip_radii(SURFACE, np.full(len(closed), mask), places)
        np.testing.assert_array_equal(radii, expected)
