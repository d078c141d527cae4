"""Which kernel there is, and making one."""

import functools
import importlib.util
import logging
from typing import TYPE_CHECKING

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.kernels.ground import Ground
from drake_pregrasp.kernels.numpy_kernel import NumpyKernel
from drake_pregrasp.kernels.tick_kernel import TickKernel
from drake_pregrasp.kernels.weighting import KINDS, Weighting

if TYPE_CHECKING:
    from drake_pregrasp.kernels.numba_kernel import NumbaKernel

IMPLEMENTATIONS = ("numpy", "numba")
"""Names of the kernels."""


@functools.cache
def numba_is_installed() -> bool:
    """Returns whether numba, the extra `[fast]`, can be imported; it is not imported for that."""
    return importlib.util.find_spec("numba") is not None


def make_kernel(
    p_OQ: FloatArray,
    nhat_OQ: FloatArray,
    areas: FloatArray,
    p_OCoM: FloatArray,
    *,
    implementation: str | None = None,
) -> TickKernel:
    """Makes the kernel of a surface. With numba it is then compiled, so that no tick waits for it.

    Args:
        p_OQ: Candidate points of Y, shape (N, 3), N >= 1, in metres.
        nhat_OQ: Outward unit normals there, shape (N, 3).
        areas: Surface area each candidate stands for, shape (N,), in m².
        p_OCoM: Centre of mass, shape (3,), in metres.
        implementation: One of `IMPLEMENTATIONS`; by default numba where it is installed.

    Raises:
        InvalidArgumentError: If there is no such implementation, or it isn't installed.
    """
    if implementation is None:
        implementation = "numba" if numba_is_installed() else "numpy"
    if implementation not in IMPLEMENTATIONS:
        raise InvalidArgumentError(
            f"no implementation {implementation!r}; there are: {', '.join(IMPLEMENTATIONS)}"
        )
    if implementation == "numpy":
        return NumpyKernel(p_OQ, nhat_OQ, areas, p_OCoM)
    if not numba_is_installed():
        raise InvalidArgumentError("numba is not installed; pip install 'drake_pregrasp[fast]'")
    warm_up()
    return _compiled(p_OQ, nhat_OQ, areas, p_OCoM)


@functools.cache
def warm_up() -> None:
    """Compiles all that ticks call, or loads it from numba's cache on disk; once a process.

    Where numba isn't installed there is nothing to do.
    """
    if not numba_is_installed():
        return
    p_OQ = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    kernel = _compiled(p_OQ, p_OQ, np.ones(2), np.zeros(3))
    if not kernel.is_compiled():
        logging.getLogger(__name__).warning("compiling the planner's kernels: some 20 s, once")
    partition = kernel.partition(p_OQ, np.zeros(2), np.zeros((1, 3)), np.zeros(1))
    for kind in KINDS:
        weighting = Weighting(kind, True, np.eye(3))
        kernel.centroids(partition, p_OQ, np.arange(2), weighting)
    patches = np.tile(p_OQ[:, None], (1, 3, 1))
    kernel.nearest_on_triangles(p_OQ[:1], [np.arange(1)], patches)
    ground = Ground(p_OQ, patches, np.arange(3))
    kernel.project_onto_regions(p_OQ, partition, np.arange(2), ground)


def _compiled(
    p_OQ: FloatArray, nhat_OQ: FloatArray, areas: FloatArray, p_OCoM: FloatArray
) -> "NumbaKernel":
    # Imported here, because numba takes a third of a second, and may not be there.
    from drake_pregrasp.kernels.numba_kernel import NumbaKernel

    return NumbaKernel(p_OQ, nhat_OQ, areas, p_OCoM)
