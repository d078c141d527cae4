"""The planner against choosing all contacts anew each time: time, Q_MSV and the margin."""

import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.centroids import select_contacts
from drake_pregrasp.contacts.selection_input import SelectionInput, WeightFunction
from drake_pregrasp.contacts.strategies import make_blend, make_strategy
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.grasp_quality import grasp_quality
from drake_pregrasp.regions.safe_regions import compute_safe_regions
from drake_pregrasp.studies.bench.direct_tick import SPREAD
from drake_pregrasp.studies.bench.scene import (
    EDGE,
    LARGEST_RADIUS,
    NUM_CONTACTS,
    Scene,
    cube,
    make_scene,
)
from drake_pregrasp.studies.continuous_selection import (
    evolved_choice,
    side_faces,
    slsqp_choice,
)
from drake_pregrasp.studies.global_selection import (
    Score,
    closed_form_score,
    eigenvalue_score,
    exchanged,
    greedy,
    margin_score,
)
from drake_pregrasp.studies.settled_margins import margin_of

PER_EDGE = 24
"""Candidates on an edge of the cube: 2,304 in all."""

SETTLING = 60
"""Ticks of the planner from random contacts, after which..."""

LAST = 8
"""...the mean of the last so many counts."""

TIMED = 60
"""Ticks that are timed then, each from the settled contacts..."""

JITTER = 1e-9
"""...with that standard deviation of each coordinate, in metres."""

GREEDY = "greedy with exchange"
"""The method whose margin the planner's is compared with."""

PLANNERS: dict[str, tuple[WeightFunction, bool]] = {
    "position": (make_strategy("position"), False),
    "msv": (make_strategy("msv"), False),
    "msv, in turns": (make_strategy("msv"), True),
    "gii": (make_strategy("gii"), False),
    "vew": (make_strategy("vew"), False),
    "margin": (make_strategy("margin"), False),
    "margin, in turns, power 4": (make_strategy("margin", power=4.0), True),
    "position + margin, in turns": (make_blend({"position": 1.0, "margin": 1.0}), True),
}
"""Strategies of the planner, and whether contacts move in turns."""

MARGIN_WEIGHTED = tuple(name for name in PLANNERS if "margin" in name)
"""Those that look at force closure."""


class GlobalJob(NamedTuple):
    """One scene, all methods in turn.

    Attributes:
        seed: Of its forbidden points and its random contacts.
        evolution: Whether differential evolution takes part; it takes long.
    """

    seed: int
    evolution: bool


class Choice(NamedTuple):
    """What a method came to in one scene.

    Attributes:
        method: Its name.
        is_planner: Whether it is a strategy of the planner.
        seed: Of the scene.
        seconds: For the choice; of the planner, the median of its ticks once settled.
        q_msv: Q_MSV reached; of the planner, once settled.
        margin: The min-weight margin reached; of the planner, once settled.
    """

    method: str
    is_planner: bool
    seed: int
    seconds: float
    q_msv: float
    margin: float


def compare_choices(job: GlobalJob) -> list[Choice]:
    """Returns what all methods come to in one scene."""
    scene = make_scene(cube(PER_EDGE)._replace(seed=job.seed))
    surface, choices = scene.surface, []
    for method, choose in _global_methods(scene, job):
        start = time.perf_counter()
        p_OC = choose()
        seconds = time.perf_counter() - start
        choices.append(Choice(method, False, job.seed, seconds, *_reached(surface, p_OC)))
    for method, (weigh, in_turns) in PLANNERS.items():
        settled = settle(surface, scene.starts[0], weigh, in_turns=in_turns)
        choices.append(Choice(method, True, job.seed, *settled))
    return choices


def settle(
    surface: ObjectSurface, p_OC: FloatArray, weigh: WeightFunction, *, in_turns: bool
) -> tuple[float, float, float]:
    """Returns the planner's median seconds a tick, and its mean Q_MSV and margin, once settled."""
    reached = []
    for tick in range(SETTLING):
        p_OC = _planned(surface, p_OC, weigh, in_turns)
        if tick >= SETTLING - LAST:
            reached.append(_reached(surface, p_OC))
    q_msv, margin = np.mean(reached, axis=0)
    seconds = seconds_a_tick(surface, p_OC, weigh, in_turns=in_turns)
    return seconds, float(q_msv), float(margin)


def seconds_a_tick(
    surface: ObjectSurface, p_OC: FloatArray, weigh: WeightFunction, *, in_turns: bool
) -> float:
    """Returns the median seconds of ticks, each from contacts that differ a little.

    Contacts may come to rest exactly, and then the kernel would return the partition it remembers.
    """
    rng, seconds = np.random.default_rng(0), []
    for _ in range(TIMED):
        jittered = p_OC + rng.normal(0, JITTER, p_OC.shape)
        start = time.perf_counter()
        _planned(surface, jittered, weigh, in_turns)
        seconds.append(time.perf_counter() - start)
    return float(np.median(seconds))


def _planned(
    surface: ObjectSurface, p_OC: FloatArray, weigh: WeightFunction, in_turns: bool
) -> FloatArray:
    """Returns where contacts go in a tick, which measures the goals too."""
    regions = compute_safe_regions(
        surface.p_OQ, p_OC, np.zeros(len(p_OC)), surface.forbidden, kernel=surface.kernel
    )
    selection = SelectionInput(surface, p_OC, regions, SPREAD**2 * np.eye(3))
    goals = select_contacts(selection, weigh, in_turns=in_turns).p_OC
    grasp_quality(goals - surface.p_OCoM)
    return goals


def _reached(surface: ObjectSurface, p_OC: FloatArray) -> tuple[float, float]:
    return grasp_quality(p_OC - surface.p_OCoM).q_msv, margin_of(surface, p_OC)


def _global_methods(scene: Scene, job: GlobalJob) -> Iterator[tuple[str, Callable[[], FloatArray]]]:
    """Yields methods that keep out of the balls around forbidden points, as the planner does.

    What depends on the surface alone is made here: it is made once, as the planner's kernel is.
    """
    surface, rng = scene.surface, np.random.default_rng(job.seed)
    clear = np.flatnonzero(surface.is_clear_of_forbidden_points)
    q, nhat = surface.p_OQ[clear], surface.nhat_OQ[clear]
    first = int(rng.integers(len(q)))

    def greedily(*scores: Score) -> Callable[[], FloatArray]:
        def choose() -> FloatArray:
            chosen = greedy(scores[0], first, NUM_CONTACTS)
            for score in scores:
                chosen = exchanged(score, chosen)
            return q[chosen]

        return choose

    library, closed = eigenvalue_score(q), closed_form_score(q)
    yield GREEDY, greedily(library)
    yield f"{GREEDY}, closed form", greedily(closed)
    yield f"{GREEDY}, then by margin", greedily(closed, margin_score(q, nhat))
    # Forbidden points are on top and bottom: beyond the largest radius all ground is clear of them.
    faces = side_faces(EDGE, LARGEST_RADIUS)
    yield "SLSQP, 10 starts", lambda: slsqp_choice(faces, NUM_CONTACTS, rng, gradient=False)
    yield "SLSQP, 10 starts, with gradient", lambda: slsqp_choice(faces, NUM_CONTACTS, rng)
    if job.evolution:
        yield "differential evolution", lambda: evolved_choice(faces, NUM_CONTACTS, rng)
