"""An optional compiled implementation of what takes most of a tick, the extra `fast` (numba).

The references are `regions.safe_regions.label_candidates`, `contacts.centroids.region_goals` and
`estimation.pose_filter.filter_step`. This package has the same functions, those of regions and
goals for a surface whose candidates are known beforehand; tests compare both. Systems choose once,
by `fast_labels`, `fast_goals` and `fast_filter_step`; None means the reference.
"""

import functools
import importlib.util
import os
from collections.abc import Mapping

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.selection_input import GoalFunction
from drake_pregrasp.estimation.pose_filter import FilterStep
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.force_closure import FRICTION
from drake_pregrasp.regions.constraints import LimitFunction, Predicates
from drake_pregrasp.regions.safe_regions import LabelCandidates

SWITCH = "DRAKE_PREGRASP_FAST"
"""Environment variable; the value 0 chooses the reference even if numba is installed."""


@functools.cache
def numba_is_installed() -> bool:
    """Returns whether numba, the extra `fast`, can be imported, without importing it."""
    return importlib.util.find_spec("numba") is not None


def _is_chosen() -> bool:
    return numba_is_installed() and os.environ.get(SWITCH) != "0"


def fast_labels(q: FloatArray, nhat: FloatArray) -> LabelCandidates | None:
    """Returns `label_candidates` compiled for the candidates of a surface, or None without numba.

    Args:
        q: Candidate points, shape (N, d), in metres.
        nhat: Outward unit normals at the candidates, shape (N, 3).
    """
    if not _is_chosen():
        return None
    from drake_pregrasp.fast.labels import CompactCandidates  # numba takes a third of a second.

    return CompactCandidates(q, nhat).label


def fast_surface(surface: ObjectSurface) -> ObjectSurface:
    """Returns a surface whose projection is compiled, or the same surface without numba."""
    if not _is_chosen():
        return surface
    from drake_pregrasp.fast.projection import CompiledSurface

    return CompiledSurface.of(surface)


def fast_limits() -> LimitFunction:
    """Returns `Predicates.limits_at` compiled, or the reference without numba."""
    if not _is_chosen():
        return Predicates.limits_at
    from drake_pregrasp.fast.predicates import compiled_limits_at

    return compiled_limits_at


def fast_goals(
    surface: ObjectSurface,
    weights: Mapping[str, float],
    *,
    reading: str = "hand",
    stretch: bool = True,
    power: float = 1.0,
    friction: float = FRICTION,
    best_point: bool = False,
) -> GoalFunction | None:
    """Returns `region_goals` or `best_points` compiled for a surface, or None without numba.

    Args:
        surface: The object's surface.
        weights: Weights of the strategies in a blend, by name; one for a single strategy.
        reading: Reading of the grasp matrix; this and the next three are as for `make_blend`.
        stretch: Whether weights are stretched over each region.
        power: Exponent of the weights.
        friction: Coulomb's coefficient.
        best_point: Whether goals are the best points.
    """
    if not _is_chosen():
        return None
    from drake_pregrasp.fast.goals import CompiledGoals

    return CompiledGoals(
        surface,
        weights,
        reading=reading,
        stretch=stretch,
        power=power,
        friction=friction,
        best_point=best_point,
    )


def fast_filter_step() -> FilterStep | None:
    """Returns `filter_step` compiled, or None without numba."""
    if not _is_chosen():
        return None
    from drake_pregrasp.fast.pose_steps import compiled_filter_step

    return compiled_filter_step
