"""Labels of faces, turned ones and curved surfaces, tick after tick, against all planes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_cases import IMPLEMENTATIONS, kernel_of, on_box
from scipy.spatial.transform import Rotation

from drake_pregrasp.kernels.region_planes import region_planes

TIE = 1e-12  # Of the square of the object's size: so near a plane a point may be on either side.


def surface_of(shape, N, seed, size=0.1):
    """Points and normals on a box, on a turned box, on a slab's two sides, or on a sphere."""
    rng = np.random.default_rng(seed)
    if shape == "sphere":
        normals = rng.normal(size=(N, 3))
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        return size / 2 * normals, normals
    points, normals = on_box(rng, N, size)
    if shape == "grid":
        cells = np.round(points / size * 16) / 16 * size
        points = np.where(normals != 0, points, cells)
    if shape == "turned box":
        turn = Rotation.random(random_state=seed).as_matrix()
        return points @ turn.T, normals @ turn.T
    return points, normals


def compare(kernel, points, p_OC, h, p_OZ, radii, size):
    """Compares with every plane of every region, at every candidate."""
    partition = kernel.partition(p_OC, h, p_OZ, radii)
    labels = partition.labels_of_candidates()
    counts = np.bincount(labels + 1, minlength=len(h) + 1)[1:]
    np.testing.assert_array_equal(partition.sizes, counts)
    for contact in range(len(h)):
        if h[contact] == -np.inf:
            assert not np.any(labels == contact)
            continue
        normals, bounds = region_planes(contact, p_OC, h, p_OZ, radii)
        over = np.max(normals @ points.T - bounds[:, None], axis=0, initial=-np.inf)
        assert np.all(over[labels == contact] <= TIE * size**2)
        assert np.all(over[labels != contact] >= -TIE * size**2)
    return partition


SHAPES = ("box", "grid", "turned box", "sphere")


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
@pytest.mark.parametrize("shape", SHAPES)
@settings(max_examples=10)
@given(
    seed=st.integers(0, 10**6),
    n=st.integers(1, 32),
    m=st.sampled_from([0, 1, 40, 300]),
    N=st.integers(1, 5000),
    inside=st.booleans(),
)
def test_labels_break_no_plane_but_for_ties(implementation, shape, seed, n, m, N, inside):
    rng = np.random.default_rng(seed)
    points, normals = surface_of(shape, N, seed)
    kernel = kernel_of(implementation, points, normals, np.ones(N), np.zeros(3))
    p_OC = points[rng.integers(0, N, n)] + 1e-3 * rng.normal(size=(n, 3))
    p_OZ = rng.uniform(-0.05, 0.05, (m, 3)) if inside else on_box(rng, m, 0.1)[0]
    p_OZ[: m // 20] = p_OC[0]  # Some at a contact itself.
    h = 1e-4 * rng.normal(size=n)
    compare(kernel, points, p_OC, h, p_OZ, np.abs(rng.normal(0, 0.004, m)), 0.1)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_contacts_inside_the_balls_of_forbidden_points_have_what_eq_1_gives(implementation):
    points, normals = surface_of("box", 4000, 0)
    kernel = kernel_of(implementation, points, normals, np.ones(4000), np.zeros(3))
    p_OC = points[[0, 900, 1800]]
    p_OZ = np.vstack([p_OC[0] + [1e-4, 0, 0], p_OC[1]])
    compare(kernel, points, p_OC, np.zeros(3), p_OZ, np.array([0.01, 0.0]), 0.1)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
@pytest.mark.parametrize("shape", SHAPES)
def test_one_kernel_gives_tick_after_tick_what_a_fresh_one_gives(implementation, shape):
    """Contacts wander by nothing, micrometres, millimetres or across the object, two planners."""
    rng = np.random.default_rng(3)
    N, n = 1500, 5
    points, normals = surface_of(shape, N, 3)
    arrays = (points, normals, np.ones(N), np.zeros(3))
    kernel = kernel_of(implementation, *arrays)
    p_OZ, radii = on_box(rng, 60, 0.1)[0], rng.uniform(0, 0.005, 60)
    hands = [points[rng.choice(N, n, replace=False)] + 1e-6 for _ in range(2)]
    weights, held = np.zeros(n), []
    for tick in range(40):
        p_OC = hands[tick // 3 % 2]  # Two planners in turn, three ticks each.
        p_OC += rng.choice([0.0, 0.0, 1e-6, 1e-3, 0.1]) * rng.normal(size=(n, 3))
        if tick % 7 == 0:
            weights = np.where(rng.random(n) < 0.2, -np.inf, 1e-5 * rng.normal(size=n))
        radii[tick] += 1e-4
        partition = kernel.partition(p_OC, weights, p_OZ, radii)
        fresh = kernel_of(implementation, *arrays).partition(p_OC, weights, p_OZ, radii)
        labels = partition.labels_of_candidates()
        np.testing.assert_array_equal(labels, fresh.labels_of_candidates())
        np.testing.assert_array_equal(partition.sizes, fresh.sizes)
        held.append((partition, labels))
    for partition, labels in held:
        np.testing.assert_array_equal(partition.labels_of_candidates(), labels)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_the_same_tick_again_gives_the_same_partition_and_any_change_another(implementation):
    points, normals = surface_of("box", 300, 0)
    kernel = kernel_of(implementation, points, normals, np.ones(300), np.zeros(3))
    asked = [points[:3] + 1e-4, np.zeros(3), points[10:20].copy(), np.full(10, 0.001)]
    first = kernel.partition(*asked)
    assert kernel.partition(*(a.copy() for a in asked)) is first
    for argument in asked:
        before = kernel.partition(*asked)
        argument[0] += 1e-3  # In place, as a caller's own buffer may be.
        assert kernel.partition(*asked) is not before
