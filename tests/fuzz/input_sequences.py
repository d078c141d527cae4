"""Feeds many planners with random sequences of inputs, and reports the outcomes.

    python -m tests.fuzz.input_sequences --count 100000 --seed 0

After each tick all outputs are to be finite, active goals on the allowed surface, and steps within
the limits, whatever came in; and nothing is to raise an error.
"""

import sys
import time
import traceback
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

sys.path.extend(str(folder) for folder in Path(__file__).parents[:2])

from command_line import Result, main
from input_cases import Case, make_case, make_value
from input_variants import PERIOD, Variant, make_variant
from pydrake.math import RigidTransform
from pydrake.systems.framework import BusValue, Context

from drake_pregrasp.contacts.goal_limits import tip_gaps
from drake_pregrasp.contacts.selection_input import ContactStatus, is_active
from drake_pregrasp.estimation.pose_track import TrackingStatus
from drake_pregrasp.geometry.surface import CONTACT_TOLERANCE
from drake_pregrasp.regions.constraints import Limit
from drake_pregrasp.regions.safe_regions import SafeRegions
from drake_pregrasp.systems.ports import is_valid

BETWEEN = 0.4
"""Share of a period after a tick at which outputs are looked at again."""

KEPT = "kept"
"""The outcome that is as it should be."""

_ROUNDING = 1e-9
_STATUSES = {float(status) for status in ContactStatus}
_P_OC = 1  # Index of the selector's state with the goals.


class BrokenLawError(Exception):
    """An output is not what it has to be."""


def _require(law: bool, words: str) -> None:
    if not law:
        raise BrokenLawError(words)


def play(case: Case) -> None:
    """Plays a sequence on a fresh Context.

    Raises:
        BrokenLawError: If an output is not what it has to be.
    """
    variant = make_variant(case.variant)
    context = variant.diagram.CreateDefaultContext()
    now = 0
    for tick in case.ticks:
        now += tick.steps
        context.SetTime(now * PERIOD)
        for port, value in tick.values.items():
            variant.diagram.GetInputPort(port).FixValue(context, make_value(value))
        before = _stored(variant, context)
        _check_outputs(variant, context)
        regions: SafeRegions = variant.diagram.GetOutputPort("safe_regions").Eval(context)
        held = _is_held(variant, context)
        context.SetDiscreteState(variant.diagram.EvalUniquePeriodicDiscreteUpdate(context))
        _check_step(variant, context, before, regions, held)
        _check_outputs(variant, context)
        if tick.between:
            stored = _stored(variant, context)
            context.SetTime((now + BETWEEN) * PERIOD)
            _check_outputs(variant, context)
            _require(np.array_equal(_stored(variant, context), stored), "goals move between ticks")


def _stored(variant: Variant, context: Context) -> np.ndarray:
    own = variant.selector.GetMyContextFromRoot(context)
    return own.get_discrete_state(_P_OC).value().reshape(-1, 3).copy()


def _is_held(variant: Variant, context: Context) -> bool:
    own = variant.selector.GetMyContextFromRoot(context)
    hold, status = (variant.selector.GetInputPort(n) for n in ("hold_contacts", "tracking_status"))
    if hold.HasValue(own) and not hold.Eval(own)[0] <= 0:
        return True
    if status.HasValue(own):
        number = status.Eval(own)[0]
        if number not in (TrackingStatus.TRACKING, TrackingStatus.COASTING):
            return True
    return not is_valid(variant.selector.GetInputPort("X_WO_estimated").Eval(own))


def _is_lost(variant: Variant, context: Context) -> np.ndarray:
    own = variant.partitioner.GetMyContextFromRoot(context)
    weights = variant.partitioner.GetInputPort("contact_weights")
    return ~(weights.Eval(own) > -np.inf) if weights.HasValue(own) else np.zeros(3, dtype=bool)


def _check_outputs(variant: Variant, context: Context) -> None:
    diagram = variant.diagram
    for index in range(diagram.num_output_ports()):
        port = diagram.get_output_port(index)
        value = port.Eval(context)
        if isinstance(value, np.ndarray):
            _require(bool(np.all(np.isfinite(value))), f"{port.get_name()} is not finite")
        elif isinstance(value, RigidTransform):
            _require(is_valid(value), f"{port.get_name()} is not a pose")
    status = diagram.GetOutputPort("contact_status").Eval(context)
    _require(set(status.tolist()) <= _STATUSES, "a status is none")
    _require(np.min(diagram.GetOutputPort("contact_causes").Eval(context)) >= -1, "no such cause")
    targets: BusValue = diagram.GetOutputPort("fingertip_targets").Eval(context)
    for finger, kind in enumerate(status):
        X_WC = targets.Find(f"fingertip_{finger}")
        _require((X_WC is None) == (kind == ContactStatus.LOST), "targets and losses differ")
        _require(X_WC is None or is_valid(X_WC), "a target is not a pose")


def _check_step(
    variant: Variant, context: Context, before: np.ndarray, regions: SafeRegions, held: bool
) -> None:
    p_OC = _stored(variant, context)
    _require(bool(np.all(np.isfinite(p_OC))), "stored goals are not finite")
    ways = np.linalg.norm(p_OC - before, axis=1)
    _require(np.max(ways) <= (0 if held else variant.limits.max_step + _ROUNDING), "a step too far")
    own = variant.selector.GetMyContextFromRoot(context)
    status = variant.selector.GetOutputPort("contact_status").Eval(own)
    nearest, normals = variant.surface.project(p_OC)
    active = is_active(status)
    off = np.linalg.norm(nearest - p_OC, axis=1)
    if np.any(off > CONTACT_TOLERANCE):
        on_mesh = np.abs(variant.surface.distance(p_OC)) <= CONTACT_TOLERANCE
        _require(bool(np.all(on_mesh)), "a goal is off the object")
    _require(np.max(off[active], initial=0) <= CONTACT_TOLERANCE, "active on forbidden surface")
    if held:
        return
    _require(
        np.array_equal(status == ContactStatus.LOST, _is_lost(variant, context)), "who is lost"
    )
    _require(not np.any(active & (regions.sizes() == 0)), "active without a region")
    constraints = regions.constraints
    for contact in np.flatnonzero(active).tolist():
        point, normal = p_OC[contact][None], normals[contact][None]
        limit = constraints.limits_at(contact, point, normal)[0][0]
        _require(limit == Limit.NONE, f"active where {Limit(limit).name} keeps it out")
    if len(constraints.tip_radii):
        gaps = tip_gaps(p_OC, normals, constraints.tip_radii, constraints.tip_gap)
        _require(np.min(gaps[np.ix_(active, active)], initial=0) >= -_ROUNDING, "tips overlap")


def outcome(case: Case) -> tuple[str, str]:
    """Returns what came of a case, and what was said."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            play(case)
    except BrokenLawError as error:
        return str(error), ""
    except (Exception, SystemExit) as error:
        return f"{type(error).__name__}", traceback.format_exc()
    return KEPT, ""


def results(seed: int, first: int, end: int) -> Iterator[Result]:
    """Yields what came of the sequences of a seed from a number up to another."""
    for number in range(first, end):
        case, start = make_case(seed, number), time.process_time()
        kind, words = outcome(case)
        failure = "" if kind == KEPT else f"{case}\n{words}"
        yield Result(number, case.variant, kind, failure, time.process_time() - start)


if __name__ == "__main__":
    sys.exit(main(__doc__, results))
