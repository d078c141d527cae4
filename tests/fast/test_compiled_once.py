"""No tick waits for the compiler, whatever arrays it meets."""

import numpy as np
import pytest
from kernel_cases import Case
from numpy.typing import NDArray

from drake_pregrasp import mesh_surface
from drake_pregrasp.geometry.shapes import cylinder_shape
from drake_pregrasp.kernels import (
    KINDS,
    Ground,
    Weighting,
    make_kernel,
    numba_is_installed,
)

pytestmark = pytest.mark.skipif(not numba_is_installed(), reason="numba is not installed")


def entries():
    from drake_pregrasp.kernels import numba_kernel

    names = ("divide", "centroids_of", "weights_of", "project", "nearest_on_triangles")
    return {name: getattr(numba_kernel, name) for name in names}


def frozen(array: NDArray) -> NDArray:
    array = np.asfortranarray(array)
    array.setflags(write=False)
    return array


def every_other(array: NDArray) -> NDArray:
    return np.repeat(array, 2, axis=0)[::2]


@pytest.mark.parametrize("kind_of_array", [np.array, frozen, every_other])
@pytest.mark.parametrize("kind", KINDS)
def test_other_kinds_of_arrays_need_no_other_code(kind_of_array, kind):
    surface = mesh_surface(cylinder_shape(0.04, 0.1), spacing=0.01)
    kernel = make_kernel(
        *(kind_of_array(a) for a in (surface.p_OQ, surface.nhat_OQ, surface.areas)),
        kind_of_array(surface.p_OCoM),
        implementation="numba",
    )
    ground = Ground(
        *(kind_of_array(a) for a in (surface.p_OQ, surface.patches)), surface.patch_starts
    )
    rng = np.random.default_rng(0)
    p_OC = surface.p_OQ[rng.choice(len(surface.p_OQ), 4, replace=False)]
    z = rng.normal(size=(6, 3))
    reference = kernel.partition(p_OC, np.zeros(4), z, np.zeros(6))
    before = {name: len(entry.signatures) for name, entry in entries().items()}
    assert all(count <= 1 for count in before.values()), before
    partition = kernel.partition(*map(kind_of_array, (p_OC, np.zeros(4), z, np.zeros(6))))
    np.testing.assert_array_equal(partition.sizes, reference.sizes)
    weighting = Weighting(kind, True, kind_of_array(1e-3 * np.eye(3)))
    movers = np.flatnonzero(partition.sizes)
    movers = kind_of_array(movers)
    kernel.centroids(partition, kind_of_array(p_OC), movers.astype(np.int32), weighting)
    kernel.project(kind_of_array(p_OC), ground)
    kernel.project_onto_regions(kind_of_array(p_OC[movers]), partition, movers, ground)
    kernel.nearest_on_triangles(kind_of_array(p_OC), [np.arange(3)] * 4, ground.patches)
    for name, entry in entries().items():
        if name != "weights_of":
            assert len(entry.signatures) == 1, name


def test_all_surfaces_share_the_code():
    for N in (1, 2, 64, 65, 5000):
        case = Case(0, 3, 5, N=N)
        kernel = case.kernel("numba")
        partition = case.partition(kernel)
        movers = np.flatnonzero(partition.sizes)
        kernel.centroids(partition, case.p_OC, movers, Weighting("gii", True, np.eye(3)))
    counts = {name: len(entry.signatures) for name, entry in entries().items()}
    assert all(count <= 1 for count in counts.values()), counts
