"""Where a tick goes, by Python's own profiler."""

import cProfile
import pstats
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.kernels import TickKernel
from drake_pregrasp.quality.grasp_quality import grasp_quality
from drake_pregrasp.studies.bench.scene import SceneSpec, make_scene
from drake_pregrasp.studies.bench.ways import make_ticks

STAGES: Mapping[str, Callable[..., Any]] = {
    "regions": TickKernel.partition,
    "weights, centroids": TickKernel.centroids,
    "projection": ObjectSurface.project_onto_regions,
    "measures": grasp_quality,
}
"""The stages of a tick, and the function in which each of them is as a whole."""

REST = "the rest"


class ShareJob(NamedTuple):
    """Ticks to profile.

    Attributes:
        spec: What to plan on.
        strategy: Name of the strategy.
        way: Name of the kernel.
        ticks: How many.
    """

    spec: SceneSpec
    strategy: str
    way: str
    ticks: int


class Shares(NamedTuple):
    """Where ticks go.

    Attributes:
        size: Number of candidates.
        strategy: Name of the strategy.
        way: Name of the kernel.
        shares: Of the time, by `STAGES` and `REST`.
    """

    size: int
    strategy: str
    way: str
    shares: Mapping[str, float]


def profile_ticks(job: ShareJob) -> Shares:
    """Profiles ticks from the scene's contact sets in turn."""
    scene = make_scene(job.spec)
    tick = make_ticks(scene, job.strategy, [job.way])[job.way]
    for start in scene.starts:
        tick(start)
    profile = cProfile.Profile()
    profile.enable()
    for k in range(job.ticks):
        tick(scene.starts[k % len(scene.starts)])
    profile.disable()
    stats = pstats.Stats(profile)
    shares = {
        stage: _cumulative_seconds(stats, function) / stats.total_tt  # type: ignore[attr-defined]
        for stage, function in STAGES.items()
    }
    shares[REST] = 1 - sum(shares.values())
    return Shares(len(scene.surface.p_OQ), job.strategy, job.way, shares)


def _cumulative_seconds(stats: pstats.Stats, function: Callable[..., Any]) -> float:
    code = function.__code__
    key = (code.co_filename, code.co_firstlineno, code.co_name)
    rows = stats.stats  # type: ignore[attr-defined]
    return float(rows[key][3]) if key in rows else 0.0
