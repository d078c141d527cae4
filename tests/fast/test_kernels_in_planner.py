"""The planner with a surface's kernel does what it does without."""

from dataclasses import replace

import numpy as np
import pytest

from drake_pregrasp.contacts.centroids import select_contacts
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import make_strategy
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.box_surface import box_surface
from drake_pregrasp.regions import safe_regions
from drake_pregrasp.regions.constraints import Limit, RegionConstraints
from drake_pregrasp.regions.safe_regions import TINY_SHARE, compute_safe_regions


def scattered_contacts(surface, seed, n=5):
    rng = np.random.default_rng(seed)
    return surface.p_OQ[rng.choice(len(surface.p_OQ), n, replace=False)] + 1e-5 * rng.random((n, 3))


def both(surface, p_OC, h, constraints=None):
    arguments = (surface.p_OQ, p_OC, h, surface.forbidden, constraints)
    without = compute_safe_regions(*arguments)
    return without, compute_safe_regions(*arguments, kernel=surface.kernel)


@pytest.mark.parametrize("seed", range(6))
def test_regions_are_the_same(surface, seed):
    h = np.where(np.arange(5) == seed, -np.inf, 0.0)
    without, regions = both(surface, scattered_contacts(surface, seed), h)
    for name in ("labels", "lost", "limits", "causes"):
        np.testing.assert_array_equal(getattr(regions, name), getattr(without, name))
    np.testing.assert_array_equal(regions.sizes(), without.sizes())


def test_a_tiny_region_is_explained_as_before(surface):
    p_OC = scattered_contacts(surface, 0)
    p_OC[1] = p_OC[0]
    without, regions = both(surface, p_OC, np.zeros(5))
    np.testing.assert_array_equal(regions.limits, without.limits)
    assert regions.limits[1] == Limit.CROWDED


def test_constraints_count_as_before(surface):
    constraints = RegionConstraints(tip_radii=np.full(5, 0.01))
    p_OC = scattered_contacts(surface, 1)
    without, regions = both(surface, p_OC, np.zeros(5), constraints)
    np.testing.assert_array_equal(regions.labels, without.labels)
    unlimited, _ = both(surface, p_OC, np.zeros(5))
    assert np.any(unlimited.labels != regions.labels)


@pytest.mark.parametrize("in_turns", [False, True])
@pytest.mark.parametrize("stretch", [False, True])
@pytest.mark.parametrize("name", ["position", "msv", "gii", "vew"])
def test_goals_are_the_same(surface, name, stretch, in_turns):
    for seed in range(4):
        p_OC = scattered_contacts(surface, seed)
        h = np.where(np.arange(5) == seed, -np.inf, 0.0)
        without, regions = both(surface, p_OC, h)
        assert regions.partition is not None
        strategy = make_strategy(name, stretch=stretch)
        plain = SelectionInput(surface, p_OC, without, np.diag([1e-3, 2e-3, 5e-4]))
        expected = select_contacts(plain, strategy, in_turns=in_turns)
        found = select_contacts(replace(plain, regions=regions), strategy, in_turns=in_turns)
        np.testing.assert_allclose(found.p_OC, expected.p_OC, rtol=0, atol=1e-10)
        np.testing.assert_array_equal(found.status, expected.status)


def test_points_project_onto_their_own_region(surface):
    rng = np.random.default_rng(0)
    _, regions = both(surface, scattered_contacts(surface, 2), np.zeros(5))
    contacts = np.flatnonzero(regions.sizes() > 0)
    for _ in range(5):
        p_OP = rng.uniform(-0.06, 0.06, (len(contacts), 3))
        members = [regions.members(int(contact)) for contact in contacts]
        expected, _ = surface.project_into(p_OP, members)
        found, _ = surface.project_onto_regions(p_OP, regions.partition, contacts)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize("sample", [safe_regions._ASKED_FOR_REASONS, 400])
def test_each_tiny_region_of_a_fine_surface_has_a_reason(monkeypatch, sample):
    """Also where a small sample, that is asked for reasons, doesn't see that it is tiny."""
    monkeypatch.setattr(safe_regions, "_ASKED_FOR_REASONS", sample)
    fine = box_surface([0.1, 0.1, 0.1], spacing=0.0011)
    rng, found = np.random.default_rng(0), 0
    for _ in range(30):
        p_OC = fine.p_OQ[rng.choice(len(fine.p_OQ), 6, replace=False)]
        near = np.argsort(np.linalg.norm(fine.p_OQ - p_OC[0], axis=1))[:300]
        p_OC = np.concatenate([p_OC, fine.p_OQ[rng.choice(near, 3, replace=False)]])
        regions = compute_safe_regions(
            fine.p_OQ, p_OC, np.zeros(9), fine.forbidden, kernel=fine.kernel
        )
        tiny = regions.sizes() < TINY_SHARE * len(fine.p_OQ) / 9
        np.testing.assert_array_equal(regions.limits != Limit.NONE, tiny)
        without = compute_safe_regions(fine.p_OQ, p_OC, np.zeros(9), fine.forbidden)
        found += np.sum(tiny)
        if sample > 1000:
            assert np.sum(regions.limits != without.limits) <= 1
    assert found > 10


def test_points_that_are_not_finite_are_refused(surface):
    _, regions = both(surface, scattered_contacts(surface, 2), np.zeros(5))
    points = np.array([[0.0, 0, 0], [0, np.inf, 0]])
    with pytest.raises(InvalidArgumentError, match=r"points must be finite, not \[ 0. inf  0.\]"):
        surface.project(points)
    with pytest.raises(InvalidArgumentError, match="points must be finite"):
        surface.project_onto_regions(points, regions.partition, np.arange(2))
    with pytest.raises(InvalidArgumentError, match="no candidates"):
        surface.project_into(points[:1], [np.empty(0, dtype=int)])


def test_systems_with_different_surfaces_say_so(surface):
    other = box_surface([0.1, 0.1, 0.1], spacing=0.02)
    p_OC = scattered_contacts(surface, 0)
    _, regions = both(other, p_OC, np.zeros(5))
    selection = SelectionInput(surface, p_OC, regions, np.eye(3))
    with pytest.raises(InvalidArgumentError, match="of another surface"):
        select_contacts(selection, make_strategy("position"))
